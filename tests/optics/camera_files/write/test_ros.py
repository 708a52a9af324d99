"""ROS: camera_info and the frames of the URDF, read back, project as the layout does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from tests.optics.camera_files.write.conftest import Case
from tests.optics.camera_files.write.read_back import as_opencv_does, assert_projects, urdf_poses


def test_ros_camera_info_with_urdf(case: Case, folder: Path) -> None:
    """What an image_geometry user does: frames from the URDF by frame_id, K and D from the camera_info."""
    poses = urdf_poses(folder)
    for place, view in enumerate(case.views):
        info = yaml.safe_load((folder / "ros" / f"{view.name}.yaml").read_text(encoding="utf-8"))
        # As camera_calibration_parsers reads them: K, R 3x3, P 3x4, D of any length.
        matrices = {}
        for name, shape in {
            "camera_matrix": (3, 3),
            "rectification_matrix": (3, 3),
            "projection_matrix": (3, 4),
            "distortion_coefficients": (1, 5),
        }.items():
            assert (info[name]["rows"], info[name]["cols"]) == shape
            assert all(type(value) is float for value in info[name]["data"])
            matrices[name] = np.array(info[name]["data"]).reshape(shape)
        assert info["distortion_model"] == "plumb_bob"
        assert (info["image_width"], info["image_height"]) == (view.camera.width_px, view.camera.height_px)
        roi = info["roi"]
        assert roi["x_offset"] + roi["width"] <= info["image_width"]
        assert roi["y_offset"] + roi["height"] <= info["image_height"]
        camera_from_rig = np.linalg.inv(poses[info["frame_id"]]) @ poses["mirrorcam_camera_optical_frame"]
        found = as_opencv_does(
            case.points_in_rig[place] / 1000.0,
            camera_from_rig,
            matrices["camera_matrix"],
            matrices["distortion_coefficients"],
        )
        assert_projects(found, case.flipped_px[place])
        ideal = matrices["projection_matrix"] @ np.vstack([np.eye(3), np.zeros(3)])
        np.testing.assert_array_equal(ideal, matrices["camera_matrix"])
