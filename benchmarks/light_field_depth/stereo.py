"""BadPix and MSE of the 4D Light Field Benchmark, and OpenCV's StereoSGBM with its best pair and settings."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import product
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.io.formats.hci import HciScene

Disparity = NDArray[np.float32]
# As the 4D Light Field Benchmark scores disparities (Honauer et al., ACCV 2016).
BORDER_PX = 15
BAD_PX = 0.07


def _errors(disparity_px: Disparity | FloatArray, truth_px: Disparity | FloatArray) -> FloatArray:
    """Return errors (n,) of all pixels with a truth, except at the border; NaN without an estimate."""
    inner = slice(BORDER_PX, -BORDER_PX)
    error = (np.asarray(disparity_px, dtype=np.float64) - truth_px)[inner, inner]
    return error[np.isfinite(truth_px[inner, inner])]


def bad_pixels(
    disparity_px: Disparity | FloatArray, truth_px: Disparity | FloatArray, threshold_px: float = BAD_PX
) -> float:
    """Return BadPix: the fraction of pixels with a disparity (v, u) wrong by more than a threshold, or unknown."""
    return float(np.mean(~(np.abs(_errors(disparity_px, truth_px)) <= threshold_px)))


def mean_square_error(disparity_px: Disparity | FloatArray, truth_px: Disparity | FloatArray) -> float:
    """Return 100 times the MSE, like the benchmark, of the pixels with an estimate, px^2."""
    return float(100.0 * np.nanmean(np.square(_errors(disparity_px, truth_px))))


def fill_gaps(disparity: Disparity) -> Disparity:
    """Fill gaps (NaN) with the farther of the nearest known disparities to their left and right."""
    numbers = np.arange(disparity.shape[1])
    result = disparity.copy()
    for row in result:
        known = np.flatnonzero(np.isfinite(row))
        if 0 < len(known) < len(row):
            left = known[np.clip(np.searchsorted(known, numbers, "right") - 1, 0, None)]
            right = known[np.clip(np.searchsorted(known, numbers), None, len(known) - 1)]
            gaps = ~np.isfinite(row)
            row[gaps] = np.minimum(row[left], row[right])[gaps]
    return result


def stereo(scene: HciScene, pair: str, block_px: int, smooth: float, mode: int) -> Disparity:
    """Return the disparity (v, u) of the central view by OpenCV's StereoSGBM with its neighbour on one side."""
    light_field = scene.light_field
    t, s = light_field.rows // 2, light_field.cols // 2
    neighbour = {"right": (t, s + 1), "left": (t, s - 1), "bottom": (t + 1, s), "top": (t - 1, s)}[pair]
    pictures = [
        np.asarray(cv2.cvtColor(light_field.samples[index], cv2.COLOR_RGB2BGR)) for index in ((t, s), neighbour)
    ]
    if pair in ("top", "bottom"):
        pictures = [picture.transpose(1, 0, 2) for picture in pictures]
    if pair in ("top", "left"):
        pictures = [picture[:, ::-1] for picture in pictures]
    low, high = scene.disparity_range_px or (0.0, 0.0)
    first = int(np.floor(low)) - 1
    matcher: Any = cv2.StereoSGBM.create(
        minDisparity=first,
        numDisparities=16 * int(np.ceil((high + 1 - first) / 16)),
        blockSize=block_px,
        P1=round(8 * 3 * block_px**2 * smooth),
        P2=round(32 * 3 * block_px**2 * smooth),
        disp12MaxDiff=1,
        uniquenessRatio=0,
        mode=mode,
    )
    # What lies beyond the picture's side cannot be matched there: the picture goes on as its edge.
    margin = 16 + max(abs(first), int(np.ceil(high)))
    padded = [cv2.copyMakeBorder(np.ascontiguousarray(p), 0, 0, margin, margin, cv2.BORDER_REPLICATE) for p in pictures]
    disparity = matcher.compute(*padded)[:, margin:-margin].astype(np.float32) / np.float32(16.0)
    disparity[disparity < first] = np.nan
    disparity = fill_gaps(disparity)
    if pair in ("top", "left"):
        disparity = disparity[:, ::-1]
    return disparity.T if pair in ("top", "bottom") else disparity


def best_stereo(scene: HciScene, every: int) -> tuple[dict[str, float], dict[str, str]]:
    """Return the minimum BadPix and the minimum MSE over all pairs and settings of StereoSGBM, chosen by the truth.

    Settings are tested on all cores: OpenCV matches outside Python's lock.
    """
    truth = scene.disparity_px
    assert truth is not None
    best = {"bad": np.inf, "mse": np.inf}
    settings_text = {"bad": "", "mse": ""}
    modes = {"sgbm": cv2.STEREO_SGBM_MODE_SGBM, "hh": cv2.STEREO_SGBM_MODE_HH, "3way": cv2.STEREO_SGBM_MODE_SGBM_3WAY}
    settings = list(product(("right", "left", "bottom", "top"), (1, 3, 5, 7, 9), (0.3, 1.0, 3.0), modes))

    def scores_of(setting: tuple[str, int, float, str]) -> dict[str, float]:
        pair, block, smooth, mode = setting
        return scores(stereo(scene, pair, block, smooth, modes[mode]), truth, every)

    with ThreadPoolExecutor(cores()) as threads:
        for (pair, block, smooth, mode), result in zip(settings, threads.map(scores_of, settings), strict=True):
            for name, value in result.items():
                if value < best[name]:
                    best[name], settings_text[name] = value, f"{pair}, block {block}, smoothness {smooth}, {mode}"
    return best, settings_text


def scores(disparity: Disparity, truth: Disparity, every: int) -> dict[str, float]:
    """Return BadPix(0.07) in percent, and MSE x 100, in px per step of the full grid."""
    own, true = disparity / every, truth / every
    return {"bad": 100.0 * bad_pixels(own, true), "mse": mean_square_error(own, true)}
