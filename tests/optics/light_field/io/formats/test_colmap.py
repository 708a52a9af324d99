"""COLMAP: the cameras and points that it reads from our files, against the scene."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import inverse
from mirrorcam.optics.light_field.io.formats.colmap import margins, read_colmap, write_colmap
from mirrorcam.optics.light_field.io.formats.ply import point_cloud
from mirrorcam.optics.light_field.io.formats.registry import (
    format_of,
    open_light_field,
    open_light_fields,
    write_light_field,
)
from mirrorcam.optics.light_field.io.light_field_format import Assumed
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.io.formats.conftest import SURFACES, points
from tests.optics.light_field.wall_cameras import FOCAL_PX, SIZE, cameras, photographs, wall_error


@pytest.fixture(scope="module")
def colmap(scene: tuple[LightField, FloatArray], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("colmap")
    write_colmap(folder, scene[0])
    return folder


def test_colmap_projects_points_as_the_views_do(scene: tuple[LightField, FloatArray], colmap: Path) -> None:
    light_field, model = scene[0], pycolmap.Reconstruction(colmap / "sparse")
    left, top, _, _ = margins(light_field)
    assert top > 0
    places = points(scene)
    expected = light_field.project(places)
    assert len(model.images) == 9
    for image in model.images.values():
        row, col = (int(word) for word in image.name.split("/")[0].split("_")[1:])
        camera = model.cameras[image.camera_id]
        seen = camera.img_from_cam(image.cam_from_world() * (places / 1000.0))
        assert np.allclose(seen - 0.5 - [left, top], expected[row, col], atol=1e-6)
        assert 0 < camera.principal_point_x < camera.width
        assert 0 < camera.principal_point_y < camera.height


def test_colmaps_rig_matches_its_model(scene: tuple[LightField, FloatArray], colmap: Path) -> None:
    """`rig_configurator` places views relative to the middle one: x_camera = x_rig - position."""
    (rig,) = pycolmap.read_rig_config(colmap / "rig_config.json")
    assert rig.cameras[0].image_prefix == "view_01_01/"
    assert rig.cameras[0].ref_sensor
    for camera in rig.cameras[1:]:
        row, col = (int(word) for word in camera.image_prefix.rstrip("/").split("_")[1:])
        assert camera.cam_from_rig is not None
        assert np.allclose(camera.cam_from_rig.translation, -scene[0].positions_mm[row, col] / 1000.0, atol=1e-12)
        assert np.allclose(camera.cam_from_rig.rotation.matrix(), np.eye(3))


@pytest.mark.slow
def test_colmap_triangulates_the_scene(scene: tuple[LightField, FloatArray], colmap: Path) -> None:
    """Features, the rig and matches are pycolmap's; the points lie on the photographed surfaces."""
    database = colmap / "database.db"
    reading = pycolmap.ImageReaderOptions()
    reading.mask_path = colmap / "masks"
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.use_gpu, extraction.num_threads = False, 1
    extraction.sift.max_num_features = 500
    mode = pycolmap.CameraMode.PER_FOLDER
    pycolmap.extract_features(
        database, colmap / "images", camera_mode=mode, reader_options=reading, extraction_options=extraction
    )
    with pycolmap.Database.open(database) as opened:
        pycolmap.apply_rig_config(pycolmap.read_rig_config(colmap / "rig_config.json"), opened)
    matching = pycolmap.FeatureMatchingOptions()
    matching.use_gpu, matching.num_threads = False, 1
    pycolmap.match_exhaustive(database, matching_options=matching)
    given = pycolmap.Reconstruction(colmap / "sparse")
    # Its bundle adjustment would move the known views.
    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_sensor_from_rig = False
    model = pycolmap.triangulate_points(given, database, colmap / "images", colmap / "points", options=options)
    found = np.array([point.xyz for point in model.points3D.values() if point.track.length() >= 4]) * 1000.0
    assert len(found) > 400
    views = scene[0]
    in_view = (found - views.reference_view_in_rig_mm) @ views.view_from_rig.T
    off = [
        (in_view[:, 2] - surface.distance_mm - in_view[:, :2] @ surface.slope) / np.hypot(1.0, np.hypot(*surface.slope))
        for surface in SURFACES
    ]
    nearest = np.array(off)[np.abs(off).argmin(axis=0), np.arange(len(found))]
    assert abs(np.median(nearest)) < 0.15
    assert np.median(np.abs(nearest)) < 0.5
    assert model.compute_mean_reprojection_error() < 0.2


