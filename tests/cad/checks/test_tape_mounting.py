"""Mirrors on tape: the moduli of bonded layers in closed form, and the pads that heavy mirrors need."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.checks.tape_mounting import SHEAR_MPA, check_tape, layer_stiffness
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.holder.holder_plan import plan_holder
from mirrorcam.cad.plan.hardware import HARDWARE, TAPE_STRESS_KPA
from mirrorcam.optics.geometry.layout import Layout
from tests.cad.taped import TAPED


@pytest.fixture(scope="module")
def holder(default_layout: Layout) -> HolderPlan:
    return plan_holder(default_layout, TAPED)


def test_a_level_pad_is_stiffer_than_an_inclined_one(default_layout: Layout) -> None:
    """On level layers both adhesives act as discs of S = d / 4t; at 30 deg a strip of 4 G / sin^2 is softer by far."""
    mirror = default_layout.mirrors[4]
    normal = mirror.normal_in_rig
    side = np.cross(normal, [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    inclined = np.cos(np.radians(30.0)) * normal + np.sin(np.radians(30.0)) * side
    level_mpa = 3.0 * SHEAR_MPA * (1.0 + 2.0 * (5.0 / 0.4) ** 2)
    level, shear = layer_stiffness(mirror, normal, TAPED)
    # Half of the lower layer, 0.05 mm thick on the mean, and all of the upper one, 0.1 mm thick.
    assert level == pytest.approx(1.0 / (0.05 / (0.5 * level_mpa) + 0.1 / level_mpa))
    softer, same_shear = layer_stiffness(mirror, inclined, TAPED)
    assert softer == pytest.approx(1.0 / (0.05 / (0.5 * 16.0 * SHEAR_MPA) + 0.1 / level_mpa))
    assert same_shear == shear == pytest.approx(SHEAR_MPA / (0.05 / 0.5 + 0.1))


def test_the_default_mirrors_are_borne(default_layout: Layout) -> None:
    hardware = HARDWARE.for_mirrors_of(default_layout)
    hardware = hardware.replaced(holder=hardware.holder.replaced(mirrors="tape"))
    checks = check_tape(default_layout, plan_holder(default_layout, hardware), hardware)
    assert {name for name, check in checks.items() if check.passed} == {"tape_kpa", "tape_creep_deg"}


def test_pads_grow_until_they_bear_the_heaviest_mirror(default_layout: Layout, holder: HolderPlan) -> None:
    glass = HARDWARE.replaced(cutting=HARDWARE.cutting.replaced(material="glass"))
    heavy = default_layout.replaced(
        mirrors=tuple(mirror.replaced(thickness_mm=3.0) for mirror in default_layout.mirrors)
    )
    on_small_pads = TAPED.replaced(cutting=glass.cutting)
    assert not check_tape(heavy, holder, on_small_pads)["tape_kpa"].passed
    widened = glass.for_mirrors_of(heavy).holder
    share = (widened.tape_pad_mm / TAPED.holder.tape_pad_mm) ** 2
    stress = check_tape(heavy, holder, on_small_pads)["tape_kpa"].value / share
    assert 0.7 * TAPE_STRESS_KPA < stress <= TAPE_STRESS_KPA
    chosen = glass.replaced(holder=HARDWARE.holder.replaced(tape_pad_mm=4.0))
    assert chosen.for_mirrors_of(heavy).holder.tape_pad_mm == 4.0


def test_mirrors_without_tape_have_no_such_check(default_layout: Layout, holder: HolderPlan) -> None:
    assert check_tape(default_layout, holder, HARDWARE) == {}
