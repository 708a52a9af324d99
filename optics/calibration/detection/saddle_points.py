"""Saddle points of a picture that look like corners of a checkerboard, at several scales.

At a corner of a checkerboard two edges cross, so that grey values have a saddle point: the determinant of the Hessian
is negative there. On a small circle around it they are alike on opposite sides and change four times between black and
white, where the edges pass.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.observations import IntArray

SCALES = (1, 2, 4)  # of the picture, by which it is reduced
SMOOTHING_PX = 1.0  # sigma, in px of the reduced picture, like all lengths below
BAND_PX = 64  # rows that are searched at a time
SUPPRESSED_PX = 5  # side of the window in which only the strongest saddle point counts
RINGS_PX = (3.0, 4.5)  # radii of the circles; the smaller one is for small cells
RING_POINTS = 32
MIN_CURVATURE = 0.6  # grey levels per squared px
MIN_CONTRAST = 8.0  # grey levels on the circle, from black to white
MAX_ODD = 0.35  # of the signal on the circle: what differs between opposite sides
MOST = 6000  # saddle points at each scale
SAME_PX = 2.5  # between saddle points found at two scales, in px of the more reduced one


@dataclass(frozen=True)
class SaddlePoints:
    """Saddle points (n) of a picture.

    Attributes
    ----------
    pixels
        Positions (n, 2).
    axes
        Angles (n, 2), rad, from 0 to pi, of the two edges. Where the angle increases from the first edge to the second
        one there is white, as also on the opposite side.
    strength
        Curvature (n,), grey levels per squared px of the picture in which it was found.
    """

    pixels: FloatArray
    axes: FloatArray
    strength: FloatArray

    def __len__(self) -> int:
        return len(self.pixels)

    def where(self, rows: NDArray[np.bool_] | IntArray) -> Self:
        """The saddle points of a mask (n,) or of indices."""
        return type(self)(*(getattr(self, field.name)[rows] for field in fields(self)))

    def and_others(self, other: Self, apart_px: float) -> Self:
        """These, and those of `other` that are farther than `apart_px` from all of these."""
        if len(self) and len(other):
            other = other.where(cKDTree(self.pixels).query(other.pixels)[0] > apart_px)
        return type(self)(
            *(np.concatenate([getattr(self, field.name), getattr(other, field.name)]) for field in fields(self))
        )


def saddle_points(grey: NDArray[np.uint8]) -> SaddlePoints:
    """Find the saddle points of a picture (h, w) that look like corners of a checkerboard."""
    picture = np.asarray(grey, dtype=np.float32)
    found = SaddlePoints(np.empty((0, 2)), np.empty((0, 2)), np.empty(0))
    for scale in SCALES:
        if scale > 1:
            # A pixel of the reduced picture is the mean of two by two.
            picture = np.asarray(cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
        if min(picture.shape) < 16:
            break
        seen = _at_one_scale(picture)
        at = (seen.pixels + 0.5) * scale - 0.5
        found = found.and_others(SaddlePoints(at, seen.axes, seen.strength), SAME_PX * scale)
    return found


def _at_one_scale(picture: NDArray[np.float32]) -> SaddlePoints:
    smooth = np.asarray(cv2.GaussianBlur(picture, (0, 0), SMOOTHING_PX), dtype=np.float32)
    bands = [_curved(smooth, top) for top in range(0, len(smooth), BAND_PX)]
    rows, cols, hessian = (np.concatenate(parts, axis=-1) for parts in zip(*bands, strict=True))
    strength = np.sqrt(hessian[2] ** 2 - hessian[0] * hessian[1])
    if len(rows) > MOST:
        strongest = np.argsort(-strength, kind="stable")[:MOST]
        rows, cols, hessian, strength = rows[strongest], cols[strongest], hessian[:, strongest], strength[strongest]
    pixels = np.stack([cols, rows], axis=1) + _to_the_saddle(smooth, rows, cols, hessian)
    axes = np.full((len(pixels), 2), np.nan)
    for radius in RINGS_PX:
        left = np.isnan(axes[:, 0])
        axes[left] = _axes(smooth, pixels[left], radius)
    good = np.isfinite(axes[:, 0])
    return SaddlePoints(pixels[good], axes[good], strength[good])


def _curved(smooth: NDArray[np.float32], top: int) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows and columns (n,) of the strongest saddle points of a band, and the Hessian (3, n) there: xx, yy, xy.

    A band stays in the processor's cache, and no memory is asked for.
    """
    above = min(SUPPRESSED_PX, top)  # what the band's derivatives and maxima depend on
    part = smooth[top - above : top + BAND_PX + SUPPRESSED_PX]
    xx, yy, xy = (
        np.asarray(cv2.Sobel(part, cv2.CV_32F, *order, ksize=3, scale=0.25)) for order in ((2, 0), (0, 2), (1, 1))
    )
    curvature = xy * xy - xx * yy
    highest = np.asarray(cv2.dilate(curvature, np.ones((SUPPRESSED_PX, SUPPRESSED_PX), np.uint8)))
    band = np.s_[above : above + BAND_PX]
    rows, cols = np.nonzero((curvature[band] >= highest[band]) & (curvature[band] > MIN_CURVATURE**2))
    hessian = np.stack([each[band][rows, cols] for each in (xx, yy, xy)]).astype(np.float64)
    return rows + top, cols, hessian


