"""COLMAP's models, written by COLMAP itself, project as COLMAP does."""

from __future__ import annotations

import shutil
import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.read.colmap import LENSES, MODELS, model_folder, read_colmap, read_model
from mirrorcam.optics.camera_files.read.registry import read_rig
from mirrorcam.optics.camera_files.write.virtual_cameras import virtual_cameras
from tests.optics.camera_files.rigs import EXACT, device
from tests.soon import soon

PARAMETERS = {
    "SIMPLE_PINHOLE": [500.0, 320.0, 240.0],
    "PINHOLE": [500.0, 510.0, 320.0, 240.0],
    "SIMPLE_RADIAL": [500.0, 320.0, 240.0, 0.05],
    "RADIAL": [500.0, 320.0, 240.0, 0.05, -0.02],
    "OPENCV": [500.0, 510.0, 320.0, 240.0, 0.05, -0.02, 0.001, -0.002],
    "FULL_OPENCV": [500.0, 510.0, 320.0, 240.0, 0.05, -0.02, 0.001, -0.002, 0.01, 0.03, -0.01, 0.002],
    "OPENCV_FISHEYE": [500.0, 510.0, 320.0, 240.0, 0.05, -0.02, 0.01, 0.002],
    "SIMPLE_FISHEYE": [500.0, 320.0, 240.0],
    "FISHEYE": [500.0, 510.0, 320.0, 240.0],
    "SIMPLE_RADIAL_FISHEYE": [500.0, 320.0, 240.0, 0.05],
    "RADIAL_FISHEYE": [500.0, 320.0, 240.0, 0.05, -0.02],
    "EUCM": [500.0, 510.0, 320.0, 240.0, 0.6, 1.1],
}


def points() -> FloatArray:
    return np.random.default_rng(0).uniform([-0.4, -0.4, 0.8], [0.4, 0.4, 2.0], (40, 3))


def model_of(camera: pycolmap.Camera, names: dict[str, pycolmap.Rigid3d]) -> pycolmap.Reconstruction:
    """A model with one camera and named pictures with poses, as made by COLMAP's mapper without a rig."""
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(camera)
    for number, (name, pose) in enumerate(names.items(), start=1):
        model.add_image_with_trivial_frame(pycolmap.Image(name=name, camera_id=camera.camera_id, image_id=number), pose)
    return model


