"""How sharp each sub-image is, beside the sharpest that it has been: an aid to focus the lens by hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.alignment.sub_image_masks import SubImage

LEAST_GREY = 4.0
"""Mean grey level of a sub-image that is too dark to be judged."""
NOISE = 0.25
"""Part of the quarter of pixels with the least detail that counts as noise."""


def sharpness(grey: NDArray[np.uint8], sub_images: Sequence[SubImage | None]) -> FloatArray:
    """Sharpness (mirrors,) of a picture (h, w): the RMS of the Laplacian over the mean grey level.

    A change of exposure leaves it as it is, and noise, as the quarter of the area with the least detail has it, is
    taken off. NaN where a sub-image is dark or shows nothing. It depends on the scene: compare it with itself.
    """
    found = np.full(len(sub_images), np.nan)
    for k, each in enumerate(sub_images):
        if each is None:
            continue
        window: Any = grey[each.window]
        mean = float(cv2.mean(window, mask=each.mask)[0])
        if mean < LEAST_GREY:
            continue
        detail: Any = cv2.Laplacian(window, cv2.CV_32F)
        energy: Any = cv2.boxFilter(detail * detail, -1, (16, 16))[::8, ::8][each.mask[::8, ::8] > 0]
        if len(energy):
            found[k] = np.sqrt(max(float(energy.mean() - np.quantile(energy, NOISE)), 0.0)) / mean
    return found


class FocusMeter:
    """Sharpness of each sub-image relative to the best so far, 0 to 1; `reset` when the scene has changed."""

    def __init__(self, mirrors: int) -> None:
        self.best = np.zeros(mirrors)

    def reset(self) -> None:
        """Forget the best so far."""
        self.best[:] = 0.0

    def measure(self, sharp: FloatArray) -> FloatArray:
        """The sharpness (mirrors,) relative to the best so far, itself included; NaN where there is none."""
        self.best = np.fmax(self.best, sharp)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(self.best > 0.0, sharp / self.best, np.nan))
