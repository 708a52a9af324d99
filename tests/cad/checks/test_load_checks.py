"""Checks of the nest: the default passes, and each check fails once.

Checks of the back against hand calculation: a device that falls, a screw that does not hold, a neck too thin.
"""

from __future__ import annotations

from dataclasses import replace

import manifold3d
import numpy as np
import pytest

from mirrorcam.cad.assembly.catalogue import purchased_items
from mirrorcam.cad.assembly.components import camera_solid, item_names, tessellated
from mirrorcam.cad.assembly.device_plan import Device, plan_device
from mirrorcam.cad.backs.back import CriticalSection, Stand
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.checks.load_checks import (
    check_aim,
    check_back,
    check_nest,
    check_rest,
    tipping_angle_deg,
    tripod_turns,
)
from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.parts.part_solids import make_clip
from mirrorcam.cad.plan.back_table import DeskBack
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import MassProperties
from mirrorcam.optics.geometry.camera_library import read_body
from mirrorcam.optics.geometry.layout import Layout
from tests.cad.backs.planned_blocks import planned_back

UP = np.array([0.0, 0.0, 1.0])


def test_the_default_camera_is_held_and_repeats_within_what_the_guide_says(default_layout: Layout) -> None:
    checks = check_nest(plan_clip(HARDWARE), default_layout, HARDWARE)
    assert [name for name, check in checks.items() if check.passed is False] == []
    assert 0.02 < checks["camera_clip.reclamped_mm"].value < 0.05
    assert 0.04 < checks["camera_clip.reclamped_deg"].value < 0.1
    assert 1.0 < checks["camera_clip.reclamped_px"].value < 3.0


def test_a_heavier_camera_than_planned_lets_go_and_a_brittle_plastic_is_bent_too_far(default_layout: Layout) -> None:
    clip = plan_clip(HARDWARE)
    heavy = HARDWARE.replaced(camera=HARDWARE.camera.replaced(mass_g=300.0))
    brittle = HARDWARE.replaced(printer=HARDWARE.printer.replaced(plastic_strain=0.002))
    assert not check_nest(clip, default_layout, heavy)["camera_clip.contact_n"].passed
    assert not check_nest(clip, default_layout, brittle)["camera_clip.leaf_strain"].passed


def test_a_board_has_no_points_to_check_but_repeats_as_its_holes_let_it(default_layout: Layout) -> None:
    board = HARDWARE.replaced(camera=read_body("board_38"))
    checks = check_nest(plan_clip(board), default_layout, board)
    assert {name: check for name, check in checks.items() if check.limit is not None} == {}
    assert 0.03 < checks["camera_clip.reclamped_mm"].value < 0.1
    assert checks["camera_clip.reclamped_between_views_px"].value < checks["camera_clip.reclamped_px"].value


def test_a_lens_too_far_from_its_rest_fails() -> None:
    hardware = HARDWARE.replaced(camera=read_body("pi_hq_cs"))
    clip = solid_of(tessellated(make_clip(plan_clip(hardware))))
    camera = solid_of(tessellated(camera_solid(hardware.camera)))
    check = check_rest(clip, camera, hardware)["camera_clip.rest_gap_mm"]
    assert check.passed
    assert check.value > 0.05
    assert not check_rest(clip, camera.translate((0.0, 0.2, 0.0)), hardware)["camera_clip.rest_gap_mm"].passed
    assert not check_rest(None, camera, hardware)["camera_clip.rest_gap_mm"].passed
    assert check_rest(clip, camera, HARDWARE) == {}


SQUARE = np.array([(-30.0, -30.0), (30.0, -30.0), (30.0, 30.0), (-30.0, 30.0)])


def whole(mass_g: float, at: tuple[float, float, float]) -> MassProperties:
    return MassProperties(volume_mm3=1.0, mass_g=mass_g, centre_in_rig_mm=np.array(at), inertia_g_mm2=np.eye(3))


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> manifold3d.Manifold:
    return manifold3d.Manifold.cube(tuple(np.subtract(high, low))).translate(low)


@pytest.mark.parametrize("corners", [SQUARE, SQUARE[::-1]], ids=["left about", "right about"])
def test_it_falls_over_the_nearest_side(corners: np.ndarray) -> None:
    stand = Stand(corners, -50.0, 10.0)
    assert tipping_angle_deg(stand, np.array([0.0, 0.0, -20.0])) == pytest.approx(45.0)
    assert tipping_angle_deg(stand, np.array([0.0, 20.0, -40.0])) == pytest.approx(45.0)
    assert tipping_angle_deg(stand, np.array([40.0, 0.0, 0.0])) < 0.0


def test_turns_are_counted_from_the_parts_lower_face() -> None:
    nut = box((-5.0, -5.0, 0.6), (5.0, 5.0, 6.16))
    assert tripod_turns(4.5, nut, box((-20.0, -20.0, 0.0), (20.0, 20.0, 8.0)), UP) == pytest.approx(3.9 / 1.27)
    # A former position of the nut, on 2.14 mm of the mount's foot.
    assert tripod_turns(4.5, nut, box((-20.0, -20.0, -1.54), (20.0, 20.0, 8.0)), UP) == pytest.approx(2.36 / 1.27)
    assert tripod_turns(4.5, None, nut, UP) == 0.0


@pytest.mark.parametrize(("look_deg", "height_mm"), [(0.0, 125.0), (-30.0, -145.0)])
def test_the_middle_ray_is_above_the_desk_up_to_the_farthest_depth_unless_the_device_looks_down(
    device: Device, look_deg: float, height_mm: float
) -> None:
    """A former default looked 30 deg down: at its design depth of 500 mm, the views were below the desk."""
    table = DeskBack(look_deg=look_deg)
    hardware = device.hardware.replaced(back=table)
    back = plan_device(device.layout, hardware).back if look_deg else device.back
    check = check_aim(back, device.layout, hardware)["device.above_desk_mm"]
    assert check.value == pytest.approx(height_mm, abs=5.0)
    assert check.passed == (height_mm > 0.0)
    tripod = replace(back, stand=None)
    assert set(check_aim(tripod, device.layout, hardware)) == {"device.look_deg"}


def test_a_device_that_falls_is_held_by_too_little_or_breaks_does_not_pass(device: Device) -> None:
    items = purchased_items(device)
    (name,) = [name for name, item in zip(item_names(items), items, strict=True) if item.size == "1/4-20 UNC"]
    back = planned_back(device, DeskBack())
    (nut,), (part,) = back.items, back.parts
    x, y, z = nut.rig_from_item[:3, 3]
    low = z - nut.length_mm
    stand = back.stand
    assert stand is not None
    solids = {
        name: box((x - 5.0, y - 5.0, low), (x + 5.0, y + 5.0, z)),
        part.name: box((-30.0, -50.0, stand.z_mm), (30.0, 30.0, z + 1.0)),
    }
    good = check_back(back, items, solids, whole(400.0, (0.0, -20.0, 26.0)))
    assert {key: check.passed for key, check in good.items()} == {
        "device.back_stress_mpa": True,
        "device.tips_at_deg": True,
        "device.tripod_turns": True,
    }
    thin = replace(
        back,
        critical_sections=(
            CriticalSection(
                "thin", np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), (20.0, 1.5), 20.0
            ),
        ),
    )
    solids[part.name] = box((-30.0, -50.0, stand.z_mm - 1.0), (30.0, 30.0, z + 1.0))
    bad = check_back(thin, items, solids, whole(400.0, (0.0, 25.0, 80.0)))
    assert not any(check.passed for check in bad.values())
