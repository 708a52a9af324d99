"""The side of a ChArUco board's markers by that of its squares, as pictures show it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import PX_PER_SQUARE, Image, covers, sample
from mirrorcam.optics.calibration.detection.board_warp import Warp
from mirrorcam.optics.calibration.detection.charuco import find_markers, groups, marker_places
from mirrorcam.optics.calibration.detection.marker_numbering import ReadMarkers, standardised
from mirrorcam.optics.calibration.detection.marker_steps import GriddedPicture
from mirrorcam.optics.calibration.solver.observations import IntArray
from mirrorcam.optics.geometry import marker_dictionaries as dictionaries
from mirrorcam.optics.geometry.targets import Charuco

ROUGH = tuple(np.arange(0.3, 0.96, 0.06).tolist())  # sides of markers, in squares, with which pictures are read
FINE, REACH = 0.01, 0.09  # step of the sides that are compared, and how far they are from the best rough one
BLURS = (0.015, 0.03, 0.045, 0.06, 0.08, 0.1, 0.125, 0.155)  # sigma in squares
LIKELY = 0.85  # correlation of what is read with the stated side, for it to be about right
MOST_MOVES = 4  # of the sides that are compared, where the best one is the first or last of them
ROUNDS = 2  # of the likeliest blur and side, each with the other
MOST_SQUARES = 16  # compared in each grid
MIN_SQUARES = 8  # in all grids
AS_CLEAR = 0.85  # of the correlation that the clearest grid's squares have: others are of other boards, or flipped
MIN_ALIKE = 0.7  # correlation of the squares with markers of the best side and blur
AROUND = np.array([[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]])  # squares, from a middle to the corners
PADDING = 8  # px of the black squares around a white one


@dataclass(frozen=True, eq=False)
class _MarkedSquares:
    """Squares of a picture that hold markers: the markers' ids (n,), and pixels (n, 4, 2) of corners, row by row."""

    picture: Image
    ids: IntArray
    quads: FloatArray


def marker_side(shown: Sequence[GriddedPicture], target: Charuco, *, mirrored: bool | None) -> float | None:
    """Side of the markers, in squares, that pictures show; None where too few markers can be read.

    `mirrored` is whether they show the board through mirrors; None: directly and through mirrors.
    Every marker is compared with its print at several sides and blurs. Blur and brightness change the edge of the
    square and those of the marker alike, so that they do not move the best side.
    """
    ways = (False, True) if mirrored is None else (mirrored,)
    side, squares = _in_grids(shown, target, ways)
    if sum(len(some.ids) for some in squares) < MIN_SQUARES:
        side, squares = _between_markers(shown, target, ways)
    count = sum(len(some.ids) for some in squares)
    if count < MIN_SQUARES:
        return None
    for _ in range(MOST_MOVES):
        tried = np.arange(-REACH, REACH + FINE / 2.0, FINE) + np.clip(side, 0.1 + REACH, 0.99 - REACH)
        alike = np.sum([_alike(some, target, tried) for some in squares], axis=0) / count
        best = int(alike.argmax())
        if 0 < best < len(tried) - 1:
            break
        side = float(tried[best])
    else:
        return None
    if alike[best] < MIN_ALIKE:
        return None
    before, at, after = alike[best - 1 : best + 2]
    bend = before - 2.0 * at + after
    return float(tried[best] + (FINE * 0.5 * (before - after) / bend if bend < 0.0 else 0.0))


def _sized(target: Charuco, side: float) -> Charuco:
    return target.replaced(marker_mm=side * target.square_mm)


