"""Where residuals that call for an explanation lie: in some pictures, in one view, or all over."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.view_statistics import SYSTEMATIC_CHANCE, CellMeans, ViewFigures

LARGE_PART = 0.8
FEW_PICTURES = 0.15  # fraction of all pictures: a cause in these is none of the others
MOST = 0.6  # fraction of corners in one view
TIMES_ITS_SHARE = 2.0  # and that in relation to how many of all corners it shows
CHANCE = 1e-3


def advice_on_corners(calibration: Calibration, views: Sequence[ViewFigures], rows: NDArray[np.bool_]) -> str:
    """What to do about some corners (n,), by where they lie: pictures, a view, or neither in particular."""
    seen = calibration.observations
    count, frames = int(rows.sum()), len(np.unique(seen.frame))
    by_frame = np.sort(np.bincount(seen.frame[rows], minlength=frames))[::-1]
    needed = int(np.searchsorted(np.cumsum(by_frame), LARGE_PART * count)) + 1
    if count and needed <= max(FEW_PICTURES * frames, 1.0):
        pictures = "1 picture" if needed == 1 else f"{needed} pictures"
        return (
            f"{LARGE_PART:.0%} of these corners are in {pictures} of {frames}: look there for glare, motion blur or "
            "something in front of the board, and take these again."
        )
    for view in views:
        own = seen.view == view.view
        share, expected = rows[own].sum() / max(count, 1), own.mean()
        if share > MOST and share > TIMES_ITS_SHARE * expected:
            return f"{share:.0%} of these corners are in {view.called}: look for dirt, an edge or glare there."
    return "These corners are spread over pictures and views, so that none is to blame: the noise has long tails."


def advice_on_cells(cells: Sequence[CellMeans], views: Sequence[ViewFigures]) -> str:
    """What to do about cells of views with significant mean residuals: in some views, or in all of them."""
    unlikely = [
        view.called
        for view, means in zip(views, cells, strict=True)
        if means.systematic.sum() > binom.isf(CHANCE, len(means.systematic), SYSTEMATIC_CHANCE)
    ]
    if 0 < len(unlikely) <= len(views) / 2.0:
        return f"See the red arrows of {', '.join(unlikely)}: a mirror there may be bent, or have moved."
    return "See the red arrows, which are in most views: the board may be bent, or the lens beyond its model."
