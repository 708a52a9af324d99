"""Ways of inserts and nuts to their seats: free ones pass, one through plastic and one that stays inside do not."""

from __future__ import annotations

from dataclasses import replace

import manifold3d
import numpy as np
import pytest

from mirrorcam.cad.checks.insertion import check_insertion, swept
from tests.cad.assembly.bought import item

WALL = manifold3d.Manifold.cube((20.0, 20.0, 10.0), center=True)
POCKET = manifold3d.Manifold.cylinder(3.0, 3.5, circular_segments=48).translate((0.0, 0.0, 2.0))
NUT = manifold3d.Manifold.cylinder(2.4, 3.0, circular_segments=6).translate((0.0, 0.0, 2.1))


def failed(way_mm: list[tuple[float, float, float]]) -> set[str]:
    nut = replace(item("nut", "M3", 2.4), way_out_mm=np.array(way_mm).reshape(-1, 3))
    checks = check_insertion([nut], {"mirror_holder": WALL - POCKET, "nut_01": NUT})
    return {name.removeprefix("device.") for name, check in checks.items() if check.passed is False}


def test_a_nut_comes_in_by_its_pocket_and_by_no_other_face() -> None:
    assert failed([(0.0, 0.0, 9.0)]) == set()
    assert failed([(0.0, 0.0, 9.0), (30.0, 0.0, 0.0)]) == set()
    assert failed([(0.0, 0.0, -12.0)]) == {"insertion_clash_mm3"}
    assert failed([(0.0, 0.0, 0.3)]) == {"threads_that_cannot_enter"}
    assert failed([]) == {"threads_that_cannot_enter"}


def test_a_part_in_pieces_is_one_part() -> None:
    nut = replace(item("nut", "M3", 2.4), way_out_mm=np.array([[0.0, 0.0, -12.0]]))
    halves = (WALL - POCKET).split_by_plane((1.0, 0.0, 0.0), 0.0)
    solids = {f"mirror_holder_{number}": half for number, half in enumerate(halves, start=1)} | {"nut_01": NUT}
    assert check_insertion([nut], solids)["device.insertion_clash_mm3"].value > 50.0


def test_a_sweep_fills_what_a_cube_passes_over() -> None:
    cube = manifold3d.Manifold.cube((1.0, 1.0, 1.0))
    assert swept(cube, np.array([[2.0, 0.0, 0.0], [0.0, 3.0, 0.0]])).volume() == pytest.approx(3.0 + 3.0)
