"""The stress in a back's section, against beam theory.

The planned load of a back: an upper bound of the parts' mass, about the same centre.
"""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.back import BACK_DOWN, FRONT_DOWN, SIDE_DOWN, UPRIGHT, CriticalSection, carried_load
from tests.cad.conftest import Built

X, Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("turn", [UPRIGHT, BACK_DOWN, FRONT_DOWN, SIDE_DOWN])
def test_parts_are_rotated_onto_the_bed_not_mirrored(turn: np.ndarray) -> None:
    np.testing.assert_array_equal(turn @ turn.T, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_a_force_through_the_centre_pulls_and_one_above_it_bends() -> None:
    section = CriticalSection("post", np.zeros(3), Z, X, (20.0, 10.0))
    assert section.stress_mpa(100.0, np.zeros(3)) == pytest.approx(100.0 / 200.0)
    above = section.stress_mpa(100.0, np.array([0.0, 0.0, 50.0]))
    # M / W about each side, W = b h^2 / 6; the force above the centre causes no torsion.
    bending = 100.0 * 50.0 * 6.0 * (1.0 / (20.0 * 10.0**2) + 1.0 / (10.0 * 20.0**2))
    assert above == pytest.approx(0.5 + bending)
    aside = section.stress_mpa(100.0, np.array([0.0, 50.0, 0.0]))
    assert aside == pytest.approx(0.5 + 5000.0 * 6.0 / (20.0 * 10.0**2) + 5000.0 * 5.0 / (20.0 * 10.0**2))


def test_a_neck_that_only_bends_has_its_own_arm() -> None:
    section = CriticalSection("plate", np.zeros(3), Z, X, (60.0, 6.0), arm_mm=30.0)
    for at in (np.zeros(3), np.array([500.0, 0.0, 0.0])):
        assert section.stress_mpa(12.0, at) == pytest.approx(12.0 / 360.0 + 12.0 * 30.0 * 6.0 / (60.0 * 36.0))


def test_the_load_is_that_of_the_parts_as_made(device: Device, built_default: Built) -> None:
    load = carried_load(device.mount, device.clip, device.hardware)
    checks = built_default[2]
    mass = checks["device.mass_g"].value
    centre = [checks[f"device.centre_{axis}_mm"].value for axis in "xyz"]
    assert 0.95 * mass < load.mass_g < 1.3 * mass
    # Only one of them includes the foot.
    np.testing.assert_allclose(device.mount.foot.rig_from_stand @ load.centre, centre, atol=12.0)


def test_a_heavier_camera_moves_the_centre_of_the_load_towards_it(device: Device) -> None:
    heavy = device.hardware.replaced(camera=device.hardware.camera.replaced(mass_g=1e6))
    load = carried_load(device.mount, device.clip, heavy)
    assert load.mass_g == pytest.approx(1e6, rel=1e-3)
    low, high = (np.array(corner) for corner in heavy.camera.box_mm)
    np.testing.assert_allclose(device.mount.foot.rig_from_stand @ load.centre, (low + high) / 2.0, atol=0.1)
