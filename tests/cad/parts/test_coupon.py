"""The fit coupon: gauges as in the parts, which do not overlap."""

from __future__ import annotations

import re
from itertools import combinations, pairwise

import numpy as np
import pytest

from mirrorcam.cad.assembly.catalogue import parts_of, purchased_items
from mirrorcam.cad.assembly.components import mesh_of
from mirrorcam.cad.assembly.device_plan import plan_device
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.parts.coupon import (
    GAUGE_WALL_MM,
    GO_DEPTH_MM,
    GO_MM,
    LENS_STEPS_MM,
    PLATE_MM,
    RIG_FROM_COUPON_MM,
    THREAD_STEPS_MM,
    CouponPlan,
    gauges_of,
    plan_coupon,
    spacer_mm,
)
from mirrorcam.cad.plan.back_table import back_of
from mirrorcam.cad.plan.dimension import Hole
from mirrorcam.cad.plan.fasteners import NUT_FIT_MM, Bore, Hexagon
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.plan.part_plan import plain
from mirrorcam.cad.plan.prisms import corners_of
from mirrorcam.cad.plan.rectangles import TEST_MIRROR_MM
from mirrorcam.cad.plan.seats import Frustum, mirror_prism
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera_library import read_body
from mirrorcam.optics.geometry.layout import Layout

CLAMPED = HARDWARE.replaced(back=back_of("gen2"))
FREE_MM, RIM_MM = HARDWARE.fit.free_mm, HARDWARE.holder.rim_mm


@pytest.fixture(scope="module")
def coupon(default_layout: Layout) -> CouponPlan:
    return plan_coupon(default_layout, HARDWARE)


def gauges(plan: CouponPlan) -> list[Bore]:
    """The holes for the lens ring, from left to right."""
    upright = [cut for cut in plan.cuts if isinstance(cut, Bore) and cut.axis[2] == -1.0]
    return sorted(upright, key=lambda bore: float(bore.mouth[0]))


def within(solids: tuple[object, ...], points: FloatArray) -> FloatArray:
    """Mask (n,) of the points (n, 3) in one of the prisms."""
    return np.any([solid.contains(points) for solid in solids if isinstance(solid, Frustum)], axis=0)


def test_the_test_mirror_has_the_play_of_a_mirror_in_its_pocket(coupon: CouponPlan) -> None:
    half = np.array(TEST_MIRROR_MM) / 2.0 + FREE_MM
    middle = RIG_FROM_COUPON_MM + np.array([*(half + RIM_MM), PLATE_MM + 0.1])
    sides = np.array([(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)])
    reach = np.abs(sides[:, :2] @ half)[:, None]
    assert not within(coupon.pieces, middle + (reach - 0.01) * sides).any()
    assert within(coupon.pieces, middle + (reach + 0.01) * sides).all()
    assert within(coupon.pieces, middle + (reach + RIM_MM - 0.01) * sides).all()


def test_the_seat_has_three_pads_under_the_test_mirror_as_high_as_the_glue(coupon: CouponPlan) -> None:
    low = RIG_FROM_COUPON_MM[:2] + FREE_MM + RIM_MM
    floor = RIG_FROM_COUPON_MM[2] + PLATE_MM
    pads = [piece for piece in coupon.pieces if len(piece.top) == 8]
    assert len(pads) == 3
    for pad in pads:
        assert pad.top[:, 2] == pytest.approx(np.full(8, floor + HARDWARE.holder.bond_mm))
        # Each pad is completely behind the mirror, wherever that is in its pocket.
        assert (pad.top[:, :2] > low + FREE_MM - 1e-9).all()
        assert (pad.top[:, :2] < low + np.array(TEST_MIRROR_MM) - FREE_MM + 1e-9).all()
        assert not within(coupon.cuts, pad.top).any()


def test_with_carriers_a_strip_is_as_thick_as_their_gap(default_layout: Layout) -> None:
    plan, plain_one = plan_coupon(default_layout, HARDWARE, 1.2), plan_coupon(default_layout, HARDWARE)
    (strip,) = [piece for piece in plan.pieces if piece.base[:, 0].min() < RIG_FROM_COUPON_MM[0] - 1.0]
    heights = corners_of((strip,))[:, 2] - RIG_FROM_COUPON_MM[2]
    assert {round(float(height), 9) for height in heights} == {0.0, 1.2}
    assert len(plan.pieces) == len(plain_one.pieces) + 1


def test_the_strip_for_gaps_between_mirrors_just_enters_the_narrowest(default_layout: Layout) -> None:
    spacer = spacer_mm(default_layout, HARDWARE)
    solids = [solid_of(mesh_of(mirror_prism(mirror))) for mirror in default_layout.mirrors]
    narrowest = min(first.min_gap(second, 20.0) for first, second in combinations(solids, 2))
    assert 0.0 <= narrowest - spacer < 0.2
    assert spacer_mm(default_layout.replaced(rows=1, cols=1, mirrors=default_layout.mirrors[:1]), HARDWARE) == 0.0
    on_screws = HARDWARE.replaced(holder=HARDWARE.holder.replaced(mirrors="screws"))
    assert spacer_mm(default_layout, on_screws) == 0.0


