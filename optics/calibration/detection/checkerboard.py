"""Plain checkerboards in one image: detect whole boards, number their corners, confirm predicted corners.

`findChessboardCornersSB` alone has errors of 0.01 to 0.4 px, depending on the size of the cells, so it only gives the
start: every corner is refined by `cv2.cornerSubPix` with a window scaled to the local cell, and in frames of a mirror
camera by comparison with the print (`corner_refinement`).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.solver.observations import MIN_CORNERS, Corners
from mirrorcam.optics.geometry.targets import Checkerboard

Grey = NDArray[np.uint8]

CHECKERBOARD_WINDOW = 0.4
MIN_SPREAD = 0.3  # rms distance from the line through the corners, in cells; two rows have 0.5
SAME_CONTRAST = 0.6  # of the board's own contrast, for a corner to count as not covered
# Where the square at a corner's lower right and that at its upper left are sampled, in cells.
AROUND = [(sign * x, sign * y) for sign in (-1, 1) for x, y in ((0.3, 0.3), (0.4, 0.15), (0.15, 0.4))]
FINDER = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE


def cell_px(pixels: FloatArray) -> FloatArray:
    """Distance (n,) from each of the pixels (n, 2) to its nearest neighbour: the short side of a cell there."""
    distances, _ = cKDTree(pixels).query(pixels, k=2)
    return np.asarray(distances[:, 1])


def refine(grey: Grey, pixels: FloatArray, cells_px: FloatArray, window: float) -> FloatArray:
    """Refine corners (n, 2) by their gradients, each in a half-window of `window` times its own cell (n,) px."""
    half = np.clip((window * cells_px).astype(np.int64), 2, 20)
    refined = np.empty_like(pixels)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    for size in np.unique(half):
        rows = half == size
        seeds = np.ascontiguousarray(pixels[rows, None], dtype=np.float32)
        refined[rows] = cv2.cornerSubPix(grey, seeds, (int(size), int(size)), (-1, -1), criteria)[:, 0]
    return refined


def spread_out(corners: Corners) -> Corners:
    """The corners, or none where they are few or all near one line and so do not determine a pose."""
    if len(corners) >= MIN_CORNERS:
        across = np.linalg.svd(corners.pixels - corners.pixels.mean(axis=0), compute_uv=False)[1]
        if across / np.sqrt(len(corners)) > MIN_SPREAD * np.median(cell_px(corners.pixels)):
            return corners
    return corners.where(np.zeros(len(corners), dtype=bool))


def find_checkerboards(grey: Grey, target: Checkerboard, *, most: int) -> list[FloatArray]:
    """Find up to `most` whole checkerboards, each as its inner corners (rows-1, cols-1, 2) in some order of the grid.

    OpenCV's detector returns one board at a time and misses small ones in a large picture, so detected boards are
    painted over and the search continues, in the whole picture and then in overlapping tiles.
    """
    work = grey.copy()
    paint = int(np.median(grey))
    shape = (target.cols - 1, target.rows - 1)
    boards: list[FloatArray] = []
    height, width = grey.shape
    for parts in (1, 2):
        tile_w, tile_h = -(-2 * width // (parts + 1)), -(-2 * height // (parts + 1))
        for row in range(parts):
            for col in range(parts):
                x, y = col * (width - tile_w) // max(parts - 1, 1), row * (height - tile_h) // max(parts - 1, 1)
                while len(boards) < most:
                    tile = np.ascontiguousarray(work[y : y + tile_h, x : x + tile_w])
                    found, pixels = cv2.findChessboardCornersSB(tile, shape, flags=FINDER)
                    if not found:
                        break
                    seeds = np.asarray(pixels, dtype=np.float64).reshape(-1, 2) + np.array([x, y])
                    cv2.fillConvexPoly(work, cv2.convexHull(np.rint(seeds).astype(np.int32)), paint)
                    if (seeds < 0.0).any() or (seeds > [width - 1.0, height - 1.0]).any():
                        continue  # completed beyond the picture, which shows only part of it
                    refined = refine(grey, seeds, cell_px(seeds), CHECKERBOARD_WINDOW)
                    boards.append(refined.reshape(target.rows - 1, target.cols - 1, 2))
    return boards


def orderings(grey: Grey, board: FloatArray, target: Checkerboard, *, mirrored: bool) -> list[FloatArray]:
    """The numberings of a board (rows-1, cols-1, 2) that match its handedness and its black and white squares.

    Each is (n, 2) in the order of the target's corner ids. There is one for a target that looks different upside down,
    otherwise two.
    """
    grids = [board, board[::-1, ::-1], board[::-1], board[:, ::-1]]
    if target.rows == target.cols:
        grids += [np.swapaxes(grid, 0, 1) for grid in grids]
    fitting = []
    for grid in grids:
        across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        if (across[0] * down[1] - across[1] * down[0] < 0) == mirrored and _colour_contrast(grey, grid) > 0:
            fitting.append(np.ascontiguousarray(grid.reshape(-1, 2)))
    return fitting


def _colour_contrast(grey: Grey, grid: FloatArray) -> float:
    """Mean grey level of the squares that should be white, less that of those that should be black."""
    centres = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4.0
    values = _sample(grey, centres.reshape(-1, 2)).reshape(centres.shape[:2])
    # Inner square (r, c) lies one down and one right of the target's black top-left square, so it is black when r + c
    # is even.
    row, col = np.indices(values.shape)
    black = (row + col) % 2 == 0
    return float(values[~black].mean() - values[black].mean())


def _sample(grey: Grey, pixels: FloatArray) -> FloatArray:
    at = np.clip(pixels.T[::-1], 0, np.array(grey.shape)[:, None] - 1)
    return np.asarray(map_coordinates(grey, at, output=np.float64, order=1))


def confirm(grey: Grey, predicted: FloatArray, target: Checkerboard, *, max_shift: float = 0.35) -> Corners:
    """Confirm the corners of a plain checkerboard near their predictions.

    A corner is confirmed where its refined position is near the prediction and its four squares are black and white as
    printed, with most of the contrast of the board as a whole: a hand or a mirror's edge in front of it fails this.

    Parameters
    ----------
    grey
        Picture (h, w).
    predicted
        Predicted pixels (n, 2) of all corners, in the order of ids.
    target
        The board.
    max_shift
        Largest distance from the prediction, in cells.
    """
    rows, cols = target.rows - 1, target.cols - 1
    cells = cell_px(predicted)
    height, width = grey.shape
    margin = np.maximum(cells, 3.0)
    inside = ((predicted > margin[:, None]) & (predicted < np.array([width, height]) - 1 - margin[:, None])).all(axis=1)
    if inside.sum() < MIN_CORNERS:
        return Corners(np.empty(0, dtype=np.int64), np.empty((0, 2)))
    ids = np.flatnonzero(inside)
    refined = refine(grey, predicted[inside], cells[inside], CHECKERBOARD_WINDOW)
    near = np.linalg.norm(refined - predicted[inside], axis=1) < max_shift * cells[inside]

    grid = predicted.reshape(rows, cols, 2)
    across, down = (np.asarray(np.gradient(grid, axis=axis)).reshape(-1, 2)[ids] for axis in (1, 0))
    # Corner (r, c) has square (r, c) at its upper left, black when r + c is even, and the same at its lower right.
    black_first = (ids // cols + ids % cols) % 2 == 0
    first, second = (
        np.array([_sample(grey, refined + x * across + sign * y * down) for x, y in AROUND]) for sign in (1, -1)
    )
    black, white = np.where(black_first, (first, second), (second, first))
    contrast = white.min(axis=0) - black.max(axis=0)
    typical = np.median(contrast[near]) if near.any() else 0.0
    good = near & (contrast > max(SAME_CONTRAST * typical, 8.0))
    return Corners(ids[good].astype(np.int64), refined[good])
