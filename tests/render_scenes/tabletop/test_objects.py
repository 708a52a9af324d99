"""Procedural textures: seeded, in range, and with detail down to their texels.

Objects as shapes: as large as asked, where they are placed, under one light at any scale.
"""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import write_image
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.tabletop.objects import (
    Kind,
    SceneObject,
    TextureName,
    grain,
    lights,
    mesh_surface,
    shapes_of,
    surface_texture,
    texture,
)
from mirrorcam.render_scenes.variant import SCALAR, use_variant


@pytest.mark.parametrize("name", get_args(TextureName))
def test_a_texture_follows_from_its_seed_and_has_fine_detail(name: TextureName) -> None:
    picture, again, other = (texture(name, (160, 120), seed) for seed in (1, 1, 2))
    assert picture.shape == (120, 160, 3)
    assert picture.dtype == np.float32
    assert picture.min() >= np.float32(0.02)
    assert picture.max() <= np.float32(0.9)
    np.testing.assert_array_equal(picture, again)
    assert (picture != other).any()
    # Neighbouring texels differ nearly everywhere, so that views can be matched.
    assert (np.abs(np.diff(picture, axis=1)).max(axis=-1) > 1e-3).mean() > 0.8


def test_noise_has_mean_zero_and_unit_deviation_at_every_fall() -> None:
    for gain in (0.5, 1.0):
        noise = np.stack(
            [grain(64, 64, np.random.default_rng(seed), cell=(16.0, 16.0), gain=gain) for seed in range(20)]
        )
        assert abs(noise.mean()) < 0.1
        assert 0.6 < noise.std() < 1.2


@pytest.fixture(autouse=True)
def _variant() -> None:
    use_variant(SCALAR)


@pytest.mark.parametrize(
    ("kind", "size_mm", "extent_mm"),
    [
        ("sphere", (20.0, 0.0, 0.0), (20.0, 20.0, 20.0)),
        ("rectangle", (30.0, 10.0, 0.0), (30.0, 10.0, 0.0)),
        ("box", (30.0, 10.0, 40.0), (30.0, 10.0, 40.0)),
        ("cylinder", (20.0, 0.0, 50.0), (20.0, 20.0, 50.0)),
    ],
)
def test_a_shape_is_as_large_as_asked_about_its_place(
    kind: Kind, size_mm: tuple[float, ...], extent_mm: tuple[float, ...]
) -> None:
    place = np.array([5.0, -7.0, 300.0])
    view_from_rig = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    item = SceneObject(
        name="x", kind=kind, material="matte", view_from_object=rigid(np.eye(3), place), size_mm=np.array(size_mm)
    )
    boxes = [shape.bbox() for shape in shapes_of(item, view_from_rig)]
    low = np.min([np.array(box.min) for box in boxes], axis=0)
    high = np.max([np.array(box.max) for box in boxes], axis=0)
    np.testing.assert_allclose(high - low, np.abs(view_from_rig.T @ extent_mm), atol=1e-3)
    np.testing.assert_allclose((low + high) / 2.0, view_from_rig.T @ place, atol=1e-3)


@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
def test_a_turned_shape_raises_no_alarm(kind: Kind, capfd: pytest.CaptureFixture[str]) -> None:
    turns = Rotation.random(20, rng=np.random.default_rng(0)).as_matrix()
    for turn in turns:
        placed = rigid(np.eye(3), np.array([5.0, -7.0, 300.0]))
        size_mm = np.array([87.0, 0.0, 50.0])
        item = SceneObject(name="x", kind=kind, material="matte", view_from_object=placed, size_mm=size_mm)
        shapes_of(item, turn)
    told = capfd.readouterr()
    assert "shear" not in told.out + told.err


def test_a_mesh_stands_with_the_middle_of_its_base_at_the_origin(tmp_path: Path) -> None:
    corners = [(2, 4, 7), (6, 4, 7), (6, 10, 7), (4, 7, 12)]
    faces = [(0, 1, 2), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
    text = "solid x\n" + "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*corners[index]) for index in face)
        + "endloop\nendfacet\n"
        for face in faces
    )
    (tmp_path / "x.stl").write_text(text + "endsolid x\n")
    item = SceneObject(
        name="x",
        kind="mesh",
        material="matte",
        view_from_object=np.eye(4),
        size_mm=np.zeros(3),
        file=tmp_path / "x.stl",
    )
    points = mesh_surface(item).points
    np.testing.assert_allclose(points.min(axis=0), [-2.0, -3.0, 0.0])
    np.testing.assert_allclose(points.max(axis=0), [2.0, 3.0, 5.0])


def test_a_mesh_in_memory_stands_where_its_vertices_are() -> None:
    vertices_mm, faces = [(2, 4, 7), (6, 4, 7), (6, 10, 7), (4, 7, 12)], [(0, 1, 2), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
    place = np.array([5.0, -7.0, 300.0])
    item = SceneObject(kind="mesh", view_from_object=rigid(np.eye(3), place), vertices_mm=vertices_mm, faces=faces)
    surface = mesh_surface(item)
    np.testing.assert_array_equal(surface.points, vertices_mm)
    np.testing.assert_array_equal(surface.faces, faces)
    (shape,) = shapes_of(item, np.eye(3))
    np.testing.assert_allclose(np.array(shape.bbox().min), np.add(place, (2.0, 4.0, 7.0)), atol=1e-4)
    np.testing.assert_allclose(np.array(shape.bbox().max), np.add(place, (6.0, 10.0, 12.0)), atol=1e-4)
    assert SceneObject.model_validate_json(item.model_dump_json()) == item


def test_a_picture_has_the_same_texels_from_a_file_as_an_array_and_in_linear_light(tmp_path: Path) -> None:
    levels = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    write_image(tmp_path / "a.png", levels)
    light = np.where(levels > 10, ((levels / 255.0 + 0.055) / 1.055) ** 2.4, levels / 255.0 / 12.92)  # sRGB
    sheet = SceneObject(kind="rectangle", view_from_object=np.eye(4), size_mm=(7, 5, 0))
    for picture in (tmp_path / "a.png", str(tmp_path / "a.png"), levels, light, light.astype(np.float32)):
        item = sheet.replaced(texture=picture)
        np.testing.assert_allclose(surface_texture(item), light, rtol=1e-5)
        assert SceneObject.model_validate_json(item.model_dump_json()) == item
    with pytest.raises(InputError, match=r"gone\.png: no such file"):
        surface_texture(sheet.replaced(texture="gone.png"))


def test_the_files_keep_the_key_of_an_objects_pose() -> None:
    item = SceneObject(name="x", kind="box", material="matte", view_from_object=np.eye(4), size_mm=np.ones(3))
    dumped = item.model_dump(mode="json", by_alias=True)
    assert "view_from_thing" in dumped
    assert "view_from_object" not in dumped


def test_the_area_light_is_as_large_as_its_distance_at_any_scale() -> None:
    import mitsuba as mi

    target = np.array([0.0, 50.0, 400.0])
    angles = []
    for reach in (100.0, 1000.0):
        box = mi.load_dict(lights(target, reach, np.eye(3))["lamp"]).bbox()
        middle = (np.array(box.min) + np.array(box.max)) / 2.0
        side = np.linalg.norm(np.array(box.max) - np.array(box.min))
        angles.append(side / np.linalg.norm(middle - target))
    assert angles[0] == pytest.approx(angles[1], rel=1e-4)
