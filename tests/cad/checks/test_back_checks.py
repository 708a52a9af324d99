"""Checks of the back against hand calculation: a device that falls, a screw that does not hold, a neck too thin."""

from __future__ import annotations

from dataclasses import replace

import manifold3d
import numpy as np
import pytest

from mirrorcam.cad.assembly.catalogue import bought_items
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.assembly.pieces import item_names
from mirrorcam.cad.backs.back import Neck, Stand
from mirrorcam.cad.checks.back_checks import check_back, tips_at_deg, tripod_turns
from mirrorcam.cad.plan.part_plan import MassProperties

SQUARE = np.array([(-30.0, -30.0), (30.0, -30.0), (30.0, 30.0), (-30.0, 30.0)])


def whole(mass_g: float, at: tuple[float, float, float]) -> MassProperties:
    return MassProperties(volume_mm3=1.0, mass_g=mass_g, centre_in_rig_mm=np.array(at), inertia_g_mm2=np.eye(3))


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> manifold3d.Manifold:
    return manifold3d.Manifold.cube(tuple(np.subtract(high, low))).translate(low)


@pytest.mark.parametrize("corners", [SQUARE, SQUARE[::-1]], ids=["left about", "right about"])
def test_it_falls_over_the_nearest_side(corners: np.ndarray) -> None:
    stand = Stand(corners, -50.0, 10.0)
    assert tips_at_deg(stand, np.array([0.0, 0.0, -20.0])) == pytest.approx(45.0)
    assert tips_at_deg(stand, np.array([0.0, 20.0, -40.0])) == pytest.approx(45.0)
    assert tips_at_deg(stand, np.array([40.0, 0.0, 0.0])) < 0.0


def test_turns_are_counted_from_the_parts_lower_face() -> None:
    nut = box((-5.0, -5.0, 0.6), (5.0, 5.0, 6.16))
    assert tripod_turns(4.5, nut, box((-20.0, -20.0, 0.0), (20.0, 20.0, 8.0))) == pytest.approx(3.9 / 1.27)
    # As the nut lay once, on 2.14 mm of the mount's foot.
    assert tripod_turns(4.5, nut, box((-20.0, -20.0, -1.54), (20.0, 20.0, 8.0))) == pytest.approx(2.36 / 1.27)
    assert tripod_turns(4.5, None, nut) == 0.0


def test_a_device_that_falls_is_held_by_too_little_or_breaks_does_not_pass(device: Device) -> None:
    items = bought_items(device)
    (name,) = [name for name, item in zip(item_names(items), items, strict=True) if item.size == "1/4-20 UNC"]
    (nut,), (part,) = device.back.items, device.back.parts
    x, y, z = nut.rig_from_item[:3, 3]
    low = z - nut.length_mm
    stand = device.back.stand
    assert stand is not None
    solids = {
        name: box((x - 5.0, y - 5.0, low), (x + 5.0, y + 5.0, z)),
        part.name: box((-30.0, -50.0, stand.z_mm), (30.0, 30.0, z + 1.0)),
    }
    good = check_back(device.back, items, solids, whole(400.0, (0.0, -5.0, 32.0)))
    assert {key: check.passed for key, check in good.items()} == {
        "device.back_stress_mpa": True,
        "device.tips_at_deg": True,
        "device.tripod_turns": True,
    }
    thin = replace(
        device.back,
        necks=(Neck("thin", np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), (20.0, 1.5), 20.0),),
    )
    solids[part.name] = box((-30.0, -50.0, stand.z_mm - 1.0), (30.0, 30.0, z + 1.0))
    bad = check_back(thin, items, solids, whole(400.0, (0.0, 25.0, 80.0)))
    assert not any(check.passed for check in bad.values())
