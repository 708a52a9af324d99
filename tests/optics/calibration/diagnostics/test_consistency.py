"""Contradictions between observed corners: each kind is found, and noise alone is not reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics import consistency
from mirrorcam.optics.calibration.diagnostics.consistency import (
    camera_note,
    check_plausible,
    pose_notes,
    refuse_implausible,
)
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.geometry.boards import AprilGrid
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.diagnostics.conftest import BOARD, Scene

CORNERS = BOARD.corners_in_board_mm


def in_frame(scene: Scene, frame: int) -> Observations:
    return scene.clean.where(scene.clean.frame == frame).with_frame_offset(-frame)


def test_corners_of_a_flat_board_fit_a_homography_except_displaced_ones(scene: Scene, device: Layout) -> None:
    seen = scene.noisy(0)
    assert not consistency.off_plane_corners(seen, device.camera, CORNERS).any()
    rows = np.array([3, 50, 200])
    pixels = seen.pixels.copy()
    pixels[rows] += 40.0
    off_plane = consistency.off_plane_corners(
        Observations(seen.frame, seen.view, seen.corner, pixels), device.camera, CORNERS
    )
    np.testing.assert_array_equal(np.flatnonzero(off_plane), rows)


def test_a_view_with_few_corners_is_rejected_completely(scene: Scene, device: Layout) -> None:
    view = in_frame(scene, 0)
    few = view.where(np.arange(len(view)) < 5)
    assert consistency.off_plane_corners(few, device.camera, CORNERS).all()
    assert consistency.off_plane_corners(Observations.empty(), device.camera, CORNERS).shape == (0,)


def test_few_off_plane_corners_are_noted_many_refused(scene: Scene, device: Layout) -> None:
    view = in_frame(scene, 0)
    off_plane = np.zeros(len(view), dtype=bool)
    assert consistency.board_notes(view, off_plane, ["a.png"], device.mirror_names) == ()
    off_plane[0] = True
    (note,) = consistency.board_notes(view, off_plane, ["a.png"], device.mirror_names)
    assert note.startswith(f"a.png, mirror {device.mirror_names[view.view[0]]}: 1 of ")
    with pytest.raises(InputError, match="100% of the corners lie where a flat board"):
        consistency.board_notes(view, ~np.zeros(len(view), dtype=bool), ["a.png"], device.mirror_names)


def test_rows_of_the_board_that_no_picture_shows_are_noted(scene: Scene) -> None:
    frames = [in_frame(scene, 0), Observations.empty(), in_frame(scene, 1)]
    assert consistency.unobserved_rows(frames, CORNERS) == ()
    assert consistency.unobserved_rows([Observations.empty()], CORNERS) == ()
    higher = BOARD.replaced(rows=BOARD.rows + 2).corners_in_board_mm
    assert consistency.unobserved_rows(frames, higher) == (
        "no picture shows the last 2 of the board's 8 rows of corners: does it have 7 rows of squares, not 9?",
    )
    grid = AprilGrid(cols=2, rows=5, tag_mm=20.0, spacing=0.3)
    below = Observations.of_view(0, 0, np.arange(16, 40), np.zeros((24, 2)))
    assert consistency.unobserved_rows([below], grid.corners_in_board_mm) == (
        "no picture shows the first 2 of the board's 5 rows of tags: does it have 3 rows of tags, not 5?",
    )
    every = Observations.of_view(0, 0, np.arange(40), np.zeros((40, 2)))
    assert consistency.unobserved_rows([every], grid.corners_in_board_mm) == ()


def test_repeated_frames_point_to_the_first_one(scene: Scene) -> None:
    a, b, none = in_frame(scene, 0), in_frame(scene, 1), Observations.empty()
    assert consistency.repeated_frames([a, none, b, a, none, a]) == {3: 0, 5: 0}


def test_views_that_agree_are_kept(scene: Scene, device: Layout) -> None:
    seen = scene.noisy(0)
    kept, notes = consistency.consistent_views(seen, seen.pixels - scene.clean.pixels, [""] * 15, device.mirror_names)
    assert kept.all()
    assert notes == ()


def test_a_contradicting_view_is_left_out_and_named(scene: Scene, device: Layout) -> None:
    seen = scene.clean
    away = (seen.frame == 2) & (seen.view == 1)
    left = np.where(away[:, None], 100.0, 0.0) * np.ones((len(seen), 2))
    kept, notes = consistency.consistent_views(seen, left, [f"{n}.png" for n in range(15)], device.mirror_names)
    np.testing.assert_array_equal(kept, ~away)
    assert [note.partition(":")[0] for note in notes] == ["2.png, mirror 0-1"]
    with pytest.raises(InputError, match="mirror 0-1 disagrees with the other views"):
        often = (seen.frame < 7) & (seen.view == 1)
        consistency.consistent_views(
            seen, np.where(often, 100.0, 0.0)[:, None] * np.ones(2), [""] * 15, device.mirror_names
        )


def fitted(columns: FloatArray, values: FloatArray) -> FloatArray:
    return values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]


def test_the_disagreement_of_fits_of_one_truth_is_one(device: Layout) -> None:
    """Linear regressions with a camera's number of shared coefficients: the squares are F, with mean near 1."""
    random = np.random.default_rng(1)
    squares = []
    for _ in range(200):
        parts = [random.normal(size=(200, 9)) for _ in range(2)]
        noise = [random.normal(size=200) for _ in range(2)]
        apart = [fitted(columns, values) for columns, values in zip(parts, noise, strict=True)]
        together = fitted(np.concatenate(parts), np.concatenate(noise))
        squares.append(
            consistency.camera_disagreement(
                [r.reshape(-1, 2) for r in apart], together.reshape(-1, 2), unknowns=18, common=9
            )
            ** 2
        )
    assert np.mean(squares) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 9 / 200))


