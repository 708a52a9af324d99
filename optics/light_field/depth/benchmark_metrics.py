"""How the 4D Light Field Benchmark scores disparities (Honauer et al., ACCV 2016): without a border of 15 px."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.values import FloatArray

BORDER_PX = 15
BAD_PX = 0.07

Disparity = NDArray[np.float32] | FloatArray


def _errors(disparity_px: Disparity, truth_px: Disparity) -> FloatArray:
    """Errors (n,) of all pixels with a truth, less the border; NaN where there is no estimate."""
    inner = slice(BORDER_PX, -BORDER_PX)
    error = (np.asarray(disparity_px, dtype=np.float64) - truth_px)[inner, inner]
    return error[np.isfinite(truth_px[inner, inner])]


def bad_pixels(disparity_px: Disparity, truth_px: Disparity, threshold_px: float = BAD_PX) -> float:
    """BadPix: the part, 0 to 1, of pixels whose disparity (v, u) is wrong by more than a threshold, or unknown."""
    return float(np.mean(~(np.abs(_errors(disparity_px, truth_px)) <= threshold_px)))


def mean_square_error(disparity_px: Disparity, truth_px: Disparity) -> float:
    """MSE, times 100 as the benchmark states it: of the pixels with an estimate, px^2."""
    return float(100.0 * np.nanmean(np.square(_errors(disparity_px, truth_px))))
