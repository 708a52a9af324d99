"""Openings in strips against the area and the factor that their shape has in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.plan.fasteners import Bore, Hexagon
from mirrorcam.cad.plan.perforations import softening
from mirrorcam.cad.plan.prisms import box

START, END, HALF = np.array([5.0, 0.0]), np.array([5.0, 40.0]), 25.0
AREA = 40.0 * 50.0
ALONG_Y, UP = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])


def hole(z_mm: float, *, travel_mm: float = 0.0, flat: bool = True) -> Bore:
    return Bore(np.array([0.0, 0.0, z_mm]), ALONG_Y, 3.0, 10.0, UP, travel_mm, flat=flat)


def test_a_round_hole_adds_three_times_its_part_of_the_area() -> None:
    expected = 1.0 + 3.0 * np.pi * 9.0 / AREA
    assert softening(START, END, HALF, [hole(20.0)]) == pytest.approx(expected, rel=1e-3)
    two = softening(START, END, HALF, [hole(10.0), hole(30.0)])
    assert two - 1.0 == pytest.approx(2.0 * (expected - 1.0), rel=1e-2)


def test_a_slot_along_the_stress_softens_less_than_its_area_would() -> None:
    slot = softening(START, END, HALF, [hole(20.0, travel_mm=8.0)])
    assert slot == pytest.approx(1.0 + (np.pi * 9.0 + 48.0) / AREA * (1.0 + 2.0 * 6.0 / 14.0), rel=1e-3)


def test_a_roof_makes_a_hole_wider() -> None:
    roofed, flat = (softening(START, END, HALF, [hole(20.0, flat=flat)]) for flat in (False, True))
    assert roofed > flat


def test_a_window_across_the_stress() -> None:
    window = box((-10.0, 0.0, 10.0), (10.0, 10.0, 15.0))
    assert softening(START, END, HALF, [window]) == pytest.approx(1.0 + 100.0 / AREA * (1.0 + 2.0 * 20.0 / 5.0))


def test_of_a_hole_over_a_strips_end_each_strip_has_its_half() -> None:
    halves = [
        softening(start, end, HALF, [hole(20.0)]) - 1.0
        for start, end in ((START, np.array([5.0, 20.0])), (np.array([5.0, 20.0]), END))
    ]
    whole = softening(START, END, HALF, [hole(20.0)]) - 1.0
    assert sum(halves) == pytest.approx(2.0 * whole, rel=1e-2)  # of strips half as long


def test_an_oblique_strip_is_cut_over_more_of_its_length() -> None:
    """At 45 deg a round bore is an ellipse, its long axis along the stress."""
    start, end = np.array([0.0, 0.0]), np.array([10.0, 10.0])
    expected = 1.0 + np.pi * 9.0 * np.sqrt(2.0) / (np.hypot(10.0, 10.0) * 50.0) * (1.0 + 2.0 / np.sqrt(2.0))
    assert softening(start, end, HALF, [Bore(np.array([0.0, -1.0, 5.0]), ALONG_Y, 3.0, 20.0, UP, flat=True)]) == (
        pytest.approx(expected, rel=1e-3)
    )


def test_what_does_not_go_through_or_lies_beside_takes_nothing() -> None:
    nut = Hexagon(np.array([0.0, 0.0, 20.0]), ALONG_Y, UP, 5.7, 10.0)
    short = Bore(np.array([0.0, 0.0, 20.0]), ALONG_Y, 3.0, 4.0, UP)
    touching = box((-10.0, 5.0, 10.0), (10.0, 10.0, 15.0))
    aside, beyond = box((-10.0, 6.0, 10.0), (10.0, 10.0, 15.0)), box((-10.0, 0.0, 50.0), (10.0, 10.0, 60.0))
    along = Bore(np.array([0.0, 5.0, -5.0]), np.array([0.0, 0.0, 1.0]), 3.0, 10.0, UP)
    assert softening(START, END, HALF, [nut, short, touching, aside, beyond, along]) == 1.0
