"""The glue between mirrors and their seats: its amount, the area it covers, and grooves for the surplus."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from shapely import LineString, Polygon, box, get_coordinates, union_all
from shapely.geometry.base import BaseGeometry

from mirrorcam.cad.plan.cuts import Cuts
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import clip_loop
from mirrorcam.cad.plan.seats import Frustum, outline_at, seat_height_mm
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import transform

# An edge within this angle of a groove counts as parallel to it, and leaves a thin wall next to it.
PARALLEL_DEG = 30.0
# Grooves end this far outside the rims, or at this fraction of the fit from the column behind an adjacent mirror; but
# within this fraction of its distance from the own mirror, so that grooves of the two meet, and leave no fin.
PAST_RIM_MM = 0.2
CLEARANCE_OF_FIT, CLEARANCE_OF_GAP = 0.8, 0.4


@dataclass(frozen=True)
class Groove:
    """A groove of one mirror's seat, along y of the mirror's plane, with its centre line at x = `x_mm`.

    `shape` (n, 2) is its outline on the seat, in the plane's axes.
    """

    x_mm: float
    shape: FloatArray


def grooves_of(index: int, mirrors: Sequence[Mirror], normal: FloatArray, hardware: Hardware) -> tuple[Groove, ...]:
    """Parallel grooves of one mirror, evenly spaced about the centre of its outline; none if it is narrow or on tape.

    They pass through notches of the rims and out of the filler round the mirror, or up to the column behind the
    adjacent mirror. Air and surplus glue can escape, and no thin wall remains at their ends: a groove that such a
    column would stop just inside the mirror's edge is left out. `normal` (3,) points out of the part's back.
    """
    dimensions, mirror = hardware.holder, mirrors[index]
    if dimensions.mirrors == "tape":
        return ()
    outline = Polygon(mirror.outline_in_plane_mm)
    filler_mm = hardware.fit.free_mm + dimensions.rim_mm
    margin = filler_mm + PAST_RIM_MM
    filler, enlarged = (outline.buffer(mm, join_style="mitre", mitre_limit=2.0) for mm in (filler_mm, margin))
    columns = [_column(mirror, other, normal, hardware) for k, other in enumerate(mirrors) if k != index]
    left, bottom, right, top = outline.bounds
    half = dimensions.groove_mm / 2.0
    steps = np.arange(0.5, 0.5 + (right - left) / dimensions.groove_pitch_mm)
    grooves = []
    for x in sorted(np.concatenate([-steps, steps]) * dimensions.groove_pitch_mm):
        strip = box(x - half, bottom - margin, x + half, top + margin)
        if strip.intersection(outline).is_empty or not _clear_of_edges(outline, strip, hardware):
            continue
        centre_y = strip.intersection(outline).centroid.y
        own, inside = filler.intersection(strip), outline.intersection(strip)
        blocked = union_all([_blocked(column, own, inside, hardware).intersection(strip) for column in columns])
        ends_below = [part.bounds[3] for part in _parts(blocked) if part.bounds[3] < centre_y]
        ends_above = [part.bounds[1] for part in _parts(blocked) if part.bounds[1] > centre_y]
        first, last = max([bottom - margin, *ends_below]), min([top + margin, *ends_above])
        _, outline_bottom, _, outline_top = strip.intersection(outline).bounds
        if any(0.0 <= inside < hardware.printer.wall_mm for inside in (first - outline_bottom, outline_top - last)):
            continue
        shape = enlarged.intersection(box(x - half, first, x + half, last))
        grooves.append(Groove(float(x), get_coordinates(shape)[:-1]))
    return tuple(grooves)


def _column(mirror: Mirror, other: Mirror, normal: FloatArray, hardware: Hardware) -> Polygon:
    """Section, by a mirror's seat plane and in that plane's axes, of the column behind another mirror."""
    frame = mirror.rig_from_plane
    origin = frame[:3, 3] + seat_height_mm(mirror, hardware) * frame[:3, 2]
    corners = outline_at(other, seat_height_mm(other, hardware)) - origin
    flat = corners - ((corners @ frame[:3, 2]) / (normal @ frame[:3, 2]))[:, None] * normal
    return Polygon(flat @ frame[:3, :2])


def _blocked(column: Polygon, filler: Polygon, outline: Polygon, hardware: Hardware) -> BaseGeometry:
    """The area that a groove spares round the column behind an adjacent mirror.

    `filler` and `outline` are those along the groove. Where the filler ends just in front of the column, a wall remains
    between the groove and one of the adjacent mirror, and a thicker one between the groove and the slit there.
    """
    slit_mm, gap_mm = filler.distance(column), outline.distance(column)
    clearance = CLEARANCE_OF_FIT * hardware.fit.free_mm
    if gap_mm > 0.0:
        clearance = min(clearance, CLEARANCE_OF_GAP * gap_mm)
    is_slit = 0.0 < slit_mm < PAST_RIM_MM + clearance
    return column.buffer((gap_mm + hardware.printer.wall_mm) / 2.0 if is_slit else clearance)


def _parts(area: BaseGeometry) -> list[BaseGeometry]:
    return [part for part in getattr(area, "geoms", [area]) if not part.is_empty]


def _clear_of_edges(outline: Polygon, strip: Polygon, hardware: Hardware) -> bool:
    """Return whether the land next to a groove is at least a wall thick: no parallel edge of the outline is near it."""
    corners = get_coordinates(outline)
    land = strip.intersection(outline)
    if land.bounds[3] - land.bounds[1] < hardware.holder.groove_pitch_mm:
        return False
    for start, end in pairwise(corners):
        dx, dy = np.abs(end - start)
        is_parallel = np.degrees(np.arctan2(dx, dy)) < PARALLEL_DEG
        if is_parallel and LineString([start, end]).distance(land) < 2.0 * hardware.printer.wall_mm:
            return False
    return True


def groove_solid(mirror: Mirror, groove: Groove, hardware: Hardware) -> Frustum:
    """The volume of a groove, from its floor to above the seat."""
    seat = seat_height_mm(mirror, hardware)
    levels = (seat - hardware.holder.groove_depth_mm, seat + 0.5 * mirror.thickness_mm)
    base, top = (
        transform(mirror.rig_from_plane, np.column_stack([groove.shape, np.full(len(groove.shape), level)]))
        for level in levels
    )
    return Frustum(base, top)


def runs_along_cut(
    mirror: Mirror,
    groove: Groove,
    axes: FloatArray,
    cuts_mm: Cuts,
    hardware: Hardware,
) -> bool:
    """Return whether a groove is so near a parallel cut, normal to one of two axes (3,), that a thin wall remains."""
    volume, wall = groove_solid(mirror, groove, hardware), hardware.printer.wall_mm
    for axis, cuts in zip(axes[:2], cuts_mm, strict=True):
        sine = min(abs(axis @ mirror.rig_from_plane[:3, 1]), 1.0)  # rounding may exceed 1
        if np.degrees(np.arcsin(sine)) > PARALLEL_DEG:
            continue
        extent = np.vstack([volume.base, volume.top]) @ axis
        if any(extent.min() - wall < cut < extent.max() + wall for cut in cuts):
            return True
    return False


def unobstructed_outline(
    index: int, mirrors: Sequence[Mirror], keep_outs: Sequence[Sequence[Frustum]], hardware: Hardware
) -> Polygon:
    """A mirror's outline, in its plane's axes, minus the areas of its seat in other mirrors' pockets and light."""
    mirror, outline = mirrors[index], Polygon(mirrors[index].outline_in_plane_mm)
    others = (volume for other, group in enumerate(keep_outs) if other != index for volume in group)
    return outline.difference(union_all([_section(mirror, outline, volume, hardware) for volume in others]))


