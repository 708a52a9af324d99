"""What is engraved on the back of a mirror: an arrow that points up and the mirror's id, in single strokes."""

from __future__ import annotations

import numpy as np
from shapely import Polygon, maximum_inscribed_circle
from shapely.geometry.polygon import orient

from optics.values import FloatArray

LINE_GAP_MM = 0.5
"""Lines of a laser closer than this burn into one."""

# Corners of a seven-segment digit, one wide and two high, and the strokes that draw each sign through them.
STROKES: dict[str, tuple[tuple[tuple[float, float], ...], ...]] = {
    "0": (((0, 0), (1, 0), (1, 2), (0, 2), (0, 0)),),
    "1": (((1, 0), (1, 2)),),
    "2": (((0, 2), (1, 2), (1, 1), (0, 1), (0, 0), (1, 0)),),
    "3": (((0, 2), (1, 2), (1, 0), (0, 0)), ((0, 1), (1, 1))),
    "4": (((0, 2), (0, 1), (1, 1)), ((1, 2), (1, 0))),
    "5": (((1, 2), (0, 2), (0, 1), (1, 1), (1, 0), (0, 0)),),
    "6": (((1, 2), (0, 2), (0, 0), (1, 0), (1, 1), (0, 1)),),
    "7": (((0, 2), (1, 2), (1, 0)),),
    "8": (((0, 0), (1, 0), (1, 2), (0, 2), (0, 0)), ((0, 1), (1, 1))),
    "9": (((1, 1), (0, 1), (0, 2), (1, 2), (1, 0), (0, 0)),),
    "-": (((0, 1), (1, 1)),),
}
ARROW = (((0, 0), (0, 2)), ((-0.5, 1.4), (0, 2), (0.5, 1.4)))


def mark(text: str, outline: FloatArray, height_mm: float) -> tuple[FloatArray, ...]:
    """Strokes (n, 2) of an up arrow and a text inside a convex outline (n, 2), mm, y up.

    They are `height_mm` high, or as high as there is room for, `LINE_GAP_MM` from the outline.
    """
    strokes = [np.array(stroke, dtype=np.float64) for stroke in ARROW]
    for place, sign in enumerate(text):
        shift = np.array([1.2 + 1.6 * place, 0.0])
        strokes.extend(np.array(stroke) + shift for stroke in STROKES[sign])
    corners = np.vstack(strokes)
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    corners = corners - middle
    polygon = Polygon(outline)
    circle = maximum_inscribed_circle(polygon, tolerance=0.01)
    centres = np.array([polygon.centroid.coords[0], circle.coords[0]])
    scales = [min(height_mm / 2.0, _largest_scale(corners, outline - centre)) for centre in centres]
    best = int(np.argmax(scales))
    return tuple((stroke - middle) * scales[best] + centres[best] for stroke in strokes)


def _largest_scale(corners: FloatArray, outline: FloatArray) -> float:
    """By how much points (n, 2) can be scaled about the origin and stay the line gap inside a convex outline (m, 2)."""
    loop = np.array(orient(Polygon(outline)).exterior.coords)
    edges = np.diff(loop, axis=0)
    outward = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    room = (outward * loop[:-1]).sum(axis=1) - LINE_GAP_MM
    return float((room / (outward @ corners.T).max(axis=1)).min())
