"""The layout of a board's markers from pictures alone: their size, and the numbers of adjacent markers.

Markers are numbered row by row, on an AprilGrid from below, so the numbers of two markers straight above each other
differ by the board's number of columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import PX_PER_SQUARE, Image, coverage, sample
from mirrorcam.optics.calibration.detection.board_warp import BoardWarp
from mirrorcam.optics.calibration.detection.charuco import (
    PREDICTION_ERROR,
    find_any_markers,
    find_markers,
    groups,
    linked_tags,
    marker_corners,
    marker_maps,
)
from mirrorcam.optics.calibration.detection.checkerboard import Grey, linked_grids
from mirrorcam.optics.calibration.detection.detections import NO_LIMITS, DetectedGrid
from mirrorcam.optics.calibration.detection.marker_numbering import (
    Markers,
    ReadMarkers,
    module_greys,
    read_markers,
    squares_of,
    standardised,
)
from mirrorcam.optics.calibration.solver.observations import Corners, IntArray
from mirrorcam.optics.geometry import marker_dictionaries as dictionaries
from mirrorcam.optics.geometry.boards import TAG_FAMILY, AprilGrid, Charuco

TRIAL_SIDES = tuple(np.arange(0.3, 0.96, 0.06).tolist())  # trial sides of markers, in squares, for reading pictures
SIDE_STEP, SIDE_RANGE = 0.01, 0.09  # step of the compared sides, and their range about the best trial side
BLURS = (0.015, 0.03, 0.045, 0.06, 0.08, 0.1, 0.125, 0.155)  # sigma in squares
MIN_LIKELY_CORRELATION = 0.85  # above which the stated side is about right
MAX_SHIFTS = 4  # of the range of compared sides, while the best side is at its end
ROUNDS = 2  # of alternating between the likeliest blur and side
MAX_SQUARES = 16  # compared in each grid
MIN_SQUARES = 8  # in all grids
MIN_RELATIVE_CORRELATION = 0.85  # relative to the clearest grid; grids with less show other boards, or are flipped
MIN_CORRELATION = 0.7  # correlation of the squares with markers of the best side and blur
CENTRE_TO_CORNERS = np.array(
    [[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]]
)  # squares, from a square's centre to its corners
PADDING = 8  # px of the black squares around a white square
MIN_PAIRS = 12
"""Number of vertically adjacent pairs in grids below which single markers are also searched."""
MAX_OFFSET = 2.0 * PREDICTION_ERROR + 0.1
"""Squares between a marker and its prediction from a marker two squares above; less for a nearer marker."""
NEIGHBOUR_OFFSETS = ((0, 2), (1, 1), (-1, 1))
"""Squares from a marker of a ChArUco board to its nearest neighbours below; AprilGrids have only the first."""
MAX_BLANK = 0.15
"""Standard deviation of the grey values within a blank square, relative to the contrast of white and black."""
NO_GRID_XY = np.empty((0, 2), dtype=np.int64)
NO_GREYS = np.empty((0, 16))


@dataclass(frozen=True, eq=False)
class _MarkedSquares:
    """Squares of a picture that hold markers: ids (n,), and pixels (n, 4, 2) of the corners, row by row."""

    picture: Image
    ids: IntArray
    quads: FloatArray


def marker_side(pictures: Sequence[GriddedPicture], board: Charuco, *, mirrored: bool | None) -> float | None:
    """Estimate the side of the markers in pictures, in squares; None if too few markers can be read.

    `mirrored` states whether the pictures show the board in mirrors; None: both directly and in mirrors.
    Every marker is compared with its print at several sides and blurs. Blur and brightness change the edges of the
    square and of the marker equally, so they do not bias the side.
    """
    flips = (False, True) if mirrored is None else (mirrored,)
    side, squares = _squares_in_grids(pictures, board, flips)
    if sum(len(marked.ids) for marked in squares) < MIN_SQUARES:
        side, squares = _between_markers(pictures, board, flips)
    count = sum(len(marked.ids) for marked in squares)
    if count < MIN_SQUARES:
        return None
    for _ in range(MAX_SHIFTS):
        sides = np.arange(-SIDE_RANGE, SIDE_RANGE + SIDE_STEP / 2.0, SIDE_STEP) + np.clip(
            side, 0.1 + SIDE_RANGE, 0.99 - SIDE_RANGE
        )
        correlations = np.sum([_correlations(marked, board, sides) for marked in squares], axis=0) / count
        best = int(correlations.argmax())
        if 0 < best < len(sides) - 1:
            break
        side = float(sides[best])
    else:
        return None
    if correlations[best] < MIN_CORRELATION:
        return None
    before, peak, after = correlations[best - 1 : best + 2]
    curvature = before - 2.0 * peak + after
    return float(sides[best] + (SIDE_STEP * 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0))


def _sized(board: Charuco, side: float) -> Charuco:
    return board.replaced(marker_mm=side * board.square_mm)


def _squares_in_grids(
    pictures: Sequence[GriddedPicture], board: Charuco, flips: Sequence[bool]
) -> tuple[float, list[_MarkedSquares]]:
    """Return a rough side of the markers, and the squares of grids of corners that hold them."""

    def read(side: float) -> list[tuple[GriddedPicture, ReadMarkers]]:
        sized = _sized(board, side)
        grids = [
            (gridded, grid) for gridded in pictures for flip in flips for grid in gridded.read(sized, mirrored=flip)
        ]
        return [(gridded, grid) for gridded, grid in grids if len(grid.ids)]

    def likelihood(grids: list[tuple[GriddedPicture, ReadMarkers]]) -> float:
        return sum(grid.correlation * len(grid.ids) for _, grid in grids)

    side = board.marker_mm / board.square_mm
    grids = read(side)
    if likelihood(grids) < MIN_LIKELY_CORRELATION * sum(len(grid.ids) for _, grid in grids):
        others = [(trial, read(trial)) for trial in TRIAL_SIDES]
        side, grids = max([(side, grids), *others], key=lambda candidate: likelihood(candidate[1]))
    clearest = max((grid.correlation for _, grid in grids), default=0.0)
    return side, [
        _MarkedSquares(gridded.picture, grid.ids[:MAX_SQUARES], grid.quads[:MAX_SQUARES])
        for gridded, grid in grids
        if grid.correlation > MIN_RELATIVE_CORRELATION * clearest
    ]


def _between_markers(
    pictures: Sequence[GriddedPicture], board: Charuco, flips: Sequence[bool]
) -> tuple[float, list[_MarkedSquares]]:
    """Like `_squares_in_grids`, for squares located by the centres of single markers."""
    detections = [
        (gridded, *find_markers(gridded.grey, board, mirrored=flip)) for gridded in pictures for flip in flips
    ]

    def grouped(side: float) -> list[list[IntArray]]:
        print_quads = marker_corners(_sized(board, side))
        return [groups(print_quads[ids], quads) for _, ids, quads in detections]

    def count(parts: list[list[IntArray]]) -> int:
        return sum(len(part) for picture_parts in parts for part in picture_parts)

    sides = (board.marker_mm / board.square_mm, *TRIAL_SIDES)
    side, parts = max(((side, grouped(side)) for side in sides), key=lambda candidate: count(candidate[1]))
    squares = []
    for (gridded, ids, quads), picture_parts in zip(detections, parts, strict=True):
        centres, centres_px = marker_corners(board).mean(axis=1)[ids], quads.mean(axis=1)
        for part in picture_parts:
            warp = BoardWarp.fit(centres[part], centres_px[part])
            if warp is not None:
                first = part[:MAX_SQUARES]
                corners = warp.map((centres[first, None] + CENTRE_TO_CORNERS).reshape(-1, 2)).reshape(-1, 4, 2)
                squares.append(_MarkedSquares(gridded.picture, board.first_marker + ids[first], corners))
    return side, squares


def _correlations(squares: _MarkedSquares, board: Charuco, sides: FloatArray) -> FloatArray:
    """Sum (s,) of the correlations of squares with their markers at sides (s,), at the likeliest blur."""
    positions = (np.arange(PX_PER_SQUARE) + 0.5) / PX_PER_SQUARE
    v, u = (axis.ravel() for axis in np.meshgrid(positions, positions, indexing="ij"))
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=1)
    sampled = standardised(sample(squares.picture, weights @ squares.quads).astype(np.float64))
    if board.inverted:
        sampled = -sampled
    white = dictionaries.white_modules(board.dictionary)[squares.ids]

    def with_side(side: float, blur: float) -> float:
        edges = PX_PER_SQUARE * (0.5 + side * (np.arange(white.shape[1] + 1) / white.shape[1] - 0.5))
        cover = coverage(edges, PX_PER_SQUARE).astype(np.float32)
        printed = 1.0 - cover.T @ (~white).astype(np.float32) @ cover
        padded = np.pad(printed, ((0, 0), (PADDING, PADDING), (PADDING, PADDING))).transpose(1, 2, 0)
        blurred = np.asarray(cv2.GaussianBlur(np.ascontiguousarray(padded), (0, 0), blur * PX_PER_SQUARE))
        inner = blurred.reshape(padded.shape)[PADDING:-PADDING, PADDING:-PADDING].transpose(2, 0, 1)
        return float((sampled * standardised(inner.reshape(len(white), -1).astype(np.float64))).sum())

    likely_sides = sides[len(sides) // 2 :: len(sides)]
    for _ in range(ROUNDS):
        blur = max(BLURS, key=lambda blur: max(with_side(side, blur) for side in likely_sides.tolist()))
        correlations = np.array([with_side(side, blur) for side in sides.tolist()])
        likely_sides = sides[correlations.argmax() :][:1]
    return correlations


@dataclass(frozen=True)
class MarkerPairs:
    """Pairs of adjacent markers.

    Attributes
    ----------
    upper, lower
        Numbers (n,) of both markers of each pair.
    offset
        Squares (n, 2) from the upper to the lower marker, along x and y of the print: one of `NEIGHBOUR_OFFSETS`.
    inner
        Whether both markers (n,) lie among inner corners, so another row of squares follows.
    """

    upper: IntArray
    lower: IntArray
    offset: IntArray
    inner: NDArray[np.bool_]

    @classmethod
    def join(cls, parts: Sequence[MarkerPairs]) -> MarkerPairs:
        """Join the pairs of several pictures."""
        return cls(*(np.concatenate([getattr(part, column.name) for part in parts]) for column in fields(cls)))

    @classmethod
    def of(cls, pairs: Sequence[tuple[int, int, tuple[int, int]]], *, inner: bool) -> MarkerPairs:
        """Build pairs from upper and lower numbers and the offsets between them."""
        numbers = np.array([pair[:2] for pair in pairs], dtype=np.int64).reshape(-1, 2)
        offsets = np.array([pair[2] for pair in pairs], dtype=np.int64).reshape(-1, 2)
        return cls(numbers[:, 0], numbers[:, 1], offsets, np.full(len(pairs), inner))

    def __len__(self) -> int:
        return len(self.upper)

    @property
    def numbers(self) -> IntArray:
        """All numbers, without repetitions."""
        return np.unique(np.concatenate([self.upper, self.lower]))

    def where(self, mask: NDArray[np.bool_]) -> MarkerPairs:
        """Select the pairs of a mask (n,)."""
        return MarkerPairs(*(getattr(self, column.name)[mask] for column in fields(self)))

    def vertical(self, board: Charuco | AprilGrid) -> VerticalPairs:
        """Return the vertically adjacent pairs."""
        vertical = self.where(self.offset[:, 0] == 0)
        tags = isinstance(board, AprilGrid)
        columns = (vertical.upper - vertical.lower) if tags else (vertical.lower - vertical.upper)
        highest, has_next_row = np.maximum(vertical.upper, vertical.lower), vertical.inner & (not tags)
        possible = columns > 1
        return VerticalPairs(columns[possible], highest[possible], has_next_row[possible].astype(np.int64))

    def count_consistent(self, cols: int, first: int, *, white_first: bool) -> int:
        """Count the diagonal pairs that are consistent with a ChArUco board with `cols` columns.

        `first` is the number of its first marker; `white_first` states whether its top-left square is white. Numbers
        continue above and below the board. Markers among inner corners do not lie in the first or last column.
        """
        # Of two rows, the first holds fewer markers if the number of columns is odd and its first square is black.
        in_first = (cols + white_first) // 2

        def grid_xy(numbers: IntArray) -> IntArray:
            two_rows, rest = np.divmod(numbers - first, cols)
            second = rest >= in_first
            column = 2 * np.where(second, rest - in_first, rest) + (second == white_first)
            return np.stack([column, 2 * two_rows + second], axis=1)

        upper, lower = grid_xy(self.upper), grid_xy(self.lower)
        columns = np.stack([upper[:, 0], lower[:, 0]])
        possible = ~self.inner | ((columns > 0) & (columns < cols - 1)).all(axis=0)
        diagonal = self.offset[:, 0] != 0
        return int((diagonal & possible & (lower - upper == self.offset).all(axis=1)).sum())


@dataclass(frozen=True)
class VerticalPairs:
    """Pairs of vertically adjacent markers.

    Attributes
    ----------
    columns
        Number of columns (n,) implied by each pair.
    highest
        Higher marker number (n,) of each pair.
    has_next_row
        1 (n,) if the lower marker lies among inner corners, so another row of squares follows, else 0.
    """

    columns: IntArray
    highest: IntArray
    has_next_row: IntArray

    @property
    def majority(self) -> tuple[int, VerticalPairs]:
        """The number of columns that more than half of the pairs imply, and these pairs; 0 without a majority."""
        if len(self.columns):
            numbers, counts = np.unique(self.columns, return_counts=True)
            if 2 * counts.max() > len(self.columns):
                columns = int(numbers[counts.argmax()])
                return columns, self._where(self.columns == columns)
        return 0, self._where(self.columns < 0)

    def _where(self, mask: NDArray[np.bool_]) -> VerticalPairs:
        return VerticalPairs(self.columns[mask], self.highest[mask], self.has_next_row[mask])


@dataclass(frozen=True, eq=False)
class GriddedPicture:
    """A picture (h, w) and its grids of corners, for a board of any size that is otherwise like a board."""

    grey: Grey
    grids: tuple[DetectedGrid, ...]

    @classmethod
    def of(cls, grey: Grey, board: Charuco | AprilGrid) -> GriddedPicture:
        """Find the grids of a picture."""
        linked = linked_tags(grey, board) if isinstance(board, AprilGrid) else linked_grids(grey)
        return cls(
            grey,
            tuple(
                DetectedGrid(grid_xy, Corners(np.arange(len(grid_xy)), pixels), NO_LIMITS) for grid_xy, pixels in linked
            ),
        )

    @property
    def picture(self) -> Image:
        """The grey values (h, w)."""
        return np.asarray(self.grey, dtype=np.float32)

    def read(self, board: Charuco | AprilGrid, *, mirrored: bool) -> list[ReadMarkers]:
        """Read the markers in each grid, from any part of any board."""
        picture, markers = self.picture, _every_marker(board)
        return [read_markers(picture, grid.as_printed if mirrored else grid, markers) for grid in self.grids]


def are_blank(gridded: GriddedPicture) -> bool | None:
    """Return whether most squares in the grids of a ChArUco board or checkerboard hold nothing; None without squares.

    The squares of one colour hold the markers of a ChArUco board.
    """
    greys = [
        np.concatenate(
            [module_greys(gridded.picture, squares_of(grid, parity)[1], 4, 0.9) for grid in gridded.grids] or [NO_GREYS]
        )
        for parity in (0, 1)
    ]
    if not all(map(len, greys)):
        return None
    contrast = abs(float(np.subtract(*(np.median(of_colour) for of_colour in greys))))
    return all(float(np.median(of_colour.std(axis=1))) < MAX_BLANK * contrast for of_colour in greys)


def marker_pairs(gridded: GriddedPicture, board: Charuco | AprilGrid, *, mirrored: bool) -> MarkerPairs:
    """Return pairs of markers of all boards in a picture, of any size but otherwise like the board.

    Markers are read in grids of corners or, if these contain few, individually by OpenCV.
    """
    pairs = _pairs_in_grids(gridded.read(board, mirrored=mirrored))
    if len(pairs.vertical(board).columns) < MIN_PAIRS:
        pairs = MarkerPairs.join([pairs, _pairs_of_single_markers(gridded.grey, board, mirrored=mirrored)])
    return pairs


def _pairs_in_grids(grids: Sequence[ReadMarkers]) -> MarkerPairs:
    pairs = []
    for grid in grids:
        read = {(x, y): number for (x, y), number in zip(grid.low.tolist(), grid.ids.tolist(), strict=True)}
        for (x, y), number in read.items():
            pairs += [
                (number, read[x + dx, y + dy], (dx, dy)) for dx, dy in NEIGHBOUR_OFFSETS if (x + dx, y + dy) in read
            ]
    return MarkerPairs.of(pairs, inner=True)


def _pairs_of_single_markers(grey: Grey, board: Charuco | AprilGrid, *, mirrored: bool) -> MarkerPairs:
    """Return pairs of single markers whose maps from the print predict each other."""
    ids, quads = find_any_markers(grey, board, mirrored=mirrored)
    if not len(ids):
        return MarkerPairs.of([], inner=False)
    centres, maps = quads.mean(axis=1), marker_maps(marker_corners(board)[0], quads)
    # The mean of two maps is the map halfway, up to second order of the perspective.
    between = (maps[:, None] + maps) / 2.0
    side = np.sqrt(np.abs(np.linalg.det(between)))
    pairs = []
    for offset in NEIGHBOUR_OFFSETS[:1] if isinstance(board, AprilGrid) else NEIGHBOUR_OFFSETS:
        distances = np.linalg.norm(centres - centres[:, None] - between @ np.array(offset, dtype=np.float64), axis=2)
        pairs += [
            (int(ids[a]), int(ids[b]), offset)
            for a, b in np.argwhere(distances < MAX_OFFSET / 2.0 * np.hypot(*offset) * side)
        ]
    return MarkerPairs.of(pairs, inner=False)


def _every_marker(board: Charuco | AprilGrid) -> Markers:
    """Return all markers of a board's family or dictionary."""
    if isinstance(board, AprilGrid):
        return Markers(_codes_of_tags(), NO_GRID_XY, 1.0, parity=0, every_other=True)
    codes = dictionaries.white_modules(board.dictionary)[:, 1:-1, 1:-1] != board.inverted
    return Markers(codes, NO_GRID_XY, board.marker_mm / board.square_mm, parity=not board.inverted)


@lru_cache(maxsize=1)
def _codes_of_tags() -> NDArray[np.bool_]:
    any_grid = AprilGrid(cols=2, rows=2, tag_mm=10.0, spacing=0.3)
    return np.array([~any_grid.tag(number)[1:-1, 1:-1] for number in range(len(TAG_FAMILY.bytesList))])
