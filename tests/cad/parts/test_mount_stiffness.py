"""Openings in strips against the area and factor of their shape in closed form.

The mount as folded plates: laws of its compliances, and the effects of thickness and openings.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.parts.mount import Profile, beam_tilt_deg, head_screws, profiles
from mirrorcam.cad.parts.mount_openings import openings
from mirrorcam.cad.parts.mount_stiffness import ThroughCuts, disc_on_solid, mount_compliance, softening
from mirrorcam.cad.plan.fasteners import Bore, Hexagon
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.prisms import box
from mirrorcam.cad.plan.stiffness import POISSON, Section
from mirrorcam.core.values import FloatArray

START, END, HALF = np.array([5.0, 0.0]), np.array([5.0, 40.0]), 25.0
AREA = 40.0 * 50.0
ALONG_Y, UP = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])


def hole(z_mm: float, *, travel_mm: float = 0.0, flat: bool = True) -> Bore:
    return Bore(np.array([0.0, 0.0, z_mm]), ALONG_Y, 3.0, 10.0, UP, travel_mm, ceiling_mm=20.0 if flat else 0.0)


def test_a_round_hole_adds_three_times_its_fraction_of_the_area() -> None:
    expected = 1.0 + 3.0 * np.pi * 9.0 / AREA
    assert softening(START, END, HALF, ThroughCuts.of([hole(20.0)])) == pytest.approx(expected, rel=1e-3)
    two = softening(START, END, HALF, ThroughCuts.of([hole(10.0), hole(30.0)]))
    assert two - 1.0 == pytest.approx(2.0 * (expected - 1.0), rel=1e-2)


def test_a_slot_along_the_stress_softens_less_than_its_area_would() -> None:
    slot = softening(START, END, HALF, ThroughCuts.of([hole(20.0, travel_mm=8.0)]))
    assert slot == pytest.approx(1.0 + (np.pi * 9.0 + 48.0) / AREA * (1.0 + 2.0 * 6.0 / 14.0), rel=1e-3)


def test_a_roof_makes_a_hole_wider() -> None:
    roofed, flat = (softening(START, END, HALF, ThroughCuts.of([hole(20.0, flat=flat)])) for flat in (False, True))
    assert roofed > flat


def test_a_window_normal_to_the_stress() -> None:
    window = box((-10.0, 0.0, 10.0), (10.0, 10.0, 15.0))
    assert softening(START, END, HALF, ThroughCuts.of([window])) == pytest.approx(
        1.0 + 100.0 / AREA * (1.0 + 2.0 * 20.0 / 5.0)
    )


def test_a_hole_over_the_end_of_strips_is_shared_by_both() -> None:
    halves = [
        softening(start, end, HALF, ThroughCuts.of([hole(20.0)])) - 1.0
        for start, end in ((START, np.array([5.0, 20.0])), (np.array([5.0, 20.0]), END))
    ]
    whole = softening(START, END, HALF, ThroughCuts.of([hole(20.0)])) - 1.0
    assert sum(halves) == pytest.approx(2.0 * whole, rel=1e-2)  # of strips half as long


def test_an_oblique_strip_is_cut_over_more_of_its_length() -> None:
    """At 45 deg a round bore is an ellipse with its long axis along the stress."""
    start, end = np.array([0.0, 0.0]), np.array([10.0, 10.0])
    expected = 1.0 + np.pi * 9.0 * np.sqrt(2.0) / (np.hypot(10.0, 10.0) * 50.0) * (1.0 + 2.0 / np.sqrt(2.0))
    assert softening(
        start, end, HALF, ThroughCuts.of([Bore(np.array([0.0, -1.0, 5.0]), ALONG_Y, 3.0, 20.0, UP, ceiling_mm=20.0)])
    ) == (pytest.approx(expected, rel=1e-3))


def test_openings_that_are_blind_or_outside_do_not_soften() -> None:
    nut = Hexagon(np.array([0.0, 0.0, 20.0]), ALONG_Y, UP, 5.7, 10.0)
    short = Bore(np.array([0.0, 0.0, 20.0]), ALONG_Y, 3.0, 4.0, UP)
    touching = box((-10.0, 5.0, 10.0), (10.0, 10.0, 15.0))
    aside, beyond = box((-10.0, 6.0, 10.0), (10.0, 10.0, 15.0)), box((-10.0, 0.0, 50.0), (10.0, 10.0, 60.0))
    along = Bore(np.array([0.0, 5.0, -5.0]), np.array([0.0, 0.0, 1.0]), 3.0, 10.0, UP)
    assert softening(START, END, HALF, ThroughCuts.of([nut, short, touching, aside, beyond, along])) == 1.0


G = 9.80665e-3


def compliance(device: Device, profile: Profile, section: Section | None = None, *, opened: bool = True) -> FloatArray:
    """Of the device's holder on a mount of that profile."""
    section = section or profile.section
    cuts = openings(device.holder, device.clip, profile.foot, section, HARDWARE) if opened else ()
    screws = head_screws(device.holder)
    load = device.mount.load_at
    return mount_compliance(profile.inner, profile.outer, section, profile.foot, screws, cuts, load, HARDWARE)


def tilt_deg(matrix: FloatArray, load_g: float) -> float:
    return float(np.degrees(np.linalg.norm(matrix[3:, :3], ord=2))) * load_g * G


@pytest.fixture(scope="module")
def taken(device: Device) -> Profile:
    """The profile of the default device's mount."""
    return next(p for p in profiles(device.holder, device.clip, 30.0, HARDWARE) if p.section == device.mount.section)


def test_work_is_positive_and_the_same_whichever_force_comes_first(device: Device, taken: Profile) -> None:
    matrix = compliance(device, taken)
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-9, atol=1e-15)
    assert np.linalg.eigvalsh(matrix).min() > 0.0
    assert tilt_deg(matrix, device.mount.load_g) == pytest.approx(device.mount.tilt_deg)


@pytest.mark.slow
def test_it_is_softer_than_the_beam_without_openings(device: Device) -> None:
    """This allows the search to skip profiles that tilt too far as beams."""
    mount = device.mount
    for profile in list(profiles(device.holder, device.clip, 30.0, HARDWARE))[::17]:
        matrix = compliance(device, profile)
        assert tilt_deg(matrix, mount.load_g) > beam_tilt_deg(profile, mount.load_g, mount.load_at)


def test_a_disc_on_a_solid_is_as_stiff_as_in_closed_form() -> None:
    """Pressed, 2 a E / (1 - nu^2) (Boussinesq); rocked, 4 a^3 E / (3 (1 - nu^2)) (Borowicka)."""
    radius, modulus = 6.0, 2300.0
    stiffness_x, stiffness_y, down, rocked = disc_on_solid(radius, modulus)
    plane = modulus / (1.0 - POISSON**2)
    assert down == pytest.approx(2.0 * radius * plane)
    assert rocked == pytest.approx(4.0 / 3.0 * radius**3 * plane)
    assert stiffness_x == stiffness_y < down


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
