"""camera_info files of ROS, with poses from a URDF or transforms, and without poses."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.optics.camera_files.read.registry import read_rig
from mirrorcam.optics.camera_files.write.virtual_cameras import virtual_cameras
from mirrorcam.optics.geometry.transforms import inverse
from tests.optics.camera_files.rigs import EXACT, device, lens_of


def test_our_own_scores_zero_with_its_urdf(exported: Path) -> None:
    score = device().score(read_rig(exported / "ros"))
    assert score.figures["max_px"].value < EXACT
    assert score.alignment == "rigid"
    assert read_rig(exported, "ros").cameras[0].name == "mirrorcam_view_0_0"


def test_without_poses_each_camera_is_judged_alone(exported: Path, tmp_path: Path) -> None:
    shutil.copytree(exported / "ros", tmp_path / "ros")
    rig = read_rig(tmp_path / "ros")
    score = device().score(rig)
    assert score.alignment == "each view alone"
    assert score.figures["max_px"].value < EXACT
    assert "scored individually" in score.notes[0]


def test_poses_of_static_transforms(exported: Path, tmp_path: Path) -> None:
    shutil.copytree(exported / "ros", tmp_path / "ros")
    transforms: list[dict[str, Any]] = []
    for view in virtual_cameras(device().truth):
        pose = inverse(view.camera_from_rig)
        x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
        tx, ty, tz = (pose[:3, 3] / 1000.0).tolist()
        transforms.append(
            {
                "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "rig"},
                "child_frame_id": f"mirrorcam_{view.name}_optical_frame",
                "transform": {
                    "translation": {"x": tx, "y": ty, "z": tz},
                    "rotation": {"x": x, "y": y, "z": z, "w": w},
                },
            }
        )
    path = tmp_path / "ros" / "tf_static.yaml"
    path.write_text(yaml.safe_dump({"transforms": transforms}))
    score = device().score(read_rig(tmp_path / "ros"))
    assert score.figures["max_px"].value < EXACT
    assert score.alignment == "rigid"
    path.write_text(yaml.safe_dump({"transforms": transforms[1:]}))
    with pytest.raises(InputError, match="no frame of camera mirrorcam_view_0_0"):
        read_rig(tmp_path / "ros")
    transforms[0]["header"]["frame_id"] = transforms[0]["child_frame_id"]
    path.write_text(yaml.safe_dump({"transforms": transforms}))
    with pytest.raises(InputError, match="is its own ancestor"):
        read_rig(tmp_path / "ros")


def test_a_file_of_camera_calibration_is_read(tmp_path: Path) -> None:
    """As `cameracalibrator` writes it: a plumb_bob of five numbers, a name of the topic."""
    path = tmp_path / "left.yaml"
    path.write_text(
        "image_width: 640\nimage_height: 480\ncamera_name: narrow_stereo/left\n"
        "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [500.5, 0.0, 320.1, 0.0, 501.5, 240.2, 0.0, 0.0, 1.0]\n"
        "distortion_model: plumb_bob\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, -0.2, 1e-05, 0.002, 0.0]\n"
        "rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]\n"
        "projection_matrix:\n  rows: 3\n  cols: 4\n  data: [500, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 0]\n"
    )
    (camera,) = read_rig(path).cameras
    assert lens_of(camera).distortion.tolist() == [0.1, -0.2, 1e-5, 0.002, 0.0]
    assert camera.name == "narrow_stereo/left"
    text = path.read_text()
    path.write_text(text.replace("plumb_bob", "thin_prism"))
    with pytest.raises(InputError, match="distortion_model 'thin_prism', expected one of plumb_bob"):
        read_rig(path)


MESSAGE = (
    "header:\n  stamp: {sec: 0, nanosec: 0}\n  frame_id: left_optical_frame\nheight: 480\nwidth: 640\n"
    "distortion_model: rational_polynomial\nd: [0.1, -0.2, 0.0, 0.002, 0.0, 0.5, 0.0, 0.0]\n"
    "k: [500.5, 0.0, 320.1, 0.0, 501.5, 240.2, 0.0, 0.0, 1.0]\n"
    "r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]\n"
    "p: [500.5, 0.0, 320.1, 0.0, 0.0, 501.5, 240.2, 0.0, 0.0, 0.0, 1.0, 0.0]\n---\n"
)


@pytest.mark.parametrize("ros1", [False, True])
@pytest.mark.parametrize("times", [1, 3])
def test_messages_as_they_are_printed_are_read(tmp_path: Path, ros1: bool, times: int) -> None:
    path, text = tmp_path / "camera_info.yaml", MESSAGE
    for key in "kdrp" if ros1 else "":
        text = text.replace(f"\n{key}: ", f"\n{key.upper()}: ")
    path.write_text("".join(text.replace("nanosec: 0", f"nanosec: {number}") for number in range(times)))
    (camera,) = read_rig(path).cameras
    assert camera.name == "left"
    assert camera.size_px == (640, 480)
    assert lens_of(camera).distortion.tolist() == [0.1, -0.2, 0.0, 0.002, 0.0, 0.5, 0.0, 0.0]
    assert lens_of(camera).fx_px == 500.5


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (MESSAGE + MESSAGE.replace("500.5", "500.6"), "2 different documents"),
        (MESSAGE.replace("0.5, 0.0, 0.0]", "'...']"), "distortion_coefficients is abbreviated, .* --full-length"),
    ],
)
def test_messages_that_differ_or_are_abbreviated_are_refused(tmp_path: Path, text: str, complaint: str) -> None:
    (tmp_path / "camera_info.yaml").write_text(text)
    with pytest.raises(InputError, match=complaint):
        read_rig(tmp_path / "camera_info.yaml")


def test_coefficients_are_as_many_as_there_are(tmp_path: Path) -> None:
    """Some tools state 1 x 5 for the eight coefficients of rational_polynomial (image_pipeline, issue 278)."""
    (tmp_path / "left.yaml").write_text(
        "image_width: 640\nimage_height: 480\ncamera_name: left\ndistortion_model: rational_polynomial\n"
        "camera_matrix: {rows: 3, cols: 3, data: [500, 0, 320, 0, 500, 240, 0, 0, 1]}\n"
        "distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0, 0, 0, 0, 0.2, 0, 0.3]}\n"
        "projection_matrix: {rows: 3, cols: 4, data: [500, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 0]}\n"
    )
    (camera,) = read_rig(tmp_path / "left.yaml").cameras
    assert lens_of(camera).distortion.tolist() == [0.1, 0, 0, 0, 0, 0.2, 0, 0.3]


@pytest.mark.parametrize(
    ("urdf", "complaint"),
    [
        ("<robot", "not valid XML"),
        ('<!DOCTYPE r [<!ENTITY a "b">]><robot/>', "a document type"),
        (
            '<robot><joint name="j"><origin xyz="1 2"/><parent link="a"/><child link="b"/></joint></robot>',
            "2 numbers, expected 3",
        ),
        (
            '<robot><joint name="j"><parent link="a"/><child link="b"/></joint>'
            '<joint name="k"><parent link="c"/><child link="d"/></joint></robot>',
            "2 unconnected trees",
        ),
    ],
)
def test_a_bad_urdf_is_refused_in_one_line(urdf: str, complaint: str, exported: Path, tmp_path: Path) -> None:
    shutil.copytree(exported / "ros", tmp_path / "ros")
    (tmp_path / "a.urdf").write_text(urdf)
    with pytest.raises(InputError, match=complaint):
        read_rig(tmp_path / "ros")


def test_angles_of_a_urdf_are_about_fixed_axes(tmp_path: Path, exported: Path) -> None:
    shutil.copytree(exported / "ros", tmp_path / "ros")
    frame = "mirrorcam_view_0_0_optical_frame"
    for path in sorted((tmp_path / "ros").iterdir())[1:]:
        path.unlink()
    (tmp_path / "a.urdf").write_text(
        f'<robot><joint name="j" type="fixed"><origin xyz="1 2 3" rpy="0.1 0.2 0.3"/><parent link="a"/>'
        f'<child link="{frame}"/></joint></robot>'
    )
    pose = inverse(np.array(read_rig(tmp_path / "ros").cameras[0].camera_from_rig))
    turn = np.eye(3)
    for axis, angle in zip(np.eye(3), (0.1, 0.2, 0.3), strict=True):
        turn = Rotation.from_rotvec(angle * axis).as_matrix() @ turn
    np.testing.assert_allclose(pose[:3, :3], turn, atol=1e-12)
    np.testing.assert_allclose(pose[:3, 3], [1.0, 2.0, 3.0])
