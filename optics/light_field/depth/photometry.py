"""Preparation of views for comparison: noise is smoothed, and their brightness equalised.

Matching compares single pixels, so noise must be small against texture at the size of a pixel: the noisier, the wider
the smoothing.
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
FINE_PX = 3
"""Side of the square whose mean is subtracted, to leave texture as fine as noise."""
SMOOTHING_PX, SMOOTHING_GROWTH_PX, MAX_SMOOTHING_PX = 0.65, 0.75, 2.2
"""Deviation of the smoothing where the noise ratio is 1, its growth with the logarithm of the ratio, and its maximum.

They are near the best for rendered scenes and real pairs with white noise and with the noise of simulated webcams."""


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


def filled(picture: Float32, valid: NDArray[np.bool_]) -> Float32:
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
    return filled(np.broadcast_to(picture, (*samples.shape[:2], 3)).copy(), light_field.weights[index] > 0)


def halved_picture(picture: Float32) -> Float32:
    """Merge blocks of two by two pixels of a picture (v, u) or (v, u, c); drop an odd last column or row."""
    rows, columns = picture.shape[0] // 2, picture.shape[1] // 2
    return np.asarray(
        cv2.resize(picture[: 2 * rows, : 2 * columns], (columns, rows), interpolation=cv2.INTER_AREA), np.float32
    )


def smoothing_px(noise_ratio: float) -> float:
    """Return the deviation of the Gaussian by which views are smoothed, given their noise ratio."""
    wanted = SMOOTHING_PX + SMOOTHING_GROWTH_PX * float(np.log(max(noise_ratio, 1e-3)))
    return float(np.clip(wanted, 0.0, MAX_SMOOTHING_PX))


def smoothed(picture: Float32, deviation_px: float) -> Float32:
    """Return a picture (v, u) or (v, u, c) smoothed by a Gaussian."""
    if deviation_px == 0.0:
        return picture
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), deviation_px), np.float32)


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
        return cls(filled(brightness, valid), filled(chroma, valid), valid)

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

    def smoothed(self, deviation_px: float) -> ViewPicture:
        """Return the view smoothed by a Gaussian."""
        if deviation_px == 0.0:
            return self
        return ViewPicture(smoothed(self.brightness, deviation_px), smoothed(self.chroma, deviation_px), self.valid)

    @cached_property
    def fine_texture(self) -> Float32:
        """Brightness (v, u) without its mean over FINE_PX squared; NaN next to a missing sample."""
        texture: Any = self.brightness - cv2.blur(self.brightness, (FINE_PX, FINE_PX))
        return np.asarray(np.where(self.interior > 0, texture, np.float32(np.nan)))

    def multiplied(self, gain: Float32 | float) -> ViewPicture:
        """Return the view with its colours multiplied by a gain, a number or a map (v, u)."""
        factor = np.asarray(gain, dtype=np.float32)
        if factor.ndim == 0 and factor == 1:
            return self
        return ViewPicture(self.brightness * factor, self.chroma * factor, self.valid)
