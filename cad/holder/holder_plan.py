"""Plan the mirror holder as plain numbers: its solids, and the light and grooves cut out of them.

The slab's back is flat and is printed on the bed, so every seat faces up and nothing needs support. The mount is
screwed to it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import chain

import numpy as np
from shapely import Polygon, box, get_coordinates
from shapely.geometry.polygon import orient

from mirrorcam.cad.holder.back import (
    FrontSurface,
    MountFace,
    fits_bed,
    mount_axes,
    nut_slots,
    place_cuts,
    place_mount,
    screw_depths_mm,
)
from mirrorcam.cad.holder.glue import (
    glue_mm3,
    groove_solid,
    grooves_of,
    planned_cover,
    runs_along_cut,
    unobstructed_outline,
)
from mirrorcam.cad.holder.holder_body import HolderPlan, body_of, one_piece
from mirrorcam.cad.holder.pads import pad_shapes, pad_solid, plan_pads
from mirrorcam.cad.holder.planar_csg import PlanarCsg
from mirrorcam.cad.holder.rims import RELIEF_MM, cut_zones, plan_rims
from mirrorcam.cad.holder.stray_light import Baffle, plan_baffle
from mirrorcam.cad.plan.cuts import Cuts, bed_lengths_mm, require_height
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import Frustum, keep_outs, outline_at, seat_height_mm
from mirrorcam.cad.printed_volume import printed_mm3
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import rigid


@dataclass(frozen=True)
class _Front:
    """The front of a holder, which is independent of its thickness and its cuts; `axes` (3, 3) are the mount's."""

    layout: Layout
    axes: FloatArray
    surface: FrontSurface
    border: Polygon
    seats: tuple[FloatArray, ...]
    keep_outs: list[list[Frustum]]


def plan_holder(layout: Layout, hardware: Hardware) -> HolderPlan:
    """Lay out the mirror holder.

    Parameters
    ----------
    layout : Layout
        The mirrors, in the rig frame.
    hardware : Hardware
        Fits, printer, screws and the holder's own dimensions.

    Returns
    -------
    HolderPlan
        All solids of the holder in the rig frame, mm.

    Raises
    ------
    InputError
        If the holder cannot be made; the message gives the dimension.
    """
    front = _front(layout, hardware)
    cuts: Cuts = ((), ())
    if not fits_bed(front.border, hardware):
        # The cuts are placed first, since rims keep clear of them and pins determine the part's thickness. The
        # obstacles to a cut are at the front and independent of that thickness.
        uncut = _without_rims(front, place_mount(front.surface, hardware), cuts, hardware)
        cuts = place_cuts(layout, front.axes, front.border, body_of(PlanarCsg(), uncut), hardware)
    mount = place_mount(front.surface, hardware, cuts)
    plan = _with_rims(_without_rims(front, mount, cuts, hardware), front, mount, cuts, hardware)
    csg = PlanarCsg()
    body = one_piece(csg.cut(body_of(csg, plan), plan.slots), plan.wall_mm)
    points = np.asarray(body.to_mesh64().vert_properties)[:, :3] @ plan.rig_from_mount[:3, :3]
    size = tuple(np.ptp(points, axis=0).tolist())
    require_height("mirror holder", size[2], hardware)
    lying = body.transform(np.linalg.inv(plan.rig_from_mount)[:3])
    return replace(plan, size_mm=size, printed_mm3=printed_mm3(lying, plan.wall_mm))


def _front(layout: Layout, hardware: Hardware) -> _Front:
    axes = mount_axes(layout)
    surface = FrontSurface(layout, axes, hardware.fit.free_mm + hardware.holder.rim_mm, hardware)
    return _Front(
        layout=layout,
        axes=axes,
        surface=surface,
        border=border_of(surface.footprint, hardware),
        seats=tuple(outline_at(mirror, seat_height_mm(mirror, hardware)) for mirror in layout.mirrors),
        keep_outs=keep_outs(layout, hardware),
    )


def _without_rims(front: _Front, mount: MountFace, cuts: Cuts, hardware: Hardware) -> HolderPlan:
    """A holder without rims and grooves; `cuts` are coordinates along the mount's x and y from the pupil."""
    axes, normal = front.axes, front.axes[2]
    column = partial(column_to_back, mount=mount, normal=normal)
    rig_from_mount = rigid(axes.T, mount.centre_mm @ axes[:2] + mount.back_mm * normal)
    hull = get_coordinates(orient(front.surface.footprint))[:-1] @ axes[:2] + front.surface.deepest_mm * normal
    rim = get_coordinates(orient(front.border))[:-1] @ axes[:2] + (mount.back_mm - hardware.holder.floor_mm) * normal
    nuts = hardware.screw.kind == "nut"
    thread_from, thread_to, hole_depth = screw_depths_mm(hardware)
    return HolderPlan(
        slab=column(hull),
        flange=column(rim),
        cores=tuple(column(seat) for seat in front.seats),
        pads=(),
        fillers=tuple(column(filler + RELIEF_MM * normal) for filler in front.surface.fillers),
        rims=(),
        walls=baffle_of(
            front.layout,
            front.border,
            front.keep_outs,
            _extent_mm(front, mount),
            mount,
            rig_from_mount,
            hardware,
        ),
        keep_outs=tuple(tuple(group) for group in front.keep_outs),
        grooves=(),
        slots=nut_slots(mount.holes_mm, front.surface.footprint, mount.centre_mm, rig_from_mount, hardware)
        if nuts
        else (),
        rig_from_mount=rig_from_mount,
        holes_in_mount_mm=mount.holes_mm,
        thread_mm=(thread_from, thread_to),
        hole_depth_mm=hole_depth,
        size_mm=(0.0, 0.0, 0.0),
        printed_mm3=0.0,
        cuts_mm=(
            tuple(cut - float(mount.centre_mm[0]) for cut in cuts[0]),
            tuple(cut - float(mount.centre_mm[1]) for cut in cuts[1]),
        ),
        planned_cover=(),
        glue_mm3=(),
        mirror_names=front.layout.mirror_names,
        screw=hardware.screw,
        wall_mm=hardware.printer.wall_mm,
    )


