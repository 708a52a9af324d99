"""Cuts through meshed bodies: fragments, what lies inside spans, and the space for pins."""

from __future__ import annotations

import numpy as np
import pytest
from manifold3d import Manifold

from mirrorcam.cad.plan.cuts import clearance_round_pin_mm, reach_of_pin_mm
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.splitting.body_cuts import (
    area_for_pins,
    best_places_mm,
    falls_apart,
    fragments,
    inside,
    triangles_of,
)


def test_a_crumb_that_a_cut_leaves_is_left_out_and_a_fragment_refused() -> None:
    bar = Manifold.cube((300.0, 30.0, 20.0))
    for width, apart in ((1.0, False), (3.0, True)):
        # A corner that only a strip behind the cut holds.
        body = bar + Manifold.cube((2.0, 1.0, width)).translate((149.5, 31.0, 0.0))
        body += Manifold.cube((0.5, 2.0, width)).translate((151.0, 29.5, 0.0))
        assert falls_apart(body, 0, 150.9, 1.2) == apart
        assert not falls_apart(body, 0, 149.0, 1.2)
        assert len(fragments(body.trim_by_plane((-1.0, 0.0, 0.0), -150.9), 1.2)) == (2 if apart else 1)


def test_a_hole_keeps_a_wall_before_what_is_hollow_beyond_its_end() -> None:
    """Pins find no room where a hollow begins nearer to the cut than their holes and a wall reach."""
    needed = HARDWARE.holder.pin_mm[1] / 2.0 + HARDWARE.fit.slide_mm + HARDWARE.printer.wall_mm
    bar, axes = Manifold.cube((300.0, 30.0, 20.0)), (-1e4, 1e4)
    for beyond, room in ((0.05, True), (-0.05, False)):
        hollow = Manifold.cube((50.0, 26.0, 16.0)).translate((150.0 + needed + beyond, 2.0, 2.0))
        found = area_for_pins(bar - hollow, 0, 150.0, axes, HARDWARE)
        assert (not found.is_empty) == room


def test_area_for_pins_in_a_bar_is_its_section_less_a_wall_round_the_hole() -> None:
    bar, around = Manifold.cube((300.0, 30.0, 20.0)), clearance_round_pin_mm(HARDWARE)
    room = area_for_pins(bar, 0, 150.0, (-1e4, 1e4), HARDWARE)
    np.testing.assert_allclose(room.bounds, (around, around, 30.0 - around, 20.0 - around), atol=1e-9)
    # Across y the other axis is x, and the span keeps as far off as the outside.
    assert area_for_pins(bar, 1, 15.0, (50.0, 80.0), HARDWARE).bounds[0] == pytest.approx(50.0 + around)


def test_the_place_with_most_area_for_pins_is_taken_and_of_equals_the_middle() -> None:
    bar = Manifold.cube((300.0, 30.0, 20.0))
    assert best_places_mm(bar, 0, (0.0, 300.0), 220.0, HARDWARE) == (150.0,)
    assert best_places_mm(bar, 0, (0.0, 200.0), 220.0, HARDWARE) == ()
    notch = Manifold.cube((20.0, 30.0, 12.0)).translate((140.0, 0.0, 8.0))
    (place,) = best_places_mm(bar - notch, 0, (0.0, 300.0), 220.0, HARDWARE)
    assert abs(place - 150.0) > 10.0 + reach_of_pin_mm(HARDWARE)


def test_what_lies_inside_spans_has_their_volume() -> None:
    box = inside(Manifold.cube((300.0, 30.0, 20.0)), ((-5.0, 120.0), (10.0, 25.0)))
    assert box.volume() == pytest.approx(120.0 * 15.0 * 20.0)
    assert triangles_of(box).shape == (12, 3, 3)
