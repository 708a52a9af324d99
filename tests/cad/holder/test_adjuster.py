"""Screws of carriers: engaged at both ends of the travel, and springs that stay compressed."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.holder.adjuster import SUNK_MM, boss_mm, head_diameter_mm, min_plate_mm, plan_adjuster, travel_mm
from mirrorcam.cad.plan.hardware import HARDWARE, CompressionSpring
from mirrorcam.core.errors import InputError
from tests.cad.holder.screwed import with_screws


@pytest.mark.parametrize("kind", ["insert", "nut"])
@pytest.mark.parametrize("reach_mm", [8.0, 16.0, 24.0])
def test_at_both_ends_of_its_travel_a_screw_engages_and_its_spring_is_neither_loose_nor_solid(
    kind: str, reach_mm: float
) -> None:
    hardware = with_screws(kind)
    screw = plan_adjuster(reach_mm, 1.5 * reach_mm, 10.0, hardware)
    held = 4.0 if kind == "insert" else 2.0 + hardware.screw.nut_height_mm
    # From the back: a sunk head, the plate, the gap, the carrier.
    assert screw.length_mm + SUNK_MM == pytest.approx(10.0 + screw.gap_mm + screw.engaged_mm)
    assert screw.length_mm in hardware.screw.lengths_mm
    assert screw.engaged_mm - screw.travel_mm >= held
    assert screw.engaged_mm + screw.travel_mm < screw.hole_mm
    assert screw.spring_mm == pytest.approx(screw.recess_mm + screw.gap_mm)
    spring = hardware.holder.spring
    assert screw.spring_mm - screw.travel_mm > spring.solid_mm
    assert screw.min_force_n == pytest.approx(spring.n_per_mm * (spring.free_mm - screw.spring_mm - screw.travel_mm))
    # The carrier's edge does not touch the holder.
    assert screw.gap_mm > 1.5 * reach_mm * np.tan(np.radians(1.0)) + hardware.holder.adjust_mm


def test_the_rate_of_a_spring_is_that_of_its_standard() -> None:
    """EN 13906-1: 81.5 GPa (1 mm)^4 / (8 (10 mm)^3 5)."""
    assert CompressionSpring(wire_mm=1.0, mean_mm=10.0, coils=5.0).n_per_mm == pytest.approx(2.0375)


def test_an_adjustment_range_that_is_too_large_is_refused_with_a_remedy() -> None:
    hardware = with_screws()
    for measure, changes in (
        ("longer than any on the list", {"adjust_mm": 15.0}),
        ("closes before a mirror has moved", {"adjust_mm": 2.0}),
        ("screws touch the sides of their holes", {"adjust_deg": 2.0}),
    ):
        with pytest.raises(InputError, match=measure):
            plan_adjuster(10.0, 12.0, 10.0, hardware.replaced(holder=hardware.holder.replaced(**changes)))


def test_spaces_follow_from_the_parts_in_them() -> None:
    assert head_diameter_mm("M3") > 6.72
    assert boss_mm(with_screws()) == HARDWARE.screw.insert_hole_mm / 2.0 + HARDWARE.screw.insert_wall_mm
    assert boss_mm(with_screws("nut")) > HARDWARE.screw.nut_flats_mm / np.sqrt(3.0) + HARDWARE.printer.wall_mm
    assert travel_mm(10.0, HARDWARE) == pytest.approx(0.3 + 10.0 * np.tan(np.radians(1.0)))
    screw = plan_adjuster(10.0, 12.0, 10.0, with_screws())
    assert min_plate_mm(screw.travel_mm, with_screws()) >= screw.recess_mm + screw.cone_mm + HARDWARE.printer.wall_mm
