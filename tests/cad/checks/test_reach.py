"""Paths of inserts and nuts to their seats: free ones pass; one through plastic and one that stays inside fail.

Reach of tools: a former channel of the clip fails; a driver needs a straight path, a key its swing, a nut a free path.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import manifold3d
import numpy as np
import pytest

from mirrorcam.cad.checks.reach import IRON_MM, check_insertion, check_tool_reach, swept, tool_clash_mm3
from mirrorcam.cad.plan.part_plan import PurchasedItem
from tests.cad.assembly.bought import item

WALL = manifold3d.Manifold.cube((20.0, 20.0, 10.0), center=True)
POCKET = manifold3d.Manifold.cylinder(3.0, 3.5, circular_segments=48).translate((0.0, 0.0, 2.0))
NUT = manifold3d.Manifold.cylinder(2.4, 3.0, circular_segments=6).translate((0.0, 0.0, 2.1))


def failed_to_enter(moves_mm: list[tuple[float, float, float]]) -> set[str]:
    nut = replace(item("nut", "M3", 2.4), exit_moves_mm=np.array(moves_mm).reshape(-1, 3))
    checks = check_insertion([nut], {"mirror_holder": WALL - POCKET, "nut_01": NUT})
    return {name.removeprefix("device.") for name, check in checks.items() if check.passed is False}


def test_a_nut_comes_in_by_its_pocket_and_by_no_other_face() -> None:
    assert failed_to_enter([(0.0, 0.0, 9.0)]) == set()
    assert failed_to_enter([(0.0, 0.0, 9.0), (30.0, 0.0, 0.0)]) == set()
    assert failed_to_enter([(0.0, 0.0, -12.0)]) == {"insertion_clash_mm3"}
    assert failed_to_enter([(0.0, 0.0, 0.3)]) == {"threads_that_cannot_enter"}
    assert failed_to_enter([]) == {"threads_that_cannot_enter"}


def test_a_part_in_pieces_is_one_part() -> None:
    nut = replace(item("nut", "M3", 2.4), exit_moves_mm=np.array([[0.0, 0.0, -12.0]]))
    halves = (WALL - POCKET).split_by_plane((1.0, 0.0, 0.0), 0.0)
    solids = {f"mirror_holder_{number}": half for number, half in enumerate(halves, start=1)} | {"nut_01": NUT}
    assert check_insertion([nut], solids)["device.insertion_clash_mm3"].value > 50.0


def test_a_sweep_fills_the_path_of_a_cube() -> None:
    solid = manifold3d.Manifold.cube((1.0, 1.0, 1.0))
    assert swept(solid, np.array([[2.0, 0.0, 0.0], [0.0, 3.0, 0.0]])).volume() == pytest.approx(3.0 + 3.0)


Solids = Mapping[str, manifold3d.Manifold]


def cube(low: tuple[float, float, float], high: tuple[float, float, float]) -> manifold3d.Manifold:
    size = np.subtract(high, low)
    return manifold3d.Manifold.cube(tuple(size)).translate(low)


def placed(
    one: PurchasedItem, joins: tuple[str, ...], origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> PurchasedItem:
    frame = np.eye(4)
    frame[:3, 3] = origin
    return replace(one, joins=joins, rig_from_item=frame)


def failed(items: list[PurchasedItem], solids: Solids) -> set[str]:
    return {name for name, check in check_tool_reach(items, solids).items() if check.passed is False}


def old_channel(slot_mm: float) -> manifold3d.Manifold:
    """The clip's former floor: inserts at z = 0, 27.8 mm below lips with a slot between them, walls 29.4 mm apart."""
    outer = cube((-50.0, -17.0, -8.0), (50.0, 17.0, 27.8))
    inner = cube((-47.0, -14.7, 0.0), (51.0, 14.7, 25.0))
    slot = cube((-47.0, -slot_mm / 2.0, 24.0), (51.0, slot_mm / 2.0, 30.0))
    return outer - inner - slot


def test_the_old_channel_lets_no_iron_at_its_inserts() -> None:
    """Next to the cable, with 2.9 mm round the insert: the iron's barrel meets the lip and would melt it."""
    inserts = [placed(item("insert", "M3", 5.7), ("camera_clip",), (x, -8.5, 0.0)) for x in (-31.0, 31.0)]
    found = failed(inserts, {"camera_clip": old_channel(23.0)})
    assert found == {"device.tool_clash_mm3", "insert_01.tool_clash_mm3", "insert_02.tool_clash_mm3"}
    assert failed(inserts, {"camera_clip": cube((-50.0, -17.0, -8.0), (50.0, 17.0, 0.0))}) == set()


