"""Motion of the picture between views: one displacement per pair of views, whatever the depths of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import LightField, Samples

MAX_SIDE_PX = 192
"""Maximum side of the reduced views that are compared."""
CELLS = 8
"""Number of rows and columns of cells in a view, each with its own depth."""
_CORNERS, _CORNER_SPACING_PX, _ROUND_TRIP_PX = 80, 4, 0.3
_ITERATIONS = 12
_MIN_CELLS = 4
_MIN_MOTION_PX = 0.05
_MIN_AGREEMENT, _MIN_AGREEMENT_OF_FEW = 0.8, 0.98
"""Minimum agreement between the displacements of the two halves of the cells, for many and for few pairs."""
_FEW_PAIRS = 3
_MIN_MOTION_OF_FEW_PX = 0.3
"""Minimum motion for few pairs; smaller motion may be a misalignment of the cameras."""
_MAX_CORRELATION = 0.8
"""Correlation of a view with its shifted copy above which its texture repeats, so motion is ambiguous."""
_MIN_SHIFT_PX, _COARSE_SIGMA_PX = 3.5, 4.0
"""Shifts ignored for this test, and the sigma of brightness variations that are not texture."""
Pairs = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class ViewMotion:
    """Displacement of the picture between views, for a point with the scene's dominant disparity.

    Attributes
    ----------
    pairs
        View numbers (n, 2) of each pair, row by row.
    displacement_px
        Displacement (n, 2) from the first view of a pair to the second, along x and y.
    """

    pairs: Pairs
    displacement_px: FloatArray


def small_views(samples: Samples) -> NDArray[np.uint8]:
    """Convert views (t, s, v, u, c) to normalised grey (n, v, u), row by row, at most `MAX_SIDE_PX` large."""
    rows, cols, height, width = samples.shape[:4]
    shrink = max(1.0, max(height, width) / MAX_SIDE_PX)
    size = max(1, round(width / shrink)), max(1, round(height / shrink))
    small = np.empty((rows * cols, size[1], size[0]), np.uint8)
    for number, (t, s) in enumerate(np.ndindex(rows, cols)):
        grey = cv2.resize(samples[t, s].astype(np.float32).mean(axis=-1), size, interpolation=cv2.INTER_AREA)
        dark, bright = np.percentile(grey, [1.0, 99.0])
        small[number] = np.clip((grey - dark) * (255.0 / max(float(bright - dark), 1e-6)), 0.0, 255.0)
    return small


def central_texture_repeats(light_field: LightField) -> bool:
    """Return whether the texture of the central view repeats."""
    t, s = light_field.rows // 2, light_field.cols // 2
    return texture_repeats(small_views(light_field.samples[t : t + 1, s : s + 1])[0].astype(np.float32))


def texture_repeats(grey: NDArray[np.float32]) -> bool:
    """Return whether the texture of a picture (h, w) repeats, as stripes and checkerboards do."""
    fine = grey - cv2.GaussianBlur(grey, (0, 0), _COARSE_SIGMA_PX)
    top, left = (side // 4 for side in fine.shape)
    central = fine[top : fine.shape[0] - top, left : fine.shape[1] - left]
    correlation = cv2.matchTemplate(fine, central, cv2.TM_CCOEFF_NORMED)
    row, col = np.ogrid[: correlation.shape[0], : correlation.shape[1]]
    shifted = np.hypot(row - top, col - left) > _MIN_SHIFT_PX
    return bool(correlation[shifted].max(initial=0.0) > _MAX_CORRELATION)


def measure_motion(light_field: LightField) -> ViewMotion | None:
    """Measure the motion between adjacent views of the array grid; None if the pictures do not show it.

    Each cell of a view has an unknown disparity, and each pair of views a displacement that scales it. Their product (a
    matrix of rank one) is fitted to the corners that optical flow tracks there and back.
    """
    views = small_views(light_field.samples)
    number = np.arange(len(views)).reshape(light_field.rows, light_field.cols)
    row_pairs = np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1)
    column_pairs = np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1)
    pairs = np.concatenate([row_pairs, column_pairs])
    if not len(pairs) or min(views.shape[1:]) < 2 * CELLS:
        return None
    flow = _flow(views, pairs)
    valid = np.isfinite(flow[..., 0])
    if np.median(valid.sum(axis=1)) < _MIN_CELLS:
        return None
    usable = valid.sum(axis=1) >= _MIN_CELLS
    flow, valid = np.nan_to_num(flow[usable]), valid[usable]
    displacement = _rank_one(flow, valid)
    checker = (np.arange(CELLS)[:, None] + np.arange(CELLS)).ravel() % 2
    if not (valid[:, checker == 0].any() and valid[:, checker == 1].any()):
        return None
    first, second = (_rank_one(flow[:, checker == side], valid[:, checker == side]) for side in (0, 1))
    agreement = 2.0 * abs(float(np.sum(first * second))) / max(float(np.sum(first**2) + np.sum(second**2)), 1e-12)
    length = float(np.sqrt(np.mean(np.sum(displacement**2, axis=1))))
    has_few_pairs = len(flow) < _FEW_PAIRS
    min_agreement = _MIN_AGREEMENT_OF_FEW if has_few_pairs else _MIN_AGREEMENT
    if length < (_MIN_MOTION_OF_FEW_PX if has_few_pairs else _MIN_MOTION_PX) or agreement < min_agreement:
        return None
    return ViewMotion(pairs[usable], displacement)


def _flow(views: NDArray[np.uint8], pairs: Pairs) -> FloatArray:
    """Return the mean flow (pair, cell, 2) of the corners in each cell; NaN without corners."""
    cells = np.full((len(pairs), CELLS * CELLS, 2), np.nan)
    size = np.array([views.shape[2], views.shape[1]])
    corners: dict[int, Any] = {}
    track: Any = partial(cv2.calcOpticalFlowPyrLK, winSize=(11, 11), maxLevel=3)
    for index, (first, second) in enumerate(pairs.tolist()):
        if first not in corners:
            corners[first] = cv2.goodFeaturesToTrack(views[first], _CORNERS, 0.01, _CORNER_SPACING_PX)
        corners_px = corners[first]
        if corners_px is None:
            continue
        tracked_px, tracked, _ = track(views[first], views[second], corners_px, None)
        returned_px, returned, _ = track(views[second], views[first], tracked_px, None)
        valid = (tracked.ravel() > 0) & (returned.ravel() > 0)
        valid &= np.abs(returned_px - corners_px).max(axis=(1, 2)) < _ROUND_TRIP_PX
        start_px, motion_px = corners_px[valid, 0], (tracked_px - corners_px)[valid, 0]
        cell_index = np.clip((start_px * CELLS / size).astype(int), 0, CELLS - 1)
        cell = cell_index[:, 1] * CELLS + cell_index[:, 0]
        count = np.bincount(cell, minlength=CELLS * CELLS)
        total = np.stack([np.bincount(cell, motion_px[:, axis], CELLS * CELLS) for axis in (0, 1)], axis=1)
        cells[index, count > 0] = (total / np.maximum(count, 1)[:, None])[count > 0]
    return cells


def _displacement(flow: FloatArray, factor: FloatArray, weight: FloatArray) -> FloatArray:
    """Fit displacements (pair, 2) to a flow (pair, cell, 2), given the factor of each cell."""
    scale = np.maximum((weight * factor**2).sum(axis=1), 1e-9)
    return np.asarray(np.einsum("pkc,k,pk->pc", flow, factor, weight) / scale[:, None])


def _rank_one(flow: FloatArray, valid: NDArray[np.bool_]) -> FloatArray:
    """Fit displacements (pair, 2), times factors of cells with mean square 1, robustly to a flow.

    Their sign is that of most cells.
    """
    factor = np.linalg.svd(flow.transpose(0, 2, 1).reshape(-1, flow.shape[1]), full_matrices=False)[2][0]
    weight = valid.astype(np.float64)
    for _ in range(_ITERATIONS):
        displacement = _displacement(flow, factor, weight)
        scale = np.maximum(np.einsum("pc,pk->k", displacement**2, weight), 1e-9)
        factor = np.einsum("pkc,pc,pk->k", flow, displacement, weight) / scale
        rms = max(float(np.sqrt(np.mean(factor[valid.any(axis=0)] ** 2))), 1e-9)
        factor = factor * np.copysign(1.0 / rms, (factor * weight.sum(axis=0)).sum())
        deviation = np.linalg.norm(flow - factor[:, None] * _displacement(flow, factor, weight)[:, None], axis=2)
        weight = valid / (1.0 + (deviation / max(2.0 * float(np.median(deviation[valid])), 0.02)) ** 2)
    return _displacement(flow, factor, weight)
