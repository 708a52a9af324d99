"""The picture of a trajectory shows every pose that is known, and how sure it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirrorcam.lightfield.trajectory_figure import draw_trajectory
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.optics.light_field.motion import TrackedPose
from tests.drawn import drawn

LOST = TrackedPose(np.full((4, 4), np.nan), np.full((6, 6), np.nan), 0, False)


def pose(number: int) -> TrackedPose:
    place = [10.0 * number, -4.0 * number, 2.0 * number]
    covariance = np.diag([0.01, 0.02, 0.06, 1e-6, 1e-6, 1e-6]) * number**2
    return TrackedPose(rigid(np.eye(3), place), covariance, 100, number == 0)


def test_paths_and_sigmas_are_drawn(tmp_path: Path) -> None:
    poses = [pose(0), pose(1), LOST, pose(3)]
    times = [0.0, 0.1, 0.2, 0.3]
    figure = drawn(lambda: draw_trajectory(tmp_path / "path.png", times, poses), tmp_path / "path.png")
    above, front, sigma = figure.axes
    np.testing.assert_allclose(
        np.asarray(above.lines[0].get_xydata(), dtype=float), [[0.0, 0.0], [10.0, 2.0], [np.nan, np.nan], [30.0, 6.0]]
    )
    np.testing.assert_allclose(
        np.asarray(front.lines[0].get_xydata(), dtype=float),
        [[0.0, 0.0], [10.0, -4.0], [np.nan, np.nan], [30.0, -12.0]],
    )
    assert front.yaxis_inverted()
    # A line along the view of each pose that is known.
    assert len(above.lines) == 1 + 3
    np.testing.assert_allclose(np.asarray(sigma.lines[0].get_ydata(), dtype=float), [0.0, 0.3, np.nan, 0.9])
    np.testing.assert_allclose(np.asarray(above.collections[1].get_offsets(), dtype=float), [[0.0, 0.0]])


def test_a_camera_that_stands_still_is_drawn(tmp_path: Path) -> None:
    draw_trajectory(tmp_path / "still.png", [0.0, 1.0], [pose(0), pose(0)])
    assert (tmp_path / "still.png").exists()
