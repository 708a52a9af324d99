"""Poses of a file are rigid, and at least one."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import InvalidValue
from mirrorcam.simulation.poses_file import PosesFile


def test_rigid_poses_are_taken() -> None:
    pose = np.eye(4)
    pose[:3, 3] = [1.0, 2.0, 300.0]
    found = PosesFile(poses=np.array([pose, np.eye(4)]), poses_hz=2.0)
    assert np.array_equal(found.poses[0], pose)
    assert PosesFile(poses=np.array([pose])).poses_hz == 1.0


@pytest.mark.parametrize(
    ("poses", "complaint"),
    [
        (np.zeros((0, 4, 4)), "0 poses, expected 1 to 100000"),
        (np.diag([1.0, 1.0, -1.0, 1.0])[None], "pose 0 turns by a matrix that is no rotation"),
        (np.diag([2.0, 2.0, 2.0, 1.0])[None], "pose 0 turns by a matrix that is no rotation"),
        (np.diag([1.0, 1.0, 1.0, 2.0])[None], "pose 0 has the last row"),
    ],
)
def test_what_is_no_pose_is_refused(poses: np.ndarray, complaint: str) -> None:
    with pytest.raises(InvalidValue, match=complaint):
        PosesFile(poses=poses)
