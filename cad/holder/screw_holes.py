"""Holes for the mount's screws in the holder's back: their depths, blunt ends, and slots for captive nuts."""

from __future__ import annotations

import numpy as np
from shapely import Polygon, get_coordinates
from shapely.geometry.polygon import orient

from mirrorcam.cad.plan.fasteners import ROOF_DEG
from mirrorcam.cad.plan.hardware import Fastening, Hardware
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import transform

# A cone at the end of a hole is blunt, with this radius: half a line of plastic.
POINT_MM = 0.2


def screw_depths_mm(hardware: Hardware) -> tuple[float, float, float]:
    """Depths from the back where the thread of insert or nut begins and ends, and the depth of the hole."""
    screw = hardware.screw
    if screw.kind == "insert":
        return 0.0, screw.insert_mm, screw.insert_depth_mm
    begin = hardware.holder.floor_mm
    end = begin + screw.nut_height_mm + hardware.fit.slide_mm
    # The slot's roof rises at 45 deg over half the nut's width; the screw's tip has clearance below its ridge.
    return begin, end, end + slot_width_mm(hardware) / 2.0


def hole_mm(screw: Fastening) -> float:
    """Diameter of the holder's screw holes."""
    return screw.insert_hole_mm if screw.kind == "insert" else screw.clearance_hole_mm


def tip_mm(screw: Fastening) -> float:
    """Height of the cone that such a hole ends in: a flat ceiling would need support beside a hollow's slope."""
    return float((hole_mm(screw) / 2.0 - POINT_MM) / np.tan(np.deg2rad(ROOF_DEG)))


def slot_width_mm(hardware: Hardware) -> float:
    """Width of the slot that a nut slides in by."""
    return hardware.screw.nut_flats_mm + 2.0 * hardware.fit.slide_mm


def slot_way(footprint: Polygon, hole: FloatArray) -> FloatArray:
    """The direction (2,) in which a nut's slot leaves a convex footprint: square to the nearest edge.

    What stands over an oblique slot would end in a tip that recedes faster than the slot's roof.
    """
    corners = get_coordinates(orient(footprint))
    sides = np.diff(corners, axis=0)
    outward = np.column_stack([sides[:, 1], -sides[:, 0]]) / np.linalg.norm(sides, axis=1)[:, None]
    return np.asarray(outward[int(np.argmin(((corners[:-1] - hole) * outward).sum(axis=1)))])


def nut_slots(
    holes_mm: FloatArray, footprint: Polygon, centre_mm: FloatArray, rig_from_mount: FloatArray, hardware: Hardware
) -> tuple[Frustum, ...]:
    """The slots, from each hole (n, 2) square to the nearest edge, that nuts slide in by: held at their flats.

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
