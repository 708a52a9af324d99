"""Pictures of the views that a calibration explains worst, to look at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from mirrorcam.core.images.pictures import read_image
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration, ViewPicture
from mirrorcam.optics.calibration.solver.observations import MIN_CORNERS, IntArray

COUNT = 4
MARGIN = 0.15
"""Margin around the corners, relative to the larger side of the rectangle that they fill."""


def with_worst_views(calibration: Calibration, picture_of: Callable[[int], Grey | Path | None]) -> Calibration:
    """Add pictures of the views with the largest standardised residuals.

    Parameters
    ----------
    calibration
        The calibration.
    picture_of
        Maps a frame's number to its picture, if there is one.
    """
    views = []
    for frame, view in _worst(calibration):
        picture = picture_of(frame)
        if isinstance(picture, Path):
            picture = read_image(picture, grey=True)
        if picture is not None:
            views.append(_cropped(calibration, picture, frame, view))
        if len(views) == COUNT:
            break
    return replace(calibration, worst_views=tuple(views))


def _worst(calibration: Calibration) -> list[tuple[int, int]]:
    """Frame and view of each view with enough corners, that with the largest standardised residuals first."""
    observations = calibration.observations
    keys = np.stack([observations.frame, observations.view], axis=1)
    groups, group, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    squares = np.bincount(group.ravel(), weights=np.sum(calibration.standardised**2, axis=1)) / counts
    order = np.argsort(-squares, kind="stable")
    return [(int(groups[n, 0]), int(groups[n, 1])) for n in order if counts[n] >= MIN_CORNERS]


def _cropped(calibration: Calibration, picture: Grey, frame: int, view: int) -> ViewPicture:
    observations = calibration.observations
    pixels = observations.pixels[(observations.frame == frame) & (observations.view == view)]
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    margin = MARGIN * float((high - low).max())
    left, top = np.maximum(np.floor(low - margin), 0).astype(int)
    right, bottom = np.ceil(high + margin).astype(int) + 1
    corner: IntArray = np.array([left, top])
    return ViewPicture(frame, view, picture[top:bottom, left:right].copy(), corner)