def test_drift_is_noted_then_refused() -> None:
    assert consistency.drift_note(1.0, (1400.0, 1401.0)) == ()
    (note,) = consistency.drift_note(4.0, (1400.0, 1404.0))
    assert "disagree about the camera by 4.0 sigmas" in note
    with pytest.raises(InputError, match=r"focal length of 1400\.0 px, frames without 1500\.0 px"):
        consistency.drift_note(4.0, (1400.0, 1500.0))


def test_one_pose_and_parallel_poses_are_noted() -> None:
    def poses(turns_deg: list[float]) -> np.ndarray:
        found = np.tile(np.eye(4), (len(turns_deg), 1, 1))
        found[:, :3, :3] = Rotation.from_rotvec(np.outer(np.radians(turns_deg), [1.0, 0.0, 0.0])).as_matrix()
        return found

    assert pose_notes(poses([10.0]))[0].startswith("one picture through the mirrors")
    assert pose_notes(poses([10.0, 12.0, 11.0]))[0].startswith("all boards are parallel to within 1.0 deg")
    assert pose_notes(poses([-20.0, 0.0, 20.0])) == ()


def test_another_focal_length_is_noted(device: Layout) -> None:
    camera = device.camera
    assert camera_note(device, camera.replaced(fx_px=1.04 * camera.fx_px)) == ()
    assert "+15% from the layout's" in camera_note(device, camera.replaced(fx_px=1.15 * camera.fx_px))[0]


def test_a_fit_with_an_undetermined_mirror_or_many_outliers_is_refused(solution: Solution, device: Layout) -> None:
    assert check_plausible(solution, device, mirrored_frames=10) == ()
    open_rows = [place for place, name in enumerate(solution.parameters) if name.startswith("mirror 2 ")]
    covariance = solution.covariance.copy()
    covariance[np.ix_(open_rows, open_rows)] += np.diag([10.0, 10.0, 10.0]) ** 2
    with pytest.raises(InputError, match=f"determine mirror {device.mirror_names[2]} only to "):
        refuse_implausible(replace(solution, covariance=covariance), device.mirror_names)
    fitting = np.arange(len(solution.inliers)) % 5 > 0
    with pytest.raises(InputError, match="20% of the corners fit neither mirrors nor camera"):
        refuse_implausible(replace(solution, inliers=fitting), device.mirror_names)
