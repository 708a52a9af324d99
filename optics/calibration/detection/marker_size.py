"""The side of a ChArUco board's markers by that of its squares, as pictures show it."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import PX_PER_SQUARE, Image, covers, sample
from mirrorcam.optics.calibration.detection.marker_numbering import ReadMarkers, standardised
from mirrorcam.optics.calibration.detection.marker_steps import GriddedPicture
from mirrorcam.optics.calibration.solver.observations import IntArray
from mirrorcam.optics.geometry import marker_dictionaries as dictionaries
from mirrorcam.optics.geometry.targets import Charuco

ROUGH = np.arange(0.3, 0.96, 0.06)  # sides of markers, in squares, with which pictures are read
FINE, REACH = 0.01, 0.09  # step of the sides that are compared, and how far they are from the best rough one
BLURS = (0.02, 0.04, 0.07, 0.11, 0.16)  # sigma in squares
LIKELY = 0.85  # correlation of what is read with the stated side, for it to be about right
MOST_SQUARES = 16  # compared in each grid
MIN_SQUARES = 8  # in all grids
AS_CLEAR = 0.85  # of the correlation that the clearest grid's squares have: others are of other boards, or flipped
MIN_ALIKE = 0.7  # correlation of the squares with markers of the best side and blur
PADDING = 8  # px of the black squares around a white one


def marker_side(shown: Sequence[GriddedPicture], target: Charuco, *, mirrored: bool | None) -> float | None:
    """Side of the markers, in squares, that pictures show; None where too few markers can be read.

    `mirrored` is whether they show the board through mirrors; None: directly and through mirrors.
    Every marker is compared with its print at several sides and blurs. Blur and brightness change the edge of the
    square and those of the marker alike, so that they do not move the best side.
    """
    side, read = target.marker_mm / target.square_mm, _read(shown, target, mirrored=mirrored)
    if _likelihood(read) < LIKELY * sum(len(grid.ids) for _, grid in read):
        others = [(float(other), _read(shown, _sized(target, float(other)), mirrored=mirrored)) for other in ROUGH]
        side, read = max([(side, read), *others], key=lambda one: _likelihood(one[1]))
    clearest = max((grid.alike for _, grid in read), default=0.0)
    read = [(picture, grid) for picture, grid in read if grid.alike > AS_CLEAR * clearest]
    grids = [(picture, grid.ids[:MOST_SQUARES], grid.quads[:MOST_SQUARES]) for picture, grid in read]
    count = sum(len(ids) for _, ids, _ in grids)
    if count < MIN_SQUARES:
        return None
    tried = np.clip(np.arange(-REACH, REACH + FINE / 2.0, FINE) + side, 0.1, 0.99)
    alike = np.sum([_alike(picture, ids, quads, target, tried) for picture, ids, quads in grids], axis=0) / count
    best = int(np.clip(alike.argmax(), 1, len(tried) - 2))
    if alike[best] < MIN_ALIKE:
        return None
    before, at, after = alike[best - 1 : best + 2]
    bend = before - 2.0 * at + after
    return float(tried[best] + (FINE * 0.5 * (before - after) / bend if bend < 0.0 else 0.0))


def _sized(target: Charuco, side: float) -> Charuco:
    return target.replaced(marker_mm=side * target.square_mm)


def _read(
    shown: Sequence[GriddedPicture], target: Charuco, *, mirrored: bool | None
) -> list[tuple[Image, ReadMarkers]]:
    """The markers in each grid of all pictures."""
    ways = (False, True) if mirrored is None else (mirrored,)
    return [
        (np.asarray(one.grey, dtype=np.float32), grid)
        for one in shown
        for flipped in ways
        for grid in one.read(target, mirrored=flipped)
        if len(grid.ids)
    ]


def _likelihood(read: list[tuple[Image, ReadMarkers]]) -> float:
    return sum(grid.alike * len(grid.ids) for _, grid in read)


def _alike(picture: Image, ids: IntArray, quads: FloatArray, target: Charuco, sides: FloatArray) -> FloatArray:
    """Sum (s,) of the correlations of squares (n, 4, 2) with their markers at sides (s,), with the likeliest blur."""
    at = (np.arange(PX_PER_SQUARE) + 0.5) / PX_PER_SQUARE
    v, u = (axis.ravel() for axis in np.meshgrid(at, at, indexing="ij"))
    shares = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=1)
    seen = standardised(sample(picture, shares @ quads))
    white = dictionaries.white_modules(target.dictionary)[ids]

    def with_side(side: float, blur: float) -> float:
        edges = PX_PER_SQUARE * (0.5 + side * (np.arange(white.shape[1] + 1) / white.shape[1] - 0.5))
        cover = covers(edges, PX_PER_SQUARE).astype(np.float32)
        drawn = 1.0 - cover.T @ (~white).astype(np.float32) @ cover
        padded = np.pad(drawn, ((0, 0), (PADDING, PADDING), (PADDING, PADDING))).transpose(1, 2, 0)
        soft = np.asarray(cv2.GaussianBlur(np.ascontiguousarray(padded), (0, 0), blur * PX_PER_SQUARE))
        inner = soft.reshape(padded.shape)[PADDING:-PADDING, PADDING:-PADDING].transpose(2, 0, 1)
        return float((seen * standardised(inner.reshape(len(ids), -1))).sum())

    some = sides[:: len(sides) // 2].tolist()
    blur = max(BLURS, key=lambda blur: max(with_side(side, blur) for side in some))
    return np.array([with_side(side, blur) for side in sides.tolist()])
