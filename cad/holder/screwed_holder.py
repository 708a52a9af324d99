"""Plan a mirror holder with mirrors on carriers: a level plate with holes for the carriers' screws."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from manifold3d import Manifold
from shapely import MultiPoint, Point, Polygon, get_coordinates, unary_union
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from mirrorcam.cad.holder.adjuster import (
    CONE_DEG,
    DRIVER_HOLE_ENDS_MM,
    Adjuster,
    head_diameter_mm,
    min_plate_mm,
    plan_adjuster,
    travel_mm,
)
from mirrorcam.cad.holder.back import (
    LevelFront,
    MountFace,
    fits_bed,
    mount_areas,
    mount_axes,
    mount_positions,
    nut_slots,
    screw_depths_mm,
)
from mirrorcam.cad.holder.carriers import CarrierPlan, min_level_mm, plan_areas, plan_carrier
from mirrorcam.cad.holder.holder_body import HolderPlan, body_of, one_piece
from mirrorcam.cad.holder.holder_plan import baffle_of, border_of, column_to_back
from mirrorcam.cad.holder.planar_csg import PlanarCsg
from mirrorcam.cad.plan.cuts import bed_lengths_mm, require_height
from mirrorcam.cad.plan.dimension import Datum, Hole
from mirrorcam.cad.plan.fasteners import head_space_mm
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import keep_outs, outline_at, seat_height_mm
from mirrorcam.cad.plan.threads import thread_of
from mirrorcam.cad.printed_volume import printed_mm3
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import inverse, rigid, transform


@dataclass(frozen=True)
class ScrewedHolderPlan(HolderPlan):
    """A holder that is a level plate with a baffle, without cores, pads, rims or grooves.

    `carriers` are in the order of `mirror_names`, each with three screws as in `adjuster`.
    """

    carriers: tuple[CarrierPlan, ...]
    adjuster: Adjuster

    @property
    def corners_in_rig(self) -> FloatArray:
        """Corners (n, 3) of the plate, its baffle, and the carriers."""
        carriers = (np.vstack([carrier.body.base, carrier.body.top]) for carrier in self.carriers)
        return np.vstack([super().corners_in_rig, *carriers])

    @property
    def screws_mm3(self) -> float:
        """Volume of the shanks of the carriers' screws, three for each."""
        radius = thread_of(self.adjuster.thread).diameter_mm / 2.0
        return float(3 * len(self.carriers) * np.pi * radius**2 * self.adjuster.length_mm)

    @property
    def screws_in_mount_mm(self) -> FloatArray:
        """Intersections (3 n, 2) of the carriers' screws with the back, in its frame, three for each carrier."""
        mount_from_rig = inverse(self.rig_from_mount)
        points = [
            transform(carrier.rig_from_back, np.column_stack([carrier.screws_mm, np.zeros(3)]))
            for carrier in self.carriers
        ]
        return transform(mount_from_rig, np.vstack(points))[:, :2]

    @property
    def heads(self) -> FloatArray:
        """Intersections (3 n, 3) of the carriers' screws with the back, in the rig frame."""
        flat = self.screws_in_mount_mm
        return transform(self.rig_from_mount, np.column_stack([flat, np.zeros(len(flat))]))

    @property
    def screw_holes(self) -> tuple[Hole, ...]:
        """The holes of the carriers' screws for the drawing."""
        axis, screw = self.rig_from_mount[:3, 2], self.adjuster
        datum = Datum(self.rig_from_mount[:3, 3], "the middle of the mount's screws")
        cone = f"countersink Ø{screw.head_mm:.3g} x {2.0 * CONE_DEG:.0f}° (far side)"
        text = f"through for {screw.thread}, {cone}, counterbore Ø{screw.recess_wide_mm:.3g} ↧{screw.recess_mm:.3g}"
        return tuple(Hole(head, axis, thread_of(screw.thread).clearance_mm, text, datum=datum) for head in self.heads)


def plan_screwed_holder(layout: Layout, hardware: Hardware) -> ScrewedHolderPlan:
    """Lay out a holder with carriers.

    Parameters
    ----------
    layout : Layout
        The mirrors, in the rig frame. The holder is as far behind them as the carriers need.
    hardware : Hardware
        Fits, printer, screws, spring and range of tilt.

    Returns
    -------
    ScrewedHolderPlan
        All solids of the holder and its carriers in the rig frame, mm.

    Raises
    ------
    InputError
        If a mirror is too small for three screws, the holder is larger than the bed, or a screw would be longer than
        any on the list.
    """
    axes = mount_axes(layout)
    footprint = _footprint(layout, axes, hardware)
    border = border_of(footprint, hardware)
    _require_bed(border, hardware)
    # Plan with the front of the plate at z = 0 first.
    mounts = mount_positions(LevelFront(footprint, 0.0), hardware)
    index, areas = plan_areas(layout, axes, (_blocked_area(face, footprint, hardware) for face in mounts), hardware)
    mount = mounts[index]
    screws_radius, edge_radius = (max(area.radii_mm[k] for area in areas) for k in (0, 1))
    thickness = max(mount.back_mm, min_plate_mm(travel_mm(screws_radius, hardware), hardware))
    adjuster = plan_adjuster(screws_radius, edge_radius, thickness, hardware)
    level = max(
        min_level_mm(mirror, area, axes, adjuster.hole_mm, hardware)
        for mirror, area in zip(layout.mirrors, areas, strict=True)
    )
    front = level + adjuster.gap_mm
    mount = MountFace(front + adjuster.plate_mm, mount.centre_mm, mount.holes_mm)
    carriers = tuple(
        plan_carrier(name, mirror, area, level, axes, -layout.view_from_rig[1], adjuster, hardware)
        for name, mirror, area in zip(layout.mirror_names, layout.mirrors, areas, strict=True)
    )
    return _plan(layout, axes, footprint, border, front, mount, carriers, adjuster, hardware)


