"""How much openings soften a strip of the mount: plates with holes in closed form."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import numpy as np
from shapely import LineString, Point, Polygon, box
from shapely.affinity import scale, translate

from mirrorcam.cad.plan.fasteners import Bore, Hexagon
from mirrorcam.cad.plan.prisms import clip_loop
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.values import FloatArray

# How far beyond a strip an opening is followed: longer than any.
FAR_MM = 500.0
# What only touches a strip takes nothing of it.
TOUCH_MM = 1e-6


def softening(
    start: FloatArray, end: FloatArray, half_width_mm: float, cuts: Iterable[Frustum | Bore | Hexagon]
) -> float:
    """How many times as much as without openings a strip stretches along itself.

    The strip is a plate from a point (2,; y and z) to another, `half_width_mm` to either side of x = 0. An ellipse 2 a
    wide across the stress and 2 b long adds its part of the area times 1 + 2 a / b (Kachanov 1992, Effective elastic
    properties of cracked solids; holes that do not act on each other); an opening of another shape counts as the
    ellipse of its width and length. Pockets for nuts do not go through and are left out.
    """
    length = float(np.linalg.norm(end - start))
    whole = box(-half_width_mm, -FAR_MM, half_width_mm, FAR_MM)
    strip = box(-half_width_mm, 0.0, half_width_mm, length)
    softer = 1.0
    for cut in cuts:
        opening = _in_plane(cut, start, (end - start) / length) if _may_meet(cut, start, end) else None
        if opening is None or not opening.intersects(strip):
            continue
        opening = opening.intersection(whole)
        low_x, low, high_x, high = opening.bounds
        part = opening.intersection(strip).area / strip.area
        softer += part * (1.0 + 2.0 * (high_x - low_x) / (high - low))
    return softer


def _may_meet(cut: Frustum | Bore | Hexagon, start: FloatArray, end: FloatArray) -> bool:
    """Whether a cut may meet a strip: not so where all its corners are on one side of it, or beyond one of its ends."""
    if not isinstance(cut, Frustum):
        return True
    length = float(np.linalg.norm(end - start))
    y, z = (end - start) / length
    along = (np.vstack([cut.base, cut.top])[:, 1:] - start) @ np.array([[y, -z], [z, y]])
    (first, left), (last, right) = along.min(axis=0), along.max(axis=0)
    return bool(left < -TOUCH_MM and right > TOUCH_MM and first < length and last > 0.0)


def _in_plane(cut: Frustum | Bore | Hexagon, start: FloatArray, along: FloatArray) -> Polygon | None:
    """What a cut takes from the plane through x and a line from a point along a direction (both (2,); y and z).

    In x and the distance along that line; None where it takes nothing.
    """
    if isinstance(cut, Hexagon):
        return None
    if isinstance(cut, Frustum):
        loop = np.array([(-FAR_MM, -FAR_MM), (FAR_MM, -FAR_MM), (FAR_MM, FAR_MM), (-FAR_MM, FAR_MM)])
        for normal, offset in zip(*cut.half_spaces, strict=True):
            direction = np.array([normal[0], normal[1:] @ along])
            if len(loop) == 0:
                return None
            loop = clip_loop(loop, direction, offset - normal[1:] @ start)
        return Polygon(loop) if len(loop) > 2 else None
    # A bore along the y-z plane, or nearly so; its roof is towards x.
    axis = cut.axis[1:] / np.linalg.norm(cut.axis[1:])
    across = np.array([-axis[1], axis[0]])
    sine = float(along @ across)
    if abs(sine) < 1e-3:
        return None
    from_mouth = start - cut.mouth[1:]
    outline = _bore_outline(cut.radius_mm, cut.travel_mm, cut.roof_mm if cut.up is not None else 0.0)
    outline = scale(outline, 1.0, 1.0 / abs(sine), origin=(0.0, 0.0))
    outline = translate(outline, float(cut.mouth[0]), -float(from_mouth @ across) / sine)
    cosine = float(along @ axis)
    if abs(cosine) < 1e-9:
        return outline if 0.0 < from_mouth @ axis < cut.depth_mm else None
    reach = sorted(float(depth - from_mouth @ axis) / cosine for depth in (0.0, cut.depth_mm))
    return outline.intersection(box(-FAR_MM, reach[0], FAR_MM, reach[1]))


@cache
def _bore_outline(radius_mm: float, travel_mm: float, roof_mm: float) -> Polygon:
    """The outline of a bore or a slot about its middle: its roof towards +x, its travel along y."""
    half = max(travel_mm / 2.0, 1e-9)
    ends = LineString([(0.0, -half), (0.0, half)]).buffer(radius_mm)
    # The roof are two tangents from its ridge.
    return ends.union(Point(roof_mm, 0.0)).convex_hull if roof_mm > radius_mm else ends
