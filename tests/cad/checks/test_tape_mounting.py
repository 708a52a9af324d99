"""Mirrors on tape: the moduli of bonded layers in closed form, and the pads that heavy mirrors need."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.tape_mounting import SHEAR_MPA, check_tape, layer_stiffness
from mirrorcam.cad.plan.hardware import HARDWARE, TAPE_STRESS_KPA
from mirrorcam.optics.geometry.layout import Layout


def test_a_level_pad_is_stiffer_than_an_inclined_one(default_layout: Layout) -> None:
    """On level layers both adhesives act as discs of S = d / 4t; at 30 deg a strip of 4 G / sin^2 is softer by far."""
    mirror = default_layout.mirrors[4]
    normal = mirror.normal_in_rig
    side = np.cross(normal, [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    inclined = np.cos(np.radians(30.0)) * normal + np.sin(np.radians(30.0)) * side
    level_mpa = 3.0 * SHEAR_MPA * (1.0 + 2.0 * (5.0 / 0.4) ** 2)
    level, shear = layer_stiffness(mirror, normal, HARDWARE)
    # Half of the lower layer, 0.05 mm thick on the mean, and all of the upper one, 0.1 mm thick.
    assert level == pytest.approx(1.0 / (0.05 / (0.5 * level_mpa) + 0.1 / level_mpa))
    softer, same_shear = layer_stiffness(mirror, inclined, HARDWARE)
    assert softer == pytest.approx(1.0 / (0.05 / (0.5 * 16.0 * SHEAR_MPA) + 0.1 / level_mpa))
    assert same_shear == shear == pytest.approx(SHEAR_MPA / (0.05 / 0.5 + 0.1))


def test_the_default_mirrors_are_borne(default_layout: Layout, device: Device) -> None:
    checks = check_tape(default_layout, device.holder, HARDWARE)
    assert {name for name, check in checks.items() if check.passed} == {"tape_kpa", "tape_creep_deg"}


def test_pads_grow_until_they_bear_the_heaviest_mirror(default_layout: Layout, device: Device) -> None:
    glass = HARDWARE.cutting.replaced(material="glass")
    heavy = default_layout.replaced(
        mirrors=tuple(mirror.replaced(thickness_mm=3.0) for mirror in default_layout.mirrors)
    )
    on_small_pads = HARDWARE.replaced(cutting=glass)
    assert not check_tape(heavy, device.holder, on_small_pads)["tape_kpa"].passed
    widened = on_small_pads.for_mirrors_of(heavy).holder
    share = (widened.tape_pad_mm / HARDWARE.holder.tape_pad_mm) ** 2
    stress = check_tape(heavy, device.holder, on_small_pads)["tape_kpa"].value / share
    assert 0.7 * TAPE_STRESS_KPA < stress <= TAPE_STRESS_KPA
    chosen = on_small_pads.replaced(holder=HARDWARE.holder.replaced(tape_pad_mm=4.0))
    assert chosen.for_mirrors_of(heavy).holder.tape_pad_mm == 4.0


def test_mirrors_without_tape_have_no_such_check(default_layout: Layout, device: Device) -> None:
    glued = HARDWARE.replaced(holder=HARDWARE.holder.replaced(mirrors="glue"))
    assert check_tape(default_layout, device.holder, glued) == {}