def _footprint(layout: Layout, axes: FloatArray, hardware: Hardware) -> Polygon:
    """The hull of all mirrors as seen from the back, with the margin for rims as in a holder for glue."""
    margin = hardware.fit.free_mm + hardware.holder.rim_mm
    outlines = [
        outline_at(mirror, seat_height_mm(mirror, hardware), margin, bevelled=True) for mirror in layout.mirrors
    ]
    return MultiPoint(np.vstack(outlines) @ axes[:2].T).convex_hull


def _blocked_area(mount: MountFace, footprint: Polygon, hardware: Hardware) -> BaseGeometry:
    """The area without axes of carriers' screws: near the mount's screws, and near the holes for their heads.

    Those holes and the screwdriver's have roofs along x (`DRIVER_HOLE_ENDS_MM`), and a wall between them.
    """
    spaces = mount_areas(mount.holes_mm, footprint, mount.centre_mm, hardware)
    areas = [space.buffer(head_diameter_mm(hardware.screw.thread) / 2.0) for space in spaces]
    radius, (low, high) = head_space_mm(hardware), DRIVER_HOLE_ENDS_MM
    for hole in mount.centre_mm + mount.holes_mm:
        disc, roof_tip = Point(hole).buffer(radius), Point(hole[0] - radius * high / low, hole[1])
        roofed = MultiPoint(np.vstack([get_coordinates(disc), get_coordinates(roof_tip)])).convex_hull
        near = MultiPoint(np.vstack([get_coordinates(roofed.buffer(-low)), get_coordinates(roofed) - [high, 0.0]]))
        areas.append(near.convex_hull.buffer(hardware.printer.wall_mm))
    return unary_union(areas)


def _require_bed(border: Polygon, hardware: Hardware) -> None:
    if fits_bed(border, hardware):
        return
    left, bottom, right, top = border.bounds
    width, depth = bed_lengths_mm((right - left, top - bottom), hardware)
    raise InputError(
        f"mirror holder with screws is {right - left:.0f} x {top - bottom:.0f} mm, but must fit the printer's bed of "
        f'{width:g} x {depth:g} mm in one piece: design smaller mirrors, or set holder.mirrors = "glue"'
    )


def _plan(
    layout: Layout,
    axes: FloatArray,
    footprint: Polygon,
    border: Polygon,
    front_mm: float,
    mount: MountFace,
    carriers: tuple[CarrierPlan, ...],
    adjuster: Adjuster,
    hardware: Hardware,
) -> ScrewedHolderPlan:
    normal = axes[2]
    rig_from_mount = rigid(axes.T, mount.centre_mm @ axes[:2] + mount.back_mm * normal)
    hull = get_coordinates(orient(footprint))[:-1] @ axes[:2] + front_mm * normal
    rim = get_coordinates(orient(border))[:-1] @ axes[:2] + (mount.back_mm - hardware.holder.floor_mm) * normal
    light = keep_outs(layout, hardware)
    nuts = hardware.screw.kind == "nut"
    thread_from, thread_to, hole_depth = screw_depths_mm(hardware)
    seats = np.vstack([carrier.body.top for carrier in carriers])
    extent = mount.back_mm - float((seats @ normal).min()) + max(mirror.thickness_mm for mirror in layout.mirrors)
    plan = ScrewedHolderPlan(
        slab=column_to_back(hull, mount, normal),
        flange=column_to_back(rim, mount, normal),
        cores=(),
        pads=(),
        fillers=(),
        rims=(),
        walls=baffle_of(layout, border, light, extent, mount, rig_from_mount, hardware),
        keep_outs=tuple(tuple(group) for group in light),
        grooves=(),
        slots=nut_slots(mount.holes_mm, footprint, mount.centre_mm, rig_from_mount, hardware) if nuts else (),
        rig_from_mount=rig_from_mount,
        holes_in_mount_mm=mount.holes_mm,
        thread_mm=(thread_from, thread_to),
        hole_depth_mm=hole_depth,
        size_mm=(0.0, 0.0, 0.0),
        printed_mm3=0.0,
        cuts_mm=((), ()),
        planned_cover=tuple(carrier.planned_cover for carrier in carriers),
        glue_mm3=tuple(carrier.glue_mm3 for carrier in carriers),
        mirror_names=layout.mirror_names,
        screw=hardware.screw,
        wall_mm=hardware.printer.wall_mm,
        carriers=carriers,
        adjuster=adjuster,
    )
    return _sized(plan, hardware)


def _sized(plan: ScrewedHolderPlan, hardware: Hardware) -> ScrewedHolderPlan:
    """The plan with the size of its body, and its volume together with its carriers'."""
    csg = PlanarCsg()
    body = one_piece(csg.cut(body_of(csg, plan), plan.slots), plan.wall_mm)
    points = np.asarray(body.to_mesh64().vert_properties)[:, :3] @ plan.rig_from_mount[:3, :3]
    size = tuple(np.ptp(points, axis=0).tolist())
    require_height("mirror holder", size[2], hardware)
    mount_from_rig = inverse(plan.rig_from_mount)[:3]
    carriers = (Manifold.hull_points(np.vstack([carrier.body.base, carrier.body.top])) for carrier in plan.carriers)
    volume = sum(printed_mm3(solid.transform(mount_from_rig), plan.wall_mm) for solid in (body, *carriers))
    return replace(plan, size_mm=size, printed_mm3=volume)
