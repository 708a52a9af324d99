"""The fit coupon: its gauges are those of the parts, and none is in the way of another."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.parts.coupon import (
    GAUGE_WALL_MM,
    LENS_STEPS_MM,
    MIRROR_MM,
    PLATE_MM,
    RIG_FROM_COUPON_MM,
    CouponPlan,
    plan_coupon,
)
from mirrorcam.cad.plan.back_table import back_of
from mirrorcam.cad.plan.dimension import Hole
from mirrorcam.cad.plan.fasteners import Bore
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.prisms import corners_of
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.optics.base.values import FloatArray
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
    """Which of points (n, 3) lie in one of the prisms."""
    return np.any([solid.contains(points) for solid in solids if isinstance(solid, Frustum)], axis=0)


def test_the_test_mirror_has_the_play_of_a_mirror_in_its_pocket(coupon: CouponPlan) -> None:
    half = np.array(MIRROR_MM) / 2.0 + FREE_MM
    middle = RIG_FROM_COUPON_MM + np.array([*(half + RIM_MM), PLATE_MM + 0.1])
    sides = np.array([(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)])
    reach = np.abs(sides[:, :2] @ half)[:, None]
    assert not within(coupon.pieces, middle + (reach - 0.01) * sides).any()
    assert within(coupon.pieces, middle + (reach + 0.01) * sides).all()
    assert within(coupon.pieces, middle + (reach + RIM_MM - 0.01) * sides).all()


@pytest.mark.parametrize("thickness_mm", [1.0, 3.0])
def test_rims_are_as_high_over_the_thickest_mirror_as_the_holders(default_layout: Layout, thickness_mm: float) -> None:
    first, *others = default_layout.mirrors
    layout = default_layout.replaced(mirrors=(first.replaced(thickness_mm=thickness_mm), *others))
    rims = corners_of(plan_coupon(layout, HARDWARE).pieces[1:5])[:, 2]
    expected = PLATE_MM + HARDWARE.holder.rim_height_of_sheet * thickness_mm
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


def test_one_two_and_three_notches_tell_the_gauges_apart(coupon: CouponPlan) -> None:
    back = corners_of(coupon.pieces)[:, 1].max() - 0.5
    for count, bore in enumerate(gauges(coupon), start=1):
        x = np.linspace(-0.5, 0.5, 2001) * (HARDWARE.camera.lens_ring_mm + 2.0 * GAUGE_WALL_MM) + bore.mouth[0]
        line = np.column_stack([x, np.full_like(x, back), np.full_like(x, RIG_FROM_COUPON_MM[2] + 1.0)])
        assert np.count_nonzero(np.diff(within(coupon.cuts, line).astype(int)) == 1) == count


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


def test_a_device_that_is_clamped_to_nothing_has_no_segment_to_try(coupon: CouponPlan) -> None:
    assert coupon.ring is None
    assert coupon.right_mm == corners_of(coupon.pieces)[:, 0].max()