def _to_the_saddle(smooth: NDArray[np.float32], rows: IntArray, cols: IntArray, hessian: FloatArray) -> FloatArray:
    """From pixels to where the gradient vanishes (n, 2), at most a pixel away; `hessian` (3, n) holds xx, yy, xy."""
    height, width = smooth.shape
    right, left = np.minimum(cols + 1, width - 1), np.maximum(cols - 1, 0)
    below, above = np.minimum(rows + 1, height - 1), np.maximum(rows - 1, 0)
    x = (smooth[rows, right] - smooth[rows, left]) / 2.0
    y = (smooth[below, cols] - smooth[above, cols]) / 2.0
    xx, yy, xy = hessian
    step = np.stack([xy * y - yy * x, xy * x - xx * y], axis=1) / (xx * yy - xy * xy)[:, None]
    return np.asarray(np.clip(step, -1.0, 1.0))


def _axes(smooth: NDArray[np.float32], pixels: FloatArray, radius: float) -> FloatArray:
    """Angles (n, 2) of the edges that cross at pixels (n, 2); NaN where a circle around one shows none, or others."""
    if not len(pixels):
        return np.empty((0, 2))
    angles = np.arange(RING_POINTS) * (2.0 * np.pi / RING_POINTS)
    around = radius * np.stack([np.cos(angles), np.sin(angles)])
    x, y = pixels.T.astype(np.float32)[:, None] + around.astype(np.float32)[:, :, None]
    ring = np.asarray(cv2.remap(smooth, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
    half = RING_POINTS // 2
    even, odd = (ring[:half] + ring[half:]) / 2.0, (ring[:half] - ring[half:]) / 2.0
    middle = (even.max(axis=0) + even.min(axis=0)) / 2.0
    contrast = even.max(axis=0) - even.min(axis=0)
    signal = even - middle
    after = np.roll(signal, -1, axis=0)
    rising, falling = (signal <= 0) & (after > 0), (signal > 0) & (after <= 0)
    good = (rising.sum(axis=0) == 1) & (falling.sum(axis=0) == 1) & (contrast > MIN_CONTRAST)
    good &= np.sqrt((odd**2).mean(axis=0)) < MAX_ODD * contrast / 2.0
    height, width = smooth.shape
    good &= ((pixels > radius) & (pixels < [width - 1 - radius, height - 1 - radius])).all(axis=1)
    axes = np.full((len(pixels), 2), np.nan)
    points = np.flatnonzero(good)
    for column, crossing in enumerate((rising, falling)):
        first = np.argmax(crossing[:, points], axis=0)
        before, behind = signal[first, points], after[first, points]
        axes[points, column] = ((first + before / (before - behind)) * (np.pi / half)) % np.pi
    return axes
