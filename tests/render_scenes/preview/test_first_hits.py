"""Rays and objects: closed forms, and normals and texture coordinates against differences and Mitsuba's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirrorcam.render_scenes.preview.first_hits import (
    LID,
    first_hit,
    interpolated_colour,
    is_hidden,
    normal_at,
    texture_uv,
)
from mirrorcam.render_scenes.preview.traced_scene import TracedScene, mean_colour
from mirrorcam.render_scenes.preview.triangle_tree import NOTHING
from mirrorcam.render_scenes.tabletop.objects import shapes_of
from mirrorcam.render_scenes.variant import use_variant
from tests.render_scenes.preview.scenes import TURN, item, scene_of

PLACE = np.array([5.0, -8.0, 300.0])
KINDS = ("rectangle", "sphere", "cylinder", "box", "leaves")


def hit(scene: TracedScene, start: Any, direction: Any) -> tuple[int, float, int]:
    found: tuple[int, float, int] = first_hit(
        scene.objects, scene.boxes, scene.triangles, tuple(start), tuple(direction), 0.0
    )
    return found


def test_each_kind_is_hit_where_a_formula_says() -> None:
    place = PLACE
    for kind, depth in (("rectangle", 0.0), ("sphere", 20.0), ("box", 30.0), ("cylinder", 30.0)):
        scene = scene_of(item(kind))
        # Along the object's z, from 200 mm above it, a little off its axis.
        start = place + TURN @ [3.0, 4.0, 200.0]
        number, length, part = hit(scene, start, TURN @ [0.0, 0.0, -1.0])
        high = np.sqrt(20.0**2 - 25.0) if kind == "sphere" else depth
        assert number == 0
        assert length == pytest.approx(200.0 - high)
        assert part == {"cylinder": LID, "box": 5}.get(kind, 0)
        assert hit(scene, start + TURN @ [40.0, 0.0, 0.0], TURN @ [0.0, 0.0, -1.0])[0] == NOTHING
    # From the side: a cylinder has the diameter x and the length z, and no lid below.
    scene = scene_of(item("cylinder"))
    for height, met in ((29.0, True), (31.0, False)):
        number, length, _ = hit(scene, place + TURN @ [-100.0, 0.0, height], TURN @ [1.0, 0.0, 0.0])
        assert (number == 0) == met
        assert not met or length == pytest.approx(80.0)
    _, length, part = hit(scene, place + TURN @ [0.0, 0.0, -100.0], TURN @ [0.0, 0.0, 1.0])
    assert length == pytest.approx(130.0)
    assert part == LID


def test_the_nearest_of_several_is_hit_and_hides_the_others() -> None:
    scene = scene_of(item("sphere", (0.0, 0.0, 400.0)), item("box", (0.0, 0.0, 300.0)))
    assert hit(scene, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))[0] == 1
    assert hit(scene, (0.0, 0.0, 350.0), (0.0, 0.0, 1.0))[0] == 0
    tables = scene.objects, scene.boxes, scene.triangles
    assert is_hidden(*tables, 0b11, (0.0, 0.0, 0.0), (0.0, 0.0, 400.0), 0.0)
    assert is_hidden(*tables, 0b10, (0.0, 0.0, 0.0), (0.0, 0.0, 400.0), 0.0)
    assert not is_hidden(*tables, 0b01, (0.0, 0.0, 0.0), (0.0, 0.0, 350.0), 0.0)
    assert not is_hidden(*tables, 0b10, (0.0, 0.0, 0.0), (0.0, 0.0, 200.0), 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_normals_and_texture_coordinates_are_those_of_mitsuba(kind: str) -> None:
    use_variant()
    import mitsuba as mi

    thing = item(kind, texture=None if kind == "leaves" else "globe", texture_px=(64, 64), seed=3)
    scene = scene_of(thing)
    reference = mi.load_dict({"type": "scene"} | {f"s{k}": s for k, s in enumerate(shapes_of(thing, np.eye(3)))})
    random = np.random.default_rng(2)
    met = 0
    for _ in range(60):
        start = PLACE + 200.0 * TURN @ _unit(random.standard_normal(3) + np.array([0.0, 0.0, 0.8]))
        direction = _unit(PLACE + random.uniform(-22.0, 22.0, 3) - start)
        number, length, part = hit(scene, start, direction)
        found = reference.ray_intersect(mi.Ray3f(mi.Point3f(*start.tolist()), mi.Vector3f(*direction.tolist())))
        depth = float(np.ravel(found.t)[0])
        assert (number == NOTHING) == (not np.isfinite(depth))
        if number == NOTHING:
            continue
        met += 1
        assert length == pytest.approx(depth, rel=1e-4)
        point = tuple((start + length * direction).tolist())
        normal = _unit(np.array(normal_at(scene.objects, scene.triangles, 0, part, point)))
        assert abs(normal @ np.ravel(found.n)) == pytest.approx(1.0, abs=1e-3)
        if kind != "leaves":
            place, _, _ = texture_uv(scene.objects, 0, part, point, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
            np.testing.assert_allclose(place, np.ravel(found.uv), atol=2e-3)
    assert met > 10


WIDTH, DEPTH, HEIGHT = 40.0, 50.0, 60.0
PICTURE_AT = {
    "rectangle": lambda x, y, z: (0.5 + x / WIDTH, 0.5 + y / DEPTH),
    "sphere": lambda x, y, z: (np.arctan2(y, x) / (2.0 * np.pi) % 1.0, np.arccos(2.0 * z / WIDTH) / np.pi),
    "cylinder": lambda x, y, z: (np.arctan2(y, x) / (2.0 * np.pi) % 1.0, 0.5 - z / HEIGHT),
}
"""Fractions of the columns and of the rows of a picture that is at a point of an object."""


@pytest.mark.parametrize("kind", PICTURE_AT)
def test_a_picture_is_where_its_description_says_in_both_renderers(kind: str) -> None:
    use_variant(colour=True)
    import mitsuba as mi

    # A picture whose red is the fraction of its columns, and whose green is the fraction of its rows.
    fractions = (np.arange(256) + 0.5) / 256.0
    picture = np.zeros((256, 256, 3))
    picture[..., 0], picture[..., 1] = fractions, fractions[:, None]
    thing = item(kind, texture=picture)
    scene = scene_of(thing)
    reference = mi.load_dict({"type": "scene"} | {f"s{k}": s for k, s in enumerate(shapes_of(thing, np.eye(3)))})
    random, met = np.random.default_rng(2), 0
    for _ in range(60):
        start = PLACE + 200.0 * TURN @ _unit(random.standard_normal(3) + np.array([0.0, 0.0, 0.8]))
        direction = _unit(PLACE + random.uniform(-22.0, 22.0, 3) - start)
        number, length, part = hit(scene, start, direction)
        if number == NOTHING or part == LID:
            continue
        point, none = start + length * direction, (0.0, 0.0, 0.0)
        expected = PICTURE_AT[kind](*(TURN.T @ (point - PLACE)))
        if not 0.01 < expected[0] < 0.99:
            continue
        met += 1
        place, _, _ = texture_uv(scene.objects, 0, part, tuple(point), none, none)
        traced = mean_colour(scene.texels, scene.scales, scene.textures, 0, place, (0.0, 0.0), (0.0, 0.0))
        np.testing.assert_allclose(traced, (*expected, 0.0), atol=3e-3)
        ray = mi.Ray3f(mi.Point3f(*start.tolist()), mi.Vector3f(*direction.tolist()))
        found = reference.ray_intersect(ray)
        np.testing.assert_allclose(np.ravel(found.bsdf(ray).eval_diffuse_reflectance(found)), traced, atol=3e-3)
    assert met > 10


@pytest.mark.parametrize("kind", KINDS[:4])
def test_texture_coordinates_change_as_differences_say(kind: str) -> None:
    scene = scene_of(item(kind, texture="globe", texture_px=(64, 64)))
    start, direction = np.array([10.0, 0.0, 0.0]), _unit(np.array([-0.01, -0.02, 1.0]))
    number, length, part = hit(scene, start, direction)
    assert number == 0
    point = start + length * direction
    normal = _unit(np.array(normal_at(scene.objects, scene.triangles, 0, part, tuple(point))))
    steps = [_unit(np.cross(normal, [1.0, 0.2, 0.3])), _unit(np.cross(normal, [0.1, 1.0, 0.3]))]
    _, *changes = texture_uv(scene.objects, 0, part, tuple(point), *(tuple(step) for step in steps))
    none = (0.0, 0.0, 0.0)
    for step, change in zip(steps, changes, strict=True):
        ends = [texture_uv(scene.objects, 0, part, tuple(point + h * step), none, none)[0] for h in (1e-4, -1e-4)]
        np.testing.assert_allclose(change, (np.array(ends[0]) - ends[1]) / 2e-4, atol=1e-6)


def test_colours_of_triangles_are_between_those_of_their_corners() -> None:
    scene = scene_of(item("leaves", seed=3))
    row = scene.triangles[7]
    unit = scene.objects[0, 11:23].reshape(3, 4)
    for weights in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.2, 0.3, 0.5)):
        inside = row[:3] + weights[1] * row[3:6] + weights[2] * row[6:9]
        point = np.linalg.solve(unit[:, :3], inside - unit[:, 3])
        found = interpolated_colour(scene.objects, scene.triangles, 0, 7, tuple(point))
        np.testing.assert_allclose(found, np.array(weights) @ row[9:18].reshape(3, 3), atol=1e-9)


def _unit(vector: Any) -> Any:
    return np.asarray(vector) / np.linalg.norm(vector)
