"""Torques of screws in plastic and their limits, against hand calculations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.cad.assembly.catalogue import purchased_items
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import FORMING, BoughtKind, PurchasedItem
from mirrorcam.cad.plan.tightening import Tightening, tightenings
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera_library import read_body

PRESSURE = 0.25 * HARDWARE.printer.plastic_strength_mpa


def item(kind: BoughtKind, size: str, length_mm: float, at_mm: tuple[float, float, float]) -> PurchasedItem:
    frame: FloatArray = np.eye(4)
    frame[:3, 3] = at_mm
    return PurchasedItem(kind, size, length_mm, frame, np.zeros(3), ("mount", "mirror_holder"))


def arm_mm(bearing_mm: float) -> float:
    """The factor of VDI 2230-1 for M3, with a pitch diameter of 2.675 mm."""
    return 0.16 * 0.5 + 0.58 * 2.675 * 0.12 + bearing_mm / 2.0 * 0.12


def torque(*items: PurchasedItem) -> Tightening:
    found = tightenings(items, HARDWARE)[0]
    assert found is not None
    return found


def test_a_head_without_a_washer_presses_on_a_ring_of_plastic() -> None:
    screw, insert = item("screw", "M3", 10.0, (0, 0, 4)), item("insert", "M3", 5.7, (0, 0, 0))
    found = torque(screw, insert)
    force = PRESSURE * np.pi / 4.0 * (5.5**2 - 3.4**2)
    assert found.torque_nm == pytest.approx(force * arm_mm(4.45) / 1000.0, rel=1e-3)
    assert found.limit == "plastic under the head"


def test_a_washer_leaves_the_limit_to_the_insert_or_the_nut() -> None:
    screw, washer = item("screw", "M3", 8.0, (0, 0, 2)), item("washer", "M3", 0.5, (0, 0, 1.5))
    insert, nut = item("insert", "M3", 5.7, (0, 0, 0)), item("nut", "M3", 2.4, (0, 0, -3))
    in_insert, in_nut = torque(screw, washer, insert), torque(screw, washer, nut)
    shear = 0.5 * PRESSURE / np.sqrt(3.0) * np.pi * 4.0 * 5.7
    assert in_insert.torque_nm == pytest.approx(shear * arm_mm(4.45) / 1000.0, rel=1e-3)
    assert in_insert.limit == "plastic round the insert"
    under = PRESSURE * (np.sqrt(3.0) / 2.0 * 5.5**2 - np.pi / 4.0 * 3.4**2)
    assert in_nut.torque_nm == pytest.approx(under * arm_mm(4.45) / 1000.0, rel=1e-3)
    assert in_nut.limit == "plastic under the nut"


def test_items_on_a_different_axis_or_beyond_the_tip_do_not_count() -> None:
    screw = item("screw", "M3", 8.0, (0, 0, 2))
    aside, beyond = item("washer", "M3", 0.5, (1, 0, 1.5)), item("washer", "M3", 0.5, (0, 0, -7))
    assert torque(screw, aside, beyond) == torque(screw)


def test_threads_in_plastic_and_screws_that_press_have_limits_of_their_own() -> None:
    forming = item("screw", f"M2{FORMING}", 8.0, (0, 0, 0))
    found = tightenings([forming], HARDWARE.replaced(camera=read_body("board_38")))[0]
    assert found is not None
    assert found.limit == "thread in the plastic"
    assert 0.01 < found.torque_nm < 0.1
    pressing = replace(item("screw", "M3", 10.0, (0, 0, 0)), joins=("camera_clip",))
    assert torque(pressing).limit == "the camera's body"
    assert tightenings([item("insert", "M3", 5.7, (0, 0, 0))], HARDWARE) == (None,)


def test_weaker_plastic_takes_less_in_proportion() -> None:
    screw = item("screw", "M3", 10.0, (0, 0, 4))
    half = HARDWARE.replaced(printer=HARDWARE.printer.replaced(plastic_strength_mpa=25.0))
    weaker = tightenings([screw], half)[0]
    assert weaker is not None
    assert weaker.torque_nm == pytest.approx(torque(screw).torque_nm / 2.0)


def test_a_torque_is_stated_rounded_down() -> None:
    assert Tightening(0.1799, "").text == "0.17 N m"
    assert Tightening(0.0119, "").text == "0.011 N m"
    assert Tightening(0.1, "").text == "0.1 N m"


def test_an_unknown_thread_is_refused() -> None:
    with pytest.raises(ValueError, match="does not name a thread"):
        tightenings([item("screw", "M7", 10.0, (0, 0, 0))], HARDWARE)


def test_every_screw_of_a_device_has_a_tightening_torque(device: Device) -> None:
    items = purchased_items(device)
    limits = [(item, found) for item, found in zip(items, tightenings(items, HARDWARE), strict=True) if found]
    assert len(limits) == sum(item.kind == "screw" for item in items)
    on_skins = [found for item, found in limits if item.joins == ("mount", "mirror_holder")]
    assert {found.limit for found in on_skins} == {"plastic under the head"}
    assert all(0.01 < found.torque_nm < 0.5 for _, found in limits)
