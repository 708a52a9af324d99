"""Cuts through a meshed body: what falls apart, and where in a cut there is space for pins."""

from __future__ import annotations

from functools import reduce

import numpy as np
import shapely
from build123d import Part
from manifold3d import Manifold, Mesh64
from shapely.geometry.base import BaseGeometry

from mirrorcam.cad.plan.cuts import FAR_MM, Span, clearance_round_pin_mm, cut_slack_mm, reach_of_pin_mm
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.core.values import FloatArray

# How many places are tried for each cut.
TRIED = 9
# Distance of the sections that are looked at along a pin.
SLICE_MM = 1.0
MESH_MM = 0.05


def mesh_of(solid: Part) -> Manifold:
    """A solid's mesh, for sections and to see what falls apart."""
    points, triangles = solid.tessellate(MESH_MM)
    corners = np.array([tuple(point) for point in points])
    mesh = Mesh64(corners, np.array(triangles, dtype=np.uint64))
    mesh.merge()
    return Manifold(mesh)


def triangles_of(body: Manifold) -> FloatArray:
    """The triangles (n, 3, 3) of a body, counter-clockwise from outside."""
    mesh = body.to_mesh64()
    triangles: FloatArray = np.asarray(mesh.vert_properties)[np.asarray(mesh.tri_verts, dtype=np.int64)]
    return triangles


def falls_apart(body: Manifold, axis: int, place_mm: float, crumb_mm: float) -> bool:
    """Return whether a cut across an axis leaves more than two pieces that are larger than a cube of `crumb_mm`."""
    normal = np.eye(3)[axis]
    return any(len(fragments(half, crumb_mm)) != 1 for half in body.split_by_plane(normal, place_mm))


def fragments(body: Manifold, crumb_mm: float) -> list[Manifold]:
    """The separate pieces of a body, without fragments too small to print."""
    return [piece for piece in body.decompose() if piece.volume() > crumb_mm**3]


def inside(body: Manifold, spans: tuple[Span, Span]) -> Manifold:
    """The part of a body within spans along x and y."""
    for normal, (low, high) in zip(np.eye(3), spans, strict=False):
        body = body.trim_by_plane(normal, low).trim_by_plane(-normal, -high)
    return body


def best_places_mm(body: Manifold, axis: int, span: Span, bed_mm: float, hardware: Hardware) -> tuple[float, ...]:
    """Places to cut a body, over a span along an axis, into equal pieces that fit the bed.

    Each cut may be moved a little; of the places that are tried, the one with the most space for pins is taken.
    """
    start, end = span
    count = int(np.ceil((end - start) / bed_mm))
    slack = cut_slack_mm(end - start, count, bed_mm)
    places = []
    for i in range(1, count):
        middle = start + (end - start) * i / count
        tried = np.linspace(middle - slack, middle + slack, TRIED)
        areas = [area_for_pins(body, axis, float(place), (-FAR_MM, FAR_MM), hardware).area for place in tried]
        # Of places that are as good, the one nearest to the middle.
        best = max(range(TRIED), key=lambda k: (round(areas[k], 3), -abs(tried[k] - middle)))
        places.append(float(tried[best]))
    return tuple(places)


def area_for_pins(body: Manifold, axis: int, place_mm: float, span: Span, hardware: Hardware) -> BaseGeometry:
    """Places for the axis of a pin in a cut, with the thinnest wall all along the pin and beyond its ends.

    Parameters
    ----------
    body : Manifold
        The part as it lies on the bed.
    axis, place_mm : int, float
        Axis of the bed that is cut across (0 or 1), and where.
    span : (float, float)
        Where along the bed's other axis pins may be.
    hardware : Hardware
        Pins, fits and the thinnest wall.

    Returns
    -------
    BaseGeometry
        An area; its x is along the bed's other axis, its y is up.
    """
    # The bed's other axis, up, and the axis that is cut across.
    turned = body.transform(np.column_stack([np.eye(3)[[1 - axis, 2, axis]], np.zeros(3)]))
    half = reach_of_pin_mm(hardware)
    levels = np.linspace(place_mm - half, place_mm + half, int(np.ceil(2.0 * half / SLICE_MM)) + 1)
    solid = shapely.intersection_all([_section(turned, float(level)) for level in levels])
    around = clearance_round_pin_mm(hardware)
    return solid.buffer(-around).intersection(shapely.box(span[0] + around, -FAR_MM, span[1] - around, FAR_MM))


def _section(body: Manifold, level: float) -> BaseGeometry:
    """A section across z; loops inside loops are holes."""
    loops = (shapely.Polygon(loop) for loop in body.slice(level).to_polygons())
    return reduce(lambda one, other: one.symmetric_difference(other), loops, shapely.Polygon())
