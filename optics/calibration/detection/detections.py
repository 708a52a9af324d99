"""Detections: the visible part of a board, its possible numberings, and all detections of a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.observations import Corners, IntArray, Observations
from mirrorcam.optics.geometry.boards import Checkerboard

QUARTER_ROTATIONS = tuple(np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), turn) for turn in range(4))
NO_LIMITS = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
FLIP, RIGHT = np.array([[-1, 0], [0, 1]]), np.array([1, 0])


@dataclass(frozen=True)
class DetectedGrid:
    """Detected corners of a checkerboard, which may be any part of it.

    Attributes
    ----------
    grid_xy
        Integer coordinates (n, 2) on a separate grid, as from `corner_grids`: the axes have the handedness of the
        picture's x and y, and a corner with an even coordinate sum has white at its lower right.
    corners
        The corners (n,) in the picture, with ids numbering them in this order.
    limits
        Coordinates of the corners at the board's visible edges (2, 2; rows: lowest, highest); infinite where an edge is
        not visible.
    """

    grid_xy: IntArray
    corners: Corners
    limits: FloatArray

    def __len__(self) -> int:
        return len(self.grid_xy)

    @property
    def extent(self) -> tuple[int, int]:
        """Number of corners along each axis."""
        cols, rows = np.ptp(self.grid_xy, axis=0) + 1
        return int(cols), int(rows)

    @property
    def as_printed(self) -> DetectedGrid:
        """The grid of a mirrored board as on the print: with the print's handedness and colours."""
        return replace(self, grid_xy=self.grid_xy @ FLIP + RIGHT, limits=_rotated_limits(self.limits, FLIP) + RIGHT)

    def transformed(self, turn: int, shift: IntArray) -> DetectedGrid:
        """Rotate the coordinates by quarter turns, then add a shift (2,); the sum of turn and shift must be even."""
        matrix = QUARTER_ROTATIONS[turn]
        return replace(
            self, grid_xy=self.grid_xy @ matrix.T + shift, limits=_rotated_limits(self.limits, matrix) + shift
        )

    def where(self, mask: NDArray[np.bool_]) -> DetectedGrid:
        """Select the corners of a mask (n,)."""
        corners = self.corners.where(mask)
        return replace(self, grid_xy=self.grid_xy[mask], corners=replace(corners, ids=np.arange(len(corners))))

    def numberings(self, board: Checkerboard, *, mirrored: bool) -> list[Corners]:
        """Return this grid's corners with all ids that are consistent with the board's colours, extent and edges.

        Parameters
        ----------
        board
            The board.
        mirrored
            Whether the board appears in a mirror.

        Returns
        -------
        list of Corners
            One or two for a board of known full extent; none if it does not fit the board.
        """
        if mirrored:
            return self.as_printed.numberings(board, mirrored=False)
        last = np.array([board.cols - 2, board.rows - 2])
        candidates = []
        for turn in range(4):
            for shift in _shifts(self.transformed(turn, np.zeros(2, dtype=np.int64)), last):
                # On the print, the square at the lower right of a corner with an even coordinate sum is black, or white
                # if the print is inverted.
                if (shift.sum() + turn) % 2 != board.inverted:
                    col, row = self.transformed(turn, shift).grid_xy.T
                    candidates.append(replace(self.corners, ids=(row * (last[0] + 1) + col).astype(np.int64)))
        return candidates

    @classmethod
    def join(cls, grids: Sequence[DetectedGrid]) -> DetectedGrid:
        """Join grids of one board with common coordinates; an edge that another grid extends beyond is dropped."""
        grid_xy = np.concatenate([grid.grid_xy for grid in grids])
        corners = Corners(
            np.arange(len(grid_xy)),
            np.concatenate([grid.corners.pixels for grid in grids]),
            np.concatenate([grid.corners.sigma_px for grid in grids]),
        )
        low, high = grid_xy.min(axis=0), grid_xy.max(axis=0)
        lows, highs = np.array([grid.limits for grid in grids]).transpose(1, 0, 2)
        lows, highs = np.where(lows <= low, lows, -np.inf), np.where(highs >= high, highs, np.inf)
        return cls(grid_xy, corners, np.array([lows.max(axis=0), highs.min(axis=0)]))


def _shifts(grid: DetectedGrid, last: IntArray) -> list[IntArray]:
    """Return the shifts (2,) that move a grid into the range from 0 to `last`, and its limits onto the range's ends."""
    first, final = -grid.grid_xy.min(axis=0), last - grid.grid_xy.max(axis=0)
    for axis in range(2):
        for limit, end in zip(grid.limits[:, axis], (0, last[axis]), strict=True):
            if np.isfinite(limit):
                first[axis], final[axis] = max(first[axis], end - int(limit)), min(final[axis], end - int(limit))
    return [
        np.array([right, down]) for right in range(first[0], final[0] + 1) for down in range(first[1], final[1] + 1)
    ]


def _rotated_limits(limits: FloatArray, matrix: IntArray) -> FloatArray:
    """Limits (2, 2) after a rotation or flip of the coordinates."""
    rotated = np.empty_like(limits)
    for axis in range(2):
        source = int(np.flatnonzero(matrix[axis])[0])
        rotated[:, axis] = np.sort(matrix[axis, source] * limits[:, source])
    return rotated


@dataclass(frozen=True)
class DetectedFrame:
    """Corners in the views of one picture, and stray boards.

    Attributes
    ----------
    corners
        The corners, numbered as frame 0.
    unassigned_px
        Centroids (k, 2) of boards that belong to no mirror of the layout, px.
    grids
        Checkerboards or parts of them, numbered or not, each with the index of the mirror that shows it; empty if all
        could be numbered.

    Raises
    ------
    ValueError
        If `unassigned_px` does not hold pairs of finite numbers.
    """

    corners: Observations
    unassigned_px: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    grids: tuple[tuple[int, DetectedGrid], ...] = ()

    def __post_init__(self) -> None:
        centroids = np.array(self.unassigned_px, dtype=np.float64)
        if centroids.ndim != 2 or centroids.shape[1] != 2 or not np.isfinite(centroids).all():
            raise ValueError(f"unassigned_px has shape {centroids.shape}, expected (k, 2) of finite numbers")
        centroids.flags.writeable = False
        object.__setattr__(self, "unassigned_px", centroids)
