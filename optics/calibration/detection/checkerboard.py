"""Detection of plain checkerboards in a picture: boards or parts of them, their edges, and confirmed predictions.

A board's edge is recognised by the white paper around it: beyond it, where black and white squares would continue, all
is white. An obstacle hardly ever ends along a grid line one square beyond the last corners, and is hardly ever as
bright as the paper.

Under a distortion too strong for corners to link into grids, OpenCV finds completely visible boards: it links squares,
which bend less than rows of corners.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import Image, sample
from mirrorcam.optics.calibration.detection.board_growing import MAX_EXTRAPOLATION, BoolArray, connected, grow_grid
from mirrorcam.optics.calibration.detection.board_warp import BoardWarp, typical_cell_px
from mirrorcam.optics.calibration.detection.corner_grids import corner_grids, saddle_points
from mirrorcam.optics.calibration.detection.detections import NO_LIMITS, DetectedGrid
from mirrorcam.optics.calibration.solver.observations import MIN_CORNERS, Corners, IntArray
from mirrorcam.optics.geometry.boards import Checkerboard

Grey = NDArray[np.uint8]
CHECKERBOARD_WINDOW = 0.4
COMPLETE_WINDOW, MAX_REFINEMENT = 0.2, 0.1  # under strong distortion: half-window and largest shift, in cells
MAX_COMPLETE = 8  # boards that OpenCV searches in a picture
MIN_KEPT = 0.85  # of the linked corners, on a board without strong distortion
MIN_SPREAD = 0.3  # rms distance from the line through the corners, in cells; for two rows it is 0.5
MIN_RELATIVE_CONTRAST = 0.6  # of an unoccluded corner, relative to the board's contrast
# Sample points, in cells from a corner, in the squares at its lower right and upper left.
SQUARE_SAMPLES = [(sign * x, sign * y) for sign in (-1, 1) for x, y in ((0.3, 0.3), (0.4, 0.15), (0.15, 0.4))]
SAME_CORNER = 0.3  # maximum distance between two detections of one corner, in cells
SAME_BOARD = 2  # squares within which corners certainly belong to one board
MAX_ROUNDS = 20
MAX_DEVIATION = 0.25  # of a linked corner from the smooth surface through the others, in cells
INSIDE, OUTSIDE = (
    (0.5, 0.7, 0.8),
    (1.2, 1.3),
)  # samples of the last square and of the paper, in squares from the last corners
EDGE_SAMPLES = (-0.2, 0.0, 0.2)  # in squares from a square's centre, along the board's edge
MAX_GREY_ERROR = 0.3  # relative to the contrast between white and black
MIN_SQUARES = 2  # number of each colour
MIN_AGREEING = 0.8  # fraction of the squares of each colour
FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_FAST_CHECK


def cell_px(pixels: FloatArray) -> FloatArray:
    """Distance (n,) from each corner (n, 2) to its nearest neighbour: the short side of the cell there, px."""
    distances, _ = cKDTree(pixels).query(pixels, k=2)
    return np.asarray(distances[:, 1])


def refine_saddles(grey: Grey, pixels: FloatArray, cells_px: FloatArray, window: float) -> FloatArray:
    """Refine corners (n, 2) by their gradients, with half-windows of `window` times their cells (n,), px."""
    half = np.clip((window * cells_px).astype(np.int64), 2, 20)
    refined = np.empty_like(pixels)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    for size in np.unique(half):
        rows = half == size
        seeds = np.ascontiguousarray(pixels[rows, None], dtype=np.float32)
        refined[rows] = cv2.cornerSubPix(grey, seeds, (int(size), int(size)), (-1, -1), criteria)[:, 0]
    return refined


def non_collinear(corners: Corners) -> Corners:
    """Return the corners, or none if they are too few or too collinear to determine a pose."""
    if len(corners) >= MIN_CORNERS:
        width = np.linalg.svd(corners.pixels - corners.pixels.mean(axis=0), compute_uv=False)[1]
        if width / np.sqrt(len(corners)) > MIN_SPREAD * np.median(cell_px(corners.pixels)):
            return corners
    return Corners.empty()


def find_checkerboards(grey: Grey, board: Checkerboard) -> list[DetectedGrid]:
    """Find all checkerboards in a picture (h, w) that may be the one of `board` or a part of it, the largest first.

    Grids of saddle points start the search; comparison with the print then decides which corners are visible. Where
    linked corners do not fit a smooth print, or none are linked, as with a fisheye lens, OpenCV searches for completely
    visible boards by their squares.
    """
    picture = np.asarray(grey, dtype=np.float32)
    max_side = max(board.cols, board.rows)
    grids: list[DetectedGrid] = []
    all_fit = True
    for linked_xy, pixels in linked_grids(grey):
        detected = [grid.corners for grid in grids]
        if not has_new_corners(pixels, detected):
            continue
        grid_xy, corners = grow_grid(picture, linked_xy, pixels, margin=max_side)
        all_fit &= len(corners) >= MIN_KEPT * len(linked_xy)
        if has_new_corners(corners.pixels, detected):
            grids.append(DetectedGrid(grid_xy, corners, board_limits(picture, grid_xy, corners.pixels)))
    if not grids or not all_fit:
        detected = [grid.corners for grid in grids]
        complete = [found for found in complete_boards(grey, board) if has_new_corners(found.corners.pixels, detected)]
        corners_in_complete = [found.corners for found in complete]
        grids = complete + [grid for grid in grids if has_new_corners(grid.corners.pixels, corners_in_complete)]
    return sorted(grids, key=lambda grid: -len(grid))


def linked_grids(grey: Grey) -> list[tuple[IntArray, FloatArray]]:
    """Return coordinates (n, 2) of corners on separate grids, as from `corner_grids`, and approximate pixels (n, 2)."""
    points = saddle_points(grey)
    return [
        (grid_xy[part], points.pixels[members[part]])
        for members, grid_xy in corner_grids(points)
        for part in smooth_parts(grid_xy.astype(np.float64), points.pixels[members])
    ]


def has_new_corners(pixels: FloatArray, detected: Sequence[Corners]) -> bool:
    """Return whether corners (n, 2) include enough new ones for another board besides those already found."""
    if len(pixels) < MIN_CORNERS or not detected:
        return len(pixels) >= MIN_CORNERS
    distances, _ = cKDTree(np.concatenate([corners.pixels for corners in detected])).query(pixels)
    return bool((distances > SAME_CORNER * np.median(cell_px(pixels))).sum() >= MIN_CORNERS)


def smooth_parts(grid_xy: FloatArray, pixels: FloatArray, step: float = 1.0) -> list[IntArray]:
    """Split linked corners (n) into boards, because two adjacent mirrors may seem to show one continuous board.

    Adjacent corners are at most `step` squares apart.
    """
    parts = []
    remaining = np.arange(len(grid_xy))
    while len(remaining) >= MIN_CORNERS:
        remaining_xy, remaining_pixels = grid_xy[remaining], pixels[remaining]
        part = _smooth_around(remaining_xy, remaining_pixels, np.ones(len(remaining), dtype=bool), step)
        if not part.all():
            near = np.abs(remaining_xy[:, None] - remaining_xy).max(axis=2) <= SAME_BOARD
            part = _smooth_around(remaining_xy, remaining_pixels, near[near.sum(axis=1).argmax()], step)
        if part.sum() < MIN_CORNERS:
            break
        parts.append(remaining[part])
        remaining = remaining[~part]
    return parts


def _smooth_around(grid_xy: FloatArray, pixels: FloatArray, seeds: BoolArray, step: float) -> BoolArray:
    """Mask (n,) of the corners connected with the mask `seeds` (n,) on the smooth surface grown from them."""
    part = seeds
    for _ in range(MAX_ROUNDS):
        warp = BoardWarp.fit(grid_xy[part], pixels[part])
        if warp is None:
            return np.zeros(len(grid_xy), dtype=bool)
        deviation = np.linalg.norm(warp.map(grid_xy) - pixels, axis=1)
        near = cKDTree(grid_xy[part]).query(grid_xy)[0] < MAX_EXTRAPOLATION * step
        grown = near & (deviation < MAX_DEVIATION * typical_cell_px(grid_xy[part], pixels[part]))
        grown[grown] = connected(grid_xy[grown], step) if grown.any() else False
        if (grown == part).all():
            break
        part = grown
        if not part.any():
            break
    return part


def _interpolated(grey: Grey, pixels: FloatArray) -> FloatArray:
    """Grey values (n,) at pixels (n, 2), interpolated bilinearly; pixels outside are moved to the border."""
    coordinates = np.clip(pixels.T[::-1], 0, np.array(grey.shape)[:, None] - 1)
    return np.asarray(map_coordinates(grey, coordinates, output=np.float64, order=1))


def confirm(grey: Grey, predicted: FloatArray, board: Checkerboard, *, max_shift: float = 0.35) -> Corners:
    """Confirm the corners of a plain checkerboard near their predictions.

    A corner is confirmed if its refined position is near the prediction and its four squares are black and white as
    printed, with most of the board's contrast. A hand or a mirror's edge in front of the corner fails this test.

    Parameters
    ----------
    grey
        Picture (h, w).
    predicted
        Predicted pixels (n, 2) of all corners, ordered by id.
    board
        The board.
    max_shift
        Maximum distance from the prediction, in cells.
    """
    rows, cols = board.rows - 1, board.cols - 1
    cells = cell_px(predicted)
    height, width = grey.shape
    margin = np.maximum(cells, 3.0)
    inside = ((predicted > margin[:, None]) & (predicted < np.array([width, height]) - 1 - margin[:, None])).all(axis=1)
    if inside.sum() < MIN_CORNERS:
        return Corners.empty()
    ids = np.flatnonzero(inside)
    refined = refine_saddles(grey, predicted[inside], cells[inside], CHECKERBOARD_WINDOW)
    near = np.linalg.norm(refined - predicted[inside], axis=1) < max_shift * cells[inside]

    grid = predicted.reshape(rows, cols, 2)
    right, down = (np.asarray(np.gradient(grid, axis=axis)).reshape(-1, 2)[ids] for axis in (1, 0))
    # Corner (r, c) has square (r, c) at its upper left, black if r + c is even (white if inverted), and the same colour
    # at its lower right.
    black_first = (ids // cols + ids % cols) % 2 == board.inverted
    first, second = (
        np.array([_interpolated(grey, refined + x * right + sign * y * down) for x, y in SQUARE_SAMPLES])
        for sign in (1, -1)
    )
    black, white = np.where(black_first, (first, second), (second, first))
    contrast = white.min(axis=0) - black.max(axis=0)
    typical = np.median(contrast[near]) if near.any() else 0.0
    confirmed = near & (contrast > max(MIN_RELATIVE_CONTRAST * typical, 8.0))
    return Corners(ids[confirmed].astype(np.int64), refined[confirmed])


def board_limits(picture: Image, grid_xy: IntArray, pixels: FloatArray) -> FloatArray:
    """Return the coordinates (2, 2) of the corners at a board's visible edges, as `DetectedGrid.limits`.

    Parameters
    ----------
    picture
        Grey values (h, w).
    grid_xy, pixels
        The corners' grid coordinates (n, 2), as from `corner_grids`, and pixels (n, 2).
    """
    warp = BoardWarp.fit(grid_xy.astype(np.float64), pixels)
    limits = NO_LIMITS.copy()
    if warp is None:
        return limits
    for axis in range(2):
        for side, sign in enumerate((-1, 1)):
            last = (grid_xy[:, axis] * sign).max() * sign
            positions = np.sort(grid_xy[grid_xy[:, axis] == last, 1 - axis])
            squares = positions[:-1][np.diff(positions) == 1] + 0.5
            if len(squares) >= 2 * MIN_SQUARES and _is_board_edge(picture, warp, axis, int(last), sign, squares):
                limits[side, axis] = last
    return limits


def _is_board_edge(picture: Image, warp: BoardWarp, axis: int, last: int, sign: int, squares: FloatArray) -> bool:
    """Return whether the squares with centres (n,) along a side of the grid are the board's last ones."""

    def values(distances: tuple[float, ...]) -> FloatArray:
        """Grey values (n, b, a) of each square at distances from the last corners; NaN off the picture."""
        normal, tangential = np.meshgrid(last + sign * np.array(distances), np.array(EDGE_SAMPLES), indexing="ij")
        points = np.empty((len(squares), *normal.shape, 2))
        points[..., axis], points[..., 1 - axis] = normal, squares[:, None, None] + tangential
        pixels = warp.map(points.reshape(-1, 2))
        within = np.asarray(((pixels >= 0.0) & (pixels <= np.array(picture.shape[::-1]) - 1.0)).all(axis=1))
        greys = sample(picture, np.where(within[:, None], pixels, 0.0)[None])[0]
        return np.where(within, greys, np.nan).reshape(points.shape[:-1])

    # The square at the lower right of a corner is white if the corner's coordinates have an even sum.
    corner = np.floor(squares).astype(np.int64) + (last if sign > 0 else last - 1)
    white = np.asarray(corner % 2 == 0)
    if min(white.sum(), (~white).sum()) < MIN_SQUARES:
        return False
    inside, outside = values(INSIDE), values(OUTSIDE)
    white_grey, black_grey = np.median(inside[white]), np.median(inside[~white])
    max_error = MAX_GREY_ERROR * (white_grey - black_grey)
    if not max_error > 0.0:
        return False
    agreeing = np.asarray((np.abs(outside - white_grey) < max_error).all(axis=(1, 2)))
    agreeing &= (np.abs(inside - np.where(white, white_grey, black_grey)[:, None, None]) < max_error).all(axis=(1, 2))
    return bool(min(agreeing[white].mean(), agreeing[~white].mean()) >= MIN_AGREEING)


