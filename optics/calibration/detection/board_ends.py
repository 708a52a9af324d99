"""Where a checkerboard is seen to end: its outermost squares border on white paper.

What hides a board, or cuts it off, hardly ever does so along a line of the grid, one square beyond the last corners,
and is hardly ever as bright as the paper: at the board's end black squares end in white where they should, and white
ones go on in white.
"""

from __future__ import annotations

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import Image, sample
from mirrorcam.optics.calibration.detection.board_warp import Warp
from mirrorcam.optics.calibration.detection.seen_grid import NO_LIMITS
from mirrorcam.optics.calibration.solver.observations import IntArray

INSIDE, OUTSIDE = (0.5, 0.7, 0.8), (1.2, 1.3)  # squares from the last corners, where a square and the paper are sampled
ACROSS = (-0.2, 0.0, 0.2)  # squares from the middle of a square, along the end
MAX_OFF = 0.3  # of the contrast between white and black
MIN_SQUARES = 2  # of each colour
MIN_AGREEING = 0.8  # of the squares of each colour


def board_ends(picture: Image, places: IntArray, pixels: FloatArray) -> FloatArray:
    """Coordinates (2, 2) of the corners where a board is seen to end, as `SeenGrid.limits`.

    Parameters
    ----------
    picture
        Grey values (h, w).
    places, pixels
        The corners on their grid (n, 2), as of `corner_grids`, and in the picture (n, 2).
    """
    warp = Warp.through(places.astype(np.float64), pixels)
    limits = NO_LIMITS.copy()
    if warp is None:
        return limits
    for axis in range(2):
        for side, sign in enumerate((-1, 1)):
            last = (places[:, axis] * sign).max() * sign
            along = np.sort(places[places[:, axis] == last, 1 - axis])
            squares = along[:-1][np.diff(along) == 1] + 0.5
            if len(squares) >= 2 * MIN_SQUARES and _ends(picture, warp, axis, int(last), sign, squares):
                limits[side, axis] = last
    return limits


def _ends(picture: Image, warp: Warp, axis: int, last: int, sign: int, squares: FloatArray) -> bool:
    """Whether squares with middles (n,) along a side of the grid are the last ones."""

    def values(beyond: tuple[float, ...]) -> FloatArray:
        """Grey values (n, b, a) of each square at distances from the last corners; NaN beyond the picture."""
        out, along = np.meshgrid(last + sign * np.array(beyond), np.array(ACROSS), indexing="ij")
        at = np.empty((len(squares), *out.shape, 2))
        at[..., axis], at[..., 1 - axis] = out, squares[:, None, None] + along
        pixels = warp.at(at.reshape(-1, 2))
        within = np.asarray(((pixels >= 0.0) & (pixels <= np.array(picture.shape[::-1]) - 1.0)).all(axis=1))
        seen = sample(picture, np.where(within[:, None], pixels, 0.0)[None])[0]
        return np.where(within, seen, np.nan).reshape(at.shape[:-1])

    # The square between corners a and a + 1 along x and y is white where a has an even sum.
    corner = np.floor(squares).astype(np.int64) + (last if sign > 0 else last - 1)
    white = np.asarray(corner % 2 == 0)
    if min(white.sum(), (~white).sum()) < MIN_SQUARES:
        return False
    inside, outside = values(INSIDE), values(OUTSIDE)
    paper, ink = np.median(inside[white]), np.median(inside[~white])
    off = MAX_OFF * (paper - ink)
    if not off > 0.0:
        return False
    good = np.asarray((np.abs(outside - paper) < off).all(axis=(1, 2)))
    good &= (np.abs(inside - np.where(white, paper, ink)[:, None, None]) < off).all(axis=(1, 2))
    return bool(min(good[white].mean(), good[~white].mean()) >= MIN_AGREEING)