def test_views_are_read_from_colmaps_model_alone(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    light_field = scene[0]
    write_colmap(tmp_path, light_field)
    (tmp_path / "views.json").unlink()
    (found,) = read_colmap(tmp_path).frames
    left, top, _, _ = margins(light_field)
    assert np.allclose(found.positions_mm, light_field.positions_mm, atol=1e-6)
    assert found.reference_depth_mm == pytest.approx(light_field.reference_depth_mm, abs=1e-4)
    places = points(scene)
    assert np.allclose(found.project(places) - [left, top], light_field.project(places), atol=1e-4)
    assert np.array_equal(found.samples[:, :, top : top + 180, left : left + 240], light_field.samples)
    assert not found.weights[:, :, :top].any()
    # As written by pycolmap, in its order and with its digits, and in binary, where COLMAP puts it.
    model = pycolmap.Reconstruction(tmp_path / "sparse")
    model.write_text(tmp_path / "sparse")
    (again,) = read_colmap(tmp_path).frames
    assert np.allclose(again.positions_mm, found.positions_mm, atol=1e-6)
    shutil.rmtree(tmp_path / "sparse")
    (tmp_path / "sparse" / "0").mkdir(parents=True)
    model.write_binary(tmp_path / "sparse" / "0")
    assert format_of(tmp_path).name == "colmap"
    binary = open_light_field(tmp_path)
    assert np.allclose(binary.positions_mm, found.positions_mm, atol=1e-6)
    assert np.array_equal(binary.samples, found.samples)


def test_points_of_the_depth_are_in_the_model(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    write_light_field(tmp_path, scene[0], "colmap", scene[1].astype(np.float32))
    model, (expected, colours) = pycolmap.Reconstruction(tmp_path / "sparse"), point_cloud(*scene)
    assert len(model.points3D) == len(expected)
    found = np.array([model.points3D[number].xyz for number in range(1, 1 + len(expected))])
    assert np.allclose(1000.0 * found, expected, atol=1e-3)
    assert np.array_equal(model.points3D[1].color, colours[0])
    assert open_light_field(tmp_path).layout_identity == scene[0].layout_identity


def test_our_export_as_binary_keeps_its_exact_views(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    write_colmap(tmp_path, scene[0])
    model = pycolmap.Reconstruction(tmp_path / "sparse")
    for text in (tmp_path / "sparse").glob("*.txt"):
        text.unlink()
    model.write_binary(tmp_path / "sparse")
    found = open_light_field(tmp_path)
    assert np.array_equal(found.positions_mm, scene[0].positions_mm)
    assert np.array_equal(found.samples, scene[0].samples)


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("model", ["PINHOLE", "SIMPLE_PINHOLE", "RADIAL", "OPENCV"])
def test_models_of_any_cameras_are_rectified(tmp_path: Path, model: str, binary: bool) -> None:
    """Turned cameras with one lens or each its own, and pictures of any names, written by pycolmap."""
    poses = cameras(2, 3, 2.0)
    random = np.random.default_rng(4)
    distortion = np.zeros(5)
    count = {"RADIAL": 2, "OPENCV": 4}.get(model, 0)
    distortion[:count] = [-0.1, 0.03, 1e-3, -1e-3][:count]
    focal_px = FOCAL_PX * (np.linspace(0.95, 1.05, 6) if model != "SIMPLE_PINHOLE" else np.ones(6))
    pictures = np.rint(255 * photographs(poses, focal_px, distortion)).astype(np.uint8)
    reconstruction = pycolmap.Reconstruction()
    for number in random.permutation(6).tolist():
        file = f"DSC_{random.integers(10**6)} ({number}).png"
        write_image(tmp_path / "images" / file, np.repeat(pictures[number][..., None], 3, axis=-1))
        centre = [SIZE[0] / 2, SIZE[1] / 2]
        core = [focal_px[number], *([focal_px[number]] if model in ("PINHOLE", "OPENCV") else []), *centre]
        camera_id = 1 if model == "SIMPLE_PINHOLE" else number + 1
        if camera_id not in reconstruction.cameras:
            camera = pycolmap.Camera(model=model, width=SIZE[0], height=SIZE[1], camera_id=camera_id)
            camera.params = [*core, *distortion[:count]]
            reconstruction.add_camera_with_trivial_rig(camera)
        camera_from_world = inverse(poses[number])
        image = pycolmap.Image(name=file, camera_id=camera_id, image_id=number + 1)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(camera_from_world[:3, :3]), camera_from_world[:3, 3] / 1000.0)
        reconstruction.add_image_with_trivial_frame(image, pose)
    (tmp_path / "sparse" / "0").mkdir(parents=True)
    (reconstruction.write_binary if binary else reconstruction.write_text)(tmp_path / "sparse" / "0")
    contents = open_light_fields(tmp_path)
    (found,) = contents.frames
    assert any("rectified: cameras turned by up to 2" in note for note in contents.notes)
    assert (found.rows, found.cols) == (2, 3)
    found = replace(found, samples=(found.samples / np.float32(255.0)).astype(np.float32))
    error, valid = wall_error(found)
    assert error < 0.004
    assert valid > 0.8
    (scaled,) = open_light_fields(tmp_path, assumed=Assumed(step_mm=5.0)).frames
    assert scaled.step_mm() == pytest.approx(5.0)
    assert np.allclose(scaled.matrices, found.matrices)
    assert scaled.reference_depth_mm / found.reference_depth_mm == pytest.approx(5.0 / found.step_mm())


def test_models_that_are_not_light_fields_are_refused(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    write_colmap(tmp_path, scene[0])
    (tmp_path / "views.json").unlink()
    for name, old, new, message in (
        ("cameras.txt", "PINHOLE", "EUCM", "6 parameters|parameters, expected 6"),
        ("images.txt", "view_01_01/", "view_01_09/", "no such file"),
        ("images.txt", "2 0.70", "2 0.80", "not a unit quaternion"),
        (
            "images.txt",
            "0.7071067811865475 0.7071067811865475 0.0 0.0",
            "0.0 0.0 0.7071067811865475 0.7071067811865475",
            "turned",
        ),
    ):
        path = tmp_path / "sparse" / name
        good = path.read_text(encoding="utf-8")
        assert old in good, (old, good[:400])
        path.write_text(good.replace(old, new, 1), encoding="utf-8")
        with pytest.raises(InputError, match=message):
            read_colmap(tmp_path)
        path.write_text(good, encoding="utf-8")


def test_names_outside_of_the_folder_are_refused(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    write_colmap(tmp_path / "a", scene[0])
    good = (tmp_path / "a" / "images" / "view_00_00" / "0000.png").read_bytes()
    (tmp_path / "secret.png").write_bytes(good)
    path = tmp_path / "a" / "sparse" / "images.txt"
    text = path.read_text(encoding="utf-8")
    for name in ("view_00_00/../../../secret.png", "_00_00/../../../secret.png"):
        path.write_text(text.replace("view_00_00/0000.png", name), encoding="utf-8")
        with pytest.raises(InputError, match="expected the name of a file in this folder"):
            read_colmap(tmp_path / "a")


def test_invalid_numbers_and_pictures_of_another_size_are_refused(
    scene: tuple[LightField, FloatArray], tmp_path: Path
) -> None:
    write_colmap(tmp_path, scene[0])
    for name, old, new, message in (
        ("sparse/cameras.txt", "700.0", "nan", "parameters that are not finite"),
        ("sparse/cameras.txt", " 240 ", " 241 ", "expected 241x.* as for its camera"),
        ("views.json", '"width_px": 240', '"width_px": 239', "views of 239x180 px, but pictures"),
        ("views.json", '"width_px": 240', '"width_px": 240.5', "expected a whole number"),
    ):
        path = tmp_path / name
        good = path.read_text(encoding="utf-8")
        assert old in good, old
        path.write_text(good.replace(old, new), encoding="utf-8")
        with pytest.raises(InputError, match=message):
            read_colmap(tmp_path)
        path.write_text(good, encoding="utf-8")


def test_large_numbers_in_names_allocate_no_memory(tmp_path: Path) -> None:
    (tmp_path / "sparse").mkdir()
    (tmp_path / "sparse" / "cameras.txt").write_text("1 PINHOLE 480 270 400 400 240 135\n")
    names = ("v_0_0", "v_999999999_999999999")
    lines = [f"1 1 0 0 0 0 0 0 1 {name}/0000.png\n\n" for name in names]
    (tmp_path / "sparse" / "images.txt").write_text("".join(lines))
    with pytest.raises(InputError, match="no such file"):
        read_colmap(tmp_path)
