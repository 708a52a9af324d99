"""Region growing of a board in a picture, from a few known points to all visible corners."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar, cast

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import LOCAL, MAX_BLUR, Image
from mirrorcam.optics.calibration.detection.board_warp import SEPTIC, BoardWarp, corner_print_xy, typical_cell_px
from mirrorcam.optics.calibration.detection.corner_patches import Appearance, ExpectedCorners
from mirrorcam.optics.calibration.detection.corner_refinement import RefinedCorners, refine
from mirrorcam.optics.calibration.solver.observations import Corners, IntArray
from mirrorcam.optics.geometry.boards import CalibrationBoard

BoolArray = NDArray[np.bool_]
GreyValues = TypeVar("GreyValues", NDArray[np.uint8], Image)

MAX_EXTRAPOLATION = 1.6  # of the warp, in squares beyond the known points
MAX_MOVE = 0.25  # cells between the expected and the refined position of a corner
MAX_ROUNDS = 15
MAX_LINK = 1.1  # distance between adjacent corners, relative to the longest side of a square
MAX_TRIES = 2  # per corner, since its expected position improves once its neighbours are found
MANY_POINTS = 40  # known points that predict positions well enough at the first try
MIN_GROWTH = 0.03  # fraction of the corners that a round must add: smaller growth is often into another mirror's board
NEIGHBOURS = 12
OUTLIER_SIGMAS = 6.0
MIN_OUTLIER_PX = 0.15  # prints are no more exact than this
MIN_STEP_PX, MAX_STEP_PX = 0.2, 1.5  # bounds on the difference between adjacent residuals of the warp
MIN_CORNERS = 8  # to judge the smoothness of a board
MIN_CELL_PX = 5.0
FIRST_BLUR_PX = 1.2  # sigma assumed for the first corners
MIN_CONTRAST = 6.0  # of a corner, in grey levels
MIN_RELATIVE_CONTRAST = 0.6  # relative to neighbouring corners
MIN_EXPLAINED = 0.8  # explained fraction of the variance around a corner
MAX_SIGMA_PX = 0.3
MAX_UNEXPLAINED_RATIO = 0.7  # of the variances unexplained with and without motion blur; below it, there is motion
SAMPLE_CORNERS = 20  # approximate number of corners used to measure blur and to detect motion blur
MIN_BLUR_PX, SHARP_PX = 0.4, 0.75  # sigma of edges: lowest estimate, and below which interpolation does not hold
SOFTENING_PX = 1.0  # sigma of the blur applied to sharp or sharpened pictures
MAX_BLUR_CHANGE, MAX_BLUR_ROUNDS = 1.2, 5  # ratio of two estimates that counts as the same blur; largest number of them
# Limits relative to the board's median: standard deviation, and unexplained variance with an offset.
MAX_RELATIVE_SIGMA, MAX_RELATIVE_UNEXPLAINED, UNEXPLAINED_OFFSET = 2.5, 3.0, 0.01
COLUMN_STEP = np.array([1.0, 0.0])


def grow_board(
    picture: Image, print_xy: FloatArray, pixels: FloatArray, board: CalibrationBoard, *, mirrored: bool
) -> Corners:
    """Find all visible corners of one board, from approximate points on it.

    Corners are searched up to `MAX_EXTRAPOLATION` squares around the known ones, and those found predict the next ones.
    Finally, all are refined with their common warp, and those off the smooth surface through the others are dropped.

    Parameters
    ----------
    picture
        Grey values (h, w).
    print_xy, pixels
        Known points: their coordinates (n, 2) on the print, in squares, and pixels (n, 2).
    board
        The board.
    mirrored
        Whether the board appears in a mirror.

    Returns
    -------
    Corners
        Empty if the points lie on no surface with the expected handedness.
    """
    return _visible_corners(picture, print_xy, pixels, corner_print_xy(board), board, mirrored=mirrored)


def grow_grid(picture: Image, grid_xy: IntArray, pixels: FloatArray, *, margin: int) -> tuple[IntArray, Corners]:
    """Find all visible corners of a checkerboard of unknown size, from some of them.

    Parameters
    ----------
    picture
        Grey values (h, w).
    grid_xy, pixels
        Known corners: integer grid coordinates (n, 2) as from `corner_grids`, and pixels (n, 2).
    margin
        Number of squares to search beyond the known corners.

    Returns
    -------
    grid_xy
        Coordinates (m, 2) of the corners on the same grid.
    corners
        The corners (m,), with ids numbering them in this order.
    """
    # A corner with an even coordinate sum has white at its lower right on the grid, but black on the print.
    shifted = grid_xy + COLUMN_STEP
    low, high = shifted.min(axis=0) - margin, shifted.max(axis=0) + margin
    x, y = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    lattice = np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)
    visible = _visible_corners(picture, shifted, pixels, lattice, LOCAL, mirrored=False)
    return np.rint(lattice[visible.ids] - COLUMN_STEP).astype(np.int64), replace(visible, ids=np.arange(len(visible)))


def _visible_corners(
    picture: Image,
    print_xy: FloatArray,
    pixels: FloatArray,
    corners: FloatArray,
    board: CalibrationBoard,
    *,
    mirrored: bool,
) -> Corners:
    """Return the visible corners among all corners (c, 2) of a print, with their indices as ids."""
    corner_pixels, rough = _grow(picture, print_xy, pixels, corners, board, mirrored=mirrored)
    grown_ids = np.flatnonzero(np.isfinite(corner_pixels[:, 0]))
    ids = grown_ids[on_smooth_surface(corners[grown_ids], corner_pixels[grown_ids], board.longest_step)]
    warp = BoardWarp.fit(corners[ids], corner_pixels[ids])
    if warp is None:
        return Corners.empty()
    expected = warp.expected(corners[ids], corner_pixels[ids])
    typical = expected.where(np.arange(len(ids)) % max(len(ids) // SAMPLE_CORNERS, 1) == 0)
    blur_px = _measured_blur_px(picture, typical, replace(rough, rough=False))
    if blur_px < min(SHARP_PX, rough.blur_px / MAX_BLUR_CHANGE):
        # The rough refinement samples the picture too sparsely: its corners are off by up to a pixel, and not smooth.
        ids, expected = grown_ids, warp.expected(corners[grown_ids], corner_pixels[grown_ids])
        picture = softened(picture)
        rough = replace(rough, blur_px=float(np.hypot(blur_px, SOFTENING_PX)))
    fine = replace(rough, rough=False, motion=_is_blurred_by_motion(picture, typical, rough))
    ids, refined = _confirmed(picture, ids, expected, fine, mirrored=mirrored)
    # Corners of the rough refinement are off by hundredths of a pixel or more: fine ones give a finer warp.
    better = expected_corners(corners[ids], refined.pixels)
    if better is None:
        return Corners.empty()
    ids, refined = _confirmed(picture, ids, better, fine, mirrored=mirrored)
    valid = _similar_contrast(corners[ids], refined.contrast) & _typical_quality(refined)
    detected = Corners(ids.astype(np.int64), refined.pixels, refined.sigma_px).where(valid)
    return detected.where(on_smooth_surface(corners[detected.ids], detected.pixels, board.longest_step))


def _measured_blur_px(picture: Image, typical: ExpectedCorners, appearance: Appearance) -> float:
    """Return the sigma of the blur at typical corners, at least `MIN_BLUR_PX`."""
    for _ in range(MAX_BLUR_ROUNDS):
        blur_px = max(float(np.median(refine(picture, typical, appearance).blur_px)), MIN_BLUR_PX)
        if max(blur_px, appearance.blur_px) < MAX_BLUR_CHANGE * min(blur_px, appearance.blur_px):
            break
        appearance = replace(appearance, blur_px=blur_px)
    return blur_px


def _is_blurred_by_motion(picture: Image, typical: ExpectedCorners, appearance: Appearance) -> bool:
    """Return whether motion blur explains much of the variance that the print leaves unexplained at typical corners.

    Without motion, a model with motion blur would only make partly occluded corners look valid.
    """
    without_motion, with_motion = (
        float(np.median(1.0 - refine(picture, typical, replace(appearance, motion=motion)).explained_variance))
        for motion in (False, True)
    )
    return with_motion < MAX_UNEXPLAINED_RATIO * without_motion


def _grow(
    picture: Image,
    print_xy: FloatArray,
    pixels: FloatArray,
    corners: FloatArray,
    board: CalibrationBoard,
    *,
    mirrored: bool,
) -> tuple[FloatArray, Appearance]:
    """Return pixels (c, 2) of all corners, NaN if not found, and the print's appearance with the estimated blur."""
    corner_pixels = np.full((len(corners), 2), np.nan)
    tries = np.zeros(len(corners), dtype=np.int64)
    known_xy, known_pixels, max_distance = print_xy, pixels, MAX_EXTRAPOLATION * board.longest_step
    appearance = Appearance(board, first_blur_px(print_xy, pixels), motion=False, rough=True)
    max_tries = 1 if len(print_xy) >= MANY_POINTS else MAX_TRIES
    for _ in range(MAX_ROUNDS):
        near = cKDTree(known_xy).query(corners, distance_upper_bound=max_distance)[0] < max_distance
        new = np.flatnonzero(near & (tries < max_tries) & np.isnan(corner_pixels[:, 0]))
        warp = BoardWarp.fit(known_xy, known_pixels) if len(new) else None
        if warp is None:
            break
        tries[new] += 1
        expected = warp.expected(corners[new], warp.map(corners[new]))
        ids, refined = _confirmed(picture, new, expected, appearance, mirrored=mirrored)
        is_first = np.isnan(corner_pixels[:, 0]).all()
        corner_pixels[ids] = refined.pixels
        # The last corners are few, and some are false: they must not change the assumed blur.
        if len(ids) >= (1 if is_first else MIN_CORNERS):
            appearance = replace(appearance, blur_px=float(np.median(refined.blur_px)))
        visible_ids = np.flatnonzero(np.isfinite(corner_pixels[:, 0]))
        if len(ids) < MIN_GROWTH * len(visible_ids):
            break
        if len(visible_ids) >= MIN_CORNERS:
            known_xy, known_pixels = corners[visible_ids], corner_pixels[visible_ids]
    return corner_pixels, appearance


