"""Detections: the part of a board that a picture shows, which of its corners these may be, and all of one frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.observations import Corners, IntArray, Observations
from mirrorcam.optics.geometry.targets import Checkerboard

TURNS = tuple(np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), turn) for turn in range(4))
NO_LIMITS = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
FLIP, RIGHT = np.array([[-1, 0], [0, 1]]), np.array([1, 0])


@dataclass(frozen=True)
class SeenGrid:
    """Corners of a checkerboard of which any part may be visible.

    Attributes
    ----------
    places
        Integer positions (n, 2) on a grid of its own, as of `corner_grids`: the second axis is turned from the first
        one as y is from x in the picture; right of and below a corner with an even sum there is white.
    corners
        The corners (n) in the picture, whose ids number them in this order.
    limits
        The lowest and the highest coordinates (2, 2) that corners have where the board is seen to end, in rows;
        infinite where it is not.
    """

    places: IntArray
    corners: Corners
    limits: FloatArray

    def __len__(self) -> int:
        return len(self.places)

    @property
    def extent(self) -> tuple[int, int]:
        """Numbers of corners along both axes."""
        across, down = np.ptp(self.places, axis=0) + 1
        return int(across), int(down)

    @property
    def as_printed(self) -> SeenGrid:
        """The grid of a board seen in a mirror as it is on the print: its axes turn, and its colours are, as there."""
        return replace(self, places=self.places @ FLIP + RIGHT, limits=_turned(self.limits, FLIP) + RIGHT)

    def moved(self, turn: int, by: IntArray) -> SeenGrid:
        """The grid with its coordinates turned by quarters, and moved (2,); their parities must add up to even."""
        matrix = TURNS[turn]
        return replace(self, places=self.places @ matrix.T + by, limits=_turned(self.limits, matrix) + by)

    def where(self, mask: NDArray[np.bool_]) -> SeenGrid:
        """The corners of a mask (n,)."""
        corners = self.corners.where(mask)
        return replace(self, places=self.places[mask], corners=replace(corners, ids=np.arange(len(corners))))

    def numberings(self, target: Checkerboard, *, mirrored: bool) -> list[Corners]:
        """All the ways in which these may be the target's corners, by their colours, extent and ends.

        Parameters
        ----------
        target
            The board.
        mirrored
            Whether the picture shows it through a mirror.

        Returns
        -------
        list of Corners
            One or two for a board whose full extent is known, none where it does not fit the target.
        """
        if mirrored:
            return self.as_printed.numberings(target, mirrored=False)
        last = np.array([target.cols - 2, target.rows - 2])
        found = []
        for turn in range(4):
            for by in _shifts(self.moved(turn, np.zeros(2, dtype=np.int64)), last):
                # On the print, black is right of and below corners with an even sum.
                if (by.sum() + turn) % 2 == 1:
                    col, row = self.moved(turn, by).places.T
                    found.append(replace(self.corners, ids=(row * (last[0] + 1) + col).astype(np.int64)))
        return found

    @classmethod
    def together(cls, grids: Sequence[SeenGrid]) -> SeenGrid:
        """Grids of one board in several views, with common coordinates; ends beyond which others go on are none."""
        places = np.concatenate([grid.places for grid in grids])
        corners = Corners(
            np.arange(len(places)),
            np.concatenate([grid.corners.pixels for grid in grids]),
            np.concatenate([grid.corners.sigma_px for grid in grids]),
        )
        low, high = places.min(axis=0), places.max(axis=0)
        lows, highs = np.array([grid.limits for grid in grids]).transpose(1, 0, 2)
        lows, highs = np.where(lows <= low, lows, -np.inf), np.where(highs >= high, highs, np.inf)
        return cls(places, corners, np.array([lows.max(axis=0), highs.min(axis=0)]))


def _shifts(grid: SeenGrid, last: IntArray) -> list[IntArray]:
    """The shifts (2,) that move a grid to within 0 and `last`, and its limits to there."""
    first, final = -grid.places.min(axis=0), last - grid.places.max(axis=0)
    for axis in range(2):
        for limit, end in zip(grid.limits[:, axis], (0, last[axis]), strict=True):
            if np.isfinite(limit):
                first[axis], final[axis] = max(first[axis], end - int(limit)), min(final[axis], end - int(limit))
    return [
        np.array([right, down]) for right in range(first[0], final[0] + 1) for down in range(first[1], final[1] + 1)
    ]


def _turned(limits: FloatArray, matrix: IntArray) -> FloatArray:
    """Limits (2, 2) after a turn or flip of the coordinates."""
    turned = np.empty_like(limits)
    for axis in range(2):
        source = int(np.flatnonzero(matrix[axis])[0])
        turned[:, axis] = np.sort(matrix[axis, source] * limits[:, source])
    return turned


@dataclass(frozen=True)
class DetectedFrame:
    """Corners in the views of one picture, and boards that belong to none of them.

    Attributes
    ----------
    corners
        The corners, as frame 0.
    unassigned_px
        Middles (k, 2) of boards in no mirror of the layout.
    grids
        Checkerboards, or parts of them, each with the mirror that shows it, whether it could be numbered or not; none
        where all of them could.

    Raises
    ------
    ValueError
        Where a middle is not finite, or not two numbers.
    """

    corners: Observations
    unassigned_px: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    grids: tuple[tuple[int, SeenGrid], ...] = ()

    def __post_init__(self) -> None:
        middles = np.array(self.unassigned_px, dtype=np.float64)
        if middles.ndim != 2 or middles.shape[1] != 2 or not np.isfinite(middles).all():
            raise ValueError(f"unassigned_px has shape {middles.shape}, expected (k, 2) of finite numbers")
        middles.flags.writeable = False
        object.__setattr__(self, "unassigned_px", middles)
