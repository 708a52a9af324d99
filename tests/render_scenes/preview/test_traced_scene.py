"""Means of textures over footprints of pixels.

Tables of objects and light, against the objects themselves.
"""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.preview.preview_frame import arranged_tabletop
from mirrorcam.render_scenes.preview.traced_scene import (
    BOUNDING_SPHERE,
    FACING,
    FIRST_SIDE,
    FLOOR_LIGHT,
    LAMP_CENTRE,
    POINTS,
    POSITIONS,
    RADIANCE,
    RADIUS,
    SECOND_SIDE,
    TEXTURE,
    WALL_LIGHT,
    lamp_light,
    mean_colour,
    texture_atlas,
    traced_board,
    traced_tabletop,
    unit_from_view,
)
from mirrorcam.render_scenes.settings import RenderSettings
from tests.render_scenes.preview.scenes import item, scene_of

RANDOM = np.random.default_rng(0)
PICTURES = [RANDOM.random((48, 64, 3)).astype(np.float32), RANDOM.random((5, 9, 3)).astype(np.float32)]
ATLAS = texture_atlas(PICTURES)


def test_each_scale_has_the_mean_of_the_texture() -> None:
    for picture, (first, count) in zip(PICTURES, ATLAS.textures, strict=True):
        for begin, columns, rows in ATLAS.scales[first : first + count]:
            texels = ATLAS.texels[begin : begin + columns * rows]
            np.testing.assert_allclose(texels.mean(axis=0), picture.mean(axis=(0, 1)), atol=1e-5)
        assert (ATLAS.scales[first + count - 1, 1:] == 1).all()


def test_a_small_footprint_has_the_colour_of_its_texel() -> None:
    for texture, picture in enumerate(PICTURES):
        rows, columns = picture.shape[:2]
        for row, column in ((0, 0), (2, 5), (rows - 1, columns - 1)):
            at = ((column + 0.5) / columns, (row + 0.5) / rows)
            found = mean_colour(*ATLAS, texture, at, (0.01 / columns, 0.0), (0.0, 0.01 / rows))
            np.testing.assert_allclose(found, picture[row, column], atol=1e-6)


@pytest.mark.parametrize("wide", [(8.0, 8.0), (8.0, 1.0), (2.0, 6.0)])
def test_a_footprint_has_about_the_mean_over_it(wide: tuple[float, float]) -> None:
    columns, rows = 64, 48
    smooth = np.linspace(0.0, 1.0, columns)[None, :, None] * np.linspace(0.5, 1.0, rows)[:, None, None]
    atlas = texture_atlas([np.repeat(smooth, 3, axis=2).astype(np.float32)])
    place = (0.4, 0.6)
    found = mean_colour(*atlas, 0, place, (wide[0] / columns, 0.0), (0.0, wide[1] / rows))
    expected = (place[0] * columns - 0.5) / (columns - 1) * (0.5 + 0.5 * (place[1] * rows - 0.5) / (rows - 1))
    np.testing.assert_allclose(found, expected, atol=4e-3)


def test_a_long_footprint_is_not_blurred_across() -> None:
    stripes = np.zeros((64, 64, 3), np.float32)
    stripes[::16] = stripes[1::16] = stripes[2::16] = stripes[3::16] = 1.0
    atlas = texture_atlas([stripes])
    along = mean_colour(*atlas, 0, (0.5, 34.0 / 64.0), (8.0 / 64.0, 0.0), (0.0, 1.0 / 64.0))
    across = mean_colour(*atlas, 0, (0.5, 34.0 / 64.0), (1.0 / 64.0, 0.0), (0.0, 16.0 / 64.0))
    assert along[0] == pytest.approx(1.0)
    assert across[0] == pytest.approx(0.25, abs=0.05)


def test_noise_finer_than_the_footprints_is_averaged() -> None:
    places = np.random.default_rng(1).uniform(0.2, 0.8, (200, 2))
    noise = texture_atlas([np.random.default_rng(2).random((256, 256, 3)).astype(np.float32)])
    wide = 16.0 / 256.0
    found = np.array([mean_colour(*noise, 0, tuple(place), (wide, 0.0), (0.0, wide)) for place in places])
    # A mean of 16 x 16 has a sixteenth of the deviation; that of fewer texels, up to twice as much.
    assert 0.5 * 0.289 / 16.0 < found.std() < 2.0 * 0.289 / 16.0


