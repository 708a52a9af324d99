"""What stands on the desk: at the depths asked for, where all views see it, in proportion to the camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.poses import fields
from mirrorcam.render_scenes.tabletop.objects import Thing
from mirrorcam.render_scenes.tabletop.tabletop import NamedMesh, desk, nearest_mm

DEPTHS = (310.0, 380.0, 520.0)
FIXED = ("wall", "desk")


def standing(things: tuple[Thing, ...]) -> list[Thing]:
    return [thing for thing in things if thing.name not in FIXED]


def test_things_stand_at_the_given_depths(default_layout: Layout) -> None:
    things = desk(default_layout, DEPTHS, 3).things
    depths = [float(thing.view_from_thing[2, 3]) for thing in standing(things)]
    assert set(depths) == set(DEPTHS)
    assert {thing.kind for thing in things} == {"sphere", "cylinder", "box", "rectangle", "leaves"}
    assert {thing.material for thing in things} == {"matte", "glossy", "glass"}
    wall = next(thing for thing in things if thing.name == "wall")
    assert wall.view_from_thing[2, 3] == pytest.approx(1.2 * 520.0)


@pytest.mark.parametrize("seed", range(5))
def test_every_view_sees_some_of_everything(default_layout: Layout, seed: int) -> None:
    for thing in standing(desk(default_layout, DEPTHS, seed).things):
        x, y, depth = thing.view_from_thing[:3, 3]
        common = shapely.intersection_all(fields(default_layout, float(depth)))
        around = shapely.Point(x, y).buffer(float(thing.size_mm.max()) / 2.0)
        assert common.intersection(around).area > 0.3 * around.area, thing.name


def test_all_stands_on_the_desk_and_before_the_wall(default_layout: Layout) -> None:
    things = desk(default_layout, DEPTHS, 3).things
    top_mm = next(thing for thing in things if thing.name == "desk").view_from_thing[1, 3]
    balls = [thing for thing in things if thing.kind == "sphere"]
    assert len(balls) == 3
    for ball in balls:
        assert ball.view_from_thing[1, 3] + ball.size_mm[0] / 2.0 == pytest.approx(top_mm)
    for thing in standing(things):
        assert thing.view_from_thing[2, 3] + thing.size_mm.max() / 2.0 < 1.2 * 520.0


def test_a_seed_moves_and_colours_but_leaves_the_depths(default_layout: Layout) -> None:
    one, again, other = (desk(default_layout, DEPTHS, seed).things for seed in (3, 3, 4))
    assert one == again
    for thing, moved in zip(one[2:], other[2:], strict=True):
        shift = thing.view_from_thing[:3, 3] - moved.view_from_thing[:3, 3]
        assert shift[0] != 0.0
        assert np.abs(shift[0]) < 0.15 * thing.view_from_thing[2, 3]
        assert shift[2] == 0.0
        assert thing.seed != moved.seed


def test_one_depth_is_enough(default_layout: Layout) -> None:
    assert {float(thing.view_from_thing[2, 3]) for thing in standing(desk(default_layout, (400.0,), 0).things)} == {
        400.0
    }


def test_a_named_mesh_stands_where_it_is_put(default_layout: Layout) -> None:
    named = NamedMesh(file=Path("vase.stl"), place_in_view_mm=np.array([10.0, -30.0, 350.0]))
    *others, placed = desk(default_layout, DEPTHS, 3, (named,)).things
    assert tuple(others) == desk(default_layout, DEPTHS, 3).things
    assert placed.view_from_thing[:3, 3].tolist() == [10.0, -30.0, 350.0]
    up = placed.view_from_thing[:3, :3] @ [0.0, 0.0, 1.0]
    assert up.tolist() == [0.0, -1.0, 0.0]
    assert np.linalg.det(placed.view_from_thing[:3, :3]) == pytest.approx(1.0)
    unplaced = desk(default_layout, DEPTHS, 3, (NamedMesh(file=Path("vase.stl")),)).things[-1]
    assert unplaced.view_from_thing[2, 3] == 380.0


def test_depths_that_make_no_desk_are_refused(default_layout: Layout) -> None:
    with pytest.raises(InputError, match=r"^depths 400, 300 mm: expected some that grow$"):
        desk(default_layout, (400.0, 300.0), 0)
    with pytest.raises(InputError, match=r"^depths  mm: expected some that grow$"):
        desk(default_layout, (), 0)
    with pytest.raises(InputError, match=r"^depth 80 mm: a thing there would touch the camera, expected 90 or more$"):
        desk(default_layout, (80.0, 300.0), 0)
    assert nearest_mm(default_layout) == pytest.approx(67.46, abs=0.01)
