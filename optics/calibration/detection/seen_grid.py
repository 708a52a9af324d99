"""The part of a checkerboard that a picture shows, and which of the board's corners it may be."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.calibration.solver.observations import Corners, IntArray
from mirrorcam.optics.geometry.targets import Checkerboard

TURNS = tuple(np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), turn) for turn in range(4))
FLIP = np.array([[-1, 0], [0, 1]])


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
    ends
        Whether the board is seen to end one square beyond the lowest and the highest coordinate (2,) of each axis: row
        0 is of the lowest ones.
    """

    places: IntArray
    corners: Corners
    ends: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.places)

    @property
    def extent(self) -> tuple[int, int]:
        """Numbers of corners along both axes."""
        across, down = np.ptp(self.places, axis=0) + 1
        return int(across), int(down)

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
        count = np.array([target.cols - 1, target.rows - 1])
        white_after = (self.places.sum(axis=1) % 2 == 0) ^ mirrored
        found = []
        for number, turn in enumerate(TURNS):
            matrix = turn @ FLIP if mirrored else turn
            places, ends = self.places @ matrix.T, _turned(self.ends, matrix)
            first, last = -places.min(axis=0), count - 1 - places.max(axis=0)
            first, last = (
                np.where(ends[1], np.maximum(first, last), first),
                np.where(ends[0], np.minimum(first, last), last),
            )
            for right in range(first[0], last[0] + 1):
                for down in range(first[1], last[1] + 1):
                    col, row = (places + np.array([right, down])).T
                    if (((col + row) % 2 == 1) == (white_after ^ (number % 2 == 1))).all():
                        found.append(replace(self.corners, ids=(row * count[0] + col).astype(np.int64)))
        return found


def _turned(ends: NDArray[np.bool_], matrix: IntArray) -> NDArray[np.bool_]:
    """Ends (2, 2) after a turn of the grid."""
    turned = np.empty_like(ends)
    for side, sign in enumerate((-1, 1)):
        for axis in range(2):
            to = matrix[:, axis] * sign
            onto = int(np.flatnonzero(to)[0])
            turned[int(to[onto] > 0), onto] = ends[side, axis]
    return turned