@pytest.mark.parametrize("kind", ["rectangle", "sphere", "cylinder", "box", "leaves"])
def test_points_of_an_object_are_within_the_sphere_around_it(kind: str) -> None:
    thing = item(kind, seed=2)
    scene = scene_of(thing)
    unit = unit_from_view(thing)
    random = np.random.default_rng(0)
    corners = random.choice([-1.0, 1.0], (50, 3)) * ([1.0, 1.0, 0.0] if kind == "rectangle" else 1.0)
    if kind == "leaves":
        corners = np.concatenate([scene.triangles[:, :3] + edge for edge in (0.0, scene.triangles[:, 3:6])])
    if kind in ("sphere", "cylinder"):
        corners[:, :2] /= np.linalg.norm(corners, axis=1, keepdims=True) if kind == "sphere" else np.sqrt(2.0)
        corners[:, 2] /= np.sqrt(3.0) if kind == "sphere" else 1.0
    points = np.linalg.solve(unit[:, :3], (corners - unit[:, 3]).T).T
    away = np.linalg.norm(points - scene.objects[0, BOUNDING_SPHERE : BOUNDING_SPHERE + 3], axis=1)
    assert away.max() <= scene.objects[0, BOUNDING_SPHERE + 3] + 1e-9
    # The sphere is no larger than necessary.
    assert away.max() > 0.95 * scene.objects[0, BOUNDING_SPHERE + 3]


def test_the_light_of_the_lamp_is_that_of_its_points() -> None:
    lamp = scene_of(item("box")).lamp
    np.testing.assert_allclose(lamp[POINTS:].mean(axis=0), lamp[LAMP_CENTRE])
    sides = lamp[[FIRST_SIDE, SECOND_SIDE]]
    np.testing.assert_allclose(sides @ lamp[FACING], 0.0, atol=1e-9)
    assert (np.abs((lamp[POINTS:] - lamp[LAMP_CENTRE]) @ sides.T) < (sides**2).sum(axis=1)).all()
    point, normal = np.array([10.0, 20.0, 310.0]), np.array([0.0, -1.0, 0.0])
    ways = lamp[POINTS:] - point
    squared = (ways**2).sum(axis=1)
    area = 4.0 * np.linalg.norm(np.cross(*sides))
    points = area * np.mean((ways @ normal) * -(ways @ lamp[FACING]) / squared**2)
    np.testing.assert_allclose(lamp_light(lamp, point, normal), points * lamp[RADIANCE], rtol=0.02)
    assert not lamp_light(lamp, point, -normal).any()


def test_a_tabletop_has_its_floor_its_wall_and_balls_for_its_objects(small_layout: Layout) -> None:
    tabletop = arranged_tabletop(small_layout, 0)
    scene = traced_tabletop(tabletop)
    wall, desk = tabletop.objects[:2]
    assert (wall.name, desk.name) == ("wall", "desk")
    np.testing.assert_allclose(
        scene.surroundings[POSITIONS, :2], [desk.view_from_object[1, 3], wall.view_from_object[2, 3]]
    )
    assert (scene.surroundings[[FLOOR_LIGHT, WALL_LIGHT]] > 0.0).all()
    assert len(scene.objects) == len(tabletop.objects)
    textured = [item.texture is not None for item in tabletop.objects]
    assert ((scene.objects[:, TEXTURE] >= 0) == textured).all()
    assert (scene.balls[:, RADIUS] > 0.0).all()
    assert traced_tabletop(tabletop).texels is scene.texels


def test_a_board_lies_where_its_pose_says() -> None:
    board = Charuco(cols=10, rows=7, square_mm=24.0, marker_mm=18.0)
    scene = traced_board(board, rigid(np.eye(3), [-100.0, -80.0, 400.0]), RenderSettings())
    unit = scene.objects[0, 11:23].reshape(3, 4)
    # A margin of a square: from -124 to 164, and from -104 to 112.
    np.testing.assert_allclose(unit @ [-124.0, -104.0, 400.0, 1.0], [-1.0, -1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(unit @ [164.0, 112.0, 400.0, 1.0], [1.0, 1.0, 0.0], atol=1e-12)


def test_scenes_that_cannot_be_traced_are_refused() -> None:
    with pytest.raises(InputError, match=r"^mesh: a mesh, expected one of rectangle, sphere, cylinder, box, leaves$"):
        scene_of(item("mesh", file="part.stl"))
    with pytest.raises(InputError, match=r"^2 objects are leaves"):
        scene_of(item("leaves"), item("leaves"))