def first_blur_px(print_xy: FloatArray, pixels: FloatArray) -> float:
    """Return the initial blur for points (n, 2) on the print, in squares, at pixels (n, 2)."""
    return min(FIRST_BLUR_PX, MAX_BLUR * typical_cell_px(print_xy, pixels))


def expected_corners(print_xy: FloatArray, pixels: FloatArray) -> ExpectedCorners | None:
    """Return a board's corners (n, 2), in squares and in pixels, with their warp's derivatives; None without a warp."""
    warp = BoardWarp.fit(print_xy, pixels, degree=SEPTIC)
    return None if warp is None else warp.expected(print_xy, pixels)


def softened(picture: GreyValues) -> GreyValues:
    """Blur a picture (h, w) whose edges are too sharp for interpolation, as where a camera sharpens."""
    return cast(GreyValues, cv2.GaussianBlur(picture, (0, 0), SOFTENING_PX))


def _confirmed(
    picture: Image, ids: IntArray, expected: ExpectedCorners, appearance: Appearance, *, mirrored: bool
) -> tuple[IntArray, RefinedCorners]:
    """Return the ids and refined positions of those expected corners (n,) that the picture confirms."""
    size = np.array(picture.shape[::-1], dtype=np.float64)
    detectable = _detectable(expected.pixels, expected.cells, size, mirrored=mirrored)
    ids, expected = ids[detectable], expected.where(detectable)
    refined = refine(picture, expected, appearance)
    shifts = np.linalg.norm(refined.pixels - expected.pixels, axis=1)
    confirmed = (shifts < MAX_MOVE * _short_side(expected.cells)) & (refined.contrast > MIN_CONTRAST)
    confirmed &= (refined.explained_variance > MIN_EXPLAINED) & (refined.sigma_px < MAX_SIGMA_PX)
    return ids[confirmed], refined.where(confirmed)