@pytest.mark.parametrize("thickness_mm", [4.0, 6.0])
def test_rims_are_as_high_over_the_thickest_mirror_as_the_holders(default_layout: Layout, thickness_mm: float) -> None:
    first, *others = default_layout.mirrors
    layout = default_layout.replaced(mirrors=(first.replaced(thickness_mm=thickness_mm), *others))
    rims = corners_of(plan_coupon(layout, HARDWARE).pieces[1:5])[:, 2]
    expected = PLATE_MM + HARDWARE.holder.bond_mm + HARDWARE.holder.rim_height_of_sheet * thickness_mm
    assert rims.max() - RIG_FROM_COUPON_MM[2] == pytest.approx(expected)


def test_the_gauges_are_the_lens_ring_and_a_little_less_and_more(coupon: CouponPlan) -> None:
    ring = HARDWARE.camera.lens_ring_mm
    assert [2.0 * bore.radius_mm for bore in gauges(coupon)] == pytest.approx([ring + step for step in LENS_STEPS_MM])
    stated = sorted(hole.diameter_mm for hole in coupon.dimensions if isinstance(hole, Hole))
    assert set(np.round([ring + step for step in LENS_STEPS_MM], 3)) <= set(stated)
    for bore in gauges(coupon):
        top, bottom = bore.mouth[2], bore.mouth[2] - bore.depth_mm
        assert bottom < RIG_FROM_COUPON_MM[2] < RIG_FROM_COUPON_MM[2] + PLATE_MM < top
    for left, right in zip(gauges(coupon), gauges(coupon)[1:], strict=False):
        wall = right.mouth[0] - left.mouth[0] - left.radius_mm - right.radius_mm
        assert wall >= 2.0 * GAUGE_WALL_MM - max(LENS_STEPS_MM) - 1e-9


def notched(plan: CouponPlan, point: FloatArray, half_width_mm: float) -> int:
    """Number of notches that a line along x through a point meets."""
    x = np.linspace(-1.0, 1.0, 2001) * half_width_mm
    return int(np.count_nonzero(np.diff(within(plan.cuts, point + x[:, None] * [1.0, 0.0, 0.0]).astype(int)) == 1))


def test_one_two_and_three_notches_tell_the_gauges_apart(coupon: CouponPlan) -> None:
    pitch = HARDWARE.camera.lens_ring_mm + 2.0 * GAUGE_WALL_MM
    for count, bore in enumerate(gauges(coupon), start=1):
        edge = np.array([bore.mouth[0], bore.mouth[1] + pitch / 2.0 - 0.5, RIG_FROM_COUPON_MM[2] + 1.0])
        assert notched(coupon, edge, pitch / 2.0) == count
    lying_top, upright_top = (corners_of((block,))[:, 2].max() - 0.5 for block in blocks(coupon))
    for count, bore in enumerate(thread_holes(coupon), start=1):
        assert notched(coupon, np.array([bore.mouth[0], bore.mouth[1] + 1.0, lying_top]), 4.0) == count
    edge_y = corners_of(blocks(coupon)[1:])[:, 1].max() - 0.5
    for count, bore in enumerate(upright_holes(coupon), start=1):
        assert notched(coupon, np.array([bore.mouth[0], edge_y, upright_top]), 4.0) == count


def blocks(plan: CouponPlan) -> tuple[Frustum, ...]:
    """The blocks with horizontal and with upright screw holes, after the plate and the four rims."""
    first, second = plan.pieces[5:7]
    assert isinstance(first, Frustum)
    assert isinstance(second, Frustum)
    return first, second


def upright_holes(plan: CouponPlan) -> list[Bore]:
    """The holes for inserts that are open on the bed, from left to right."""
    upright = [cut for cut in plan.cuts if isinstance(cut, Bore) and cut.axis[2] == 1.0]
    return sorted(upright, key=lambda bore: float(bore.mouth[0]))


def thread_holes(plan: CouponPlan) -> list[Bore]:
    """The horizontal holes for inserts, from left to right."""
    level = [cut for cut in plan.cuts if isinstance(cut, Bore) and cut.axis[1] == 1.0]
    return sorted(level, key=lambda bore: float(bore.mouth[0]))


def test_screw_holes_are_those_of_the_parts_and_a_little_less_and_more(
    coupon: CouponPlan, default_layout: Layout
) -> None:
    screw = HARDWARE.screw
    expected = [screw.insert_hole_mm + step for step in THREAD_STEPS_MM]
    for holes in (thread_holes(coupon), upright_holes(coupon)):
        assert [2.0 * bore.radius_mm for bore in holes] == pytest.approx(expected)
    for bore in upright_holes(coupon):
        assert bore.mouth[2] == pytest.approx(RIG_FROM_COUPON_MM[2], abs=0.02)
        assert within(blocks(coupon)[1:], bore.mouth + np.array([0.0, 0.0, bore.depth_mm])).all()
    for left, right in pairwise(thread_holes(coupon)):
        assert right.mouth[0] - left.mouth[0] - left.radius_mm - right.radius_mm >= screw.insert_wall_mm
    nuts = plan_coupon(default_layout, HARDWARE.replaced(screw=screw.replaced(kind="nut")))
    flats = [cut.flats_mm for cut in nuts.cuts if isinstance(cut, Hexagon)]
    assert flats == pytest.approx([screw.nut_flats_mm + NUT_FIT_MM + step for step in THREAD_STEPS_MM for _ in "12"])


