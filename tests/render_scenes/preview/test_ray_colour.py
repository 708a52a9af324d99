"""Shading of surfaces: physical laws, and the shadow of an object against rays to the lamp.

What rays see: closed forms of glass and gloss in an even surrounding.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.preview.preview_frame import arranged_tabletop
from mirrorcam.render_scenes.preview.ray_colour import (
    FLOOR_FRACTION,
    GLOSS,
    WALL_FRACTION,
    facing_normal,
    ray_colour,
    scattered_light,
    surface_colour,
)
from mirrorcam.render_scenes.preview.traced_scene import (
    BOUNDING_SPHERE,
    FACING,
    FIRST_SIDE,
    FLOOR_LIGHT,
    GLOW,
    LAMP_CENTRE,
    RADIANCE,
    SKY_LIGHT,
    WALL_LIGHT,
    TracedScene,
    lamp_light,
    traced_tabletop,
)
from mirrorcam.render_scenes.preview.traced_scene import (
    COLOUR as COLOUR_COLUMN,
)
from mirrorcam.render_scenes.preview.triangle_tree import NOTHING
from tests.render_scenes.preview.scenes import item, scene_of

FLOOR = rigid(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), [0.0, 40.0, 300.0])
COLOUR = (0.5, 0.4, 0.3)
ZERO = (0.0, 0.0, 0.0)
POINT, UP = (3.0, 40.0, 305.0), (0.0, -1.0, 0.0)


def floor() -> Any:
    return item("rectangle", view_from_object=FLOOR, size_mm=np.array([900.0, 900.0, 0.0]), colour=np.array(COLOUR))


def light(scene: TracedScene, *, shaded: bool = True) -> Any:
    return np.array(scattered_light(scene, 0, 0, POINT, UP, (0.1, 1.0, 0.2), ZERO, ZERO, shaded))


@pytest.mark.slow
def test_a_matte_surface_alone_scatters_the_light_of_the_sky_and_the_lamp() -> None:
    scene = scene_of(floor())
    expected = np.array(COLOUR) * (
        scene.surroundings[SKY_LIGHT] + lamp_light(scene.lamp, np.array(POINT), np.array(UP)) / np.pi
    )
    np.testing.assert_allclose(light(scene), expected)
    below = scattered_light(scene, 0, 0, POINT, (0.0, 1.0, 0.0), (0.1, -1.0, 0.2), ZERO, ZERO, True)
    np.testing.assert_allclose(below, np.array(COLOUR) * scene.surroundings[SKY_LIGHT])


def test_an_object_before_the_lamp_takes_its_light_and_some_of_the_sky() -> None:
    open_scene = scene_of(floor())
    halfway = tuple(0.5 * (open_scene.lamp[LAMP_CENTRE] + POINT))
    scene = scene_of(floor(), item("sphere", halfway, size_mm=np.array([200.0] * 3)))
    np.testing.assert_array_less(light(scene), np.array(COLOUR) * open_scene.surroundings[SKY_LIGHT])
    unshaded = light(scene, shaded=False) - light(scene)
    lamp = lamp_light(scene.lamp, np.array(POINT), np.array(UP)) / np.pi
    np.testing.assert_allclose(unshaded, np.array(COLOUR) * lamp, rtol=1e-6)
    beside = scene_of(floor(), item("sphere", (400.0, -100.0, 300.0)))
    np.testing.assert_allclose(light(beside), light(open_scene), rtol=0.01)


@pytest.mark.parametrize("radius", [6.0, 12.0, 20.0])
def test_a_small_object_hides_a_part_of_the_lamp(radius: float) -> None:
    open_scene = scene_of(floor())
    place = np.array(POINT) + 0.3 * (open_scene.lamp[LAMP_CENTRE] - POINT)
    scene = scene_of(floor(), item("sphere", tuple(place), size_mm=np.array([2.0 * radius] * 3)))
    lit = (light(scene) - light(scene_of(floor()))).sum() / (np.array(COLOUR) * lamp_part(scene)).sum()
    # The cone to the lamp, of 0.3 times half its side of 44 mm there, is hidden up to the ball's radius.
    assert (lit < -0.99) == (radius == 20.0)
    assert lit < -0.1


def test_a_ball_hides_a_part_of_the_sky_and_adds_its_own_light() -> None:
    radius, away = 20.0, 50.0
    place = tuple(np.array(POINT) + away * np.array(UP))
    scene = scene_of(
        floor(), item("sphere", place, size_mm=np.array([2.0 * radius] * 3), colour=np.array([0.1, 0.2, 0.3]))
    )
    # The form factor of a sphere straight above a surface (Howell, A Catalog of Radiation Heat Transfer, B-45).
    part = (radius / away) ** 2
    sky, glow = scene.surroundings[SKY_LIGHT], scene.balls[0, GLOW : GLOW + 3]
    expected = np.array(COLOUR) * (sky + part * (glow - sky) + lamp_part(scene))
    np.testing.assert_allclose(light(scene, shaded=False), expected, rtol=1e-9)


def test_a_floor_and_a_wall_stand_in_for_a_part_of_the_sky(small_layout: Layout) -> None:
    scene = traced_tabletop(arranged_tabletop(small_layout, 0))
    alone = scene._replace(balls=scene.balls[:0])
    names = [thing.name for thing in arranged_tabletop(small_layout, 0).objects]
    number = names.index("glossy ball")
    place = tuple(scene.objects[number, BOUNDING_SPHERE : BOUNDING_SPHERE + 3])
    colour = scene.objects[number, COLOUR_COLUMN : COLOUR_COLUMN + 3]
    seen = {}
    for name, normal in (("up", UP), ("down", (0.0, 1.0, 0.0))):
        towards = tuple(-np.array(normal))
        seen[name] = np.array(scattered_light(alone, number, 0, place, normal, towards, ZERO, ZERO, False)) / colour
    sky = scene.surroundings[SKY_LIGHT]
    half = sky + 0.5 * WALL_FRACTION * (scene.surroundings[WALL_LIGHT] - sky)
    down = sky + FLOOR_FRACTION * (scene.surroundings[FLOOR_LIGHT] - sky)
    np.testing.assert_allclose(seen["down"], down + 0.5 * WALL_FRACTION * (scene.surroundings[WALL_LIGHT] - down))
    lamp = lamp_light(scene.lamp, np.array(place), np.array(UP)) / np.pi
    np.testing.assert_allclose(seen["up"], half + lamp)


def lamp_part(scene: TracedScene) -> Any:
    return lamp_light(scene.lamp, np.array(POINT), np.array(UP)) / np.pi


def test_the_colour_is_the_mean_of_the_texture_over_the_footprint() -> None:
    scene = scene_of(item("rectangle", view_from_object=FLOOR, texture="cover", texture_px=(64, 64), seed=1))
    normal = facing_normal(scene, 0, 0, (0.0, 40.0, 300.0), (0.0, 1.0, 0.0))
    np.testing.assert_allclose(normal, UP, atol=1e-12)
    np.testing.assert_allclose(facing_normal(scene, 0, 0, (0.0, 40.0, 300.0), (0.0, -1.0, 0.0)), (0.0, 1.0, 0.0))
    wide = surface_colour(scene, 0, 0, (0.0, 40.0, 300.0), normal, (0.0, 1.0, 0.0), (40.0, 0.0, 0.0), (0.0, 0.0, 50.0))
    np.testing.assert_allclose(wide, scene.texels[: 64 * 64].mean(axis=0), atol=0.05)


NONE = (1e-4, 0.0, 0.0)
CENTRE = np.array([0.0, 0.0, 300.0])


def seen(scene: TracedScene, start: Any, direction: Any) -> tuple[Any, int]:
    colour, number, _, _ = ray_colour(scene, tuple(start), tuple(direction), 0.0, NONE, NONE)
    return np.array(colour), number


def without_lamp(scene: TracedScene) -> TracedScene:
    lamp = scene.lamp.copy()
    lamp[RADIANCE] = 0.0
    return scene._replace(lamp=lamp)


def test_a_ray_that_misses_all_objects_shows_the_sky() -> None:
    scene = scene_of(item("sphere", tuple(CENTRE)))
    colour, number = seen(scene, (0.0, 0.0, 0.0), (0.5, 0.0, 1.0))
    assert number == NOTHING
    np.testing.assert_array_equal(colour, scene.surroundings[SKY_LIGHT])


@pytest.mark.parametrize("off", [0.0, 8.0, 15.0])
def test_glass_in_uniform_surroundings_shows_what_its_surfaces_transmit(off: float) -> None:
    scene = without_lamp(scene_of(item("sphere", tuple(CENTRE), material="glass")))
    colour, _ = seen(scene, (off, 0.0, 0.0), (0.0, 0.0, 1.0))
    cosine = np.sqrt(1.0 - (off / 20.0) ** 2)
    inner = np.sqrt(1.0 - (off / 20.0 / 1.5) ** 2)
    lost = 0.5 * (
        ((cosine - 1.5 * inner) / (cosine + 1.5 * inner)) ** 2 + ((inner - 1.5 * cosine) / (inner + 1.5 * cosine)) ** 2
    )
    np.testing.assert_allclose(colour, scene.surroundings[SKY_LIGHT] * (lost + (1.0 - lost) ** 2), rtol=1e-9)


def test_a_glass_ball_shows_what_is_behind_it_upside_down() -> None:
    # Focus of a ball: n r / (2 (n - 1)) = 1.5 radii from its centre, so 30 mm. Well behind it, the image is inverted.
    things = (
        item("sphere", (-30.0, 0.0, 400.0), size_mm=np.array([40.0] * 3), colour=np.array([0.9, 0.0, 0.0])),
        item("sphere", (30.0, 0.0, 400.0), size_mm=np.array([40.0] * 3), colour=np.array([0.0, 0.9, 0.0])),
    )
    scene = scene_of(item("sphere", tuple(CENTRE), material="glass"), *things)
    right, _ = seen(scene, (5.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    left, _ = seen(scene, (-5.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    assert right[0] > 2.0 * right[1]
    assert left[1] > 2.0 * left[0]


def test_a_glossy_ball_reflects_the_lamp_where_the_angles_are_equal() -> None:
    scene = scene_of(item("sphere", tuple(CENTRE), material="glossy", colour=np.array([0.2, 0.2, 0.2])))
    # The normal that bisects the angle between the directions to the camera and to the lamp.
    camera = np.zeros(3)
    normal = -CENTRE / 300.0
    for _ in range(50):
        point = CENTRE + 20.0 * normal
        ways = [end - point for end in (camera, scene.lamp[LAMP_CENTRE])]
        normal = ways[0] / np.linalg.norm(ways[0]) + ways[1] / np.linalg.norm(ways[1])
        normal /= np.linalg.norm(normal)
    shine, _ = seen(scene, camera, CENTRE + 20.0 * normal)
    side, _ = seen(scene, camera, CENTRE + 20.0 * normal + [4.0, 0.0, 0.0])
    assert (shine > side + 0.035 * scene.lamp[RADIANCE]).all()
    # Facing the camera: 4 % of the sky, and 96 % of the radiance of a matte ball.
    dark = without_lamp(scene)
    middle, _ = seen(dark, camera, (0.0, 0.0, 1.0))
    np.testing.assert_allclose(middle, dark.surroundings[SKY_LIGHT] * (0.04 + GLOSS * 0.96 * 0.2), rtol=1e-6)


def test_only_the_emitting_side_of_a_lamp_is_visible_in_glass() -> None:
    scene = scene_of(item("sphere", tuple(CENTRE), material="glass", size_mm=np.array([20.0] * 3)))
    lamp = scene.lamp
    for side, bright in ((1.0, True), (-1.0, False)):
        moved = lamp.copy()
        # A lamp straight behind the ball, visible through its centre.
        moved[LAMP_CENTRE] = CENTRE + np.array([0.0, 0.0, 200.0])
        moved[FACING] = [0.0, 0.0, -side]
        moved[FIRST_SIDE], moved[FIRST_SIDE + 1] = [40.0, 0.0, 0.0], [0.0, 40.0, 0.0]
        colour, _ = seen(scene._replace(lamp=moved), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
        assert (colour.max() > 50.0) == bright


def test_the_light_on_a_matte_ball_is_that_of_its_normal() -> None:
    scene = scene_of(item("sphere", tuple(CENTRE), colour=np.array([0.5, 0.5, 0.5])))
    colour, number = seen(scene, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    assert number == 0
    lamp = lamp_light(scene.lamp, np.array([0.0, 0.0, 280.0]), np.array([0.0, 0.0, -1.0])) / np.pi
    np.testing.assert_allclose(colour, 0.5 * (scene.surroundings[SKY_LIGHT] + lamp), rtol=1e-9)
