"""What the mirror holder is made of, as plain numbers: material, light that it gives way to, and what is cut out of it.

The slab's back is flat: it lies on the print bed (every seat then looks up, nothing needs support), and the mount is
screwed to it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from manifold3d import Manifold
from shapely import Polygon, box, get_coordinates
from shapely.geometry.polygon import orient

from mirrorcam.cad.holder.back import (
    FrontSurface,
    fits_bed,
    mount_axes,
    place_cuts,
    place_mount,
    screw_depths_mm,
    slot_way,
    slot_width_mm,
)
from mirrorcam.cad.holder.glue import groove_volume, grooves_of, planned_cover, runs_along_cut
from mirrorcam.cad.holder.planar_csg import Workshop
from mirrorcam.cad.holder.rims import RELIEF_MM, beside_cuts, plan_rims
from mirrorcam.cad.holder.stray_light import Ring, plan_walls
from mirrorcam.cad.holder.webs import Hollow, plan_hollows
from mirrorcam.cad.plan.bed import bed_lengths_mm, require_height
from mirrorcam.cad.plan.cuts import Cuts
from mirrorcam.cad.plan.hardware import Fastening, Hardware
from mirrorcam.cad.plan.seats import Frustum, keep_outs, outline_at
from mirrorcam.cad.splitting.body_cuts import fragments
from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import rigid, transform

# Solids that are joined reach into each other by so much: faces that only touch are not joined for sure.
OVERLAP_MM = 0.5


@dataclass(frozen=True)
class HolderPlan:
    """The solids of a mirror holder, in rig, mm.

    Material: `slab`, a `flange` round it, `cores` (right behind a mirror, their fronts the seats, row by row in `cols`
    columns), `fillers` (in the gaps around and between the mirrors, a little further back), `rims` (each with the
    ground it stands on after it) and, on the flange, `walls` against stray light. All of it gives way to `keep_outs`
    (of each mirror its pocket, camera cone and reflected beam), to the `grooves` of the seats, the `hollows` and, for
    nuts, the `slots` that they are put in by.

    `rig_from_mount` (4, 4) is the frame of the flat back: origin amid the mount holes, x along the rig's x, z out of
    the back. `holes_in_mount_mm` (4, 2) are on it; the thread of insert or nut lies `thread_mm` (from, to) deep, and a
    screw may reach `hole_depth_mm`. `size_mm` is the part's along x, y and z of that frame; `cuts_mm` are the
    positions along its x and y at which the part is cut to fit the bed. `planned_cover` is the share of every
    mirror's back that its seat bears.
    """

    slab: Frustum
    flange: Frustum
    cores: tuple[Frustum, ...]
    fillers: tuple[Frustum, ...]
    rims: tuple[Frustum, ...]
    walls: Ring
    keep_outs: tuple[tuple[Frustum, ...], ...]
    grooves: tuple[Frustum, ...]
    hollows: tuple[Hollow, ...]
    slots: tuple[Frustum, ...]
    rig_from_mount: FloatArray
    holes_in_mount_mm: FloatArray
    thread_mm: tuple[float, float]
    hole_depth_mm: float
    size_mm: tuple[float, float, float]
    cuts_mm: Cuts
    planned_cover: tuple[float, ...]
    cols: int
    screw: Fastening
    wall_mm: float

    @property
    def corners_in_rig(self) -> FloatArray:
        """Corners (n, 3) of all the material, before light is taken away: the part lies inside their hull."""
        solids = (self.slab, self.flange, *self.cores, *self.fillers, *self.rims)
        walls = (self.walls.outer_foot, self.walls.inner_foot, self.walls.outer_crest, self.walls.inner_crest)
        return np.vstack([*(np.vstack([solid.base, solid.top]) for solid in solids), *walls])

    @property
    def slot_ways(self) -> FloatArray:
        """The directions (n, 3) in rig of the slots for nuts, in the order of the holes; none for inserts."""
        ways = np.array([slot.top[0] - slot.base[0] for slot in self.slots]).reshape(-1, 3)
        return ways / np.linalg.norm(ways, axis=1, keepdims=True)

    @property
    def cuts_on_bed_mm(self) -> Cuts:
        """The cuts along x and y of the bed, on which the part lies by its back: y is the mount's, turned round."""
        return self.cuts_mm[0], tuple(-cut for cut in reversed(self.cuts_mm[1]))