@pytest.mark.parametrize("back", ["none", "gen2", "monitor"])
def test_every_insert_is_printed_as_one_of_the_gauges(default_layout: Layout, back: str) -> None:
    """Open on the bed or on its side; the hole of the clip's corner screw leans by 45 deg, with a roof."""
    device = plan_device(default_layout, HARDWARE.replaced(back=back_of(back)))
    parts = {part.name: part for part in parts_of(device)}
    for item in purchased_items(device):
        if item.kind == "insert":
            out = parts[item.joins[-1]].print_from_rig[:3, :3] @ item.rig_from_item[:3, 2]
            assert -0.1 < out[2] < 0.71 or out[2] < -0.99, (item.joins, out)


@pytest.mark.parametrize("height_mm", [28.0, 29.0, 60.0])
def test_the_slot_lets_the_stated_body_in_and_stops_it_at_the_step(default_layout: Layout, height_mm: float) -> None:
    camera = HARDWARE.camera.replaced(height_mm=height_mm)
    plan = plan_coupon(default_layout, HARDWARE.replaced(camera=camera))
    low, high = corners_of(plan.pieces).min(axis=0), corners_of(plan.pieces).max(axis=0)
    x = np.arange(low[0], high[0], 0.01)
    widths = []
    for depth in (0.5 * GO_DEPTH_MM, 1.5 * GO_DEPTH_MM):
        line = np.column_stack([x, np.full_like(x, high[1] - depth), np.full_like(x, low[2] + 1.0)])
        widths.append(0.01 * np.count_nonzero(within(plan.cuts, line)))
        assert not within(plan.cuts, line[[0, -1]]).any()
    assert widths == pytest.approx([height_mm + GO_MM, height_mm - GO_MM], abs=0.03)


def test_a_bare_board_has_no_slot_for_its_body(default_layout: Layout) -> None:
    hardware = HARDWARE.replaced(camera=read_body("board_38"))
    assert "slot with a step" not in {gauge.name for gauge in gauges_of(default_layout, hardware)}
    plan = plan_coupon(default_layout, hardware)
    assert len(plan.cuts) == len(plan_coupon(default_layout, HARDWARE).cuts) - 2


@pytest.mark.parametrize("hardware", [HARDWARE, CLAMPED, HARDWARE.replaced(screw=HARDWARE.screw.replaced(kind="nut"))])
def test_every_gauge_changes_with_the_parameter_that_it_names(default_layout: Layout, hardware: Hardware) -> None:
    tables = {"fit": "fit", "screw": "screw", "back": "back"}
    before = plain(plan_coupon(default_layout, hardware))
    found = gauges_of(default_layout, hardware)
    assert len(found) == (5 if hardware is CLAMPED else 4)
    for gauge in found:
        name, *table = re.findall(r"`\[?(\w+)\]?`", gauge.parameter)
        place = tables[table[0]] if table else "camera"
        values = getattr(hardware, place)
        changed = hardware.replaced(**{place: values.replaced(**{name: getattr(values, name) + 0.1})})
        assert plain(plan_coupon(default_layout, changed)) != before, gauge.name


def test_the_wrist_reaches_into_the_plate_and_clears_the_other_gauges(default_layout: Layout) -> None:
    coupon = plan_coupon(default_layout, CLAMPED)
    ring = coupon.ring
    assert ring is not None
    deepest = coupon.centre[0] - ring.radius_mm
    assert deepest < coupon.right_mm < coupon.centre[0]
    assert ring == CLAMPED.back.ring_gauge
    edge = deepest - ring.ring_mm
    assert corners_of(coupon.pieces[1:])[:, 0].max() <= edge
    assert max(bore.mouth[0] + bore.radius_mm for bore in gauges(coupon)) <= edge


def test_without_a_clamp_there_is_no_segment(coupon: CouponPlan) -> None:
    assert coupon.ring is None
    assert coupon.right_mm == corners_of(coupon.pieces)[:, 0].max()


def test_the_strip_does_not_make_the_coupon_wider_than_the_bed(default_layout: Layout) -> None:
    wide = HARDWARE.replaced(camera=HARDWARE.camera.replaced(lens_ring_mm=63.0))
    for hardware in (HARDWARE, wide):
        corners = corners_of(plan_coupon(default_layout, hardware, 1.0).pieces)
        assert np.ptp(corners[:, 0]) <= hardware.printer.bed_mm[0]
    assert np.ptp(corners[:, 0]) > HARDWARE.printer.bed_mm[0] - 22.0
