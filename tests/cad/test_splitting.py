"""Cuts through meshed bodies: fragments, the body within spans, and the space for pins.

A piece as a solid: the part within the box of its plan, minus its teardrop holes; InputError if it falls apart.

Parts cut for the bed: pieces that fit, join without a gap and have space for pins; and parts that cannot be cut.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from build123d import Align, Box, BuildPart, GeomType, Locations, Mode, Part
from manifold3d import Manifold

from mirrorcam.cad.plan.cuts import PiecePlan, clearance_around_pin_mm, depth_for_pin_mm, hole_frame
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.cad.splitting import (
    area_for_pins,
    best_cuts_mm,
    falls_apart,
    fragments,
    inside,
    make_piece,
    split,
    triangles_of,
    uncut_part,
)
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import transform


def test_a_crumb_left_by_a_cut_is_omitted_and_a_fragment_refused() -> None:
    bar = Manifold.cube((300.0, 30.0, 20.0))
    for width, apart in ((1.0, False), (3.0, True)):
        # A corner connected only by a strip behind the cut.
        body = bar + Manifold.cube((2.0, 1.0, width)).translate((149.5, 31.0, 0.0))
        body += Manifold.cube((0.5, 2.0, width)).translate((151.0, 29.5, 0.0))
        assert falls_apart(body, 0, 150.9, 1.2) == apart
        assert not falls_apart(body, 0, 149.0, 1.2)
        assert len(fragments(body.trim_by_plane((-1.0, 0.0, 0.0), -150.9), 1.2)) == (2 if apart else 1)


def test_a_hole_leaves_a_wall_before_a_hollow_beyond_its_end() -> None:
    """Pins have no space if a hollow is nearer to the cut than the depth of their holes and a wall."""
    needed = HARDWARE.holder.pin_mm[1] / 2.0 + HARDWARE.fit.slide_mm + HARDWARE.printer.wall_mm
    bar, axes = Manifold.cube((300.0, 30.0, 20.0)), (-1e4, 1e4)
    for beyond, room in ((0.05, True), (-0.05, False)):
        hollow = Manifold.cube((50.0, 26.0, 16.0)).translate((150.0 + needed + beyond, 2.0, 2.0))
        found = area_for_pins(bar - hollow, 0, 150.0, axes, HARDWARE)
        assert (not found.is_empty) == room


def test_area_for_pins_in_a_bar_is_its_section_less_a_wall_round_the_hole() -> None:
    bar, around = Manifold.cube((300.0, 30.0, 20.0)), clearance_around_pin_mm(HARDWARE)
    room = area_for_pins(bar, 0, 150.0, (-1e4, 1e4), HARDWARE)
    np.testing.assert_allclose(room.bounds, (around, around, 30.0 - around, 20.0 - around), atol=1e-9)
    # For a cut normal to y the other axis is x; the clearance from the ends of the span is as from the outside.
    assert area_for_pins(bar, 1, 15.0, (50.0, 80.0), HARDWARE).bounds[0] == pytest.approx(50.0 + around)


def test_the_cut_with_most_area_for_pins_is_chosen_and_of_equals_the_central_one() -> None:
    bar = Manifold.cube((300.0, 30.0, 20.0))
    assert best_cuts_mm(bar, 0, (0.0, 300.0), 220.0, HARDWARE) == (150.0,)
    assert best_cuts_mm(bar, 0, (0.0, 200.0), 220.0, HARDWARE) == ()
    notch = Manifold.cube((20.0, 30.0, 12.0)).translate((140.0, 0.0, 8.0))
    (place,) = best_cuts_mm(bar - notch, 0, (0.0, 300.0), 220.0, HARDWARE)
    assert abs(place - 150.0) > 10.0 + depth_for_pin_mm(HARDWARE)


def test_the_part_of_a_body_inside_spans_has_their_volume() -> None:
    box = inside(Manifold.cube((300.0, 30.0, 20.0)), ((-5.0, 120.0), (10.0, 25.0)))
    assert box.volume() == pytest.approx(120.0 * 15.0 * 20.0)
    assert triangles_of(box).shape == (12, 3, 3)


CORNER = (Align.MIN, Align.MIN, Align.MIN)


def make_posts(gap_mm: float) -> Part:
    """Two posts of 20 x 20 x 20 mm on a plate of 4 mm, this far apart along x."""
    with BuildPart() as posts:
        Box(40.0 + gap_mm, 20.0, 4.0, align=CORNER)
        with Locations((0.0, 0.0, 0.0), (20.0 + gap_mm, 0.0, 0.0)):
            Box(20.0, 20.0, 20.0, align=CORNER)
    return Part(posts.solids())


PIECE = PiecePlan(
    whole=10.0,
    make=make_posts,
    rig_from_bed=np.eye(4),
    low_mm=(-1.0, -1.0, -1.0),
    high_mm=(15.0, 21.0, 21.0),
    rig_from_pins=np.zeros((0, 4, 4)),
    hole_mm=(3.0, 8.0),
    crumb_mm=1.2,
)


def test_a_piece_is_its_box_of_the_part_less_its_holes() -> None:
    assert make_piece(PIECE).volume == pytest.approx(15.0 * 20.0 * 20.0)
    holes = np.array([hole_frame(np.array([15.0, y, 10.0]), 0, -1.0) for y in (6.0, 14.0)])
    drilled = make_piece(replace(PIECE, rig_from_pins=holes))
    steep = math.radians(42.0)
    teardrop = 1.5**2 * (math.pi - (math.pi / 2 - steep) + 1 / math.tan(steep))
    assert drilled.volume == pytest.approx(15.0 * 20.0 * 20.0 - 2.0 * 8.0 * teardrop, rel=1e-9)
    # The roofs are up: the ridge is higher above a hole's axis than its radius.
    assert not drilled.solids()[0].is_inside((10.0, 6.0, 10.0 + 1.5 / math.sin(steep) - 0.05))
    assert drilled.solids()[0].is_inside((10.0, 6.0, 10.0 - 1.55))


def test_a_box_on_a_rotated_bed_is_rotated_with_it() -> None:
    turned = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    piece = make_piece(replace(PIECE, rig_from_bed=turned, low_mm=(-1.0, -60.0, -1.0), high_mm=(21.0, -40.0, 21.0)))
    box = piece.bounding_box()
    assert pytest.approx((40.0, 50.0)) == (box.min.X, box.max.X)


def test_a_piece_of_two_solids_is_refused() -> None:
    with pytest.raises(InputError, match="falls apart into 2 pieces, expected one"):
        make_piece(replace(PIECE, low_mm=(10.0, -1.0, 5.0), high_mm=(40.0, 21.0, 21.0)))


def test_booleans_on_a_piece_do_not_change_the_cached_part() -> None:
    before = uncut_part(10.0, make_posts).volume
    make_piece(PIECE)
    assert uncut_part(10.0, make_posts).volume == before


@dataclass(frozen=True)
class BarPlan:
    length_mm: float
    width_mm: float
    height_mm: float
    slot_mm: float = 0.0


def make_bar(plan: BarPlan) -> Part:
    """A bar along x from the origin, z up, with a slot through its full height in the middle."""
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


def test_a_part_that_fits_the_bed_is_unchanged_and_not_even_made() -> None:
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
    # Another plan for the same function gives another part.
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
    # A teardrop: a disc minus the segment under its roof, plus the roof.
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


def test_cuts_are_where_requested_or_else_where_the_part_is_solid() -> None:
    part, corners = bar_part(BarPlan(300.0, 30.0, 20.0))
    asked = split(part, corners, HARDWARE, ((120.0,), ()))
    assert isinstance(asked.parts[0].plan, PiecePlan)
    assert asked.parts[0].plan.high_mm[0] == 120.0
    slotted, corners = bar_part(BarPlan(300.0, 30.0, 20.0, slot_mm=26.0))
    cut = split(slotted, corners, HARDWARE).parts[0].plan.high_mm[0]
    assert not 120.0 - 9.2 < cut < 180.0 + 9.2


def test_a_part_that_cannot_be_cut_is_refused_with_the_dimension() -> None:
    part, corners = bar_part(BarPlan(300.0, 30.0, 6.0))
    with pytest.raises(
        InputError, match=r"a cut at x = 150\.0 mm has space for two pins 0\.0 mm apart, expected 12 mm"
    ):
        split(part, corners, HARDWARE)
    part, corners = bar_part(BarPlan(300.0, 30.0, 260.0))
    with pytest.raises(InputError, match=r"bar is 260\.0 mm high, expected at most 250 mm"):
        split(part, corners, HARDWARE)
    part, corners = bar_part(BarPlan(300.0, 30.0, 20.0, slot_mm=12.0))
    # Both cuts are solid, but so near the slot's ends that only two legs are between them.
    part, corners = bar_part(BarPlan(300.0, 60.0, 20.0, slot_mm=20.0))
    with pytest.raises(InputError, match=r"piece 2 of the bar falls apart into 2 pieces, expected one"):
        split(part, corners, HARDWARE, ((135.0, 165.0), ()))
    part, corners = bar_part(BarPlan(300.0, 30.0, 20.0))
    with pytest.raises(InputError, match=r"piece 1 of the bar is 230\.0 mm along the bed, expected at most 220 mm"):
        split(part, corners, HARDWARE, ((230.0,), ()))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_cut_is_shifted_off_corners_that_it_almost_touches(side: float) -> None:
    """A groove across the bar ends in the middle, at the requested cut up to rounding.

    A cut moved towards the groove leaves its end intact; moved away, it leaves a fin as thin as the move.
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