def same_board(first: Corners, second: Corners) -> bool:
    """Return whether two detections show the same board: most of their common corners are at the same pixels."""
    _, a, b = np.intersect1d(first.ids, second.ids, return_indices=True)
    return len(a) > 0 and bool(np.median(np.linalg.norm(first.pixels[a] - second.pixels[b], axis=1)) < 2.0)


def _short_side(cells: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(cells, axis=1).min(axis=1))


def _detectable(expected: FloatArray, cells: FloatArray, size: FloatArray, *, mirrored: bool) -> BoolArray:
    """Mask of corners (n, 2) well inside the picture whose cells (n, 2, 2) are large enough and not flipped."""
    handedness = np.linalg.det(np.nan_to_num(cells)) * (-1.0 if mirrored else 1.0)
    short_side_px = _short_side(np.nan_to_num(cells))
    margin = np.maximum(0.5 * np.nan_to_num(np.linalg.norm(cells, axis=1)).max(axis=1), 3.0)[:, None]
    inside = (expected > margin) & (expected < size - 1.0 - margin)
    return np.asarray(inside.all(axis=1) & (handedness > 0) & (short_side_px >= MIN_CELL_PX))


def _neighbours(print_xy: FloatArray) -> IntArray:
    """Indices (n, k) of the nearest neighbours of points (n, 2)."""
    count = min(NEIGHBOURS, len(print_xy) - 1)
    return np.asarray(cKDTree(print_xy).query(print_xy, k=count + 1)[1][:, 1:], dtype=np.int64)


