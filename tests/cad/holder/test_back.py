"""Screw holes of the holder: printable ends in solid material, slots normal to the edge.

The back of the holder: its frame, the front as seen from it, and layouts with too little space for it.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import Literal

import numpy as np
import pytest
from build123d import GeomType
from shapely import Polygon, get_coordinates

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.holder.back import FrontSurface, mount_axes, slot_direction, tip_mm
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.holder.holder_plan import plan_holder
from mirrorcam.cad.holder.holder_solid import make_holder
from mirrorcam.cad.plan.fasteners import head_space_mm
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.seats import mirror_prism, seat_distance_mm
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import transform
from tests.nightly import a_few


def on_back(plan: HolderPlan, loop: FloatArray) -> Polygon:
    """A loop (n, 3) projected along the back's normal."""
    return Polygon(loop @ plan.rig_from_mount[:3, :2])


@pytest.mark.slow
@pytest.mark.parametrize("kind", a_few(1, ["insert", "nut"]))
def test_blind_holes_end_in_cones_that_print(default_layout: Layout, kind: Literal["insert", "nut"]) -> None:
    """The end of a hole is surrounded by material, and its cone is steeper than the printer's limit."""
    hardware = HARDWARE.replaced(screw=HARDWARE.screw.replaced(kind=kind))
    plan = plan_holder(default_layout, hardware)
    part = make_holder(plan)
    into = -plan.rig_from_mount[:3, 2]
    cones = [face for face in part.faces() if face.geom_type == GeomType.CONE]
    assert len(cones) == 4
    for cone in cones:
        assert cone.semi_angle is not None
        assert 0.0 < cone.semi_angle < hardware.printer.overhang_deg
    for hole in transform(plan.rig_from_mount, np.column_stack([plan.holes_in_mount_mm, np.zeros(4)])):
        end = hole + (plan.hole_depth_mm + tip_mm(hardware.screw)) * into
        assert not part.is_inside(tuple(end - 0.05 * into))
        for over in (0.05, hardware.printer.floor_mm - 0.05):  # below a groove for glue, the thinnest floor
            assert part.is_inside(tuple(end + over * into))


def test_slots_leave_square_to_the_edge(default_layout: Layout) -> None:
    """Each slot leaves the nearest side of the outline at a right angle, so that no wall over it ends in a tip."""
    square = Polygon([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)])
    np.testing.assert_allclose(slot_direction(square, np.array([3.0, 5.0])), [-1.0, 0.0])
    np.testing.assert_allclose(slot_direction(square, np.array([5.0, 8.0])), [0.0, 1.0])
    plan = plan_holder(default_layout, HARDWARE.replaced(screw=HARDWARE.screw.replaced(kind="nut")))
    corners = get_coordinates(on_back(plan, plan.slab.top).convex_hull)
    sides = np.diff(corners, axis=0) / np.linalg.norm(np.diff(corners, axis=0), axis=1)[:, None]
    ways = plan.slot_directions @ plan.rig_from_mount[:3, :2]
    assert len(ways) == 4
    np.testing.assert_allclose(np.abs(ways @ sides.T).min(axis=1), 0.0, atol=1e-9)


def test_the_mount_frame_is_right_handed_on_the_back_and_faces_away(default_layout: Layout, device: Device) -> None:
    body = device.holder
    turn, origin = body.rig_from_mount[:3, :3], body.rig_from_mount[:3, 3]
    np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    assert all(turn[:, 2] @ mirror.normal_in_rig < -0.8 for mirror in default_layout.mirrors)
    np.testing.assert_allclose(body.slab.base @ turn[:, 2], origin @ turn[:, 2])
    for solid in (*body.cores, *body.fillers, *body.rims):
        assert (solid.top @ turn[:, 2] < origin @ turn[:, 2]).all()


def test_fillers_stay_behind_adjacent_seats(default_layout: Layout) -> None:
    axes = mount_axes(default_layout)
    front = FrontSurface(default_layout, axes, HARDWARE.fit.free_mm + HARDWARE.holder.rim_mm, HARDWARE)
    seats = [Polygon(mirror_prism(mirror).base @ axes[:2].T) for mirror in default_layout.mirrors]
    for index, filler in enumerate(front.fillers):
        shadow = Polygon(filler @ axes[:2].T)
        for other, (mirror, seat) in enumerate(zip(default_layout.mirrors, seats, strict=True)):
            if other != index and shadow.intersects(seat):
                common = np.array(shadow.intersection(seat).exterior.coords) @ axes[:2]
                normal = np.cross(filler[1] - filler[0], filler[2] - filler[1])
                level = ((filler[0] - common) @ normal) / (axes[2] @ normal)
                points = common + level[:, None] * axes[2]
                assert (points @ mirror.normal_in_rig + seat_distance_mm(mirror, HARDWARE) < 1e-9).all()


def test_a_back_without_space_for_the_inserts_is_refused(make_parabola: Callable[..., Layout]) -> None:
    with pytest.raises(InputError, match="expected space for four M3 inserts with 4 mm of material"):
        plan_holder(make_parabola(1, 2, scale_mm=8.0, gap_mm=1.0), HARDWARE)


def test_mirrors_with_diverging_normals_are_refused(make_flat_pair: Callable[..., Layout]) -> None:
    mirrors = []
    for side in (-1.0, 1.0):
        point, normal = np.array([60.0 * side, 0.0, 60.0]), np.array([-0.95 * side, 0.0, -0.3])
        across = np.cross(normal, [0.0, 1.0, 0.0])
        outline = [point + 10.0 * across * a + np.array([0.0, 10.0 * b, 0.0]) for a, b in ((0, 0), (1, 0), (1, 1))]
        mirrors.append(Mirror.from_plane(point, normal, outline_in_rig_mm=outline))
    with pytest.raises(InputError, match="the mirrors' normals must be within 60 deg of their mean"):
        plan_holder(make_flat_pair(gap_mm=5.0).replaced(mirrors=tuple(mirrors)), HARDWARE)


def test_heads_of_screws_in_the_mount_have_a_wall_between_them(make_flat_pair: Callable[..., Layout]) -> None:
    """In a low holder: InputError for a back without space for heads, washers and drivers."""
    layout = make_flat_pair(gap_mm=2.0, height_mm=16.0)
    holes = plan_holder(layout, HARDWARE).holes_in_mount_mm
    apart = min(np.linalg.norm(one - other) for one, other in combinations(holes, 2))
    assert apart - 2.0 * head_space_mm(HARDWARE) >= HARDWARE.printer.wall_mm - 1e-9
    wide = HARDWARE.replaced(screw=HARDWARE.screw.replaced(washer_mm=11.0))
    with pytest.raises(InputError, match=r"12\.5 mm from each other"):
        plan_holder(layout, wide)
