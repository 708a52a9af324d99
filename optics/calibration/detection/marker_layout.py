"""The layout of a board's markers by the pictures alone: their size, and the numbers of neighbouring ones.

Markers are numbered row by row, those of an AprilGrid from below, so that the number of one differs from that of the
next one straight below by the board's columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import PX_PER_SQUARE, Image, covers, sample
from mirrorcam.optics.calibration.detection.board_warp import BoardWarp
from mirrorcam.optics.calibration.detection.charuco import (
    PREDICTION_ERROR,
    find_markers,
    groups,
    linked_tags,
    marker_maps,
    marker_places,
)
from mirrorcam.optics.calibration.detection.checkerboard import Grey, linked_grids
from mirrorcam.optics.calibration.detection.detections import NO_LIMITS, SeenGrid
from mirrorcam.optics.calibration.detection.marker_numbering import Markers, ReadMarkers, read_markers, standardised
from mirrorcam.optics.calibration.solver.observations import Corners, IntArray
from mirrorcam.optics.geometry import marker_dictionaries as dictionaries
from mirrorcam.optics.geometry.targets import SQUARES, TAG_FAMILY, TAGS, AprilGrid, Charuco

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
FEW = 12
"""Pairs straight above each other in grids below which markers are also sought one by one."""
OFF = 2.0 * PREDICTION_ERROR + 0.1
"""Squares between a marker and its prediction by one two squares above; less by one nearer."""
BELOW = ((0, 2), (1, 1), (-1, 1))
"""Squares from a marker of a checkerboard to its nearest neighbours below it: only the first has one on AprilGrids."""
NO_PLACES = np.empty((0, 2), dtype=np.int64)


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
    side, squares = _squares_in_grids(shown, target, ways)
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


def _squares_in_grids(
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
            warp = BoardWarp.through(middles[part], centres[part])
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


@dataclass(frozen=True)
class MarkerPairs:
    """Neighbouring markers.

    Attributes
    ----------
    upper, lower
        The numbers (n,) of both markers of each pair.
    by
        Squares (n, 2) from the upper to the lower one, along x and y of the print: one of `BELOW`.
    inner
        Whether both (n,) lie among inner corners, so that another row of squares follows.
    """

    upper: IntArray
    lower: IntArray
    by: IntArray
    inner: NDArray[np.bool_]

    @classmethod
    def together(cls, parts: Sequence[MarkerPairs]) -> MarkerPairs:
        """Those of several pictures."""
        return cls(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(cls)))

    @classmethod
    def of(cls, pairs: Sequence[tuple[int, int, tuple[int, int]]], *, inner: bool) -> MarkerPairs:
        """Pairs of an upper and a lower number, and where one lies from the other."""
        numbers = np.array([pair[:2] for pair in pairs], dtype=np.int64).reshape(-1, 2)
        by = np.array([pair[2] for pair in pairs], dtype=np.int64).reshape(-1, 2)
        return cls(numbers[:, 0], numbers[:, 1], by, np.full(len(pairs), inner))

    def __len__(self) -> int:
        return len(self.upper)

    @property
    def numbers(self) -> IntArray:
        """All numbers, once each."""
        return np.unique(np.concatenate([self.upper, self.lower]))

    def where(self, kept: NDArray[np.bool_]) -> MarkerPairs:
        """The pairs of a mask (n,)."""
        return MarkerPairs(*(getattr(self, each.name)[kept] for each in fields(self)))

    def steps(self, target: Charuco | AprilGrid) -> Steps:
        """Those straight above each other."""
        straight = self.where(self.by[:, 0] == 0)
        tags = isinstance(target, AprilGrid)
        columns = (straight.upper - straight.lower) if tags else (straight.lower - straight.upper)
        highest, follows = np.maximum(straight.upper, straight.lower), straight.inner & (not tags)
        possible = columns > 1
        return Steps(columns[possible], highest[possible], follows[possible].astype(np.int64))

    def explained(self, cols: int, first: int, *, white_first: bool) -> int:
        """How many of the pairs on a slant are as on a ChArUco board of so many columns.

        `first` is the number of its first marker, and `white_first` whether its top-left square is white. Numbers go on
        above and below the board. Markers among inner corners do not lie in the first or last column.
        """
        # Of two rows, the first holds fewer where the number of columns is odd and its first square is black.
        of_first = (cols + white_first) // 2

        def place(numbers: IntArray) -> IntArray:
            two_rows, rest = np.divmod(numbers - first, cols)
            second = rest >= of_first
            along = 2 * np.where(second, rest - of_first, rest) + (second == white_first)
            return np.stack([along, 2 * two_rows + second], axis=1)

        upper, lower = place(self.upper), place(self.lower)
        along = np.stack([upper[:, 0], lower[:, 0]])
        possible = ~self.inner | ((along > 0) & (along < cols - 1)).all(axis=0)
        slanted = self.by[:, 0] != 0
        return int((slanted & possible & (lower - upper == self.by).all(axis=1)).sum())


@dataclass(frozen=True)
class Steps:
    """Pairs of markers straight above each other.

    Attributes
    ----------
    columns
        The number of columns (n,) by each pair.
    highest
        The higher marker's number (n,) of each.
    follows
        1 (n,) where the lower marker lies among inner corners, so that another row of squares follows, or 0.
    """

    columns: IntArray
    highest: IntArray
    follows: IntArray

    @property
    def likely(self) -> tuple[int, Steps]:
        """The number of columns on which more than half of the pairs agree, and these pairs; 0 for none."""
        if len(self.columns):
            numbers, counts = np.unique(self.columns, return_counts=True)
            if 2 * counts.max() > len(self.columns):
                columns = int(numbers[counts.argmax()])
                return columns, self._where(self.columns == columns)
        return 0, self._where(self.columns < 0)

    def _where(self, kept: NDArray[np.bool_]) -> Steps:
        return Steps(self.columns[kept], self.highest[kept], self.follows[kept])


@dataclass(frozen=True, eq=False)
class GriddedPicture:
    """A picture (h, w) and the grids of corners in it, of a board of any size but otherwise like a target."""

    grey: Grey
    grids: tuple[SeenGrid, ...]

    @classmethod
    def of(cls, grey: Grey, target: Charuco | AprilGrid) -> GriddedPicture:
        """The picture with its grids."""
        linked = linked_tags(grey, target) if isinstance(target, AprilGrid) else linked_grids(grey)
        return cls(
            grey,
            tuple(SeenGrid(places, Corners(np.arange(len(places)), pixels), NO_LIMITS) for places, pixels in linked),
        )

    @property
    def picture(self) -> Image:
        """The grey values (h, w)."""
        return np.asarray(self.grey, dtype=np.float32)

    def read(self, target: Charuco | AprilGrid, *, mirrored: bool) -> list[ReadMarkers]:
        """The markers in each grid, whatever part of whatever board they are."""
        picture, markers = self.picture, _every_marker(target)
        return [read_markers(picture, grid.as_printed if mirrored else grid, markers) for grid in self.grids]


def marker_pairs(shown: GriddedPicture, target: Charuco | AprilGrid, *, mirrored: bool) -> MarkerPairs:
    """Pairs of markers of all boards in a picture, of any size but otherwise like the target.

    Markers are read in grids of corners or, where these show few, as OpenCV finds them one by one.
    """
    pairs = _pairs_in_grids(shown.read(target, mirrored=mirrored))
    if len(pairs.steps(target).columns) < FEW:
        pairs = MarkerPairs.together([pairs, _one_by_one(shown.grey, target, mirrored=mirrored)])
    return pairs


def _pairs_in_grids(grids: Sequence[ReadMarkers]) -> MarkerPairs:
    pairs = []
    for grid in grids:
        read = {(x, y): number for (x, y), number in zip(grid.low.tolist(), grid.ids.tolist(), strict=True)}
        for (x, y), number in read.items():
            pairs += [(number, read[x + dx, y + dy], (dx, dy)) for dx, dy in BELOW if (x + dx, y + dy) in read]
    return MarkerPairs.of(pairs, inner=True)


def _one_by_one(grey: Grey, target: Charuco | AprilGrid, *, mirrored: bool) -> MarkerPairs:
    """The same of markers that lie where their maps from the print predict each other."""
    ids, quads = find_markers(grey, _with_every_marker(target), mirrored=mirrored)
    if not len(ids):
        return MarkerPairs.of([], inner=False)
    centres, maps = quads.mean(axis=1), marker_maps(marker_places(target)[0], quads)
    # The mean of two maps is that between them, up to second order of the perspective.
    between = (maps[:, None] + maps) / 2.0
    side = np.sqrt(np.abs(np.linalg.det(between)))
    pairs = []
    for by in BELOW[:1] if isinstance(target, AprilGrid) else BELOW:
        off = np.linalg.norm(centres - centres[:, None] - between @ np.array(by, dtype=np.float64), axis=2)
        pairs += [(int(ids[a]), int(ids[b]), by) for a, b in np.argwhere(off < OFF / 2.0 * np.hypot(*by) * side)]
    return MarkerPairs.of(pairs, inner=False)


def _with_every_marker(target: Charuco | AprilGrid) -> Charuco | AprilGrid:
    """A board like the target with as many rows as there are markers for."""
    if isinstance(target, AprilGrid):
        return target.replaced(rows=min(len(TAG_FAMILY.bytesList) // target.cols, int(TAGS.most)))
    markers = dictionaries.count(target.dictionary)
    return target.replaced(rows=min(2 * markers // target.cols, int(SQUARES.most)), first_marker=0, legacy=False)


def _every_marker(target: Charuco | AprilGrid) -> Markers:
    """All markers of a target's family or dictionary."""
    if isinstance(target, AprilGrid):
        return Markers(_codes_of_tags(), NO_PLACES, 1.0, parity=0, every_other=True)
    codes = dictionaries.white_modules(target.dictionary)[:, 1:-1, 1:-1]
    return Markers(codes, NO_PLACES, target.marker_mm / target.square_mm, parity=1)


@lru_cache(maxsize=1)
def _codes_of_tags() -> NDArray[np.bool_]:
    any_grid = AprilGrid(cols=2, rows=2, tag_mm=10.0, spacing=0.3)
    return np.array([~any_grid.tag(number)[1:-1, 1:-1] for number in range(len(TAG_FAMILY.bytesList))])
