"""Plans of parts: their identity depends on numbers and recipe, not on the module; plain data only.

Connections of parts: fixed unless a sliding range is given.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from build123d import Box, Part

from mirrorcam.cad.plan.part_plan import Connection, PartPlan, plain, recipe
from mirrorcam.core.values import FloatArray


@dataclass(frozen=True)
class Cube:
    side_mm: float
    corner: FloatArray


@recipe("tests.cube")
def make_cube(plan: Cube) -> Part:
    return Part(Box(plan.side_mm, plan.side_mm, plan.side_mm).solids())


@recipe("tests.cube")
def make_moved_cube(plan: Cube) -> Part:
    return make_cube(plan)


def make_unnamed_cube(plan: Cube) -> Part:
    return make_cube(plan)


def part(plan: Cube) -> PartPlan:
    return PartPlan("cube", "Cube", "MC-99", plan, make_cube, np.eye(4), np.zeros(3), (0.5, 0.5, 0.5))


def test_the_same_numbers_and_recipe_are_the_same_part_wherever_the_code_stands() -> None:
    cube = part(Cube(10.0, np.zeros(3)))
    assert len(cube.identity) == 12
    assert part(Cube(10.0, np.zeros(3))).identity == cube.identity
    assert replace(cube, make=make_moved_cube, title="Die").identity == cube.identity
    assert replace(cube, make=make_unnamed_cube).identity != cube.identity
    assert part(Cube(10.0, np.array([0.0, 0.0, 1e-9]))).identity != cube.identity


def test_a_plan_becomes_plain_data() -> None:
    assert plain(Cube(np.float64(10.0), np.arange(3.0))) == {"side_mm": 10.0, "corner": [0.0, 1.0, 2.0]}
    assert plain((None, "a", True, {1: make_cube})) == [None, "a", True, {"1": "tests.cube"}]
    with pytest.raises(TypeError, match="a plan contains a set, expected numbers"):
        plain({1.0})


def test_a_connection_does_not_slide_by_itself() -> None:
    assert Connection("a", "mount", "clip", np.eye(4), np.eye(4)).slides_mm == 0.0