def plan_holder(layout: Layout, hardware: Hardware) -> HolderPlan:
    """Lay out the mirror holder; raises InputError with the measure that breaks where it cannot be made."""
    axes = mount_axes(layout)
    front = FrontSurface(layout, axes, hardware.fit.free_mm + hardware.holder.rim_mm)
    border = _border(front.footprint, hardware)
    plan, body = _solid_plan(layout, axes, front, border, ((), ()), hardware)
    if not fits_bed(border, hardware):
        # Rims give way to cuts wherever these are.
        bare = body_of(Workshop(), replace(plan, rims=()))
        cuts = place_cuts(layout, axes, border, bare, hardware)
        # What a cut meets at the front does not depend on how thick the part is, which its pins decide.
        plan, body = _solid_plan(layout, axes, front, border, cuts, hardware)
    points = np.asarray(body.to_mesh64().vert_properties)[:, :3] @ plan.rig_from_mount[:3, :3]
    size = tuple(np.ptp(points, axis=0).tolist())
    require_height("mirror holder", size[2], hardware)
    in_mount = Polygon(get_coordinates(border) - plan.rig_from_mount[:3, 3] @ axes[:2].T)
    hollows = plan_hollows(body, plan.rig_from_mount, in_mount, plan.holes_in_mount_mm, plan.cuts_mm, hardware)
    return replace(plan, size_mm=size, hollows=hollows)


def _solid_plan(
    layout: Layout,
    axes: FloatArray,
    front: FrontSurface,
    border: Polygon,
    cuts: Cuts,
    hardware: Hardware,
) -> tuple[HolderPlan, Manifold]:
    """A holder without hollows, to be cut at places along the mount's axes from the pupil; and its body."""
    away = axes[2]
    mount = place_mount(front, hardware, cuts)

    def down_from(polygon: FloatArray) -> Frustum:
        return Frustum(polygon + (mount.back_mm - polygon @ away)[:, None] * away, polygon)

    seats = [outline_at(mirror, mirror.back_mm) for mirror in layout.mirrors]
    reach = mount.back_mm - min(float((polygon @ away).min()) for polygon in seats)
    reach += max(mirror.thickness_mm for mirror in layout.mirrors)
    volumes = keep_outs(layout, hardware)
    grooves = [
        tuple(
            groove
            for groove in grooves_of(index, layout.mirrors, away, hardware)
            if not runs_along_cut(mirror, groove, axes, cuts, hardware)
        )
        for index, mirror in enumerate(layout.mirrors)
    ]
    rims = plan_rims(layout, volumes, grooves, beside_cuts(axes, cuts, hardware), reach, hardware)
    rig_from_mount = rigid(axes.T, mount.centre_mm @ axes[:2] + mount.back_mm * away)
    in_mount = Polygon(get_coordinates(border) - mount.centre_mm)
    walls = plan_walls(
        layout,
        in_mount,
        rig_from_mount,
        [*chain.from_iterable(volumes), *(_way_in(mirror, reach, hardware) for mirror in layout.mirrors)],
        hardware.holder.floor_mm,
        hardware,
    )
    hull = get_coordinates(orient(front.footprint))[:-1] @ axes[:2] + front.deepest_mm * away
    around = get_coordinates(orient(border))[:-1] @ axes[:2] + (mount.back_mm - hardware.holder.floor_mm) * away
    thread_from, thread_to, hole_depth = screw_depths_mm(hardware)
    plan = HolderPlan(
        slab=down_from(hull),
        flange=down_from(around),
        cores=tuple(down_from(polygon) for polygon in seats),
        fillers=tuple(down_from(polygon + RELIEF_MM * away) for polygon in front.fillers),
        rims=tuple(solid for rim, ground in rims for solid in (rim, down_from(ground))),
        walls=walls,
        keep_outs=tuple(tuple(group) for group in volumes),
        grooves=tuple(
            groove_volume(mirror, groove, hardware)
            for mirror, group in zip(layout.mirrors, grooves, strict=True)
            for groove in group
        ),
        hollows=(),
        slots=_slots(mount.holes_mm, front.footprint, mount.centre_mm, rig_from_mount, hardware)
        if hardware.screw.kind == "nut"
        else (),
        rig_from_mount=rig_from_mount,
        holes_in_mount_mm=mount.holes_mm,
        thread_mm=(thread_from, thread_to),
        hole_depth_mm=hole_depth,
        size_mm=(0.0, 0.0, 0.0),
        cuts_mm=(
            tuple(cut - float(mount.centre_mm[0]) for cut in cuts[0]),
            tuple(cut - float(mount.centre_mm[1]) for cut in cuts[1]),
        ),
        planned_cover=planned_cover(layout.mirrors, grooves, volumes),
        cols=layout.cols,
        screw=hardware.screw,
        wall_mm=hardware.printer.wall_mm,
    )
    workshop = Workshop()
    return plan, one_piece(workshop.cut(body_of(workshop, plan), plan.slots), plan.wall_mm)


