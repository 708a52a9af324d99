"""COLMAP's text files of a rig: numbers of cameras, poses, and the reference that comes first."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.optics.geometry.sfm_rigs import WORLD_FROM_VIEW, SfmCamera, frame, rig_config, sparse_model
from mirrorcam.optics.geometry.transforms import rigid

TURNS = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.1, 0.0, 0.2], [0.0, -0.3, 0.0]]).as_matrix()
SHIFTS_MM = np.array([[0.0, 0.0, 0.0], [10.0, -20.0, 5.0], [-7.0, 0.0, 1.0]])


@pytest.fixture
def cameras() -> list[SfmCamera]:
    return [
        SfmCamera(f"view_{number}", "PINHOLE", 640, 480, (500.0, 501.0, 320.0, 240.5), rigid(turn, shift))
        for number, (turn, shift) in enumerate(zip(TURNS, SHIFTS_MM, strict=True))
    ]


def transform_of(values: list[float]) -> np.ndarray:
    """The rigid transform, in mm, of a quaternion w, x, y, z and a translation in metres."""
    return rigid(Rotation.from_quat(values[:4], scalar_first=True).as_matrix(), np.array(values[4:]) * 1000.0)


def test_poses_in_the_rig_are_from_the_reference_which_comes_first(cameras: list[SfmCamera]) -> None:
    entries = json.loads(rig_config(cameras, 1))[0]["cameras"]
    assert [entry["image_prefix"] for entry in entries] == ["view_1/", "view_0/", "view_2/"]
    assert entries[0]["ref_sensor"] is True
    assert "cam_from_rig_rotation" not in entries[0]
    for entry, number in zip(entries[1:], (0, 2), strict=True):
        found = transform_of([*entry["cam_from_rig_rotation"], *entry["cam_from_rig_translation"]])
        assert np.allclose(found @ cameras[1].camera_from_world, cameras[number].camera_from_world)
        assert entry["camera_params"] == [500.0, 501.0, 320.0, 240.5]


def test_the_sparse_model_numbers_cameras_from_one_and_the_joint_rig_next(cameras: list[SfmCamera]) -> None:
    texts = sparse_model(cameras, 1, "0000.png")
    lines = {name: [line for line in text.splitlines() if line and line[0] != "#"] for name, text in texts.items()}
    assert lines["cameras.txt"][2] == "3 PINHOLE 640 480 500.0 501.0 320.0 240.5"
    assert lines["rigs.txt"][0].startswith("4 3 CAMERA 2 CAMERA 1 1 ")
    assert lines["frames.txt"][0].endswith(" 3 CAMERA 1 1 CAMERA 2 2 CAMERA 3 3")
    assert lines["points3D.txt"] == []
    for line, camera in zip(lines["images.txt"], cameras, strict=True):
        words = line.split()
        assert words[9] == f"{camera.name}/0000.png"
        assert np.allclose(transform_of([float(word) for word in words[1:8]]), camera.camera_from_world)


def test_a_view_looks_along_the_worlds_y_and_has_its_z_up() -> None:
    made = frame("a", (64, 48), (50.0, 51.0), (31.5, 23.5), rigid(WORLD_FROM_VIEW, [100.0, 0.0, 0.0]), {"k1": 0.0})
    transform = np.array(made["transform_matrix"])
    assert np.array_equal(transform[:3, :3] @ [0.0, 0.0, -1.0], [0.0, 1.0, 0.0])
    assert np.array_equal(transform[:3, :3] @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    assert np.array_equal(transform[:3, 3], [0.1, 0.0, 0.0])
    assert np.linalg.det(transform[:3, :3]) == 1.0
    # The middle of a picture of 64x48 px is at (32, 24) where corners are counted.
    assert (made["cx"], made["cy"], made["w"], made["h"]) == (32.0, 24.0, 64, 48)
    assert (made["file_path"], made["mask_path"], made["k1"]) == ("images/a.png", "masks/a.png", 0.0)
