"""How the markers of a board are numbered, by the numbers of neighbouring ones, whatever part of it is visible.

Markers are numbered row by row, those of an AprilGrid from below, so that the number of one differs from that of the
next one straight below by the board's columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.calibration.detection.blurred_print import Image
from mirrorcam.optics.calibration.detection.charuco import PREDICTION_ERROR, find_markers, marker_maps, marker_places
from mirrorcam.optics.calibration.detection.checkerboard import Grey, linked_grids
from mirrorcam.optics.calibration.detection.marker_numbering import Markers, ReadMarkers, read_markers
from mirrorcam.optics.calibration.detection.seen_grid import NO_LIMITS, SeenGrid
from mirrorcam.optics.calibration.detection.tag_grids import linked_tags
from mirrorcam.optics.calibration.solver.observations import Corners, IntArray
from mirrorcam.optics.geometry import marker_dictionaries as dictionaries
from mirrorcam.optics.geometry.targets import SQUARES, TAG_FAMILY, TAGS, AprilGrid, Charuco

FEW = 12
"""Pairs straight above each other in grids below which markers are also sought one by one."""
OFF = 2.0 * PREDICTION_ERROR + 0.1
"""Squares between a marker and its prediction by one two squares above; less by one nearer."""
BELOW = ((0, 2), (1, 1), (-1, 1))
"""Squares from a marker of a checkerboard to its nearest neighbours below it: only the first has one on AprilGrids."""
NO_PLACES = np.empty((0, 2), dtype=np.int64)


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
        The number of columns (n,) that each pair says.
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
        """The number of columns that more than a half of the pairs say, and these pairs; 0 for none."""
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
    pairs = _in_grids(shown.read(target, mirrored=mirrored))
    if len(pairs.steps(target).columns) < FEW:
        pairs = MarkerPairs.together([pairs, _one_by_one(shown.grey, target, mirrored=mirrored)])
    return pairs


def _in_grids(grids: Sequence[ReadMarkers]) -> MarkerPairs:
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
