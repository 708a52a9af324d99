"""What rays see: closed forms of glass and gloss in an even surrounding."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirrorcam.render_scenes.preview.ray_colour import GLOSS, ray_colour
from mirrorcam.render_scenes.preview.traced_scene import (
    FACING,
    FIRST_SIDE,
    MIDDLE,
    RADIANCE,
    SKY_LIGHT,
    TracedScene,
    lamp_light,
)
from mirrorcam.render_scenes.preview.triangle_tree import NOTHING
from tests.render_scenes.preview.scenes import item, scene_of

NONE = (1e-4, 0.0, 0.0)
CENTRE = np.array([0.0, 0.0, 300.0])


def seen(scene: TracedScene, start: Any, direction: Any) -> tuple[Any, int]:
    colour, number, _, _ = ray_colour(scene, tuple(start), tuple(direction), 0.0, NONE, NONE)
    return np.array(colour), number


def without_lamp(scene: TracedScene) -> TracedScene:
    lamp = scene.lamp.copy()
    lamp[RADIANCE] = 0.0
    return scene._replace(lamp=lamp)


def test_beside_all_objects_there_is_the_sky() -> None:
    scene = scene_of(item("sphere", tuple(CENTRE)))
    colour, number = seen(scene, (0.0, 0.0, 0.0), (0.5, 0.0, 1.0))
    assert number == NOTHING
    np.testing.assert_array_equal(colour, scene.around[SKY_LIGHT])


@pytest.mark.parametrize("off", [0.0, 8.0, 15.0])
def test_glass_in_an_even_surrounding_keeps_what_both_its_surfaces_let_through(off: float) -> None:
    scene = without_lamp(scene_of(item("sphere", tuple(CENTRE), material="glass")))
    colour, _ = seen(scene, (off, 0.0, 0.0), (0.0, 0.0, 1.0))
    cosine = np.sqrt(1.0 - (off / 20.0) ** 2)
    inner = np.sqrt(1.0 - (off / 20.0 / 1.5) ** 2)
    lost = 0.5 * (
        ((cosine - 1.5 * inner) / (cosine + 1.5 * inner)) ** 2 + ((inner - 1.5 * cosine) / (inner + 1.5 * cosine)) ** 2
    )
    np.testing.assert_allclose(colour, scene.around[SKY_LIGHT] * (lost + (1.0 - lost) ** 2), rtol=1e-9)


def test_a_glass_ball_shows_what_is_behind_it_upside_down() -> None:
    # Focus of a ball: n r / (2 (n - 1)) = 1.5 radii from its middle, that is 30 mm. Well behind, right shows left.
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
    # From the camera's place, the normal that halves the angle between the ways to it and to the lamp.
    camera = np.zeros(3)
    normal = -CENTRE / 300.0
    for _ in range(50):
        point = CENTRE + 20.0 * normal
        ways = [end - point for end in (camera, scene.lamp[MIDDLE])]
        normal = ways[0] / np.linalg.norm(ways[0]) + ways[1] / np.linalg.norm(ways[1])
        normal /= np.linalg.norm(normal)
    shine, _ = seen(scene, camera, CENTRE + 20.0 * normal)
    side, _ = seen(scene, camera, CENTRE + 20.0 * normal + [4.0, 0.0, 0.0])
    assert (shine > side + 0.035 * scene.lamp[RADIANCE]).all()
    # Where it faces the camera: 4 % of the sky, and the rest of what a matte ball would have.
    dark = without_lamp(scene)
    middle, _ = seen(dark, camera, (0.0, 0.0, 1.0))
    np.testing.assert_allclose(middle, dark.around[SKY_LIGHT] * (0.04 + GLOSS * 0.96 * 0.2), rtol=1e-6)


def test_a_lamp_is_seen_in_glass_from_the_side_that_shines_alone() -> None:
    scene = scene_of(item("sphere", tuple(CENTRE), material="glass", size_mm=np.array([20.0] * 3)))
    lamp = scene.lamp
    for side, bright in ((1.0, True), (-1.0, False)):
        moved = lamp.copy()
        # A lamp right behind the ball, which is seen through its middle.
        moved[MIDDLE] = CENTRE + np.array([0.0, 0.0, 200.0])
        moved[FACING] = [0.0, 0.0, -side]
        moved[FIRST_SIDE], moved[FIRST_SIDE + 1] = [40.0, 0.0, 0.0], [0.0, 40.0, 0.0]
        colour, _ = seen(scene._replace(lamp=moved), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
        assert (colour.max() > 50.0) == bright


def test_the_light_on_a_matte_ball_is_that_of_its_normal() -> None:
    scene = scene_of(item("sphere", tuple(CENTRE), colour=np.array([0.5, 0.5, 0.5])))
    colour, number = seen(scene, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    assert number == 0
    lamp = lamp_light(scene.lamp, np.array([0.0, 0.0, 280.0]), np.array([0.0, 0.0, -1.0])) / np.pi
    np.testing.assert_allclose(colour, 0.5 * (scene.around[SKY_LIGHT] + lamp), rtol=1e-9)
