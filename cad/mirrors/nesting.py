"""Nesting of convex outlines on stock sheets: rotated, and packed to one side by their no-fit polygons.

A piece at p overlaps a placed one if p lies in the Minkowski sum of the placed piece and the reflected new one (Burke,
Hellier, Kendall, Whitwell, "Complete and robust no-fit polygon generation", EJOR 179, 2007). For convex pieces this sum
is the hull of the sums of their corners. A piece is placed where it extends least far from the packed side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import shapely
from shapely import Polygon

from mirrorcam.core.values import FloatArray

# Rounding margin, so that a piece as wide as the sheet's usable area still fits.
ROUNDING_MM = 1e-6


@dataclass(frozen=True)
class NestedOutline:
    """The position of an outline on a sheet: rotated by `rotation` (2, 2), then shifted by `shift_mm` (2,)."""

    sheet: int
    rotation: FloatArray
    shift_mm: FloatArray

    def apply(self, points: FloatArray) -> FloatArray:
        """Points (n, 2) of the piece on the sheet, mm from its lower left corner."""
        return np.asarray(points @ self.rotation.T + self.shift_mm)


@dataclass(frozen=True)
class _Orientation:
    """A piece in one of its orientations: `outline` (n, 2) with its lower left corner at the origin, and its size."""

    rotation: FloatArray
    outline: FloatArray
    offset: FloatArray
    size: FloatArray


def nest(pieces: Sequence[FloatArray], sheet_mm: tuple[float, float], gap_mm: float) -> list[NestedOutline]:
    """A position for every convex piece (n, 2), at least a gap from the others and from the sheet's edge.

    Tries several orders, packed to the left and to the bottom, until the number of sheets reaches the lower bound given
    by the total area. Otherwise returns the nesting with the fewest sheets and, among these, the smallest used part of
    the last one. Raises ValueError for a piece that does not fit.
    """
    if not all(fits(piece, sheet_mm, gap_mm) for piece in pieces):
        raise ValueError("a piece is larger than a sheet, but each must fit")
    orientations = [_orientations(piece) for piece in pieces]
    usable_mm = _usable_mm(sheet_mm, gap_mm)
    areas = [Polygon(piece).area for piece in pieces]
    lengths = [max(oriented.size.max() for oriented in candidates) for candidates in orientations]
    widths = [min(oriented.size.min() for oriented in candidates) for candidates in orientations]
    min_sheets = np.ceil(sum(areas) / usable_mm.prod())
    best: tuple[tuple[int, float], list[NestedOutline]] | None = None
    for sizes, axis in product((areas, lengths, widths), (0, 1)):
        order = sorted(range(len(pieces)), key=lambda index: (-round(sizes[index], 6), index))
        cost, placed = _pack(orientations, order, usable_mm, gap_mm, axis)
        if best is None or cost < best[0]:
            best = (cost, placed)
        if best[0][0] <= min_sheets:
            break
    return best[1] if best else []


def fits(piece: FloatArray, sheet_mm: tuple[float, float], gap_mm: float) -> bool:
    """Return whether a convex piece (n, 2) fits on a sheet in some orientation, with a gap to the sheet's edge."""
    usable_mm = _usable_mm(sheet_mm, gap_mm)
    return any((oriented.size <= usable_mm).all() for oriented in _orientations(piece))


def _usable_mm(sheet_mm: tuple[float, float], gap_mm: float) -> FloatArray:
    return np.array(sheet_mm) - 2.0 * gap_mm + ROUNDING_MM


def _orientations(piece: FloatArray) -> list[_Orientation]:
    """The distinct orientations of a piece on each of its edges, and these rotated by quarter turns."""
    edges = np.roll(piece, -1, axis=0) - piece
    angles = (np.arctan2(edges[:, 1], edges[:, 0])[:, None] + np.arange(4) * np.pi / 2.0).ravel()
    orientations = []
    for angle in np.unique(np.round(np.mod(-angles, 2.0 * np.pi), 6) % round(2.0 * np.pi, 6)):
        rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        outline = piece @ rotation.T
        low = outline.min(axis=0)
        orientations.append(_Orientation(rotation, outline - low, -low, np.ptp(outline, axis=0)))
    return orientations


def _pack(
    orientations: list[list[_Orientation]], order: list[int], usable_mm: FloatArray, gap_mm: float, axis: int
) -> tuple[tuple[int, float], list[NestedOutline]]:
    """Number of sheets, used fraction of the last one along an axis, and the positions in the order of the pieces."""
    placed: list[NestedOutline | None] = [None] * len(orientations)
    sheets: list[list[FloatArray]] = []
    used: list[float] = []
    for index in order:
        for sheet in range(len(sheets) + 1):
            if sheet == len(sheets):
                sheets.append([])
                used.append(0.0)
            best = _nearest_position(orientations[index], sheets[sheet], usable_mm, axis)
            if best is None:
                continue
            oriented, corner = best
            placed[index] = NestedOutline(sheet, oriented.rotation, oriented.offset + corner + gap_mm)
            enlarged = Polygon(oriented.outline + corner).buffer(gap_mm, join_style="mitre", mitre_limit=2.0)
            sheets[sheet].append(shapely.get_coordinates(enlarged)[:-1])
            used[sheet] = max(used[sheet], float((corner + oriented.size)[axis] / usable_mm[axis]))
            break
    return (len(sheets), used[-1] if used else 0.0), [position for position in placed if position is not None]


def _nearest_position(
    orientations: list[_Orientation], placed: list[FloatArray], usable_mm: FloatArray, axis: int
) -> tuple[_Orientation, FloatArray] | None:
    """The orientation and the corner (2,) at which a piece extends least far along an axis, then along the other."""
    best: tuple[tuple[float, float], _Orientation, FloatArray] | None = None
    for oriented in orientations:
        if (oriented.size > usable_mm).any():
            continue
        free = shapely.box(0.0, 0.0, *(usable_mm - oriented.size))
        if placed:
            free = free.difference(shapely.union_all(_no_fit(oriented.outline, placed)))
        for corner in shapely.get_coordinates(free):
            end = np.round(corner + oriented.size, 6)
            key = (float(end[axis]), float(end[1 - axis]))
            if best is None or key < best[0]:
                best = (key, oriented, corner)
    return best[1:] if best else None


def _no_fit(outline: FloatArray, placed: list[FloatArray]) -> FloatArray:
    """The no-fit polygons of an outline (n, 2) around placed outlines, as an array of shapely polygons."""
    sums = [(obstacle[:, None] - outline).reshape(-1, 2) for obstacle in placed]
    indices = np.repeat(np.arange(len(sums)), [len(points) for points in sums])
    return shapely.convex_hull(shapely.multipoints(np.concatenate(sums), indices=indices))
