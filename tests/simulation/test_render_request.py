"""Requests of sets and scenes: texts of tolerances and sensors, and rigid poses of a file."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import InvalidValue
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.settings import SENSORS
from mirrorcam.simulation.render_request import PosesFile, sensor_of, tolerances_of


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
        (np.diag([1.0, 1.0, -1.0, 1.0])[None], "pose 0 has a matrix that is not a rotation"),
        (np.diag([2.0, 2.0, 2.0, 1.0])[None], "pose 0 has a matrix that is not a rotation"),
        (np.diag([1.0, 1.0, 1.0, 2.0])[None], "pose 0 has the last row"),
    ],
)
def test_what_is_no_pose_is_refused(poses: np.ndarray, complaint: str) -> None:
    with pytest.raises(InvalidValue, match=complaint):
        PosesFile(poses=poses)


def test_texts_become_tolerances_and_sensors() -> None:
    assert tolerances_of("") == Tolerances()
    assert tolerances_of("none") == Tolerances.none()
    assert tolerances_of("tilt_deg=0.5,centre_px=2") == Tolerances(tilt_deg=0.5, centre_px=2.0)
    assert sensor_of("poor") == SENSORS["poor"]


def test_a_text_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="tilt is not a tolerance, expected tilt_deg"):
        tolerances_of("tilt=1")
    with pytest.raises(ValueError, match="tilt_deg: "):
        tolerances_of("tilt_deg=wide")
    with pytest.raises(ValueError, match="expected ideal, c920"):
        sensor_of("film")