def _similar_contrast(print_xy: FloatArray, contrast: FloatArray) -> BoolArray:
    """Mask of corners with about the contrast of their neighbours; partly occluded corners have less."""
    if len(print_xy) < 2:
        return np.zeros(len(print_xy), dtype=bool)
    neighbours_contrast = np.median(contrast[_neighbours(print_xy)], axis=1)
    return np.asarray(contrast > MIN_RELATIVE_CONTRAST * neighbours_contrast)


def _typical_quality(refined: RefinedCorners) -> BoolArray:
    """Mask of corners about as precise and as well explained as most of the board, which excludes glare."""
    if not len(refined.pixels):
        return np.zeros(0, dtype=bool)
    unexplained = 1.0 - refined.explained_variance
    precise = refined.sigma_px < MAX_RELATIVE_SIGMA * np.median(refined.sigma_px)
    return np.asarray(precise & (unexplained < MAX_RELATIVE_UNEXPLAINED * np.median(unexplained) + UNEXPLAINED_OFFSET))


def _largest_part(warp: BoardWarp, print_xy: FloatArray, pixels: FloatArray, step: float) -> BoolArray:
    """Mask of the largest connected part of the corners in which adjacent corners have nearly equal residuals.

    Two mirrors may show a board as if it continued from one to the other, except for a step of a few pixels. Then the
    residuals of the warp through both differ across the step.
    """
    residual = pixels - warp.map(print_xy)
    first, second = cKDTree(print_xy).query_pairs(MAX_LINK * step, output_type="ndarray").T
    change = np.linalg.norm(residual[first] - residual[second], axis=1)
    linked = change < max(OUTLIER_SIGMAS * 1.4826 * float(np.median(change)) if len(change) else 0.0, MIN_STEP_PX)
    linked &= change < MAX_STEP_PX
    graph = coo_array((np.ones(int(linked.sum())), (first[linked], second[linked])), shape=(len(print_xy),) * 2)
    labels = connected_components(graph, directed=False)[1]
    return np.asarray(labels == np.bincount(labels).argmax())


def connected(print_xy: FloatArray, step: float = 1.0) -> BoolArray:
    """Mask (n,) of the largest connected part of corners (n, 2), at most `step` squares apart on their grid."""
    first, second = cKDTree(print_xy).query_pairs(MAX_LINK * step, output_type="ndarray").T
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(len(print_xy),) * 2)
    labels = connected_components(graph, directed=False)[1]
    return np.asarray(labels == np.bincount(labels).argmax())


def on_smooth_surface(print_xy: FloatArray, pixels: FloatArray, step: float = 1.0) -> BoolArray:
    """Mask (n,) of the corners that lie on a smooth surface with their largest connected part.

    Adjacent corners are at most `step` squares apart.
    """
    empty = np.zeros(len(print_xy), dtype=bool)
    warp = BoardWarp.fit(print_xy, pixels)
    if len(print_xy) < MIN_CORNERS or warp is None:
        return empty
    keep = _largest_part(warp, print_xy, pixels, step)
    for round_ in range(5):
        if round_ or not keep.all():
            warp = BoardWarp.fit(print_xy[keep], pixels[keep]) if keep.sum() >= MIN_CORNERS else None
        if warp is None:
            return empty
        deviation = np.linalg.norm(pixels - warp.map(print_xy), axis=1)
        sigma = float(np.median(deviation[keep])) / 1.1774
        inliers = keep & (deviation < np.clip(OUTLIER_SIGMAS * sigma, MIN_OUTLIER_PX, MAX_STEP_PX))
        if (inliers == keep).all():
            break
        keep = inliers
    return keep
