"""Blur out of focus of views whose boards are planes: a Gaussian with the variance of the circle of confusion.

A thin lens that is in focus at a distance shows a point at another one, both along the axis, as a disc of the diameter
f A |1 / focus - 1 / distance|. The discs of a plane grow linearly in the image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.values import FloatArray

BLUR_STEP_PX = 0.25
"""Largest step of sigma, px, between blurred copies that are mixed."""

LEAST_BLUR_PX = 0.02
"""Sigma, px, that is left out."""


@dataclass(frozen=True)
class ViewWindow:
    """Window of the picture around the subpixels that show a view.

    Attributes
    ----------
    view
        Index of the view.
    place
        Rows and columns of the window.
    mask
        Which of its subpixels (h, w) show the view.
    rays
        Their normalized coordinates x, y and 1 (h, w, 3).
    spread
        Their defocus (h, w) over that through the whole pupil.
    """

    view: int
    place: tuple[slice, slice]
    mask: NDArray[np.bool_]
    rays: NDArray[np.float32]
    spread: NDArray[np.float32]


def defocused(
    radiance: NDArray[np.float32], windows: Sequence[ViewWindow], sigma_px: Sequence[FloatArray], subpixels: int
) -> NDArray[np.float32]:
    """Blur each view of a picture (h * subpixels, w * subpixels).

    Parameters
    ----------
    radiance
        The picture in focus.
    windows
        The windows of its views.
    sigma_px
        For each window the vector (3,) whose product with a ray is the defocus, px, or its negative.
    subpixels
        Squares along each side of a pixel.
    """
    blurred = radiance.copy()
    for window, slope in zip(windows, sigma_px, strict=True):
        sigma = np.abs(window.rays @ slope.astype(np.float32)) * window.spread
        sharp = radiance[window.place]
        found = _mixed_levels(sharp, sigma, window.mask, subpixels)
        np.copyto(blurred[window.place], found, where=window.mask)
    return blurred


def _mixed_levels(
    sharp: NDArray[np.float32], sigma: NDArray[np.float32], mask: NDArray[np.bool_], subpixels: int
) -> NDArray[np.float32]:
    """Blur by a sigma (h, w), px, of each subpixel, mixed in variance between levels that cover those of the mask."""
    low, high = float(sigma[mask].min()), float(sigma[mask].max())
    if high < LEAST_BLUR_PX:
        return sharp
    levels = np.linspace(low, high, max(int(np.ceil((high - low) / BLUR_STEP_PX)), 1) + 1)
    found = _blurred(sharp, float(levels[0]) * subpixels)
    for before, level in pairwise(levels.tolist()):
        if level > before:
            part = np.clip((sigma**2 - before**2) / (level**2 - before**2), 0.0, 1.0)
            found = found + part * (_blurred(sharp, level * subpixels) - found)
    return found


def _blurred(picture: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    if sigma < LEAST_BLUR_PX:
        return picture
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)
