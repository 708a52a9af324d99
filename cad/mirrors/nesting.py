"""Nesting of convex outlines on stock sheets, turned and packed to one side by their no-fit polygons.

A piece at p meets a placed one where p lies in the Minkowski sum of the placed one and the piece reflected in its
origin; what those sums leave of the sheet is where it may go, and it goes where it reaches least far from that side.
(Burke, Hellier, Kendall, Whitwell, "Complete and robust no-fit polygon generation", EJOR 179, 2007; of convex pieces
the sum is the hull of the sums of their corners.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import shapely
from shapely import Polygon

from mirrorcam.core.values import FloatArray

# Margin for rounding, so that a piece as wide as the sheet's usable area is not refused.
ROUNDING_MM = 1e-6


@dataclass(frozen=True)
class NestedOutline:
    """The place of an outline: its sheet, turned by `turn` (2, 2), then moved by `shift_mm` (2,)."""

    sheet: int
    turn: FloatArray
    shift_mm: FloatArray

    def apply(self, points: FloatArray) -> FloatArray:
        """Points (n, 2) of the piece on the sheet, mm from its lower left corner."""
        return np.asarray(points @ self.turn.T + self.shift_mm)


@dataclass(frozen=True)
class _Turned:
    """A piece in one of its orientations: `outline` (n, 2) with its lower left at the origin, and its size."""

    turn: FloatArray
    outline: FloatArray
    offset: FloatArray
    size: FloatArray


def nest(pieces: Sequence[FloatArray], sheet_mm: tuple[float, float], gap_mm: float) -> list[NestedOutline]:
    """A place for every convex piece (n, 2), at least a gap from each other and from the sheet's edge.

    They are laid down in several orders, to the left and to the bottom, until their area could need no fewer sheets;
    else the way with the fewest sheets, and the least of the last one. Raises ValueError for a piece that does not fit.
    """
    if not all(fits(piece, sheet_mm, gap_mm) for piece in pieces):
        raise ValueError("a piece is larger than a sheet, expected each to fit")
    ways = [_ways_to_lie(piece) for piece in pieces]
    usable_mm = _usable_mm(sheet_mm, gap_mm)
    areas = [Polygon(piece).area for piece in pieces]
    lengths = [max(way.size.max() for way in turned) for turned in ways]
    widths = [min(way.size.min() for way in turned) for turned in ways]
    fewest = np.ceil(sum(areas) / usable_mm.prod())
    best: tuple[tuple[int, float], list[NestedOutline]] | None = None
    for sizes, along in product((areas, lengths, widths), (0, 1)):
        order = sorted(range(len(pieces)), key=lambda index: (-round(sizes[index], 6), index))
        cost, placed = _lay_down(ways, order, usable_mm, gap_mm, along)
        if best is None or cost < best[0]:
            best = (cost, placed)
        if best[0][0] <= fewest:
            break
    return best[1] if best else []


def fits(piece: FloatArray, sheet_mm: tuple[float, float], gap_mm: float) -> bool:
    """Return whether a convex piece (n, 2) lies on a sheet in one of the orientations tried, a gap from its edge."""
    usable_mm = _usable_mm(sheet_mm, gap_mm)
    return any((way.size <= usable_mm).all() for way in _ways_to_lie(piece))


def _usable_mm(sheet_mm: tuple[float, float], gap_mm: float) -> FloatArray:
    return np.array(sheet_mm) - 2.0 * gap_mm + ROUNDING_MM


def _ways_to_lie(piece: FloatArray) -> list[_Turned]:
    """A piece on each of its edges, and these turned by quarters; alike ones once."""
    edges = np.roll(piece, -1, axis=0) - piece
    angles = (np.arctan2(edges[:, 1], edges[:, 0])[:, None] + np.arange(4) * np.pi / 2.0).ravel()
    ways = []
    for angle in np.unique(np.round(np.mod(-angles, 2.0 * np.pi), 6) % round(2.0 * np.pi, 6)):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        outline = piece @ turn.T
        low = outline.min(axis=0)
        ways.append(_Turned(turn, outline - low, -low, np.ptp(outline, axis=0)))
    return ways


def _lay_down(
    ways: list[list[_Turned]], order: list[int], usable_mm: FloatArray, gap_mm: float, along: int
) -> tuple[tuple[int, float], list[NestedOutline]]:
    """Sheets needed and the share used of the last one along an axis, and the places, in the order of the pieces."""
    placed: list[NestedOutline | None] = [None] * len(ways)
    sheets: list[list[FloatArray]] = []
    used: list[float] = []
    for index in order:
        for number in range(len(sheets) + 1):
            if number == len(sheets):
                sheets.append([])
                used.append(0.0)
            found = _nearest_place(ways[index], sheets[number], usable_mm, along)
            if found is None:
                continue
            way, corner = found
            placed[index] = NestedOutline(number, way.turn, way.offset + corner + gap_mm)
            grown = Polygon(way.outline + corner).buffer(gap_mm, join_style="mitre", mitre_limit=2.0)
            sheets[number].append(shapely.get_coordinates(grown)[:-1])
            used[number] = max(used[number], float((corner + way.size)[along] / usable_mm[along]))
            break
    return (len(sheets), used[-1] if used else 0.0), [place for place in placed if place is not None]


def _nearest_place(
    ways: list[_Turned], taken: list[FloatArray], usable_mm: FloatArray, along: int
) -> tuple[_Turned, FloatArray] | None:
    """The orientation and the corner (2,) at which a piece reaches least far along an axis, then across it."""
    best: tuple[tuple[float, float], _Turned, FloatArray] | None = None
    for way in ways:
        if (way.size > usable_mm).any():
            continue
        free = shapely.box(0.0, 0.0, *(usable_mm - way.size))
        if taken:
            free = free.difference(shapely.union_all(_no_fit(way.outline, taken)))
        for corner in shapely.get_coordinates(free):
            reached = np.round(corner + way.size, 6)
            key = (float(reached[along]), float(reached[1 - along]))
            if best is None or key < best[0]:
                best = (key, way, corner)
    return best[1:] if best else None


def _no_fit(outline: FloatArray, taken: list[FloatArray]) -> FloatArray:
    """The no-fit polygons of an outline (n, 2) around those that are taken, as an array of shapely polygons."""
    sums = [(other[:, None] - outline).reshape(-1, 2) for other in taken]
    owners = np.repeat(np.arange(len(sums)), [len(points) for points in sums])
    return shapely.convex_hull(shapely.multipoints(np.concatenate(sums), indices=owners))
