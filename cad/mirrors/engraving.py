"""The mark engraved on the back of a mirror: an arrow that points up and the mirror's id, in single strokes."""

from __future__ import annotations

from itertools import product

import numpy as np
from shapely import Polygon, maximum_inscribed_circle
from shapely.geometry.polygon import orient

from mirrorcam.cad.plan.stroke_font import STROKES
from mirrorcam.core.values import FloatArray

LINE_GAP_MM = 0.5
"""Lines of a laser closer than this burn into one."""

# Between signs, of half their height: as it reads best, and as small signs need it.
GAPS = (0.6, 1.0)
ARROW = (((0, 0), (0, 2)), ((-0.5, 1.4), (0, 2), (0.5, 1.4)))


def mark(text: str, outline: FloatArray, height_mm: float) -> tuple[FloatArray, ...]:
    """Strokes (n, 2) of an up arrow, its shaft first, and a text inside a convex outline (n, 2), mm, y up.

    Signs are `height_mm` high, or as high as fits, `LINE_GAP_MM` from the outline: in a row or a column,
    spaced wider where only that keeps them as far from each other. Where not even that fits, they are as
    far apart as can be.
    """
    polygon = Polygon(outline)
    circle = maximum_inscribed_circle(polygon, tolerance=0.01)
    centres = np.array([polygon.centroid.coords[0], circle.coords[0]])
    best: tuple[tuple[float, float], tuple[FloatArray, ...]] | None = None
    for gap, axis, centre in product(GAPS, (0, 1), centres):
        strokes = _set_out(text, gap, axis)
        scale = min(height_mm / 2.0, _largest_scale(np.vstack(strokes), outline - centre))
        # Strokes of a sign are 1 apart.
        apart_mm = min(LINE_GAP_MM, scale * min(gap, 1.0))
        if best is None or (apart_mm, scale) > best[0]:
            best = ((apart_mm, scale), tuple(stroke * scale + centre for stroke in strokes))
    assert best is not None
    return best[1]


def _set_out(text: str, gap: float, axis: int) -> list[FloatArray]:
    """Arrow and signs, two high, in a row (axis 0) or down a column (axis 1), their middle in the origin."""
    placed: list[FloatArray] = []
    reached = 0.0
    for sign in (ARROW, *(STROKES[letter] for letter in text)):
        strokes = [np.array(stroke, dtype=np.float64) for stroke in sign]
        corners = np.vstack(strokes)
        low, high = corners.min(axis=0), corners.max(axis=0)
        shift = (
            np.array([reached - low[0], 0.0]) if axis == 0 else np.array([-(low + high)[0] / 2.0, reached - high[1]])
        )
        placed += [stroke + shift for stroke in strokes]
        reached += (high - low)[0] + gap if axis == 0 else -(high - low)[1] - gap
    corners = np.vstack(placed)
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    return [stroke - middle for stroke in placed]


def _largest_scale(corners: FloatArray, outline: FloatArray) -> float:
    """Largest scale about the origin at which points (n, 2) stay the line gap inside a convex outline (m, 2)."""
    loop = np.array(orient(Polygon(outline)).exterior.coords)
    edges = np.diff(loop, axis=0)
    outward = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    free_mm = (outward * loop[:-1]).sum(axis=1) - LINE_GAP_MM
    return float((free_mm / (outward @ corners.T).max(axis=1)).min())