def planned_cover(mirror: Mirror, free: Polygon, grooves: Sequence[Groove], pads: Sequence[FloatArray]) -> float:
    """Fraction of a mirror's back that its seat covers: its `unobstructed_outline` without grooves and pads (n, 2)."""
    excluded = union_all([*(Polygon(groove.shape) for groove in grooves), *(Polygon(pad) for pad in pads)])
    return float(free.difference(excluded).area / Polygon(mirror.outline_in_plane_mm).area)


def glue_mm3(free: Polygon, pads: Sequence[FloatArray], hardware: Hardware) -> float:
    """Volume of glue in the gap between a mirror and its seat: all but the pads (n, 2), including over grooves."""
    if hardware.holder.mirrors == "tape":
        return 0.0
    return float(free.difference(union_all([Polygon(pad) for pad in pads])).area) * hardware.holder.bond_mm


def bead_mm(hardware: Hardware) -> float:
    """Diameter of a bead of glue that spreads over one pitch of the grooves at the bond's thickness.

    The volume per length is pi d^2 / 4 = pitch x bond.
    """
    return float(np.sqrt(4.0 / np.pi * hardware.holder.groove_pitch_mm * hardware.holder.bond_mm))


def glue_amount(glue_mm3: Sequence[float]) -> str:
    """The total volume of glue for documents: "1.4 ml"."""
    return f"{sum(glue_mm3) / 1000.0:.2g} ml"


def _section(mirror: Mirror, outline: Polygon, volume: Frustum, hardware: Hardware) -> Polygon:
    """Section of a convex solid by a mirror's seat plane, in that plane's axes; empty if they do not intersect."""
    frame = mirror.rig_from_plane
    origin = frame[:3, 3] + seat_height_mm(mirror, hardware) * frame[:3, 2]
    loop = get_coordinates(outline)[:-1]
    normals, offsets = volume.half_spaces
    for direction, limit in zip(normals @ frame[:3, :2], offsets - normals @ origin, strict=True):
        loop = clip_loop(loop, direction, limit)
        if len(loop) < 3:
            return Polygon()
    return Polygon(loop)
