"""nerfstudio's file projects as the layout does."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from mirrorcam.core.images.pictures import read_image
from mirrorcam.optics.geometry.transforms import rigid
from tests.optics.camera_files.write.conftest import Case
from tests.optics.camera_files.write.read_back import as_opencv_does, assert_projects


def test_nerfstudio(case: Case, folder: Path) -> None:
    """As nerfstudio's data parser and its undistortion read it: OpenGL poses, half a pixel, OpenCV's lens."""
    meta = json.loads((folder / "nerfstudio" / "transforms.json").read_text(encoding="utf-8"))
    assert meta["camera_model"] == "OPENCV"
    world_from_rig = rigid(np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) @ case.layout.view_from_rig, np.zeros(3))
    for place, (frame, view) in enumerate(zip(meta["frames"], case.views, strict=True)):
        camera_from_world = np.diag([1.0, -1.0, -1.0, 1.0]) @ np.linalg.inv(np.array(frame["transform_matrix"]))
        fx, fy, cx, cy = (frame[name] for name in ("fl_x", "fl_y", "cx", "cy"))
        camera_matrix = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
        distortion = np.array([frame[name] for name in ("k1", "k2", "p1", "p2", "k3")])
        points = case.points_in_rig[place] / 1000.0
        found = as_opencv_does(points, camera_from_world @ world_from_rig, camera_matrix, distortion)
        cut = view.sub_image
        assert_projects(found + np.array([cut.x, cut.y]), case.flipped_px[place])
        for name in (frame["file_path"], frame["mask_path"]):
            assert read_image(folder / "nerfstudio" / name).shape[:2] == (frame["h"], frame["w"])
    # Its z is up, as its own viewer has it.
    up = np.mean([np.array(frame["transform_matrix"])[:3, 1] for frame in meta["frames"]], axis=0)
    assert up[2] > 0.7
