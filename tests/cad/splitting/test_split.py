"""Parts cut for the bed: pieces that fit, join without a gap, hold their pins; and parts that cannot be cut."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from build123d import Align, Box, BuildPart, GeomType, Locations, Mode, Part

from mirrorcam.cad.plan.cuts import PiecePlan
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.cad.splitting.split import split
from mirrorcam.core.values import FloatArray, InputError
from mirrorcam.optics.geometry.transforms import transform


@dataclass(frozen=True)
class BarPlan:
    length_mm: float
    width_mm: float
    height_mm: float
    slot_mm: float = 0.0


def make_bar(plan: BarPlan) -> Part:
    """A bar along x from the origin, z up, with a slot through all its height in its middle."""
    corner = (Align.MIN, Align.MIN, Align.MIN)
    with BuildPart() as bar:
        Box(plan.length_mm, plan.width_mm, plan.height_mm, align=corner)
        if plan.slot_mm > 0.0:
            with Locations((0.4 * plan.length_mm, (plan.width_mm - plan.slot_mm) / 2.0, 0.0)):
                Box(0.2 * plan.length_mm, plan.slot_mm, plan.height_mm, align=corner, mode=Mode.SUBTRACT)
    return Part(bar.solids())


def bar_part(plan: BarPlan) -> tuple[PartPlan, FloatArray]:
    part = PartPlan("bar", "Bar", "MC-99", plan, make_bar, np.eye(4), np.zeros(3), (0.5, 0.5, 0.5))
    corners = np.array(
        [(x, y, z) for x in (0, plan.length_mm) for y in (0, plan.width_mm) for z in (0, plan.height_mm)], dtype=float
    )
    return part, corners


def test_what_fits_the_bed_is_left_alone_and_not_even_made() -> None:
    part, corners = bar_part(BarPlan(219.0, 30.0, 20.0))

    def never(plan: object) -> Part:
        raise AssertionError("made")

    assert split(replace(part, make=never), corners, HARDWARE).parts[0].plan is part.plan
    with pytest.raises(AssertionError, match="made"):
        split(replace(part, make=never), 2.0 * corners, HARDWARE)


def test_a_part_is_made_once_for_all_its_pieces_and_no_piece_changes_another() -> None:
    part, corners = bar_part(BarPlan(310.0, 260.0, 20.0))
    made = []

    def make(plan: BarPlan) -> Part:
        made.append(plan)
        return make_bar(plan)

    parts = split(replace(part, make=make), corners, HARDWARE).parts
    volumes = [piece.make(piece.plan).volume for piece in (*parts, *parts[::-1])]
    assert len(made) == 1
    assert volumes[:4] == volumes[:3:-1]
    # Another part of the same function is another part.
    longer, corners = bar_part(BarPlan(312.0, 260.0, 20.0))
    split(replace(longer, make=make), corners, HARDWARE)
    assert len(made) == 2


@pytest.mark.parametrize(("length", "width", "count"), [(300.0, 30.0, 2), (500.0, 40.0, 3), (300.0, 260.0, 4)])
def test_pieces_fit_the_bed_and_are_the_part_less_its_pin_holes(length: float, width: float, count: int) -> None:
    part, corners = bar_part(BarPlan(length, width, 20.0))
    pieces = split(part, corners, HARDWARE)
    assert len(pieces.parts) == count
    cuts = {2: 1, 3: 2, 4: 4}[count]
    assert len(pieces.pins) == 2 * cuts
    radius, depth = HARDWARE.holder.pin_mm[0] / 2.0 + HARDWARE.fit.press_mm, HARDWARE.holder.pin_mm[1] / 2.0 + 0.2
    # A teardrop: a disc less the segment under its roof, and the roof.
    steep = math.radians(42.0)
    hole = radius**2 * (math.pi - (math.pi / 2 - steep) + 1 / math.tan(steep)) * depth
    volume = 0.0
    for piece in pieces.parts:
        solid = piece.make(piece.plan)
        assert len(solid.solids()) == 1
        assert solid.is_valid
        volume += solid.volume
        on_bed = transform(piece.print_from_rig, np.array([tuple(vertex) for vertex in solid.vertices()]))
        assert (np.ptp(on_bed, axis=0) <= np.array(HARDWARE.printer.bed_mm)).all()
        assert on_bed[:, 2].min() == pytest.approx(0.0, abs=1e-9)
        assert len(solid.faces().filter_by(GeomType.CYLINDER)) == len(piece.plan.rig_from_pins)
    assert volume == pytest.approx(length * width * 20.0 - 4 * cuts * hole, rel=1e-9)
    assert len({piece.identity for piece in pieces.parts}) == count


def test_a_pin_lies_half_in_either_piece() -> None:
    part, corners = bar_part(BarPlan(300.0, 30.0, 20.0))
    pieces = split(part, corners, HARDWARE)
    solids = {piece.name: piece.make(piece.plan) for piece in pieces.parts}
    for pin in pieces.pins:
        assert pin.joins == ("bar_1", "bar_2")
        axis, top = pin.rig_from_item[:3, 2], pin.rig_from_item[:3, 3]
        ends = np.sort([top[0], (top - pin.length_mm * axis)[0]])
        np.testing.assert_allclose(ends, [142.0, 158.0], atol=1e-9)
        for along in np.linspace(0.05, 0.95, 7):
            point = tuple(top - along * pin.length_mm * axis)
            assert not any(solid.solids()[0].is_inside(point) for solid in solids.values())
            around = tuple(np.array(point) + np.array([0.0, 1.0 + HARDWARE.holder.pin_mm[0] / 2.0, 0.0]))
            assert any(solid.solids()[0].is_inside(around) for solid in solids.values())


def test_cuts_keep_to_the_places_asked_for_and_else_to_solid_ones() -> None:
    part, corners = bar_part(BarPlan(300.0, 30.0, 20.0))
    asked = split(part, corners, HARDWARE, ((120.0,), ()))
    assert isinstance(asked.parts[0].plan, PiecePlan)
    assert asked.parts[0].plan.high_mm[0] == 120.0
    slotted, corners = bar_part(BarPlan(300.0, 30.0, 20.0, slot_mm=26.0))
    cut = split(slotted, corners, HARDWARE).parts[0].plan.high_mm[0]
    assert not 120.0 - 9.2 < cut < 180.0 + 9.2


def test_what_cannot_be_cut_is_refused_with_the_measure() -> None:
    part, corners = bar_part(BarPlan(300.0, 30.0, 6.0))
    with pytest.raises(
        InputError, match=r"a cut at x = 150\.0 mm has space for two pins 0\.0 mm apart, expected 12 mm"
    ):
        split(part, corners, HARDWARE)
    part, corners = bar_part(BarPlan(300.0, 30.0, 260.0))
    with pytest.raises(InputError, match=r"bar is 260\.0 mm high, expected at most 250 mm"):
        split(part, corners, HARDWARE)
    part, corners = bar_part(BarPlan(300.0, 30.0, 20.0, slot_mm=12.0))
    # Both cuts are solid, but so near the slot's ends that only two legs lie between them.
    part, corners = bar_part(BarPlan(300.0, 60.0, 20.0, slot_mm=20.0))
    with pytest.raises(InputError, match=r"piece 2 of the bar falls apart into 2, expected one"):
        split(part, corners, HARDWARE, ((135.0, 165.0), ()))
    part, corners = bar_part(BarPlan(300.0, 30.0, 20.0))
    with pytest.raises(InputError, match=r"piece 1 of the bar is 230\.0 mm along the bed, expected at most 220 mm"):
        split(part, corners, HARDWARE, ((230.0,), ()))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_cut_keeps_off_corners_that_it_all_but_touches(side: float) -> None:
    """A groove across the bar ends in the middle, where the cut is asked for, but for rounding.

    Moved towards the groove, the cut leaves its end whole; moved away, a fin as thin as the move.
    """

    def make(plan: float) -> Part:
        with BuildPart() as bar:
            Box(300.0, 30.0, 20.0, align=(Align.MIN, Align.MIN, Align.MIN))
            with Locations((150.0 + 20.0 * side + plan, 15.0, 20.0)):
                Box(40.0, 30.0, 2.0, align=(Align.CENTER, Align.CENTER, Align.MAX), mode=Mode.SUBTRACT)
        return Part(bar.solids())

    corners = np.array([(0.0, 0.0, 0.0), (300.0, 30.0, 20.0)])
    for rounding in (0.0, 1e-5, -1e-5):
        part = PartPlan("bar", "Bar", "MC-99", rounding, make, np.eye(4), np.zeros(3), (0.5, 0.5, 0.5))
        first, second = split(part, corners, HARDWARE, ((150.0,), ())).parts
        cut = first.plan.high_mm[0]
        assert cut == second.plan.low_mm[0] == pytest.approx(150.0 + 0.01 * side, abs=1e-9)
        xs = np.array([vertex.X for piece in (first, second) for vertex in piece.make(piece.plan).vertices()])
        off = np.abs(xs - cut)
        assert not ((off > 1e-7) & (off < 0.005)).any()
        assert (off < 1e-7).any()
