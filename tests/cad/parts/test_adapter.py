"""The clamp against closed forms, and where it stands."""

from __future__ import annotations

import numpy as np
import pytest
from build123d import GeomType

from mirrorcam.cad.parts.adapter import CAP_EAR_MM, plan_adapter
from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.parts.foot import foot_z_mm
from mirrorcam.cad.parts.part_solids import make_ring
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.optics.base.values import InputError


def segment_area(radius: float, distance: float) -> float:
    """Area of a disk beyond a chord at a distance from its centre."""
    return float(radius**2 * np.arccos(distance / radius) - distance * np.sqrt(radius**2 - distance**2))


def test_the_cap_is_half_a_ring_with_two_drilled_ears() -> None:
    plan = plan_adapter(plan_clip(HARDWARE), HARDWARE)
    cap, wrist, screw = plan.cap, HARDWARE.wrist, HARDWARE.screw
    r, outer, gap = cap.radius_mm, cap.radius_mm + cap.ring_mm, wrist.gap_mm / 2.0
    ring = segment_area(outer, gap) - segment_area(r, gap)
    # An ear's profile lies outside the ring as far as the ring's outer circle leaves it.
    low, high = -gap - CAP_EAR_MM, -gap
    ear_end = float(max(piece.top[:, 0].max() for piece in cap.pieces))
    levels = np.linspace(low, high, 20001)
    ear = float(np.trapezoid(ear_end - np.sqrt(outer**2 - levels**2), levels))
    hole_r, steep = screw.clearance_hole_mm / 2.0, np.deg2rad(42.0)
    hole = np.pi * hole_r**2 + hole_r**2 / np.tan(steep) - (np.pi / 2.0 - steep) * hole_r**2
    expected = wrist.band_mm * (ring + 2.0 * ear) - 2.0 * CAP_EAR_MM * hole
    assert make_ring(cap).volume == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("kind", ["insert", "nut"])
def test_both_halves_are_one_valid_solid_on_the_wrists_axis(kind: str) -> None:
    hardware = HARDWARE.replaced(screw=HARDWARE.screw.replaced(kind=kind))
    plan = plan_adapter(plan_clip(hardware), hardware)
    for ring in (plan.saddle, plan.cap):
        part = make_ring(ring)
        assert part.is_valid
        radius = pytest.approx(hardware.wrist.diameter_mm / 2.0)
        bores = [face for face in part.faces().filter_by(GeomType.CYLINDER) if face.radius == radius]
        assert bores
        for face in bores:
            axis = face.axis_of_rotation
            assert axis is not None
            assert abs(axis.direction.Y) == pytest.approx(1.0)
            np.testing.assert_allclose([axis.position.X, axis.position.Z], [0.0, ring.axis_z_mm], atol=1e-9)
        bounds = part.bounding_box()
        assert pytest.approx(ring.band_mm[1]) == bounds.max.Y
        # Halves keep their gap.
        face_z = bounds.min.Z if ring.above else bounds.max.Z
        side = 1.0 if ring.above else -1.0
        assert face_z == pytest.approx(ring.axis_z_mm + side * hardware.wrist.gap_mm / 2.0)


def test_the_saddle_reaches_up_to_the_mounts_foot_and_clears_the_clip() -> None:
    clip = plan_clip(HARDWARE)
    plan = plan_adapter(clip, HARDWARE)
    top = make_ring(plan.saddle).bounding_box().max.Z
    assert top == pytest.approx(foot_z_mm(clip, HARDWARE))
    assert top < clip.bottom_mm - clip.travel_mm


def test_another_wrist_gives_another_clamp() -> None:
    hardware = HARDWARE.replaced(wrist=HARDWARE.wrist.replaced(diameter_mm=75.0, band_mm=11.0))
    plan = plan_adapter(plan_clip(hardware), hardware)
    part = make_ring(plan.saddle)
    assert part.is_valid
    assert plan.saddle.radius_mm == 37.5
    assert np.ptp(plan.saddle.band_mm) == pytest.approx(11.0)


def test_a_riser_too_thin_for_its_screws_is_refused() -> None:
    hardware: Hardware = HARDWARE.replaced(wrist=HARDWARE.wrist.replaced(riser_mm=10.0))
    with pytest.raises(InputError, match=r"adapter's plate is 4\.0 mm thick, expected 5\.8 mm"):
        plan_adapter(plan_clip(hardware), hardware)
