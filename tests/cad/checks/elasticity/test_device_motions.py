"""The table of plastics: bounds for every plastic, and unknown names.

The complete device by finite elements: laws of statics, and the planned tilt of the mount.
"""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.elasticity.condensed_solid import Carried, Solid
from mirrorcam.cad.checks.elasticity.device_motions import (
    CAMERA,
    PLASTICS,
    SUPPORT_CTE_PER_K,
    DeviceMotions,
    TiedPart,
    device_motions,
    plastic_named,
    tied_motions,
)
from mirrorcam.cad.checks.elasticity.tetrahedra import Tetrahedra
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout


def test_plastics_are_softer_and_expand_more_than_metal() -> None:
    assert len({plastic.name for plastic in PLASTICS}) == len(PLASTICS) == 5
    for plastic in PLASTICS:
        assert 1000.0 < plastic.modulus_mpa < 10000.0
        assert 1.0 < plastic.density_g_per_cm3 < 1.5
        assert SUPPORT_CTE_PER_K < plastic.cte_per_k < 2e-4
        assert 0.1 < plastic.creep < 1.5
        assert plastic.source


def test_a_printers_plastic_keeps_its_own_modulus() -> None:
    printer = HARDWARE.printer
    found = plastic_named(printer.plastic, 2000.0, 1.2)
    assert (found.name, found.modulus_mpa, found.density_g_per_cm3) == ("PLA", 2000.0, 1.2)
    assert plastic_named("pla", printer.plastic_mpa, printer.plastic_g_per_cm3) == PLASTICS[0]
    with pytest.raises(InputError, match=r"printer\.plastic = wood: .* expected one of PLA, PETG"):
        plastic_named("wood", 2000.0, 1.2)


FIRST, LAST = np.array([0.0, 3.0, 3.0]), np.array([60.0, 3.0, 3.0])


def test_motions_of_a_plastic_are_sums_of_parts(default_layout: Layout, turning: DeviceMotions) -> None:
    name = default_layout.mirror_names[0]
    gravity = turning.under_gravity(2000.0, 3.0)[name]
    np.testing.assert_allclose(gravity, (3.0 + 1.0) / 2000.0 * turning.per_plastic_weight[name])
    strain = turning.under_strain(2e-3, 5.0, 7.0)[name]
    np.testing.assert_allclose(strain, 2e-3 * turning.per_plastic_strain[name])


def test_a_device_tilted_any_way_moves_as_the_sum_of_three_directions(bar: Tetrahedra) -> None:
    """Two bars tied by a screw, with a camera and a glued mirror, solved again with the bars tilted."""
    gravity = np.array([0.36, -0.48, 0.8])
    across = np.array([0.8, 0.6, 0.0])
    turn = np.column_stack([gravity, across, np.cross(gravity, across)])
    upright = _tied_bars(bar, np.eye(3)).under_gravity(2000.0, 1.2)["mirror"] @ gravity
    # In axes with gravity along the first.
    tilted = _tied_bars(bar, turn).under_gravity(2000.0, 1.2)["mirror"][:, 0]
    assert np.linalg.norm(upright[3:]) > 0.0
    np.testing.assert_allclose(np.kron(np.eye(2), turn) @ tilted, upright, rtol=1e-6, atol=1e-9)


def _tied_bars(bar: Tetrahedra, turn: FloatArray) -> DeviceMotions:
    """One bar is fixed to the ground, the other continues it; the columns of `turn` are their axes."""
    solids = [Solid(Tetrahedra((bar.points + offset) @ turn, bar.corners)) for offset in (np.zeros(3), LAST - FIRST)]
    first, last = (np.flatnonzero(np.abs(Solid(bar).nodes[:, 0] - x) < 1e-6) for x in (0.0, LAST[0]))
    at = np.array([FIRST, LAST]) @ turn
    middle = np.array([0.0, 0.0, 20.0])
    halfway = np.flatnonzero(np.abs(Solid(bar).nodes[:, 0] - LAST[0] / 2.0) < 1e-6)
    camera = Carried(halfway, (FIRST + LAST) / 2.0 @ turn, 1.0, ((FIRST + LAST) / 2.0 + middle) @ turn)
    beyond = (2.0 * LAST - FIRST) @ turn
    glue = np.tile(1e-3 * np.eye(3), (len(last), 1, 1))
    mirror = Carried(last, beyond, 0.5, beyond + middle @ turn, glue)
    parts = (TiedPart(solids[0], (0, 1), {CAMERA: camera}), TiedPart(solids[1], (1,), {"mirror": mirror}))
    return tied_motions(parts, ((first, last), (first,)), at, (0,), 0.0)


@pytest.fixture(scope="module")
def solved(device: Device) -> DeviceMotions:
    pytest.importorskip("skfem", reason="scikit-fem is not installed (extra fe)")
    return device_motions(device, 8.0)


@pytest.mark.slow
def test_uniform_expansion_only_scales_the_device(device: Device, solved: DeviceMotions, gmsh: str) -> None:
    """Mirrors move away from the camera by the strain, without rotation, except where the camera rests."""
    for name, mirror in zip(device.layout.mirror_names, device.layout.mirrors, strict=True):
        motion = solved.under_strain(1e-3, 1e-3, 1e-3)[name]
        middle = mirror.rig_from_plane[:3, 3]
        assert np.linalg.norm(motion[:3] - 1e-3 * middle) < 0.2 * np.linalg.norm(1e-3 * middle)
        assert np.linalg.norm(motion[3:]) < 1e-9


@pytest.mark.slow
def test_mirrors_turn_nearly_as_one_body(solved: DeviceMotions, gmsh: str) -> None:
    turns = np.array([motion[3:] for motion in solved.under_gravity(2300.0, 1.24).values()])
    assert np.degrees(np.linalg.norm(turns, axis=(1, 2)).max()) < 0.3
    assert np.abs(turns - turns.mean(axis=0)).max() < 0.1 * np.abs(turns).max()