def _in_grids(
    shown: Sequence[GriddedPicture], target: Charuco, ways: Sequence[bool]
) -> tuple[float, list[_MarkedSquares]]:
    """About the side of the markers, and the squares of grids of corners that hold them."""

    def read(side: float) -> list[tuple[GriddedPicture, ReadMarkers]]:
        sized = _sized(target, side)
        grids = [(one, grid) for one in shown for flipped in ways for grid in one.read(sized, mirrored=flipped)]
        return [(one, grid) for one, grid in grids if len(grid.ids)]

    def likelihood(grids: list[tuple[GriddedPicture, ReadMarkers]]) -> float:
        return sum(grid.alike * len(grid.ids) for _, grid in grids)

    side = target.marker_mm / target.square_mm
    grids = read(side)
    if likelihood(grids) < LIKELY * sum(len(grid.ids) for _, grid in grids):
        others = [(other, read(other)) for other in ROUGH]
        side, grids = max([(side, grids), *others], key=lambda one: likelihood(one[1]))
    clearest = max((grid.alike for _, grid in grids), default=0.0)
    return side, [
        _MarkedSquares(one.picture, grid.ids[:MOST_SQUARES], grid.quads[:MOST_SQUARES])
        for one, grid in grids
        if grid.alike > AS_CLEAR * clearest
    ]


def _between_markers(
    shown: Sequence[GriddedPicture], target: Charuco, ways: Sequence[bool]
) -> tuple[float, list[_MarkedSquares]]:
    """The same of squares whose corners follow from the middles of markers that are found one by one."""
    seen = [(one, *find_markers(one.grey, target, mirrored=flipped)) for one in shown for flipped in ways]

    def grouped(side: float) -> list[list[IntArray]]:
        places = marker_places(_sized(target, side))
        return [groups(places[ids], quads) for _, ids, quads in seen]

    def count(parts: list[list[IntArray]]) -> int:
        return sum(len(part) for some in parts for part in some)

    sides = (target.marker_mm / target.square_mm, *ROUGH)
    side, parts = max(((side, grouped(side)) for side in sides), key=lambda one: count(one[1]))
    squares = []
    for (one, ids, quads), some in zip(seen, parts, strict=True):
        middles, centres = marker_places(target).mean(axis=1)[ids], quads.mean(axis=1)
        for part in some:
            warp = Warp.through(middles[part], centres[part])
            if warp is not None:
                first = part[:MOST_SQUARES]
                corners = warp.at((middles[first, None] + AROUND).reshape(-1, 2)).reshape(-1, 4, 2)
                squares.append(_MarkedSquares(one.picture, target.first_marker + ids[first], corners))
    return side, squares


def _alike(squares: _MarkedSquares, target: Charuco, sides: FloatArray) -> FloatArray:
    """Sum (s,) of the correlations of squares with their markers at sides (s,), with the likeliest blur."""
    at = (np.arange(PX_PER_SQUARE) + 0.5) / PX_PER_SQUARE
    v, u = (axis.ravel() for axis in np.meshgrid(at, at, indexing="ij"))
    shares = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=1)
    seen = standardised(sample(squares.picture, shares @ squares.quads).astype(np.float64))
    white = dictionaries.white_modules(target.dictionary)[squares.ids]

    def with_side(side: float, blur: float) -> float:
        edges = PX_PER_SQUARE * (0.5 + side * (np.arange(white.shape[1] + 1) / white.shape[1] - 0.5))
        cover = covers(edges, PX_PER_SQUARE).astype(np.float32)
        drawn = 1.0 - cover.T @ (~white).astype(np.float32) @ cover
        padded = np.pad(drawn, ((0, 0), (PADDING, PADDING), (PADDING, PADDING))).transpose(1, 2, 0)
        soft = np.asarray(cv2.GaussianBlur(np.ascontiguousarray(padded), (0, 0), blur * PX_PER_SQUARE))
        inner = soft.reshape(padded.shape)[PADDING:-PADDING, PADDING:-PADDING].transpose(2, 0, 1)
        return float((seen * standardised(inner.reshape(len(white), -1).astype(np.float64))).sum())

    likely = sides[len(sides) // 2 :: len(sides)]
    for _ in range(ROUNDS):
        blur = max(BLURS, key=lambda blur: max(with_side(side, blur) for side in likely.tolist()))
        alike = np.array([with_side(side, blur) for side in sides.tolist()])
        likely = sides[alike.argmax() :][:1]
    return alike