def test_an_iron_needs_as_much_room_as_its_barrel() -> None:
    insert = placed(item("insert", "M3", 5.7), ("mount",))
    for beside, expected in ((0.2, 0.0), (-0.5, 1.0)):
        wall = IRON_MM[0] / 2.0 + beside
        part = cube((-20.0, -20.0, -8.0), (20.0, 20.0, 0.0)) + cube((wall, -20.0, -8.0), (20.0, 20.0, 30.0))
        assert (tool_clash_mm3(insert, {"mount": part}) > 0.0) == bool(expected)
        # Pieces of later steps do not count.
        assert tool_clash_mm3(insert, {"mount": cube((-9.0, -9.0, -8.0), (9.0, 9.0, 0.0)), "camera_clip": part}) == 0.0


@pytest.mark.parametrize(
    ("over_mm", "wide_mm", "reached"),
    [(30.0, 100.0, True), (30.0, 9.0, False), (15.0, 100.0, False), (120.0, 9.0, False), (200.0, 40.0, True)],
)
def test_a_screw_is_turned_by_a_straight_driver_or_a_key_that_can_swing(
    over_mm: float, wide_mm: float, reached: bool
) -> None:
    """A key swings under a roof if it is high enough and the walls are apart; a shaft has space for a driver."""
    screw = placed(item("screw", "M3", 12.0), ("mount", "camera_clip"))
    floor = cube((-60.0, -60.0, -5.0), (60.0, 60.0, 0.0))
    walls = cube((-60.0, -60.0, 0.0), (60.0, 60.0, over_mm)) - cube(
        (-60.0, -wide_mm / 2.0, -1.0), (60.0, wide_mm / 2.0, 300.0)
    )
    roof = cube((-60.0, -60.0, over_mm), (60.0, 60.0, over_mm + 3.0))
    part = floor + walls + roof
    hole = manifold3d.Manifold.cylinder(30.0, 1.7, circular_segments=24).translate((0.0, 0.0, -20.0))
    clash = tool_clash_mm3(screw, {"mount": part - hole})
    assert (clash == 0.0) == reached


def test_a_deep_narrow_shaft_takes_a_blade_but_not_its_handle_below_the_rim() -> None:
    screw = placed(item("screw", "M3", 12.0), ("mount", "camera_clip"))
    for deep, reached in ((60.0, True), (100.0, False)):
        block = cube((-15.0, -15.0, -5.0), (15.0, 15.0, deep))
        shaft = manifold3d.Manifold.cylinder(200.0, 3.2, circular_segments=48).translate((0.0, 0.0, 0.0))
        assert (tool_clash_mm3(screw, {"mount": block - shaft}) == 0.0) == reached


def test_a_nut_needs_a_free_path_for_the_rod_that_pushes_it() -> None:
    way = np.array([[0.0, 0.0, 10.0], [0.0, 20.0, 0.0]])
    nut = replace(placed(item("nut", "M3", 2.4), ("camera_clip",)), exit_moves_mm=way)
    floor = cube((-9.0, -9.0, -5.0), (9.0, 9.0, 0.0)) - cube((-3.2, -3.2, -3.0), (3.2, 3.2, 1.0))
    assert tool_clash_mm3(nut, {"camera_clip": floor}) == 0.0
    beyond = floor + cube((-9.0, 40.0, -5.0), (9.0, 44.0, 12.0))
    assert tool_clash_mm3(nut, {"camera_clip": beyond}) > 10.0


def test_washers_and_pins_need_no_tool() -> None:
    block = {"mount": cube((-9.0, -9.0, -9.0), (9.0, 9.0, 90.0))}
    assert tool_clash_mm3(placed(item("washer", "M3", 0.5), ("mount",)), block) == 0.0
    assert tool_clash_mm3(placed(item("pin", "3", 16.0), ("mount",)), block) == 0.0


def test_a_key_for_a_countersunk_screw_needs_less_room_over_it() -> None:
    """19 mm above an M4 screw: the key's arm is 18 mm long, and 20 mm for a socket cap head."""
    roof = cube((-90.0, -90.0, 19.0), (90.0, 90.0, 30.0))
    for size, reached in (("M4 countersunk", True), ("M4", False)):
        screw = placed(item("screw", size, 16.0), ("adapter_hook", "adapter_jaw"))
        assert (tool_clash_mm3(screw, {"adapter_hook": roof}) == 0.0) == reached