@pytest.fixture(scope="module")
def binary(exported: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The exported model, written again by COLMAP as binary."""
    folder = tmp_path_factory.mktemp("binary")
    pycolmap.Reconstruction(exported / "colmap" / "sparse").write_binary(folder)
    return folder


def test_every_lens_that_is_known_is_tested() -> None:
    assert PARAMETERS.keys() == LENSES.keys()


@pytest.mark.parametrize("model", sorted(LENSES))
@pytest.mark.parametrize("binary", [True, False])
def test_lenses_are_colmaps(model: str, binary: bool, tmp_path: Path) -> None:
    camera = pycolmap.Camera(model=model, width=640, height=480, params=PARAMETERS[model], camera_id=3)
    pose = pycolmap.Rigid3d(pycolmap.Rotation3d([0.0, 0.0, 0.1]), [1.0, 2.0, 3.0])
    written = model_of(camera, {"view_0_1/0000.png": pose})
    if binary:
        written.write_binary(tmp_path)
    else:
        written.write_text(tmp_path)
    rig = read_colmap(tmp_path)
    (found,) = rig.cameras
    expected = np.asarray(camera.img_from_cam(points())) - 0.5  # COLMAP: the corner of the top-left pixel
    np.testing.assert_allclose(found.lens.project(points()), expected, atol=1e-9)
    assert (found.name, found.size_px, rig.unit_mm) == ("view_0_1", (640, 480), None)
    np.testing.assert_allclose(np.array(found.camera_from_rig)[:3], pose.matrix(), atol=1e-12)


@pytest.mark.parametrize("what", ["text", "binary"])
def test_our_own_scores_zero(what: str, exported: Path, binary: Path) -> None:
    rig = read_rig(exported / "colmap" if what == "text" else binary)
    score = device().score(rig)
    assert score.figures["max_px"].value < EXACT
    assert score.alignment == "similarity"
    assert score.notes == ("poses are taken from the rig",)
    metric = device().score(read_rig(exported, "colmap", "m"))
    assert metric.alignment == "rigid"
    assert abs(metric.figures["scale_error_percent"].value) < EXACT


def test_text_and_binary_are_one(exported: Path, binary: Path) -> None:
    for ours, theirs in zip(
        read_colmap(exported / "colmap" / "sparse").cameras, read_colmap(binary).cameras, strict=True
    ):
        assert ours.name == theirs.name
        np.testing.assert_allclose(np.array(ours.camera_from_rig), np.array(theirs.camera_from_rig), atol=1e-12)


def test_without_a_rig_poses_are_those_of_the_picture_that_most_views_have(exported: Path, tmp_path: Path) -> None:
    """A mapper without a rig poses every picture individually: views at different times do not mix."""
    source = exported / "colmap" / "sparse"
    for name in ("cameras.txt", "images.txt"):
        (tmp_path / name).write_bytes((source / name).read_bytes())
    with (tmp_path / "images.txt").open("a") as file:
        file.write("90 1 0 0 0 9 9 9 1 view_0_0/0001.png\n10.5 20.5 -1 30 40 7\n")
        file.write("91 1 0 0 0 9 9 9 2 view_0_1/0001.png\n\n")
    rig = read_colmap(tmp_path)
    assert rig.notes == ("poses are taken from the picture 0000.png",)
    assert device().score(rig).figures["max_px"].value < EXACT


def test_other_lenses_are_refused_by_name(tmp_path: Path) -> None:
    camera = pycolmap.Camera(model="FOV", width=640, height=480, params=[500.0, 510.0, 320.0, 240.0, 0.9], camera_id=1)
    model_of(camera, {"view_0_0/a.png": pycolmap.Rigid3d()}).write_binary(tmp_path)
    with pytest.raises(InputError, match="camera 1: FOV, expected one of SIMPLE_PINHOLE"):
        read_colmap(tmp_path)


def test_one_camera_may_be_that_of_all_views(tmp_path: Path) -> None:
    """All mirrors share one lens, and COLMAP may use a single camera."""
    views = virtual_cameras(device().truth)
    lens = views[0].camera
    parameters = [lens.fx_px, lens.fy_px, lens.cx_px + 0.5, lens.cy_px + 0.5, *lens.distortion[:4]]
    size = {"width": lens.width_px, "height": lens.height_px}
    camera = pycolmap.Camera(model="OPENCV", **size, params=parameters, camera_id=1)
    poses = {f"{view.name}.png": pycolmap.Rigid3d(view.camera_from_rig[:3]) for view in views}
    model_of(camera, poses).write_binary(tmp_path)
    rig = read_colmap(tmp_path)
    assert rig.notes == ("poses are taken from the pictures",)
    assert device().score(rig).figures["max_px"].value < EXACT


def test_cameras_of_a_rig_without_folders_of_their_own_are_refused(exported: Path, tmp_path: Path) -> None:
    for path in (exported / "colmap" / "sparse").iterdir():
        (tmp_path / path.name).write_text(path.read_text().replace(" 2 view_0_1/", " 1 view_0_1/"))
    with pytest.raises(InputError, match="camera 1 has no name"):
        read_colmap(tmp_path)


def test_a_model_without_pictures_is_refused(tmp_path: Path) -> None:
    camera = pycolmap.Camera(model="PINHOLE", width=640, height=480, params=PARAMETERS["PINHOLE"], camera_id=1)
    model_of(camera, {}).write_text(tmp_path)
    with pytest.raises(InputError, match="no images, expected a model with poses"):
        read_colmap(tmp_path)


def test_the_model_is_found_where_colmap_puts_it(tmp_path: Path) -> None:
    assert model_folder(tmp_path) is None
    (tmp_path / "sparse" / "0").mkdir(parents=True)
    (tmp_path / "sparse" / "0" / "cameras.bin").touch()
    assert model_folder(tmp_path) == tmp_path / "sparse" / "0"


@pytest.fixture(scope="module")
def binary_model(exported: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("model")
    pycolmap.Reconstruction(exported / "colmap" / "sparse").write_binary(folder)
    return folder


def test_numbers_of_models_are_colmaps() -> None:
    for number, (name, count) in MODELS.items():
        assert int(getattr(pycolmap.CameraModelId, name)) == number
        size = pycolmap.Camera.create_from_model_name(1, name, 500.0, 640, 480).params_info.count(",") + 1
        assert size == count


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "rigs.bin"])
def test_a_file_that_ends_early_is_refused(name: str, binary_model: Path, tmp_path: Path) -> None:
    shutil.copytree(binary_model, tmp_path / "cut")
    raw = (binary_model / name).read_bytes()
    for length in range(0, len(raw), 7):
        (tmp_path / "cut" / name).write_bytes(raw[:length])
        with pytest.raises(InputError) as caught:
            read_model(tmp_path / "cut")
        assert "\n" not in str(caught.value)
        assert "invalid COLMAP file" in str(caught.value)


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "rigs.bin"])
def test_a_count_beyond_the_file_is_refused_before_anything_is_read(
    name: str, binary_model: Path, tmp_path: Path
) -> None:
    shutil.copytree(binary_model, tmp_path / "many")
    raw = (binary_model / name).read_bytes()
    (tmp_path / "many" / name).write_bytes(struct.pack("<Q", 2**60) + raw[8:])
    with pytest.raises(InputError, match="items in"):
        read_model(tmp_path / "many")


@pytest.mark.parametrize(
    ("name", "text", "complaint"),
    [
        ("cameras.txt", "1 PINHOLE 640 480 1 2 3\n", "camera 1: 3 parameters, expected 4"),
        ("cameras.txt", "1 PINHOLE 640 480 1 2 3 inf\n", "not finite"),
        ("cameras.txt", "1 PINHOLE 0 480 1 2 3 4\n", "camera 1 is 0 x 480 px"),
        ("cameras.txt", "one PINHOLE 640 480 1 2 3 4\n", "invalid COLMAP file"),
        ("images.txt", "1 1 1 0 0 0 0 0 1 a/b.png\n\n", "not a unit quaternion"),
        ("images.txt", "1 1 0 0\n\n", "invalid COLMAP file"),
        ("images.txt", "1 nan 0 0 0 0 0 0 1 a/b.png\n\n", "not finite"),
        ("rigs.txt", "1 2 CAMERA\n", "invalid COLMAP file"),
    ],
)
def test_text_that_is_no_model_is_refused(name: str, text: str, complaint: str, exported: Path, tmp_path: Path) -> None:
    shutil.copytree(exported / "colmap" / "sparse", tmp_path / "model")
    (tmp_path / "model" / name).write_text(text)
    with pytest.raises(InputError) as caught:
        read_model(tmp_path / "model")
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_names_of_pictures_may_hold_blanks(exported: Path, tmp_path: Path) -> None:
    shutil.copytree(exported / "colmap" / "sparse", tmp_path / "model")
    path = tmp_path / "model" / "images.txt"
    path.write_text(path.read_text().replace("0000.png", "my picture.png"))
    assert read_model(tmp_path / "model").images[0].name == "view_0_0/my picture.png"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("rigs.txt", b"1 2 CAMERA 1 " + b"CAMERA 1 0 " * 200_000),
        ("images.txt", b"\n" * 400_000),
        ("images.txt", b"1 1 0 0 0 0 0 0 1 a/b.png\n\n" * 200_000),
        ("images.bin", struct.pack("<Q", 200_000) + (struct.pack("<I7dI", 1, 1, *[0] * 6, 1) + bytes(9)) * 200_000),
    ],
)
def test_a_model_takes_no_more_time_than_a_large_one(
    name: str, content: bytes, exported: Path, binary_model: Path, tmp_path: Path
) -> None:
    shutil.copytree(exported / "colmap" / "sparse" if name.endswith(".txt") else binary_model, tmp_path / "model")
    (tmp_path / "model" / name).write_bytes(content)
    with soon(), suppress(InputError):
        read_model(tmp_path / "model")