def _with_rims(plan: HolderPlan, front: _Front, mount: MountFace, cuts: Cuts, hardware: Hardware) -> HolderPlan:
    """The holder with rims round its mirrors, and grooves and pads in their seats, all clear of the cuts."""
    mirrors, axes = front.layout.mirrors, front.axes
    grooves = [
        tuple(
            groove
            for groove in grooves_of(index, mirrors, axes[2], hardware)
            if not runs_along_cut(mirror, groove, axes, cuts, hardware)
        )
        for index, mirror in enumerate(mirrors)
    ]
    extent = _extent_mm(front, mount)
    rims = plan_rims(front.layout, front.keep_outs, grooves, cut_zones(axes, cuts, hardware), extent, hardware)
    free = [unobstructed_outline(index, mirrors, front.keep_outs, hardware) for index in range(len(mirrors))]
    pads = [
        pad_shapes(plan_pads(name, mirror, area, mirror_grooves, axes, cuts, hardware), hardware)
        for name, mirror, area, mirror_grooves in zip(front.layout.mirror_names, mirrors, free, grooves, strict=True)
    ]
    return replace(
        plan,
        pads=tuple(
            pad_solid(mirror, shape, hardware) for mirror, shapes in zip(mirrors, pads, strict=True) for shape in shapes
        ),
        rims=tuple(solid for rim, ground in rims for solid in (rim, column_to_back(ground, mount, axes[2]))),
        grooves=tuple(
            groove_solid(mirror, groove, hardware)
            for mirror, group in zip(mirrors, grooves, strict=True)
            for groove in group
        ),
        planned_cover=tuple(map(planned_cover, mirrors, free, grooves, pads)),
        glue_mm3=tuple(glue_mm3(area, shapes, hardware) for area, shapes in zip(free, pads, strict=True)),
    )


def column_to_back(polygon: FloatArray, mount: MountFace, normal: FloatArray) -> Frustum:
    """The column from a polygon (n, 3) to the holder's back, along the back's normal."""
    return Frustum(polygon + (mount.back_mm - polygon @ normal)[:, None] * normal, polygon)


def _extent_mm(front: _Front, mount: MountFace) -> float:
    """Upper bound of the distance of the holder's material from a mirror along its normal."""
    extent = mount.back_mm - min(float((seat @ front.axes[2]).min()) for seat in front.seats)
    return extent + max(mirror.thickness_mm for mirror in front.layout.mirrors)


def baffle_of(
    layout: Layout,
    border: Polygon,
    keep_outs: list[list[Frustum]],
    extent_mm: float,
    mount: MountFace,
    rig_from_mount: FloatArray,
    hardware: Hardware,
) -> Baffle:
    """Plan the baffle outside all light, and outside the paths, `extent_mm` long, of mirrors into their pockets."""
    path_mm = extent_mm + 2.0 * hardware.holder.hood_mm
    insertions = (_insertion(mirror, path_mm, hardware) for mirror in layout.mirrors)
    return plan_baffle(
        layout,
        Polygon(get_coordinates(border) - mount.centre_mm),
        rig_from_mount,
        [*chain.from_iterable(keep_outs), *insertions],
        hardware.holder.floor_mm,
        hardware,
    )


def border_of(footprint: Polygon, hardware: Hardware) -> Polygon:
    """Outline of the slab: the footprint, enlarged for the baffle as far as the bed allows."""
    left, bottom, right, top = footprint.bounds
    bed = bed_lengths_mm((right - left, top - bottom), hardware)
    enlarged = footprint.buffer(hardware.holder.shade_out_mm, join_style="mitre", mitre_limit=1.5)
    # A side that does not fit the bed is cut anyway.
    spare_x, spare_y = (
        (longest - length) / 2.0 if length <= longest else longest
        for length, longest in zip((right - left, top - bottom), bed, strict=True)
    )
    return enlarged.intersection(box(left - spare_x, bottom - spare_y, right + spare_x, top + spare_y)).simplify(0.05)


def _insertion(mirror: Mirror, path_mm: float, hardware: Hardware) -> Frustum:
    """The volume that a mirror sweeps on its path into its pocket."""
    seat, gap = seat_height_mm(mirror, hardware), hardware.fit.free_mm
    return Frustum(outline_at(mirror, seat, gap), outline_at(mirror, seat + path_mm, gap))
