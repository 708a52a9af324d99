"""Motion of the picture between views: one displacement per pair of views, for any depths of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import LightField, Samples

MOST_SIDE_PX = 192
"""Longest side at which views are compared."""
CELLS = 8
"""Cells across and down a view, each with its own depth."""
_CORNERS, _APART_PX, _ROUND_TRIP_PX = 80, 4, 0.3
_ITERATIONS = 12
_LEAST_CELLS = 4
_LEAST_MOTION_PX = 0.05
_LEAST_AGREEMENT, _SURE = 0.8, 0.98
"""Least agreement between displacements by either half of the cells, for many and for few pairs."""
_FEW_PAIRS = 3
_LEAST_PAIR_PX = 0.3
"""Least motion of few pairs: cameras of a pair may be misaligned by less."""
_REPEATED = 0.8
"""Correlation of a view with its shifted copy above which its texture repeats, so that motion is ambiguous."""
_NOT_MOVED_PX, _COARSE_PX = 3.5, 4.0
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
    """Convert views (t, s, v, u, c) to normalised grey (n, v, u), row by row, at most `MOST_SIDE_PX` large."""
    rows, cols, height, width = samples.shape[:4]
    shrink = max(1.0, max(height, width) / MOST_SIDE_PX)
    size = max(1, round(width / shrink)), max(1, round(height / shrink))
    found = np.empty((rows * cols, size[1], size[0]), np.uint8)
    for number, (t, s) in enumerate(np.ndindex(rows, cols)):
        grey = cv2.resize(samples[t, s].astype(np.float32).mean(axis=-1), size, interpolation=cv2.INTER_AREA)
        dark, bright = np.percentile(grey, [1.0, 99.0])
        found[number] = np.clip((grey - dark) * (255.0 / max(float(bright - dark), 1e-6)), 0.0, 255.0)
    return found


def repeats(light_field: LightField) -> bool:
    """Return whether the texture of the central view repeats."""
    t, s = light_field.rows // 2, light_field.cols // 2
    return texture_repeats(small_views(light_field.samples[t : t + 1, s : s + 1])[0].astype(np.float32))


def texture_repeats(grey: NDArray[np.float32]) -> bool:
    """Return whether the texture of a picture (h, w) repeats, as stripes and checkerboards do."""
    fine = grey - cv2.GaussianBlur(grey, (0, 0), _COARSE_PX)
    down, across = (side // 4 for side in fine.shape)
    middle = fine[down : fine.shape[0] - down, across : fine.shape[1] - across]
    alike = cv2.matchTemplate(fine, middle, cv2.TM_CCOEFF_NORMED)
    row, col = np.ogrid[: alike.shape[0], : alike.shape[1]]
    moved = np.hypot(row - down, col - across) > _NOT_MOVED_PX
    return bool(alike[moved].max(initial=0.0) > _REPEATED)


def measured_motion(light_field: LightField) -> ViewMotion | None:
    """Measure the motion between adjacent views of the grid of arrays; None if the pictures do not show it.

    Each cell of a view has an unknown disparity, and each pair of views a displacement that scales it. Their product (a
    matrix of rank one) is fitted to the corners that optical flow tracks there and back.
    """
    views = small_views(light_field.samples)
    number = np.arange(len(views)).reshape(light_field.rows, light_field.cols)
    across = np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1)
    down = np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1)
    pairs = np.concatenate([across, down])
    if not len(pairs) or min(views.shape[1:]) < 2 * CELLS:
        return None
    flow = _flow(views, pairs)
    seen = np.isfinite(flow[..., 0])
    if np.median(seen.sum(axis=1)) < _LEAST_CELLS:
        return None
    known = seen.sum(axis=1) >= _LEAST_CELLS
    flow, seen = np.nan_to_num(flow[known]), seen[known]
    displacement = _rank_one(flow, seen)
    half = (np.arange(CELLS)[:, None] + np.arange(CELLS)).ravel() % 2
    if not (seen[:, half == 0].any() and seen[:, half == 1].any()):
        return None
    one, other = (_rank_one(flow[:, half == side], seen[:, half == side]) for side in (0, 1))
    agreement = 2.0 * abs(float(np.sum(one * other))) / max(float(np.sum(one**2) + np.sum(other**2)), 1e-12)
    length = float(np.sqrt(np.mean(np.sum(displacement**2, axis=1))))
    few = len(flow) < _FEW_PAIRS
    if length < (_LEAST_PAIR_PX if few else _LEAST_MOTION_PX) or agreement < (_SURE if few else _LEAST_AGREEMENT):
        return None
    return ViewMotion(pairs[known], displacement)


def _flow(views: NDArray[np.uint8], pairs: Pairs) -> FloatArray:
    """Mean flow (pair, cell, 2) of the corners in each cell; NaN without corners."""
    cells = np.full((len(pairs), CELLS * CELLS, 2), np.nan)
    size = np.array([views.shape[2], views.shape[1]])
    corners: dict[int, Any] = {}
    follow: Any = partial(cv2.calcOpticalFlowPyrLK, winSize=(11, 11), maxLevel=3)
    for index, (one, other) in enumerate(pairs.tolist()):
        if one not in corners:
            corners[one] = cv2.goodFeaturesToTrack(views[one], _CORNERS, 0.01, _APART_PX)
        begin = corners[one]
        if begin is None:
            continue
        end, there, _ = follow(views[one], views[other], begin, None)
        back, again, _ = follow(views[other], views[one], end, None)
        good = (there.ravel() > 0) & (again.ravel() > 0)
        good &= np.abs(back - begin).max(axis=(1, 2)) < _ROUND_TRIP_PX
        start, moved = begin[good, 0], (end - begin)[good, 0]
        place = np.clip((start * CELLS / size).astype(int), 0, CELLS - 1)
        cell = place[:, 1] * CELLS + place[:, 0]
        count = np.bincount(cell, minlength=CELLS * CELLS)
        total = np.stack([np.bincount(cell, moved[:, axis], CELLS * CELLS) for axis in (0, 1)], axis=1)
        cells[index, count > 0] = (total / np.maximum(count, 1)[:, None])[count > 0]
    return cells


def _displacement(flow: FloatArray, factor: FloatArray, weight: FloatArray) -> FloatArray:
    """Fit displacements (pair, 2) to a flow (pair, cell, 2), given the factor of each cell."""
    scale = np.maximum((weight * factor**2).sum(axis=1), 1e-9)
    return np.asarray(np.einsum("pkc,k,pk->pc", flow, factor, weight) / scale[:, None])


def _rank_one(flow: FloatArray, seen: NDArray[np.bool_]) -> FloatArray:
    """Fit displacements (pair, 2), times factors of cells with mean square 1, robustly to a flow.

    Their sign follows most cells.
    """
    factor = np.linalg.svd(flow.transpose(0, 2, 1).reshape(-1, flow.shape[1]), full_matrices=False)[2][0]
    weight = seen.astype(np.float64)
    for _ in range(_ITERATIONS):
        displacement = _displacement(flow, factor, weight)
        square = np.maximum(np.einsum("pc,pk->k", displacement**2, weight), 1e-9)
        factor = np.einsum("pkc,pc,pk->k", flow, displacement, weight) / square
        size = max(float(np.sqrt(np.mean(factor[seen.any(axis=0)] ** 2))), 1e-9)
        factor = factor * np.copysign(1.0 / size, (factor * weight.sum(axis=0)).sum())
        apart = np.linalg.norm(flow - factor[:, None] * _displacement(flow, factor, weight)[:, None], axis=2)
        weight = seen / (1.0 + (apart / max(2.0 * float(np.median(apart[seen])), 0.02)) ** 2)
    return _displacement(flow, factor, weight)
