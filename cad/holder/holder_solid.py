"""The mirror holder as one B-rep solid, in the rig frame."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from build123d import Align, BuildPart, Cone, Cylinder, Face, Locations, Mode, Part, Plane, Shell, Solid, Wire, insert

from mirrorcam.cad.holder.back import BLUNT_RADIUS_MM, hole_mm, tip_mm
from mirrorcam.cad.holder.holder_body import HolderPlan, body_of, one_piece
from mirrorcam.cad.holder.planar_csg import PlanarCsg, brep
from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan
from mirrorcam.cad.plan.device_names import HOLDER
from mirrorcam.cad.plan.fasteners import OUTSIDE_MM
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import recipe
from mirrorcam.cad.plan.seats import Frustum, mirror_prism
from mirrorcam.cad.plan.threads import thread_of
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout

UPRIGHT = (Align.CENTER, Align.CENTER, Align.MIN)


def solid_of(frustum: Frustum) -> Solid:
    """The B-rep of a frustum, with flat faces."""
    return Solid(Shell([Face(Wire.make_polygon([tuple(corner) for corner in loop])) for loop in frustum.faces]))


def check_gaps(layout: Layout, hardware: Hardware) -> None:
    """Raise InputError if two mirrors are so close that the pocket of one cuts the seat of the other."""
    solids = [mirror_prism(mirror) for mirror in layout.mirrors]
    corners = [np.vstack([solid.base, solid.top]) for solid in solids]
    min_gap = hardware.fit.free_mm
    for i, j in combinations(range(len(solids)), 2):
        axis_gaps = np.maximum(
            corners[i].min(axis=0) - corners[j].max(axis=0), corners[j].min(axis=0) - corners[i].max(axis=0)
        )
        if axis_gaps.max() >= min_gap:
            continue
        gap = solid_of(solids[i]).distance_to(solid_of(solids[j]))
        if gap < min_gap:
            names = f"mirrors {layout.mirror_names[i]} and {layout.mirror_names[j]}"
            raise InputError(f"{names} are {gap:.2f} mm apart as cut from sheet, expected at least {min_gap:.2f} mm")


@recipe("cad.holder.solid.make_holder")
def make_holder(plan: HolderPlan) -> Part:
    """The holder as one B-rep: the union of its solids, minus light, pockets, grooves and holes."""
    csg = PlanarCsg()
    solid = one_piece(body_of(csg, plan), plan.wall_mm)
    # No groove cuts the baffle right behind the rims, where it would have a ceiling.
    grooved = csg.cut(solid, plan.grooves) + (solid ^ csg.solid(plan.walls))
    body = one_piece(csg.cut(grooved, plan.slots), plan.wall_mm)
    with BuildPart() as holder:
        insert(brep(csg, body))
        with Locations(back_plane(plan)):
            _drill_for_mount(plan)
    return _one_holder(holder)


@recipe("cad.holder.solid.make_screwed_holder")
def make_screwed_holder(plan: ScrewedHolderPlan) -> Part:
    """A holder for carriers as one B-rep: its plate and baffle, minus light, slots and the holes of all screws."""
    csg = PlanarCsg()
    body = one_piece(csg.cut(body_of(csg, plan), plan.slots), plan.wall_mm)
    screw, hole_radius = plan.adjuster, thread_of(plan.adjuster.thread).clearance_mm / 2.0
    with BuildPart() as holder:
        insert(brep(csg, body))
        with Locations(back_plane(plan)):
            _drill_for_mount(plan)
            with Locations(*((x, y, 0.0) for x, y in plan.screws_in_mount_mm)):
                with Locations((0.0, 0.0, -screw.plate_mm - OUTSIDE_MM)):
                    Cylinder(hole_radius, screw.plate_mm, align=UPRIGHT, mode=Mode.SUBTRACT)
                    recess_mm = screw.recess_mm + OUTSIDE_MM
                    Cylinder(screw.recess_wide_mm / 2.0, recess_mm, align=UPRIGHT, mode=Mode.SUBTRACT)
                with Locations((0.0, 0.0, -screw.cone_mm)):
                    Cone(hole_radius, screw.head_mm / 2.0, screw.cone_mm, align=UPRIGHT, mode=Mode.SUBTRACT)
    return _one_holder(holder)


def back_plane(plan: HolderPlan) -> Plane:
    """The plane of a holder's flat back, z out of it."""
    x_axis, _, z_axis, origin = (tuple(column) for column in plan.rig_from_mount[:3].T)
    return Plane(origin=origin, x_dir=x_axis, z_dir=z_axis)


def _drill_for_mount(plan: HolderPlan) -> None:
    """Cut the holes of the mount's screws, in the frame of the back."""
    radius_mm, cone_mm = hole_mm(plan.screw) / 2.0, tip_mm(plan.screw)
    with Locations(*((x, y, -plan.hole_depth_mm) for x, y in plan.holes_in_mount_mm)):
        Cylinder(radius_mm, plan.hole_depth_mm, align=UPRIGHT, mode=Mode.SUBTRACT)
        with Locations((0.0, 0.0, -cone_mm)):
            Cone(BLUNT_RADIUS_MM, radius_mm, cone_mm, align=UPRIGHT, mode=Mode.SUBTRACT)


def _one_holder(holder: BuildPart) -> Part:
    """The part, if it is one solid; raises InputError otherwise."""
    solids = holder.solids()
    if len(solids) != 1:
        raise InputError(f"mirror holder falls apart into {len(solids)} pieces at its holes, expected one")
    return Part(solids, label=HOLDER)
