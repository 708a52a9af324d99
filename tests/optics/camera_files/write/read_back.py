"""Readers shared by tests of exports."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from urdf_parser_py.urdf import URDF

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid
from tests.optics.camera_files.write.conftest import TOLERANCE_PX


def assert_projects(found_px: FloatArray, expected_px: FloatArray) -> None:
    np.testing.assert_allclose(found_px, expected_px, rtol=0, atol=TOLERANCE_PX)


def as_opencv_does(
    points: FloatArray, camera_from: FloatArray, camera_matrix: FloatArray, distortion: FloatArray
) -> FloatArray:
    turn = cv2.Rodrigues(camera_from[:3, :3])[0]
    found, _ = cv2.projectPoints(points, turn, camera_from[:3, 3], camera_matrix, distortion)
    return np.asarray(found, dtype=np.float64)[:, 0]


def urdf_poses(folder: Path) -> dict[str, FloatArray]:
    """root_from_link (4, 4) in metres of every link, by ROS's parser and the definition of rpy."""
    robot = URDF.from_xml_file(str(folder / "mirrorcam_calibrated.urdf"))
    poses = {robot.get_root(): np.eye(4)}
    for joint in robot.joints:  # parents come before their children in the file
        assert joint.type == "fixed"
        about = [Rotation.from_rotvec(angle * axis) for angle, axis in zip(joint.origin.rpy, np.eye(3), strict=True)]
        pose = rigid((about[2] * about[1] * about[0]).as_matrix(), joint.origin.xyz)
        poses[joint.child] = poses[joint.parent] @ pose
    assert set(poses) == {link.name for link in robot.links}
    return poses