def complete_boards(grey: Grey, board: Checkerboard) -> list[DetectedGrid]:
    """Return the completely visible boards of the size of `board` in a picture (h, w), under any distortion."""
    remaining = grey.copy()
    boards: list[DetectedGrid] = []
    while len(boards) < MAX_COMPLETE and (complete := complete_board(remaining, board)):
        grid_xy, pixels = complete
        cells = cell_px(pixels)
        refined = refine_saddles(grey, pixels, cells, COMPLETE_WINDOW)
        stable = np.linalg.norm(refined - pixels, axis=1) < MAX_REFINEMENT * cells
        corners = Corners(np.arange(len(grid_xy)), np.where(stable[:, None], refined, pixels))
        boards.append(DetectedGrid(grid_xy, corners, NO_LIMITS))
        cv2.fillConvexPoly(remaining, cv2.convexHull(np.rint(pixels).astype(np.int32)), int(np.median(grey)))
    return boards


def complete_board(grey: NDArray[np.uint8], board: Checkerboard) -> tuple[IntArray, FloatArray] | None:
    """Return grid coordinates (n, 2), as from `corner_grids`, and pixels (n, 2) of a complete board's corners.

    None if the picture (h, w) shows no complete board of the size of `board`.
    """
    cols, rows = board.corner_counts
    found, corners = cv2.findChessboardCorners(grey, (cols, rows), flags=FLAGS)
    if not found:
        return None
    pixels = np.asarray(corners, dtype=np.float64).reshape(rows, cols, 2)
    directions = [np.diff(pixels, axis=axis).reshape(-1, 2).sum(axis=0) for axis in (1, 0)]
    if np.linalg.det(np.array(directions)) < 0.0:
        pixels = pixels[:, ::-1]
    y, x = np.indices(pixels.shape[:2])
    # A corner with an even coordinate sum has white at its lower right.
    centres = (pixels[:-1, :-1] + pixels[1:, :-1] + pixels[:-1, 1:] + pixels[1:, 1:]) / 4.0
    bright = sample(np.asarray(grey, dtype=np.float32), centres.reshape(1, -1, 2))[0]
    even = ((x + y) % 2 == 0)[:-1, :-1].ravel()
    if bright[even].mean() < bright[~even].mean():
        x = x + 1
    return np.stack([x.ravel(), y.ravel()], axis=1).astype(np.int64), pixels.reshape(-1, 2)
