"""URDF, read back by its parser."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.optics.camera_files.write.read_back import urdf_poses


def test_the_urdf_camera_link_has_x_forward_and_z_up(folder: Path) -> None:
    pose = urdf_poses(folder)["mirrorcam_camera_optical_frame"]
    np.testing.assert_allclose(pose[:3, 2], [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(pose[:3, 1], [0.0, 0.0, -1.0], atol=1e-12)
