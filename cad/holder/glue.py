"""Where the glue goes: grooves in every seat, and how much of each mirror the seat still bears."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from shapely import LineString, Polygon, box, get_coordinates, union_all

from cad.hardware import Hardware
from cad.seats import Frustum, back_height_mm
from optics.mirror import Mirror
from optics.transforms import transform
from optics.values import FloatArray

# An edge that runs along a groove to less than this does not cross it, and leaves a thin wall beside it.
ALONG_DEG = 30.0


@dataclass(frozen=True)
class Groove:
    """A groove of one mirror's seat: `at_mm` is its middle along x of the mirror's plane; it runs along y.

    `shape` (n, 2) is what it takes of the seat, in the plane's axes.
    """

    at_mm: float
    shape: FloatArray


def grooves_of(mirror: Mirror, hardware: Hardware) -> tuple[Groove, ...]:
    """Parallel grooves, evenly spaced about the middle of the outline, from edge to edge; none in a narrow mirror.

    Air and surplus glue leave at both ends: the rims have a notch there.
    """
    dimensions = hardware.holder
    outline = Polygon(mirror.outline_in_plane_mm)
    # A little inside the pocket's sides, so that the two have no face in common.
    room = outline.buffer(0.8 * hardware.fit.free_mm, join_style="mitre", mitre_limit=2.0)
    left, low, right, high = outline.bounds
    steps = np.arange(0.5, 0.5 + (right - left) / dimensions.groove_pitch_mm)
    grooves = []
    for at in sorted(np.concatenate([-steps, steps]) * dimensions.groove_pitch_mm):
        strip = box(at - dimensions.groove_mm / 2.0, low - 1.0, at + dimensions.groove_mm / 2.0, high + 1.0)
        shape = room.intersection(strip)
        if isinstance(shape, Polygon) and not shape.is_empty and _clear_of_edges(outline, strip, hardware):
            grooves.append(Groove(float(at), get_coordinates(shape)[:-1]))
    return tuple(grooves)


def _clear_of_edges(outline: Polygon, strip: Polygon, hardware: Hardware) -> bool:
    """Whether the land beside a groove is nowhere thinner than a wall: no edge runs along it there."""
    corners = get_coordinates(outline)
    ends = strip.intersection(outline)
    if ends.bounds[3] - ends.bounds[1] < hardware.holder.groove_pitch_mm:
        return False
    for start, end in pairwise(corners):
        across, along = np.abs(end - start)
        if np.degrees(np.arctan2(across, along)) < ALONG_DEG:
            beside = LineString([start, end]).distance(ends)
            if beside < 1.5 * hardware.printer.wall_mm:
                return False
    return True


def groove_volume(mirror: Mirror, groove: Groove, hardware: Hardware) -> Frustum:
    """What a groove cuts, from its floor to above the seat."""
    seat = back_height_mm(mirror)
    levels = (seat - hardware.holder.groove_depth_mm, seat + 0.5 * mirror.thickness_mm)
    base, top = (
        transform(mirror.rig_from_plane, np.column_stack([groove.shape, np.full(len(groove.shape), level)]))
        for level in levels
    )
    return Frustum(base, top)


def planned_cover(
    mirrors: tuple[Mirror, ...], grooves: list[tuple[Groove, ...]], keep_outs: list[list[Frustum]]
) -> tuple[float, ...]:
    """Share of each mirror's back that its seat bears: the outline less grooves and what gives way to other mirrors."""
    shares = []
    for index, (mirror, own) in enumerate(zip(mirrors, grooves, strict=True)):
        outline = Polygon(mirror.outline_in_plane_mm)
        others = [volume for other, group in enumerate(keep_outs) if other != index for volume in group]
        lost = [Polygon(groove.shape) for groove in own] + [_section(mirror, outline, volume) for volume in others]
        shares.append(float(outline.difference(union_all(lost)).area / outline.area))
    return tuple(shares)


def _section(mirror: Mirror, outline: Polygon, volume: Frustum) -> Polygon:
    """What a convex solid takes of a mirror's seat, in the plane's axes; empty where it takes nothing."""
    frame = mirror.rig_from_plane
    origin = frame[:3, 3] + back_height_mm(mirror) * frame[:3, 2]
    loop = get_coordinates(outline)[:-1]
    normals, offsets = volume.half_spaces
    for slope, most in zip(normals @ frame[:3, :2], offsets - normals @ origin, strict=True):
        over = loop @ slope - most
        kept = []
        for start, end, a, b in zip(loop, np.roll(loop, -1, axis=0), over, np.roll(over, -1), strict=True):
            if a <= 0.0:
                kept.append(start)
            if a * b < 0.0:
                kept.append(start + (end - start) * a / (a - b))
        if len(kept) < 3:
            return Polygon()
        loop = np.array(kept)
    return Polygon(loop)