def body_of(workshop: Workshop, plan: HolderPlan) -> Manifold:
    """The holder without hollows, grooves and holes: what is material and not in any light."""
    away = plan.rig_from_mount[:3, 2]
    down, up, still = OVERLAP_MM * away, -OVERLAP_MM * away, np.zeros(3)
    body = workshop.joined(
        [
            plan.slab.stretched(down, still),
            plan.flange.stretched(down, still),
            # A core reaches into its pocket, whose floor is the seat.
            *(core.stretched(down, up) for core in plan.cores),
            *(filler.stretched(down, still) for filler in plan.fillers),
            *plan.rims[::2],
            *(ground.stretched(down, still) for ground in plan.rims[1::2]),
            plan.walls,
        ]
    )
    far = 10.0 * max(float(np.ptp(plan.slab.base, axis=0).max()), 1.0)
    square = np.array([[-far, -far, 0.0], [far, -far, 0.0], [far, far, 0.0], [-far, far, 0.0]])
    turn, origin = plan.rig_from_mount[:3, :3], plan.rig_from_mount[:3, 3]
    under = Frustum(square @ turn.T + origin, (square + np.array([0.0, 0.0, far])) @ turn.T + origin)
    return workshop.cut(body, [under, *(volume for group in plan.keep_outs for volume in group)])


def one_piece(body: Manifold, crumb_mm: float) -> Manifold:
    """The body, less crumbs that light leaves where seats meet, too small to print; InputError where it falls apart."""
    pieces = fragments(body, crumb_mm)
    if len(pieces) != 1:
        raise InputError(f"mirror holder falls apart into {len(pieces)} pieces where the light passes, expected one")
    return pieces[0]


def _border(footprint: Polygon, hardware: Hardware) -> Polygon:
    """Outline of the slab: the footprint and room for the walls against stray light, as far as the bed has room."""
    left, bottom, right, top = footprint.bounds
    bed = bed_lengths_mm((right - left, top - bottom), hardware)
    wide = footprint.buffer(hardware.holder.shade_out_mm, join_style="mitre", mitre_limit=1.5)
    # What does not fit is cut anyway.
    spare_x, spare_y = (
        (longest - length) / 2.0 if length <= longest else longest
        for length, longest in zip((right - left, top - bottom), bed, strict=True)
    )
    return wide.intersection(box(left - spare_x, bottom - spare_y, right + spare_x, top + spare_y)).simplify(0.05)


def _way_in(mirror: Mirror, reach_mm: float, hardware: Hardware) -> Frustum:
    """Where a mirror passes on its way into its pocket."""
    seat, fit = mirror.back_mm, hardware.fit.free_mm
    return Frustum(outline_at(mirror, seat, fit), outline_at(mirror, seat + reach_mm, fit))


def _slots(
    holes_mm: FloatArray, footprint: Polygon, centre_mm: FloatArray, rig_from_mount: FloatArray, hardware: Hardware
) -> tuple[Frustum, ...]:
    """The slots, from each hole square to the nearest edge, that nuts slide in by: held at their flats.

    A screw from the back pulls its nut against the slot's floor. The roof is a ridge of 45 deg.
    """
    begin, end, ridge = screw_depths_mm(hardware)
    half = slot_width_mm(hardware) / 2.0
    profile = np.array([(-half, -begin), (half, -begin), (half, -end), (0.0, -ridge - 0.05), (-half, -end)])
    corner = hardware.screw.nut_flats_mm / np.sqrt(3.0) + hardware.fit.slide_mm
    slots = []
    for hole in holes_mm:
        way = slot_way(footprint, centre_mm + hole)
        across = np.array([-way[1], way[0]])
        ends = [
            transform(rig_from_mount, np.column_stack([hole + place * way + profile[:, :1] * across, profile[:, 1]]))
            for place in (-corner, 1e3)
        ]
        slots.append(Frustum(ends[0], ends[1]))
    return tuple(slots)
