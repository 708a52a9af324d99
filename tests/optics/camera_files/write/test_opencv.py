"""OpenCV's FileStorage, read back by OpenCV, projects as the layout does."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from mirrorcam.core.values import FloatArray
from tests.optics.camera_files.write.conftest import Case
from tests.optics.camera_files.write.read_back import as_opencv_does, assert_projects


def matrix(node: cv2.FileNode, name: str) -> FloatArray:
    return np.asarray(node.getNode(name).mat(), dtype=np.float64)


def test_opencv(case: Case, folder: Path) -> None:
    file = cv2.FileStorage(str(folder / "opencv.yaml"), cv2.FILE_STORAGE_READ)
    frame = np.arange(6, dtype=np.uint8).reshape(2, 3)
    flipped = cv2.flip(frame, int(file.getNode("flip_code").real()))
    np.testing.assert_array_equal(flipped, case.views[0].flipped(frame))
    assert file.getNode("image_width").real() == case.layout.camera.width_px
    nodes = file.getNode("views")
    assert nodes.size() == len(case.views)
    for place, view in enumerate(case.views):
        node = nodes.at(place)
        assert node.getNode("name").string() == view.name
        pose = np.hstack([matrix(node, "R"), matrix(node, "T")])
        found = as_opencv_does(
            case.points_in_rig[place],
            pose,
            matrix(node, "camera_matrix"),
            matrix(node, "distortion_coefficients"),
        )
        assert_projects(found, case.flipped_px[place])
        cut = view.sub_image
        assert node.getNode("roi").mat().tolist() == [[cut.x, cut.y, cut.width, cut.height]]
