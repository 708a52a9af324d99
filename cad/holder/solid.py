"""The mirror holder as one B-rep solid, in the rig frame."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from build123d import BuildPart, Cylinder, Face, Locations, Mode, Part, Plane, Shell, Solid, Wire, insert

from cad.hardware import Hardware
from cad.holder.plan import HolderPlan
from cad.seats import Frustum, sheet
from optics.layout import Layout
from optics.values import InputError


def solid_of(frustum: Frustum) -> Solid:
    """The B-rep of a frustum, all its faces flat."""
    return Solid(Shell([Face(Wire.make_polygon([tuple(corner) for corner in loop])) for loop in frustum.faces]))


def check_gaps(layout: Layout, hardware: Hardware) -> None:
    """Raise InputError where two sheets come so near that the pocket of one would cut the seat of the other."""
    sheets = [sheet(mirror) for mirror in layout.mirrors]
    corners = [np.vstack([volume.base, volume.top]) for volume in sheets]
    needed = hardware.fit.free_mm
    for i, j in combinations(range(len(sheets)), 2):
        apart = np.maximum(
            corners[i].min(axis=0) - corners[j].max(axis=0), corners[j].min(axis=0) - corners[i].max(axis=0)
        )
        if apart.max() >= needed:
            continue
        gap = solid_of(sheets[i]).distance_to(solid_of(sheets[j]))
        if gap < needed:
            raise InputError(
                f"mirrors {i} and {j} are {gap:.2f} mm apart as cut from sheet, expected at least {needed:.2f} mm"
            )


def make_holder(plan: HolderPlan) -> Part:
    """Cut and join the body's solids; the light and the pockets are removed by construction."""
    with BuildPart() as holder:
        insert([solid_of(volume) for volume in (plan.slab, *plan.cores, *plan.fillers, *plan.rims)])
        for volumes in plan.keep_outs:
            insert([solid_of(volume) for volume in volumes], mode=Mode.SUBTRACT)
        x_axis, _, z_axis, origin = (tuple(column) for column in plan.rig_from_mount[:3].T)
        with (
            Locations(Plane(origin=origin, x_dir=x_axis, z_dir=z_axis)),
            Locations(*((x, y, -plan.screw.insert_depth_mm / 2.0) for x, y in plan.holes_in_mount_mm)),
        ):
            Cylinder(plan.screw.insert_hole_mm / 2.0, plan.screw.insert_depth_mm, mode=Mode.SUBTRACT)
    # Light may leave crumbs too small to print where two seats meet; they are no part of the holder.
    pieces = [solid for solid in holder.solids() if solid.volume > plan.wall_mm**3]
    part = Part(pieces, label="mirror_holder")
    if len(pieces) != 1:
        raise InputError(f"mirror holder falls apart into {len(pieces)} pieces where the light passes, expected one")
    return part
