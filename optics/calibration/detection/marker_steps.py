"""How many columns a board of markers has, by the numbers of markers one above the other.

Markers are numbered row by row, those of an AprilGrid from below, so that the number of one differs from that of the
next one straight below by the board's columns, whatever part of it is visible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.calibration.detection.charuco import PREDICTION_ERROR, find_markers, marker_maps, marker_places
from mirrorcam.optics.calibration.detection.checkerboard import Grey, linked_grids
from mirrorcam.optics.calibration.detection.marker_numbering import Markers, read_markers
from mirrorcam.optics.calibration.detection.seen_grid import NO_LIMITS, SeenGrid
from mirrorcam.optics.calibration.detection.tag_grids import linked_tags
from mirrorcam.optics.calibration.solver.observations import Corners, IntArray
from mirrorcam.optics.geometry.targets import DICTIONARIES, SQUARES, TAG_FAMILY, TAGS, AprilGrid, Charuco

FEW = 12
"""Pairs in grids below which markers are also sought one by one."""
OFF = 2.0 * PREDICTION_ERROR + 0.1
"""Squares between a marker and its prediction by one two squares above."""
NO_PLACES = np.empty((0, 2), dtype=np.int64)


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

    @classmethod
    def together(cls, parts: Sequence[Steps]) -> Steps:
        """Those of several pictures."""
        return cls(
            *(np.concatenate([getattr(part, name) for part in parts]) for name in ("columns", "highest", "follows"))
        )

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


def marker_steps(grey: Grey, target: Charuco | AprilGrid, *, mirrored: bool) -> Steps:
    """Pairs of markers of all boards in a picture (h, w), of any size but otherwise like the target.

    Markers are read in grids of corners or, where these show few, as OpenCV finds them one by one.
    """
    pairs = _in_grids(grey, target, mirrored=mirrored)
    in_grids = len(pairs)
    if in_grids < FEW:
        pairs += _one_by_one(grey, target, mirrored=mirrored)
    upper, lower = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    columns = upper - lower if isinstance(target, AprilGrid) else lower - upper
    follows = (np.arange(len(pairs)) < in_grids).astype(np.int64) * (not isinstance(target, AprilGrid))
    possible = columns > 1
    return Steps(columns[possible], np.maximum(upper, lower)[possible], follows[possible])


def _in_grids(grey: Grey, target: Charuco | AprilGrid, *, mirrored: bool) -> list[tuple[int, int]]:
    """Numbers of the upper and the lower marker of each pair in grids of corners."""
    picture, markers = np.asarray(grey, dtype=np.float32), _every_marker(target)
    pairs = []
    for places, pixels in linked_tags(grey, target) if isinstance(target, AprilGrid) else linked_grids(grey):
        grid = SeenGrid(places, Corners(np.arange(len(places)), pixels), NO_LIMITS)
        low, ids = read_markers(picture, grid.as_printed if mirrored else grid, markers)
        read = {(x, y): number for (x, y), number in zip(low.tolist(), ids.tolist(), strict=True)}
        pairs += [(number, read[x, y + 2]) for (x, y), number in read.items() if (x, y + 2) in read]
    return pairs


def _one_by_one(grey: Grey, target: Charuco | AprilGrid, *, mirrored: bool) -> list[tuple[int, int]]:
    """The same of markers that lie where their maps from the print predict each other."""
    ids, quads = find_markers(grey, _with_every_marker(target), mirrored=mirrored)
    if not len(ids):
        return []
    centres, maps = quads.mean(axis=1), marker_maps(marker_places(target)[0], quads)
    # The mean of two maps is that between them, up to second order of the perspective.
    between = (maps[:, None] + maps) / 2.0
    off = np.linalg.norm(centres - centres[:, None] - 2.0 * between[..., 1], axis=2)
    side = np.sqrt(np.abs(np.linalg.det(between)))
    return [(int(ids[a]), int(ids[b])) for a, b in np.argwhere(off < OFF * side)]


def _with_every_marker(target: Charuco | AprilGrid) -> Charuco | AprilGrid:
    """A board like the target with as many rows as there are markers for."""
    if isinstance(target, AprilGrid):
        return target.replaced(rows=min(len(TAG_FAMILY.bytesList) // target.cols, int(TAGS.most)))
    return target.replaced(rows=min(2 * len(_codes(target.dictionary)) // target.cols, int(SQUARES.most)))


def _every_marker(target: Charuco | AprilGrid) -> Markers:
    """All markers of a target's family or dictionary."""
    if isinstance(target, AprilGrid):
        return Markers(_codes_of_tags(), NO_PLACES, 1.0, parity=0, every_other=True)
    return Markers(_codes(target.dictionary), NO_PLACES, target.marker_mm / target.square_mm, parity=1)


@lru_cache(maxsize=1)
def _codes_of_tags() -> NDArray[np.bool_]:
    any_grid = AprilGrid(cols=2, rows=2, tag_mm=10.0, spacing=0.3)
    return np.array([~any_grid.tag(number)[1:-1, 1:-1] for number in range(len(TAG_FAMILY.bytesList))])


@lru_cache(maxsize=2)
def _codes(name: str) -> NDArray[np.bool_]:
    number, modules = DICTIONARIES[name]
    dictionary = cv2.aruco.getPredefinedDictionary(number)
    drawn = [
        dictionary.generateImageMarker(marker, modules, borderBits=1) for marker in range(len(dictionary.bytesList))
    ]
    return np.array(drawn)[:, 1:-1, 1:-1] > 0
