"""Doubts about a finished fit: raised by what is implausible, and by nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import InputError
from mirrorcam.optics.calibration.diagnostics.plausibility import (
    camera_note,
    check_solution,
    pose_notes,
    refuse_implausible,
)
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution
from mirrorcam.optics.geometry.layout import Layout


def test_one_pose_and_parallel_poses_are_noted() -> None:
    def poses(turns_deg: list[float]) -> np.ndarray:
        found = np.tile(np.eye(4), (len(turns_deg), 1, 1))
        found[:, :3, :3] = Rotation.from_rotvec(np.outer(np.radians(turns_deg), [1.0, 0.0, 0.0])).as_matrix()
        return found

    assert pose_notes(poses([10.0]))[0].startswith("one picture through the mirrors")
    assert pose_notes(poses([10.0, 12.0, 11.0]))[0].startswith("all boards are parallel to 1.0 deg")
    assert pose_notes(poses([-20.0, 0.0, 20.0])) == ()


def test_another_focal_length_is_noted(device: Layout) -> None:
    camera = device.camera
    assert camera_note(device, camera.replaced(fx_px=1.04 * camera.fx_px)) == ()
    assert "+15% from the layout's" in camera_note(device, camera.replaced(fx_px=1.15 * camera.fx_px))[0]


def test_a_fit_that_leaves_a_mirror_open_or_corners_over_is_refused(solution: Solution, device: Layout) -> None:
    assert check_solution(solution, device, mirrored_frames=10) == ()
    open_rows = [place for place, name in enumerate(solution.parameters) if name.startswith("mirror 2 ")]
    covariance = solution.covariance.copy()
    covariance[np.ix_(open_rows, open_rows)] += np.diag([10.0, 10.0, 10.0]) ** 2
    with pytest.raises(InputError, match=f"determine mirror {device.mirror_names[2]} only to "):
        refuse_implausible(replace(solution, covariance=covariance), device.mirror_names)
    fitting = np.arange(len(solution.inliers)) % 5 > 0
    with pytest.raises(InputError, match="20% of the corners fit neither mirrors nor camera"):
        refuse_implausible(replace(solution, inliers=fitting), device.mirror_names)
