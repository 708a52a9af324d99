"""COLMAP: the cameras and points that it reads from our files, against the scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.io.formats.colmap import margins, read_colmap, write_colmap
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.io.formats.conftest import SURFACES, points


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
    found = read_colmap(tmp_path)
    left, top, _, _ = margins(light_field)
    assert np.allclose(found.positions_mm, light_field.positions_mm, atol=1e-6)
    assert found.reference_depth_mm == pytest.approx(light_field.reference_depth_mm, abs=1e-4)
    places = points(scene)
    assert np.allclose(found.project(places) - [left, top], light_field.project(places), atol=1e-4)
    assert np.array_equal(found.samples[:, :, top : top + 180, left : left + 240], light_field.samples)
    assert not found.weights[:, :, :top].any()
    # As written by pycolmap, in its order and with its digits.
    pycolmap.Reconstruction(tmp_path / "sparse").write_text(tmp_path / "sparse")
    again = read_colmap(tmp_path)
    assert np.allclose(again.positions_mm, found.positions_mm, atol=1e-6)


def test_models_that_are_not_light_fields_are_refused(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    write_colmap(tmp_path, scene[0])
    (tmp_path / "views.json").unlink()
    for name, old, new, message in (
        ("cameras.txt", "PINHOLE", "OPENCV", "is OPENCV, expected PINHOLE"),
        ("cameras.txt", "700.0", "900.0", "do not share a plane"),
        ("images.txt", "view_01_01/", "view_01_09/", "not a model of a grid"),
        ("images.txt", "2 0.70", "2 0.80", "different orientations"),
    ):
        path = tmp_path / "sparse" / name
        good = path.read_text(encoding="utf-8")
        assert old in good, old
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
        ("sparse/cameras.txt", "700.0", "nan", "numbers are missing or not finite"),
        ("sparse/cameras.txt", "PINHOLE", "PINHOLE 1", "expected .* as for its camera|of different sizes"),
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
    with pytest.raises(InputError, match="not a model of a grid of views: 2 views, expected 1000000000x1000000000"):
        read_colmap(tmp_path)
