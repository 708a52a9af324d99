"""Three pads in every seat: a mirror rests on them, directly or on tape, and they set its distance from the seat."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from shapely import LineString, Polygon, get_coordinates, union_all
from shapely.geometry.base import BaseGeometry

from mirrorcam.cad.holder.glue import Groove
from mirrorcam.cad.plan.cuts import Cuts
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import Frustum, pad_height_mm, seat_height_mm
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import transform

PADS = 3
# Sides of a pad, a regular polygon.
SIDES = 8
# Gap between a pad and grooves or other mirrors' light, and the depth of its foot in the seat.
GAP_MM = 0.2
# Minimum spacing of the candidate points, and their maximum number.
STEP_MM, MAX_POINTS = 0.5, 60
FAR_MM = 1e4


def plan_pads(
    name: str,
    mirror: Mirror,
    free: Polygon,
    grooves: Sequence[Groove],
    axes: FloatArray,
    cuts: Cuts,
    hardware: Hardware,
) -> FloatArray:
    """The centres (3, 2) of the three pads of a mirror's seat, in the plane's axes, mm.

    They form the triangle, containing the outline's centroid, whose smallest altitude is largest: an error in a pad's
    height tilts the mirror by at most that error divided by the smallest altitude.

    Parameters
    ----------
    name : str
        Name of the mirror in messages.
    mirror : Mirror
        The mirror that the pads carry.
    free : Polygon
        Area of the seat in the plane's axes: the outline without other mirrors' light and pockets.
    grooves : sequence of Groove
        Grooves of the seat, which the pads avoid.
    axes : (3, 3)
        Axes of the part's back (rows); its cuts are normal to the first two.
    cuts : Cuts
        Coordinates of the cuts along these axes, from the pupil; pads are at least a wall's thickness from them.
    hardware : Hardware
        Diameter of the pads, fits and walls.

    Raises
    ------
    InputError
        If there is no space for three pads about the centroid.
    """
    radius = hardware.holder.pad_mm / 2.0
    # Each pad is behind the mirror wherever the mirror sits within its pocket.
    inside = Polygon(mirror.outline_in_plane_mm).buffer(-radius - hardware.fit.free_mm)
    region = inside.intersection(free.buffer(-radius - GAP_MM))
    groove_areas = [Polygon(groove.shape).buffer(radius + GAP_MM) for groove in grooves]
    cut_distance = radius + hardware.printer.wall_mm
    region = region.difference(
        union_all([*groove_areas, *(line.buffer(cut_distance) for line in _cut_lines(mirror, axes, cuts, hardware))])
    )
    centroid = np.array(Polygon(mirror.outline_in_plane_mm).centroid.coords[0])
    centres = widest_triangle(region, centroid)
    if centres is None or float(min_altitude_mm(centres[None])[0].round(6)) < hardware.holder.pad_mm:
        width, height = np.ptp(mirror.outline_in_plane_mm, axis=0)
        field = "tape_pad_mm" if hardware.holder.mirrors == "tape" else "glue_pad_mm"
        raise InputError(
            f"mirror {name} of {width:.1f} x {height:.1f} mm has no space for three pads of "
            f"{hardware.holder.pad_mm:g} mm about its centre, expected larger mirrors or a smaller holder.{field}"
        )
    return centres


def widest_triangle(region: BaseGeometry, point: FloatArray) -> FloatArray | None:
    """The triangle (3, 2) with the largest smallest altitude, of those on an area's border that contain a point (2,).

    Returns None if no triangle contains the point.
    """
    points = _border_points(region)
    triples = np.array(list(combinations(range(len(points)), PADS)), dtype=np.int64).reshape(-1, PADS)
    altitudes = np.where(_contain(points[triples], point), min_altitude_mm(points[triples]), 0.0)
    best = int(np.argmax(altitudes.round(6))) if len(altitudes) else -1
    return np.asarray(points[triples[best]]) if best >= 0 and altitudes[best] > 0.0 else None


def _cut_lines(mirror: Mirror, axes: FloatArray, cuts: Cuts, hardware: Hardware) -> list[LineString]:
    """Cuts normal to the first two axes, as lines in the seat, in the plane's axes; none for cuts parallel to it."""
    frame, lines = mirror.rig_from_plane, []
    origin = frame[:3, 3] + seat_height_mm(mirror, hardware) * frame[:3, 2]
    for axis, cuts_of_axis in zip(axes[:2], cuts, strict=True):
        normal = axis @ frame[:3, :2]
        sine = float(np.linalg.norm(normal))
        if sine < 1e-6:
            continue
        normal = normal / sine
        half_line = FAR_MM * np.array([-normal[1], normal[0]])
        for cut in cuts_of_axis:
            point = (cut - axis @ origin) / sine * normal
            lines.append(LineString([point - half_line, point + half_line]))
    return lines


def _border_points(region: BaseGeometry) -> FloatArray:
    """Points (n, 2) along the border of an area."""
    if region.is_empty:
        return np.zeros((0, 2))
    step = max(STEP_MM, region.length / MAX_POINTS)
    return np.unique(get_coordinates(region.simplify(0.02).segmentize(step)).round(6), axis=0)


def min_altitude_mm(triangles: FloatArray) -> FloatArray:
    """Smallest altitude (n,) of triangles (n, 3, 2): twice the area over the longest side."""
    sides = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2)
    return np.asarray(
        np.abs(_doubled_area(triangles[:, 0], triangles[:, 1], triangles[:, 2])) / np.maximum(sides.max(axis=1), 1e-9)
    )


def _contain(triangles: FloatArray, point: FloatArray) -> NDArray[np.bool_]:
    """Mask (n,) of the triangles (n, 3, 2) that contain a point (2,)."""
    areas = np.array([_doubled_area(triangles[:, i], triangles[:, (i + 1) % 3], point) for i in range(3)])
    return np.asarray((areas > 0.0).all(axis=0) | (areas < 0.0).all(axis=0))


def _doubled_area(first: FloatArray, second: FloatArray, third: FloatArray) -> FloatArray:
    """Twice the signed area (n,) of triangles with corners (n, 2)."""
    a, b = second - first, third - first
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def pad_shapes(centres: FloatArray, hardware: Hardware) -> tuple[FloatArray, ...]:
    """Outlines (8, 2) of pads about their centres (n, 2)."""
    angles = 2.0 * np.pi * (np.arange(SIDES) + 0.5) / SIDES
    corners = hardware.holder.pad_mm / 2.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    return tuple(centre + corners for centre in centres)


def pad_solid(mirror: Mirror, shape: FloatArray, hardware: Hardware) -> Frustum:
    """The solid of a pad, from just inside the seat to the mirror's back or its tape."""
    levels = (seat_height_mm(mirror, hardware) - GAP_MM, pad_height_mm(mirror, hardware))
    base, top = (
        transform(mirror.rig_from_plane, np.column_stack([shape, np.full(len(shape), level)])) for level in levels
    )
    return Frustum(base, top)
