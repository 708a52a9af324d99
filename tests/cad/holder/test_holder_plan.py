"""The plan of the holder: rims out of the light, holes in solid material, and layouts that cannot be built."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from shapely import Polygon

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.holder.back import FrontSurface, mount_axes
from mirrorcam.cad.holder.glue import groove_volume, grooves_of, runs_along_cut
from mirrorcam.cad.holder.holder_plan import HolderPlan, plan_holder
from mirrorcam.cad.holder.rims import RELIEF_MM, beside_cuts, plan_rims
from mirrorcam.cad.holder.screw_holes import tip_mm
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.seats import keep_outs, mirror_prism, seat_distance_mm
from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror


def spread(loop: FloatArray, other: FloatArray) -> FloatArray:
    """Points strictly inside the hull of two loops (n, 3)."""
    corners = np.vstack([loop, other])
    middle = corners.mean(axis=0)
    weights = np.random.default_rng(0).dirichlet(np.full(len(corners), 0.3), 400)
    return middle + 0.999 * (weights @ corners - middle)


@pytest.mark.parametrize(
    ("rows", "cols", "surface", "thickness_mm"), [(1, 2, "first", 1.0), (2, 2, "second", 2.0), (3, 4, "first", 3.0)]
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


@pytest.mark.parametrize("surface", ["first", "second"])
def test_rims_stand_at_the_fit_on_two_sides_of_every_mirror(make_parabola: Callable[..., Layout], surface: str) -> None:
    """Light that leans over an edge keeps its rim back, but not on all sides: something locates every mirror."""
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
            key=lambda m: np.abs(rim.base @ m.normal_in_rig + seat_distance_mm(m) + 2.0 * RELIEF_MM).max(),
        )
        heights = rim.top @ owner.normal_in_rig + owner.distance_mm
        np.testing.assert_allclose(heights, -0.4, atol=1e-9)


def test_the_mount_frame_is_right_handed_on_the_back_and_faces_away(default_layout: Layout, device: Device) -> None:
    body = device.holder
    turn, origin = body.rig_from_mount[:3, :3], body.rig_from_mount[:3, 3]
    np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    assert all(turn[:, 2] @ mirror.normal_in_rig < -0.8 for mirror in default_layout.mirrors)
    np.testing.assert_allclose(body.slab.base @ turn[:, 2], origin @ turn[:, 2])
    for solid in (*body.cores, *body.fillers, *body.rims):
        assert (solid.top @ turn[:, 2] < origin @ turn[:, 2]).all()


def test_every_hole_ends_a_wall_below_the_seats(default_layout: Layout, device: Device) -> None:
    body = device.holder
    turn, origin = body.rig_from_mount[:3, :3], body.rig_from_mount[:3, 3]
    angle = np.linspace(0.0, 2.0 * np.pi, 36)
    ring = HARDWARE.screw.insert_hole_mm / 2.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    for hole in body.holes_in_mount_mm:
        flat = np.column_stack(
            [ring + hole, np.full(len(ring), -HARDWARE.screw.insert_depth_mm - HARDWARE.printer.wall_mm)]
        )
        ends = flat @ turn.T + origin
        for mirror, core in zip(default_layout.mirrors, body.cores, strict=True):
            below = Polygon((core.top - origin) @ turn[:, :2])
            over = [below.contains(Polygon(ring + hole)), below.intersects(Polygon(ring + hole))]
            if any(over):
                assert (ends @ mirror.normal_in_rig + seat_distance_mm(mirror) < 1e-9).all()


def test_fillers_stay_behind_the_seats_beside_them(default_layout: Layout) -> None:
    axes = mount_axes(default_layout)
    front = FrontSurface(default_layout, axes, HARDWARE.fit.free_mm + HARDWARE.holder.rim_mm)
    seats = [Polygon(mirror_prism(mirror).base @ axes[:2].T) for mirror in default_layout.mirrors]
    for index, filler in enumerate(front.fillers):
        shadow = Polygon(filler @ axes[:2].T)
        for other, (mirror, seat) in enumerate(zip(default_layout.mirrors, seats, strict=True)):
            if other != index and shadow.intersects(seat):
                common = np.array(shadow.intersection(seat).exterior.coords) @ axes[:2]
                normal = np.cross(filler[1] - filler[0], filler[2] - filler[1])
                level = ((filler[0] - common) @ normal) / (axes[2] @ normal)
                points = common + level[:, None] * axes[2]
                assert (points @ mirror.normal_in_rig + seat_distance_mm(mirror) < 1e-9).all()


def test_a_groove_keeps_away_from_a_cut_that_it_runs_along_and_may_cross_one(default_layout: Layout) -> None:
    axes = mount_axes(default_layout)
    mirror = default_layout.mirrors[4]
    groove = grooves_of(4, default_layout.mirrors, -mirror.normal_in_rig, HARDWARE)[0]
    volume = groove_volume(mirror, groove, HARDWARE)
    corners = np.vstack([volume.base, volume.top])
    low, high = float((corners @ axes[0]).min()), float((corners @ axes[0]).max())
    wall = HARDWARE.printer.wall_mm
    for place, near in ((low - wall - 0.01, False), (low - wall + 0.01, True), (high + 0.9, True), (high + 1.3, False)):
        assert runs_along_cut(mirror, groove, axes, ((place,), ()), HARDWARE) == near
    assert not runs_along_cut(mirror, groove, axes, ((), (float((corners @ axes[1]).mean()),)), HARDWARE)


def test_no_rim_stands_where_a_cut_would_leave_less_than_a_wall_of_it(default_layout: Layout) -> None:
    axes, wall = mount_axes(default_layout), HARDWARE.printer.wall_mm
    volumes = keep_outs(default_layout, HARDWARE)

    def rims_beside(cuts: tuple[tuple[float, ...], tuple[float, ...]]) -> list[FloatArray]:
        zones = beside_cuts(axes, cuts, HARDWARE)
        rims = plan_rims(default_layout, volumes, [()] * len(volumes), zones, 20.0, HARDWARE)
        return [np.vstack([rim.base, rim.top, ground]) for rim, ground in rims]

    def nearest_mm(rims: list[FloatArray], axis: int, place: float) -> float:
        across = [rim @ axes[axis] - place for rim in rims]
        return min(max(float(side.min()), float(-side.max()), 0.0) for side in across)

    free = rims_beside(((), ()))
    # One cut through the middle of a rim that runs along it, and one through that of a rim that it crosses.
    along = min(free, key=lambda rim: float(np.ptp(rim @ axes[0])))
    crossed = max(free, key=lambda rim: float(np.ptp(rim @ axes[1])))
    x, y = float((along @ axes[0]).mean()), float((crossed @ axes[1]).mean())
    assert nearest_mm(free, 0, x) == nearest_mm(free, 1, y) == 0.0
    rims = rims_beside(((x,), (y,)))
    assert nearest_mm(rims, 0, x) >= wall
    assert nearest_mm(rims, 1, y) >= wall
    # All others stand, those crossed in two parts.
    assert sum(float(np.ptp(rim, axis=0).max()) for rim in rims) > 0.75 * sum(
        float(np.ptp(rim, axis=0).max()) for rim in free
    )


def thin_floor(body: HolderPlan) -> float:
    """Least material behind any corner of a seat, along the mount's z."""
    back = body.rig_from_mount[:3, 3] @ body.rig_from_mount[:3, 2]
    return min(float((back - core.top @ body.rig_from_mount[:3, 2]).min()) for core in body.cores)


