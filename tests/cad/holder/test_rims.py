"""Rims: outside all light and pockets, at the gap from their mirrors, away from cuts, on solid ground."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from shapely import Polygon

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.holder.back import mount_axes
from mirrorcam.cad.holder.holder_plan import plan_holder
from mirrorcam.cad.holder.rims import RELIEF_MM, cut_zones, plan_rims
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.seats import keep_outs, seat_distance_mm
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from tests.nightly import a_few


def spread(loop: FloatArray, other: FloatArray) -> FloatArray:
    """Points strictly inside the hull of two loops (n, 3)."""
    corners = np.vstack([loop, other])
    middle = corners.mean(axis=0)
    weights = np.random.default_rng(0).dirichlet(np.full(len(corners), 0.3), 400)
    return middle + 0.999 * (weights @ corners - middle)


@pytest.mark.parametrize(
    ("rows", "cols", "surface", "thickness_mm"),
    a_few(1, [(1, 2, "first", 1.0), (2, 2, "second", 2.0), (3, 4, "first", 3.0)]),
)
def test_rims_stay_out_of_all_light_and_all_pockets(
    make_parabola: Callable[..., Layout], rows: int, cols: int, surface: str, thickness_mm: float
) -> None:
    layout = make_parabola(rows, cols, surface=surface, thickness_mm=thickness_mm, gap_mm=1.5)
    body = plan_holder(layout, HARDWARE)
    assert len(body.rims) >= 2 * rows * cols
    volumes = [volume for group in keep_outs(layout, HARDWARE) for volume in group]
    for rim in body.rims[::2]:
        points = spread(rim.base, rim.top)
        assert not any(volume.contains(points).any() for volume in volumes)


@pytest.mark.parametrize("surface", a_few(1, ["first", "second"]))
def test_rims_stand_at_the_fit_on_two_sides_of_every_mirror(make_parabola: Callable[..., Layout], surface: str) -> None:
    """Light that spreads over an edge sets its rim back, but not on all sides: every mirror is located."""
    layout = make_parabola(2, 2, surface=surface, thickness_mm=2.0, gap_mm=2.0)
    plan = plan_holder(layout, HARDWARE)
    for mirror in layout.mirrors:
        outline = Polygon(mirror.outline_in_plane_mm)
        frame = mirror.rig_from_plane
        near = 0
        for rim in plan.rims[::2]:
            flat = Polygon((rim.top - frame[:3, 3]) @ frame[:3, :2])
            level = (rim.top - frame[:3, 3]) @ frame[:3, 2]
            stands = flat.distance(outline) == pytest.approx(HARDWARE.fit.free_mm, abs=1e-6)
            near += int(stands and np.ptp(level) < 1e-6)
        assert near >= 2


def test_a_first_surface_rim_ends_below_the_reflecting_plane(default_layout: Layout, device: Device) -> None:
    body = device.holder
    for rim in body.rims[::2]:
        owner = min(
            default_layout.mirrors,
            key=lambda m: np.abs(rim.base @ m.normal_in_rig + seat_distance_mm(m, HARDWARE) + 2.0 * RELIEF_MM).max(),
        )
        heights = rim.top @ owner.normal_in_rig + owner.distance_mm
        np.testing.assert_allclose(heights, -0.4 * owner.thickness_mm, atol=1e-9)


def test_no_rim_is_where_a_cut_would_leave_it_thinner_than_a_wall(default_layout: Layout) -> None:
    axes, wall = mount_axes(default_layout), HARDWARE.printer.wall_mm
    volumes = keep_outs(default_layout, HARDWARE)

    def rims_beside(cuts: tuple[tuple[float, ...], tuple[float, ...]]) -> list[FloatArray]:
        zones = cut_zones(axes, cuts, HARDWARE)
        rims = plan_rims(default_layout, volumes, [()] * len(volumes), zones, 20.0, HARDWARE)
        return [np.vstack([rim.base, rim.top, ground]) for rim, ground in rims]

    def nearest_mm(rims: list[FloatArray], axis: int, place: float) -> float:
        across = [rim @ axes[axis] - place for rim in rims]
        return min(max(float(side.min()), float(-side.max()), 0.0) for side in across)

    free = rims_beside(((), ()))
    # One cut through the middle of a rim parallel to it, and one through the middle of a rim that it crosses.
    along = min(free, key=lambda rim: float(np.ptp(rim @ axes[0])))
    crossed = max(free, key=lambda rim: float(np.ptp(rim @ axes[1])))
    x, y = float((along @ axes[0]).mean()), float((crossed @ axes[1]).mean())
    assert nearest_mm(free, 0, x) == nearest_mm(free, 1, y) == 0.0
    rims = rims_beside(((x,), (y,)))
    assert nearest_mm(rims, 0, x) >= wall
    assert nearest_mm(rims, 1, y) >= wall
    # All others remain, those that are crossed in two parts.
    assert sum(float(np.ptp(rim, axis=0).max()) for rim in rims) > 0.75 * sum(
        float(np.ptp(rim, axis=0).max()) for rim in free
    )


def test_the_slab_bears_the_grounds_of_all_rims(device: Device) -> None:
    """Ground outside the slab would start in the air, over a nut's slot in its side."""
    plan = device.holder
    to_back = plan.rig_from_mount[:3, :2]
    slab = Polygon(plan.slab.base @ to_back).buffer(1e-6)
    assert len(plan.rims) > 20
    for ground in plan.rims[1::2]:
        assert slab.contains(Polygon(ground.top @ to_back))
        assert slab.contains(Polygon(ground.base @ to_back))
