"""OpenCV's FileStorage as OpenCV writes it, in the layouts of its samples, projects as OpenCV does."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.read.opencv import read_opencv
from mirrorcam.optics.camera_files.read.registry import read_rig
from mirrorcam.optics.camera_files.write.formats import opencv_yaml
from mirrorcam.optics.camera_files.write.virtual_cameras import virtual_cameras
from tests.optics.camera_files.rigs import EXACT, device, pose_of

MATRIX = np.array([[500.0, 0.0, 320.5], [0.0, 510.0, 240.25], [0.0, 0.0, 1.0]])
COEFFICIENTS = [0.11, -0.05, 1e-3, -2e-3, 0.02, 0.05, -0.02, 0.01, 1e-3, -1e-3, 2e-3, -2e-3, 0.0, 0.0]
TURN = cv2.Rodrigues(np.array([0.1, -0.2, 0.3]))[0]
SHIFT = np.array([[10.0], [-20.0], [30.0]])


def stored(path: Path, write: Callable[[cv2.FileStorage], None]) -> Path:
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    write(file)
    file.release()
    return path


def points() -> FloatArray:
    return np.random.default_rng(0).uniform([-0.4, -0.4, 0.8], [0.4, 0.4, 2.0], (40, 3))


def test_our_own_scores_zero(exported: Path) -> None:
    score = device().score(read_rig(exported / "opencv.yaml"))
    assert score.figures["max_px"].value < EXACT
    assert abs(score.figures["scale_error_percent"].value) < EXACT
    assert score.notes == ()


@pytest.mark.parametrize(
    ("lens_model", "distortion"),
    [
        ("rational", (0.3, -0.1, 1e-3, -2e-3, 0.02, 0.25, -0.02, 0.01)),
        ("thin_prism", (0.3, -0.1, 1e-3, -2e-3, 0.02, 0.25, -0.02, 0.01, 1e-3, -1e-3, 2e-3, -2e-3)),
        ("fisheye", (-0.02, 0.005, 0.0, 0.0)),
    ],
)
def test_our_own_of_other_lenses_scores_zero(lens_model: str, distortion: tuple[float, ...], tmp_path: Path) -> None:
    other = device(lens_model, distortion)
    (tmp_path / "opencv.yaml").write_text(opencv_yaml(virtual_cameras(other.truth)))
    assert other.score(read_rig(tmp_path / "opencv.yaml")).figures["max_px"].value < EXACT


@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
@pytest.mark.parametrize("suffix", ["yaml", "yml", "json"])
def test_the_sample_calibration_projects_as_opencv(count: int, suffix: str, tmp_path: Path) -> None:
    def write(file: cv2.FileStorage) -> None:
        file.write("calibration_time", "Tue 1 Jan 2030")
        file.write("image_width", 640)
        file.write("image_height", 480)
        file.write("flags", 0)
        file.write("camera_matrix", MATRIX)
        file.write("distortion_coefficients", np.array(COEFFICIENTS[:count])[:, None])
        file.write("avg_reprojection_error", 0.1)

    path = stored(tmp_path / f"view_1_0.{suffix}", write)
    rig = read_rig(path)
    (camera,) = rig.cameras
    expected, _ = cv2.projectPoints(points(), np.zeros(3), np.zeros(3), MATRIX, np.array(COEFFICIENTS[:count]))
    np.testing.assert_allclose(camera.lens.project(points()), expected[:, 0], atol=1e-9)
    assert (camera.name, camera.size_px, camera.camera_from_rig) == ("view_1_0", (640, 480), None)


def test_a_fisheye_is_one_where_the_file_says_so(tmp_path: Path) -> None:
    """Four numbers are k1, k2, p1, p2 elsewhere, as `cv2.projectPoints` takes them."""

    def write(file: cv2.FileStorage) -> None:
        file.write("camera_matrix", MATRIX)
        file.write("distortion_coefficients", np.array(COEFFICIENTS[:4]))
        file.write("distortion_model", "fisheye")

    (camera,) = read_opencv((stored(tmp_path / "a.yaml", write),)).cameras
    expected, _ = cv2.fisheye.projectPoints(
        points()[:, None], np.zeros(3), np.zeros(3), MATRIX, np.array(COEFFICIENTS[:4])
    )
    np.testing.assert_allclose(camera.lens.project(points()), expected[:, 0], atol=1e-9)
    assert camera.size_px is None


@pytest.mark.parametrize("keys", [("R", "T"), ("rvec", "tvec"), ("rotation", "translation")])
def test_cameras_by_name_with_poses(keys: tuple[str, str], tmp_path: Path) -> None:
    turn = TURN if keys[0] != "rvec" else np.array([0.1, -0.2, 0.3])

    def write(file: cv2.FileStorage) -> None:
        file.write("unit", "m")
        for name in ("cam0", "cam1"):
            file.startWriteStruct(name, cv2.FILE_NODE_MAP)
            file.write("camera_matrix", MATRIX)
            file.write("distortion_coefficients", np.zeros((1, 5)))
            file.write(keys[0], turn)
            file.write(keys[1], SHIFT)
            file.endWriteStruct()

    rig = read_rig(stored(tmp_path / "cameras.yaml", write))
    assert [camera.name for camera in rig.cameras] == ["cam0", "cam1"]
    np.testing.assert_allclose(pose_of(rig.cameras[0])[:3], np.hstack([TURN, SHIFT]), atol=1e-12)
    assert (rig.unit_mm, rig.notes) == (1000.0, ())


def test_the_sample_stereo_calib(tmp_path: Path) -> None:
    def intrinsics(file: cv2.FileStorage) -> None:
        for number in (1, 2):
            file.write(f"M{number}", MATRIX)
            file.write(f"D{number}", np.array(COEFFICIENTS[:8])[None])

    def extrinsics(file: cv2.FileStorage) -> None:
        file.write("R", TURN)
        file.write("T", SHIFT)
        file.write("Q", np.eye(4))

    stored(tmp_path / "intrinsics.yml", intrinsics)
    stored(tmp_path / "extrinsics.yml", extrinsics)
    rig = read_rig(tmp_path)
    assert [camera.name for camera in rig.cameras] == ["first", "second"]
    np.testing.assert_allclose(pose_of(rig.cameras[0]), np.eye(4))
    np.testing.assert_allclose(pose_of(rig.cameras[1])[:3], np.hstack([TURN, SHIFT]), atol=1e-12)
    assert rig.notes == ("the file does not state the unit of poses: mm is assumed",)
    (tmp_path / "extrinsics.yml").unlink()
    with pytest.raises(InputError, match="M1 and M2 without R and T"):
        read_rig(tmp_path)


def test_files_of_one_camera_each_are_named_as_the_files(tmp_path: Path) -> None:
    for name in ("cam0", "cam1"):
        (tmp_path / f"{name}.json").write_text(
            json.dumps({"camera_matrix": MATRIX.tolist(), "distortion_coefficients": [COEFFICIENTS[:5]]})
        )
    assert [camera.name for camera in read_rig(tmp_path).cameras] == ["cam0", "cam1"]


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ({"camera_matrix": [[1, 2], [3, 4]]}, "expected [fx 0 cx; 0 fy cy; 0 0 1]"),
        ({"camera_matrix": [[500, 3, 1], [0, 500, 1], [0, 0, 1]]}, "expected [fx 0 cx; 0 fy cy; 0 0 1]"),
        ({"camera_matrix": {"rows": 3, "cols": 3, "data": [1.0]}}, "1 numbers, expected 3 x 3"),
        ({"camera_matrix": [[500, 0, 1], [0, 500], [0, 0, 1]]}, "rows of different lengths"),
        ({"camera_matrix": MATRIX.tolist(), "distortion": [0.1] * 7}, "7 numbers, expected 4, 5, 8, 12 or 14"),
        ({"camera_matrix": MATRIX.tolist(), "distortion": [0.1] * 14}, "a tilted sensor"),
        ({"camera_matrix": MATRIX.tolist(), "R": np.eye(3).tolist()}, "expected both R and T"),
        ({"camera_matrix": MATRIX.tolist(), "R": np.eye(3).tolist(), "T": [1.0]}, "T: 1 numbers, expected 3"),
        ({"camera_matrix": MATRIX.tolist(), "unit": "inch"}, "unit 'inch', expected one of mm, cm, m"),
        ({"camera_matrix": MATRIX.tolist(), "flip_code": -1}, "flip_code [-1], expected 0 or 1"),
        ({"camera_matrix": MATRIX.tolist(), "image_width": 640}, "1 numbers, expected 2"),
        ({"views": [1]}, "views: expected names with values"),
        ({"views": []}, "contains no camera"),
    ],
)
def test_what_is_no_camera_is_refused_in_one_line(content: object, complaint: str, tmp_path: Path) -> None:
    path = tmp_path / "cam0.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError) as caught:
        read_opencv((path,))
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_poses_of_some_cameras_are_refused(tmp_path: Path) -> None:
    camera = {"camera_matrix": MATRIX.tolist()}
    pose = {"R": np.eye(3).tolist(), "T": [0.0, 0.0, 0.0]}
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"cam0": camera | pose, "cam1": camera}))
    with pytest.raises(InputError, match="'cam1' has no pose"):
        read_opencv((path,))