def test_the_floor_is_as_thick_as_the_table_says(make_flat_pair: Callable[..., Layout]) -> None:
    layout = make_flat_pair(gap_mm=10.0)
    assert thin_floor(plan_holder(layout, HARDWARE)) == pytest.approx(
        HARDWARE.screw.insert_depth_mm + tip_mm(HARDWARE.screw) + HARDWARE.printer.wall_mm
    )
    assert thin_floor(
        plan_holder(layout, HARDWARE.replaced(holder=HARDWARE.holder.replaced(floor_mm=12.0)))
    ) == pytest.approx(12.0)


def test_a_part_higher_than_the_printer_is_refused_with_its_height(make_parabola: Callable[..., Layout]) -> None:
    with pytest.raises(InputError, match=r"mm high, expected at most 20 mm"):
        plan_holder(
            make_parabola(3, 3), HARDWARE.replaced(printer=HARDWARE.printer.replaced(bed_mm=(220.0, 220.0, 20.0)))
        )


def test_a_back_without_room_for_the_inserts_is_refused(make_parabola: Callable[..., Layout]) -> None:
    with pytest.raises(InputError, match="expected room for four M3 inserts with 4 mm of material"):
        plan_holder(make_parabola(1, 2, scale_mm=8.0, gap_mm=1.0), HARDWARE)


def test_mirrors_that_face_apart_are_refused(make_flat_pair: Callable[..., Layout]) -> None:
    mirrors = []
    for side in (-1.0, 1.0):
        point, normal = np.array([60.0 * side, 0.0, 60.0]), np.array([-0.95 * side, 0.0, -0.3])
        across = np.cross(normal, [0.0, 1.0, 0.0])
        outline = [point + 10.0 * across * a + np.array([0.0, 10.0 * b, 0.0]) for a, b in ((0, 0), (1, 0), (1, 1))]
        mirrors.append(Mirror.from_plane(point, normal, outline_in_rig_mm=outline))
    with pytest.raises(InputError, match="the mirrors face apart, expected normals within 60 deg of their mean"):
        plan_holder(make_flat_pair(gap_mm=5.0).replaced(mirrors=tuple(mirrors)), HARDWARE)


def test_the_slab_bears_the_grounds_of_all_rims(device: Device) -> None:
    """What stuck out of it would begin in the air, over a nut's slot in its side."""
    plan = device.holder
    to_back = plan.rig_from_mount[:3, :2]
    slab = Polygon(plan.slab.base @ to_back).buffer(1e-6)
    assert len(plan.rims) > 20
    for ground in plan.rims[1::2]:
        assert slab.contains(Polygon(ground.top @ to_back))
        assert slab.contains(Polygon(ground.base @ to_back))
