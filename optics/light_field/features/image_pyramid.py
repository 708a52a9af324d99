"""The views of a light field on several scales, side by side in one picture per scale, and samples of them."""

from __future__ import annotations

import itertools
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray, InputError

RADIUS_PX = 4
"""Half the side of the patches that are sampled, without the pixel in the middle."""
LEVELS = 5
FRAME_PX = RADIUS_PX + 3

Floats = NDArray[np.float32]

# The coefficients of the cubic B-spline that goes through samples: their filter, cut off where it is below 1e-5.
_POLE = np.sqrt(3.0) - 2.0
_SPLINE = _POLE ** np.abs(np.arange(-9, 10))
_SPLINE /= _SPLINE.sum()


class ImagePyramid:
    """The views (t, s, v, u) in grey, side by side; pixel x of level l is pixel x * 2**l of the views.

    Views are framed by what is at their border, so that a patch around a pixel at the edge of a view is of that
    view alone.

    Raises InputError for views that side by side are larger than OpenCV's tables address.
    """

    def __init__(self, images: NDArray[np.uint8]) -> None:
        rows, cols, *size = images.shape
        if max(rows * (size[0] + 2 * FRAME_PX), cols * (size[1] + 2 * FRAME_PX)) >= 2**15 - 1:
            raise InputError(f"{rows}x{cols} views of {size[1]}x{size[0]} px, expected less than 32767 px side by side")
        self.mosaics: list[Floats] = []
        self.origins: list[Floats] = []
        views: list[Any] = [np.float32(image) for image in images.reshape(-1, *size)]
        while len(self.mosaics) < LEVELS and (not self.mosaics or min(views[0].shape) > 8 * RADIUS_PX):
            views = [cv2.pyrDown(view) for view in views] if self.mosaics else views
            high, wide = views[0].shape[0] + 2 * FRAME_PX, views[0].shape[1] + 2 * FRAME_PX
            mosaic = np.empty((rows * high, cols * wide), np.float32)
            places = mosaic.reshape(rows, high, cols, wide).transpose(0, 2, 1, 3)
            for place, view in zip(np.ndindex(rows, cols), views, strict=True):
                places[place] = cv2.copyMakeBorder(
                    cv2.sepFilter2D(view, cv2.CV_32F, _SPLINE, _SPLINE),
                    FRAME_PX,
                    FRAME_PX,
                    FRAME_PX,
                    FRAME_PX,
                    cv2.BORDER_REPLICATE,
                )
            t, s = np.divmod(np.arange(rows * cols), cols)
            self.mosaics.append(mosaic)
            self.origins.append((np.stack([s * wide, t * high], axis=1) + FRAME_PX).astype(np.float32))

    def level_of(self, scale_px: FloatArray) -> NDArray[np.int64]:
        """The level (n,) on which a pixel is nearest to half a scale (n,).

        A smaller patch is nearer to a plane, and shows more detail.
        """
        return np.clip(np.rint(np.log2(scale_px / 2.0)), 0, len(self.mosaics) - 1).astype(np.int64)

    def samples(self, level: int, across: Floats, down: Floats, *, exact: bool = True) -> Floats:
        """Samples (n, k) of a mosaic at its pixels (n, k); not exact ones are a little sharper, and fast."""
        sampled = _spline_samples if exact else _linear_samples
        parts = [
            sampled(self.mosaics[level], across[start:end], down[start:end])
            for start, end in itertools.pairwise([*range(0, len(across), 2**14), len(across)])
        ]
        return np.concatenate(parts) if parts else np.zeros(across.shape, np.float32)


def _linear_samples(coefficients: Floats, across: Floats, down: Floats) -> Floats:
    return np.asarray(cv2.remap(coefficients, across, down, cv2.INTER_LINEAR))


def _spline_samples(coefficients: Floats, across: Floats, down: Floats) -> Floats:
    """Samples of a cubic B-spline as mixtures of four bilinear ones, each of four of its sixteen coefficients.

    Sigg and Hadwiger, "Fast third-order texture filtering", GPU Gems 2, 2005.
    """
    left, right, leftward = _linear_pairs(across)
    above, below, upward = _linear_pairs(down)
    upper, lower = (
        right_ + leftward * (left_ - right_)
        for left_, right_ in (
            [cv2.remap(coefficients, x, y, cv2.INTER_LINEAR) for x in (left, right)] for y in (above, below)
        )
    )
    return np.asarray(lower + upward * (upper - lower))


def _linear_pairs(at: Floats) -> tuple[Floats, Floats, Floats]:
    """Where linear samples mix the first two and the last two of four B-spline weights, and the weight of the first."""
    start = np.floor(at)
    part = at - start
    square, rest = part * part, np.float32(1.0) - part
    last = square * part * np.float32(1.0 / 6.0)
    first = rest * rest * rest * np.float32(1.0 / 6.0)
    # The second weight is 2/3 - part^2 (1 - part / 2).
    second = np.float32(2.0 / 3.0) - square + np.float32(3.0) * last
    weight = first + second
    return start - 1 + second / weight, start + 1 + last / (1 - weight), weight
