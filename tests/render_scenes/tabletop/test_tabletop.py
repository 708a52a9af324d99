"""Objects of the tabletop scene: at the requested depths, visible in all views, in proportion to the camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.fields_of_view import fields
from mirrorcam.render_scenes.tabletop.objects import SceneObject
from mirrorcam.render_scenes.tabletop.tabletop import UserMesh, arrange_tabletop, clear_depth_mm

DEPTHS = (310.0, 380.0, 520.0)
FIXED = ("wall", "desk")


def standing(objects: tuple[SceneObject, ...]) -> list[SceneObject]:
    return [item for item in objects if item.name not in FIXED]


def test_things_stand_at_the_given_depths(default_layout: Layout) -> None:
    objects = arrange_tabletop(default_layout, DEPTHS, 3).objects
    depths = [float(item.view_from_object[2, 3]) for item in standing(objects)]
    assert set(depths) == set(DEPTHS)
    assert {item.kind for item in objects} == {"sphere", "cylinder", "box", "rectangle", "leaves"}
    assert {item.material for item in objects} == {"matte", "glossy", "glass"}
    wall = next(item for item in objects if item.name == "wall")
    assert wall.view_from_object[2, 3] == pytest.approx(1.2 * 520.0)


@pytest.mark.parametrize("seed", range(5))
def test_every_view_sees_some_of_everything(default_layout: Layout, seed: int) -> None:
    for item in standing(arrange_tabletop(default_layout, DEPTHS, seed).objects):
        x, y, depth = item.view_from_object[:3, 3]
        common = shapely.intersection_all(fields(default_layout, float(depth)))
        around = shapely.Point(x, y).buffer(float(item.size_mm.max()) / 2.0)
        assert common.intersection(around).area > 0.3 * around.area, item.name


def test_all_stands_on_the_desk_and_before_the_wall(default_layout: Layout) -> None:
    objects = arrange_tabletop(default_layout, DEPTHS, 3).objects
    top_mm = next(item for item in objects if item.name == "desk").view_from_object[1, 3]
    balls = [item for item in objects if item.kind == "sphere"]
    assert len(balls) == 3
    for ball in balls:
        assert ball.view_from_object[1, 3] + ball.size_mm[0] / 2.0 == pytest.approx(top_mm)
    for item in standing(objects):
        assert item.view_from_object[2, 3] + item.size_mm.max() / 2.0 < 1.2 * 520.0


def test_a_seed_moves_and_colours_but_leaves_the_depths(default_layout: Layout) -> None:
    one, again, other = (arrange_tabletop(default_layout, DEPTHS, seed).objects for seed in (3, 3, 4))
    assert one == again
    for item, moved in zip(one[2:], other[2:], strict=True):
        shift = item.view_from_object[:3, 3] - moved.view_from_object[:3, 3]
        assert shift[0] != 0.0
        assert np.abs(shift[0]) < 0.15 * item.view_from_object[2, 3]
        assert shift[2] == 0.0
        assert item.seed != moved.seed


def test_one_depth_is_enough(default_layout: Layout) -> None:
    assert {
        float(item.view_from_object[2, 3]) for item in standing(arrange_tabletop(default_layout, (400.0,), 0).objects)
    } == {400.0}


def test_a_named_mesh_stands_where_it_is_put(default_layout: Layout) -> None:
    named = UserMesh(file=Path("vase.stl"), position_in_view_mm=np.array([10.0, -30.0, 350.0]))
    *others, placed = arrange_tabletop(default_layout, DEPTHS, 3, (named,)).objects
    assert tuple(others) == arrange_tabletop(default_layout, DEPTHS, 3).objects
    assert placed.view_from_object[:3, 3].tolist() == [10.0, -30.0, 350.0]
    up = placed.view_from_object[:3, :3] @ [0.0, 0.0, 1.0]
    assert up.tolist() == [0.0, -1.0, 0.0]
    assert np.linalg.det(placed.view_from_object[:3, :3]) == pytest.approx(1.0)
    unplaced = arrange_tabletop(default_layout, DEPTHS, 3, (UserMesh(file=Path("vase.stl")),)).objects[-1]
    assert unplaced.view_from_object[2, 3] == 380.0


def test_depths_that_make_no_tabletop_are_refused(default_layout: Layout) -> None:
    with pytest.raises(InputError, match=r"^depths 400, 300 mm: expected one or more, ascending$"):
        arrange_tabletop(default_layout, (400.0, 300.0), 0)
    with pytest.raises(InputError, match=r"^depths  mm: expected one or more, ascending$"):
        arrange_tabletop(default_layout, (), 0)
    with pytest.raises(InputError, match=r"^depth 8 mm: an object there would touch the camera, expected 8 or more$"):
        arrange_tabletop(default_layout, (8.0, 300.0), 0)
    assert clear_depth_mm(default_layout) == pytest.approx(20.0 - 13.77, abs=0.01)
