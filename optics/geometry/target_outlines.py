"""The printed ink of a board as outlines, for vector prints."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.targets import AprilGrid, Charuco, Target


def ink_in_board_mm(target: Target) -> shapely.MultiPolygon:
    """Black squares and markers in the board's frame, x and y in mm.

    Modules of a marker that share an edge are one polygon, so that no viewer shows seams between them. Squares that
    touch in a corner are separate polygons.
    """
    if isinstance(target, AprilGrid):
        x, y = (target.cell_edges(n, tag=target.tag_mm, gap=target.gap_mm) for n in (target.cols, target.rows))
        return shapely.MultiPolygon([shapely.orient_polygons(polygon) for polygon in _joined(target.black, x, y)])
    side = target.square_mm
    black = target.black if isinstance(target, Charuco) else target.image(1) == 0
    squares = [
        shapely.box(column * side, row * side, (column + 1) * side, (row + 1) * side)
        for row, column in np.argwhere(black).tolist()
    ]
    markers = _markers(target) if isinstance(target, Charuco) else ()
    return shapely.MultiPolygon([shapely.orient_polygons(polygon) for polygon in (*squares, *markers)])


def _markers(target: Charuco) -> Iterator[shapely.Polygon]:
    """The polygons of the markers: in the middle of each white square, in the order of their numbers, row by row."""
    for white, (row, column) in zip(target.markers, target.marker_squares.tolist(), strict=True):
        corner = (np.array([column, row]) + 0.5) * target.square_mm - target.marker_mm / 2.0
        # Edges of neighbours are the same numbers, so that their union closes.
        yield from _joined(~white, *(corner[:, None] + np.arange(len(white) + 1) * target.marker_mm / len(white)))


def _joined(black: NDArray[np.bool_], x: FloatArray, y: FloatArray) -> tuple[shapely.Polygon, ...]:
    """The black cells of a grid with lines at `x` and `y`; those that share an edge are one polygon."""
    boxes = [shapely.box(x[k], y[j], x[k + 1], y[j + 1]) for j, k in np.argwhere(black)]
    whole = shapely.union_all(boxes)
    return tuple(whole.geoms) if isinstance(whole, shapely.MultiPolygon) else (whole,)
