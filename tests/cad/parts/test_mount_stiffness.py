"""The mount as folded plates: laws that any of its compliances obeys, and what stiffens and softens it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.parts.mount import Profile, beam_tilt_deg, head_screws, profiles
from mirrorcam.cad.parts.mount_openings import openings
from mirrorcam.cad.parts.mount_stiffness import disc_on_solid, mount_compliance
from mirrorcam.cad.plan.beam import POISSON, Section
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.values import FloatArray

G = 9.80665e-3


def compliance(device: Device, profile: Profile, section: Section | None = None, *, opened: bool = True) -> FloatArray:
    """Of the device's holder on a mount of that profile."""
    section = section or profile.section
    cuts = openings(device.holder, device.clip, profile.inner[-2:], section, HARDWARE) if opened else ()
    screws = head_screws(device.holder)
    return mount_compliance(profile.inner, profile.outer, section, screws, cuts, device.mount.load_at, HARDWARE)


def tilt_deg(matrix: FloatArray, load_g: float) -> float:
    return float(np.degrees(np.linalg.norm(matrix[3:, :3], ord=2))) * load_g * G


@pytest.fixture(scope="module")
def taken(device: Device) -> Profile:
    """The profile of the default device's mount."""
    return next(p for p in profiles(device.holder, device.clip, HARDWARE) if p.section == device.mount.section)


def test_work_is_positive_and_the_same_whichever_force_comes_first(device: Device, taken: Profile) -> None:
    matrix = compliance(device, taken)
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-9, atol=1e-15)
    assert np.linalg.eigvalsh(matrix).min() > 0.0
    assert tilt_deg(matrix, device.mount.load_g) == pytest.approx(device.mount.tilt_deg)


def test_it_is_softer_than_the_beam_without_openings(device: Device) -> None:
    """Which is what lets the search pass over profiles whose beam tilts too far."""
    mount = device.mount
    for profile in list(profiles(device.holder, device.clip, HARDWARE))[::17]:
        matrix = compliance(device, profile)
        assert tilt_deg(matrix, mount.load_g) > beam_tilt_deg(profile, mount.load_g, mount.load_at)


def test_a_disc_on_a_solid_is_as_stiff_as_in_closed_form() -> None:
    """Pressed, 2 a E / (1 - nu^2) (Boussinesq); rocked, 4 a^3 E / (3 (1 - nu^2)) (Borowicka)."""
    radius, modulus = 6.0, 2300.0
    along_x, along_y, down, rocked = disc_on_solid(radius, modulus)
    plane = modulus / (1.0 - POISSON**2)
    assert down == pytest.approx(2.0 * radius * plane)
    assert rocked == pytest.approx(4.0 / 3.0 * radius**3 * plane)
    assert along_x == along_y < down


def test_openings_soften_and_thickness_stiffens(device: Device, taken: Profile) -> None:
    """Finite elements of solids (default device): openings add a third to the tilt, .0313 to .0421 deg."""
    load = device.mount.load_g
    as_made = tilt_deg(compliance(device, taken), load)
    closed = tilt_deg(compliance(device, taken, opened=False), load)
    assert 1.15 < as_made / closed < 1.5
    section = taken.section
    thicker = replace(section, skin_mm=1.5 * section.skin_mm, web_mm=1.5 * section.web_mm)
    assert as_made / 1.8 < tilt_deg(compliance(device, taken, thicker), load) < as_made / 1.2
    softer = replace(section, plastic_mpa=section.plastic_mpa / 2.0)
    assert tilt_deg(compliance(device, taken, softer), load) == pytest.approx(2.0 * as_made)
