"""Detections: the visible part of a board, its possible numberings, and all detections of a frame."""

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
    """Visible corners of a checkerboard, which may be any part of it.

    Attributes
    ----------
    places
        Integer coordinates (n, 2) on a separate grid, as from `corner_grids`: the axes have the handedness of the
        picture's x and y, and a corner with an even sum has white at its lower right.
    corners
        The corners (n,) in the picture, with ids numbering them in this order.
    limits
        Lowest and highest coordinates (2, 2), in rows, of corners at the board's visible ends; infinite where an end is
        not visible.
    """

    places: IntArray
    corners: Corners
    limits: FloatArray

    def __len__(self) -> int:
        return len(self.places)

    @property
    def extent(self) -> tuple[int, int]:
        """Number of corners along each axis."""
        across, down = np.ptp(self.places, axis=0) + 1
        return int(across), int(down)

    @property
    def as_printed(self) -> SeenGrid:
        """The grid of a mirrored board as on the print: with the print's handedness and colours."""
        return replace(self, places=self.places @ FLIP + RIGHT, limits=_rotated_limits(self.limits, FLIP) + RIGHT)

    def moved(self, turn: int, shift: IntArray) -> SeenGrid:
        """Rotate the coordinates by quarter turns, then add a shift (2,); turn and shift must have an even sum."""
        matrix = TURNS[turn]
        return replace(self, places=self.places @ matrix.T + shift, limits=_rotated_limits(self.limits, matrix) + shift)

    def where(self, mask: NDArray[np.bool_]) -> SeenGrid:
        """Select the corners of a mask (n,)."""
        corners = self.corners.where(mask)
        return replace(self, places=self.places[mask], corners=replace(corners, ids=np.arange(len(corners))))

    def numberings(self, target: Checkerboard, *, mirrored: bool) -> list[Corners]:
        """Return all numberings as the target's corners that match its colours, extent and ends.

        Parameters
        ----------
        target
            The board.
        mirrored
            Whether the board is seen in a mirror.

        Returns
        -------
        list of Corners
            One or two for a board of known full extent; none if it does not fit the target.
        """
        if mirrored:
            return self.as_printed.numberings(target, mirrored=False)
        last = np.array([target.cols - 2, target.rows - 2])
        found = []
        for turn in range(4):
            for shift in _shifts(self.moved(turn, np.zeros(2, dtype=np.int64)), last):
                # On the print, black is right of and below corners with an even sum.
                if (shift.sum() + turn) % 2 == 1:
                    col, row = self.moved(turn, shift).places.T
                    found.append(replace(self.corners, ids=(row * (last[0] + 1) + col).astype(np.int64)))
        return found

    @classmethod
    def join(cls, grids: Sequence[SeenGrid]) -> SeenGrid:
        """Join grids of one board with common coordinates; an end that another grid passes is dropped."""
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
    """Return the shifts (2,) that move a grid into the range from 0 to `last`, with its limits on the ends."""
    first, final = -grid.places.min(axis=0), last - grid.places.max(axis=0)
    for axis in range(2):
        for limit, end in zip(grid.limits[:, axis], (0, last[axis]), strict=True):
            if np.isfinite(limit):
                first[axis], final[axis] = max(first[axis], end - int(limit)), min(final[axis], end - int(limit))
    return [
        np.array([right, down]) for right in range(first[0], final[0] + 1) for down in range(first[1], final[1] + 1)
    ]


def _rotated_limits(limits: FloatArray, matrix: IntArray) -> FloatArray:
    """Limits (2, 2) after a rotation or flip of the coordinates."""
    turned = np.empty_like(limits)
    for axis in range(2):
        source = int(np.flatnonzero(matrix[axis])[0])
        turned[:, axis] = np.sort(matrix[axis, source] * limits[:, source])
    return turned


@dataclass(frozen=True)
class DetectedFrame:
    """Corners in the views of one picture, and stray boards.

    Attributes
    ----------
    corners
        The corners, numbered as frame 0.
    unassigned_px
        Centroids (k, 2) of boards that no mirror of the layout explains, px.
    grids
        Checkerboards, or parts of them, with the index of the mirror that shows each, numbered or not; empty if all
        could be numbered.

    Raises
    ------
    ValueError
        If `unassigned_px` does not hold pairs of finite numbers.
    """

    corners: Observations
    unassigned_px: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    grids: tuple[tuple[int, SeenGrid], ...] = ()

    def __post_init__(self) -> None:
        centroids = np.array(self.unassigned_px, dtype=np.float64)
        if centroids.ndim != 2 or centroids.shape[1] != 2 or not np.isfinite(centroids).all():
            raise ValueError(f"unassigned_px has shape {centroids.shape}, expected (k, 2) of finite numbers")
        centroids.flags.writeable = False
        object.__setattr__(self, "unassigned_px", centroids)
