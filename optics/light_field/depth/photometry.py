"""Preparation of views for comparison: noise is smoothed, and their brightness equalised.

Matching compares single pixels, so noise must be small at the size of a pixel: the noisier, the wider the smoothing.
Mirrors reflect unevenly and a lens darkens its corners, so a point's brightness differs by up to a fifth between views:
it is equalised by one gain before depth is known, by a linear function afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.optics.light_field.light_field import LightField, Samples

Float32 = NDArray[np.float32]

NO_SAMPLE = -1e4
"""Value where a grey picture has no sample: any blend with it is negative."""
FILL_PX = 5
"""Side of the square whose mean replaces a missing sample, so that it causes no false edge."""
MIN_GAIN, MAX_GAIN = np.float32(0.4), np.float32(2.5)
GAIN_STRIDE_PX = 8
GAIN_PATCH_PX = 5
MIN_SAMPLES = 50
MIN_GAIN_CHANGE = 0.03
"""Minimum relative difference in brightness that is equalised before depth is known."""
OCCLUSION_SCALES = (24.0, 12.0, 6.0, 6.0)
"""Scale of the robust loss per round, out of 255: larger differences probably show different surfaces."""
NOISE_KERNEL = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / np.float32(6.0)
"""Difference of two Laplacians: white noise keeps its deviation, planes and edges along an axis vanish."""
NOISE_BLOCK_PX = 16
NOISE_QUANTILE = 0.2
"""Quantile of the blocks, by noise, that is taken as the noise: texture raises others."""
MEDIAN_OF_NOISE = 0.6745
USUAL_NOISE_GREY = 1.5
"""Noise up to which nothing is smoothed; fine texture measures as much."""
SMOOTHING_PX = 0.35
"""Deviation of the smoothing for 1 grey level more."""


@compiled
def _separate(samples: Samples, scale: float, brightness: Float32, chroma: Float32) -> None:
    """Fill brightness (v, u) (ITU-R BT.601) and chroma (v, u) of samples (v, u, c) times `scale`, within 0 to 255."""
    zero, white, half = np.float32(0.0), np.float32(255.0), np.float32(0.5)
    red_part, green_part, blue_part = np.float32(0.299), np.float32(0.587), np.float32(0.114)
    for y in range(brightness.shape[0]):
        row, out, chroma_out = samples[y], brightness[y], chroma[y]
        if samples.shape[2] == 3:
            for x in range(len(out)):
                red = min(max(np.float32(row[x, 0]) * scale, zero), white)
                green = min(max(np.float32(row[x, 1]) * scale, zero), white)
                blue = min(max(np.float32(row[x, 2]) * scale, zero), white)
                out[x] = red_part * red + green_part * green + blue_part * blue
                chroma_out[x] = half * (red - blue)
        else:
            for x in range(len(out)):
                out[x] = min(max(np.float32(row[x, 0]) * scale, zero), white)
                chroma_out[x] = zero


def _filled(picture: Float32, valid: NDArray[np.bool_]) -> Float32:
    """Return a picture (v, u) or (v, u, c) with missing samples replaced by the mean of neighbours."""
    if valid.all():
        return picture
    mask = valid if picture.ndim == 2 else valid[..., None]
    fraction: Any = cv2.blur(valid.astype(np.float32), (FILL_PX, FILL_PX))
    mean: Any = cv2.blur(picture * mask, (FILL_PX, FILL_PX))
    filled = picture.copy()
    filled[~valid] = mean[~valid] / np.maximum(fraction[~valid], 1e-3).reshape(-1, *[1] * (picture.ndim - 2))
    return filled


def colours(light_field: LightField, index: tuple[int, int]) -> Float32:
    """Return the colours (v, u, 3), 0 to 255, of view (t, s); a grey view gets three equal ones."""
    samples: Any = light_field.samples[index]
    picture = samples.astype(np.float32)
    if samples.dtype == np.float32:
        picture = np.clip(picture, np.float32(0.0), np.float32(1.0)) * np.float32(255.0)
    return _filled(np.broadcast_to(picture, (*samples.shape[:2], 3)).copy(), light_field.weights[index] > 0)


def halved_picture(picture: Float32) -> Float32:
    """Merge blocks of two by two pixels of a picture (v, u) or (v, u, c); drop an odd last column or row."""
    rows, columns = picture.shape[0] // 2, picture.shape[1] // 2
    return np.asarray(
        cv2.resize(picture[: 2 * rows, : 2 * columns], (columns, rows), interpolation=cv2.INTER_AREA), np.float32
    )


def noise_grey(light_field: LightField, index: tuple[int, int]) -> float:
    """Return the standard deviation of white noise of view (t, s), of 255 grey levels, from its second colour.

    As Immerkaer (1996), by medians over blocks; 0 for a view that is smaller than a block.
    """
    samples = light_field.samples[index]
    picture = samples[..., samples.shape[-1] // 2].astype(np.float32)
    if samples.dtype == np.float32:
        picture = picture * np.float32(255.0)
    side = NOISE_BLOCK_PX
    rows, columns = picture.shape[0] // side, picture.shape[1] // side
    if min(rows, columns) == 0:
        return 0.0
    residual = np.abs(cv2.filter2D(picture, -1, NOISE_KERNEL))[: rows * side, : columns * side]
    blocks = residual.reshape(rows, side, columns, side).transpose(0, 2, 1, 3).reshape(rows * columns, side * side)
    return float(np.quantile(np.median(blocks, axis=1), NOISE_QUANTILE)) / MEDIAN_OF_NOISE


def smoothed(picture: Float32, noise_grey: float) -> Float32:
    """Return a picture (v, u) or (v, u, c) smoothed as its noise requires."""
    if noise_grey <= USUAL_NOISE_GREY:
        return picture
    deviation_px = SMOOTHING_PX * float(np.sqrt(noise_grey - USUAL_NOISE_GREY))
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), deviation_px))


@dataclass(frozen=True, eq=False)
class ViewPicture:
    """A view prepared for comparison.

    Attributes
    ----------
    brightness, chroma
        (v, u), 0 to 255, and half the difference (v, u) of red and blue, 0 for a grey view; missing samples are filled
        with the mean of neighbours.
    valid
        Mask (v, u) of valid samples.
    """

    brightness: Float32
    chroma: Float32
    valid: NDArray[np.bool_]

    @classmethod
    def of(cls, light_field: LightField, index: tuple[int, int]) -> ViewPicture:
        """Return view (t, s) of a light field."""
        samples: Any = light_field.samples[index]
        brightness, chroma = np.empty((2, *samples.shape[:2]), np.float32)
        _separate(samples, np.float32(255.0 if samples.dtype == np.float32 else 1.0), brightness, chroma)
        valid = light_field.weights[index] > 0
        return cls(_filled(brightness, valid), _filled(chroma, valid), valid)

    @property
    def grey(self) -> Float32:
        """Brightness (v, u), 0 to 255, `NO_SAMPLE` where there is no sample."""
        if self.valid.all():
            return self.brightness
        return np.where(self.valid, self.brightness, np.float32(NO_SAMPLE))

    @cached_property
    def interior(self) -> NDArray[np.uint8]:
        """Mask (v, u), as uint8, of samples whose neighbours are all valid."""
        return np.asarray(cv2.erode(self.valid.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1))

    @cached_property
    def halved(self) -> ViewPicture:
        """The view with blocks of two by two pixels merged, unknown if a sample is missing; see `halved_picture`."""
        rows, columns = self.valid.shape[0] // 2, self.valid.shape[1] // 2
        valid = self.valid[: 2 * rows, : 2 * columns]
        valid_rows = valid[::2] & valid[1::2]
        both_valid = valid_rows[:, ::2] & valid_rows[:, 1::2]
        return ViewPicture(halved_picture(self.brightness), halved_picture(self.chroma), both_valid)

    def smoothed(self, noise_grey: float) -> ViewPicture:
        """Return the view smoothed as its noise requires, see `smoothed`."""
        return ViewPicture(smoothed(self.brightness, noise_grey), smoothed(self.chroma, noise_grey), self.valid)

    def multiplied(self, gain: Float32 | float) -> ViewPicture:
        """Return the view with its colours multiplied by a gain, a number or a map (v, u)."""
        factor = np.asarray(gain, dtype=np.float32)
        if factor.ndim == 0 and factor == 1:
            return self
        return ViewPicture(self.brightness * factor, self.chroma * factor, self.valid)


def rough_gain(picture: Float32, reference: Float32) -> float:
    """Return the factor that roughly equalises a grey view (v, u) to the reference view before depth is known.

    It is the median ratio of means over large squares; 1 below `MIN_GAIN_CHANGE`, which depth alone may explain.
    """
    side = max(3, min(picture.shape) // 8)
    shared = (picture >= 0) & (reference >= 0)

    def means(values: Float32) -> Float32:
        blurred: Any = cv2.blur(np.where(shared, values, np.float32(0.0)), (side, side))
        return np.asarray(blurred[side // 2 :: side, side // 2 :: side])

    reference_means, picture_means = means(reference), means(picture)
    usable = (reference_means > 1.0) & (picture_means > 1.0)
    if not usable.any():
        return 1.0
    gain = float(np.median(reference_means[usable] / picture_means[usable]))
    return float(np.clip(gain, MIN_GAIN, MAX_GAIN)) if abs(gain - 1.0) > MIN_GAIN_CHANGE else 1.0


def patch_means(picture: Float32) -> Float32:
    """Means over small squares of a grey picture (v, u); negative where a square has a missing sample."""
    return np.asarray(cv2.blur(picture, (GAIN_PATCH_PX, GAIN_PATCH_PX)))


def matching_gain(picture: Float32, u: Float32, v: Float32, reference: Float32) -> Float32:
    """Return the gain (v, u) that equalises a grey view to the reference view; ones if the overlap is too small.

    The gain is a plane over the view, g = a + b u + c v, fitted to the points that both views show; points that differ
    too much, probably occluded in one view, lose weight round by round (Geman-McClure).

    Parameters
    ----------
    picture
        The view (v, u), 0 to 255, `NO_SAMPLE` where there is none.
    u, v
        Pixels (m, n) of the view that show given points of the reference view.
    reference
        Brightness (m, n) of these points in the reference view, from `patch_means`.
    """
    picture_means = np.asarray(
        cv2.remap(patch_means(picture), u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=-1.0)
    )
    shared = (picture_means >= 0) & (reference >= 0)
    if np.count_nonzero(shared) < MIN_SAMPLES:
        return np.ones_like(picture)
    height, width = picture.shape
    basis = np.stack([np.ones_like(u), u / width - 0.5, v / height - 0.5], axis=-1)[shared].astype(float)
    target = reference[shared].astype(float)
    terms, weight = basis * picture_means[shared].astype(float)[:, None], np.ones(len(target))
    for scale in OCCLUSION_SCALES:
        weighted = terms * weight[:, None]
        # The weak prior of gain 1 gives even a black picture a gain.
        gain = np.linalg.solve(weighted.T @ terms + np.eye(3), weighted.T @ target + [1.0, 0.0, 0.0])
        weight = 1.0 / np.square(1.0 + np.square((terms @ gain - target) / scale))
    columns = np.arange(width, dtype=np.float32) / np.float32(width) - np.float32(0.5)
    rows = np.arange(height, dtype=np.float32)[:, None] / np.float32(height) - np.float32(0.5)
    plane = (np.float32(gain[0]) + np.float32(gain[1]) * columns) + np.float32(gain[2]) * rows
    return np.asarray(np.clip(plane, MIN_GAIN, MAX_GAIN))
