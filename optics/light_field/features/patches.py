"""Patches of the reference view around keypoints, sampled from an image pyramid, and their derivatives by warps.

The pyramid holds the views of a light field at several scales, as one mosaic per scale.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray

RADIUS_PX = 4
"""Half the side of the sampled patches, excluding the central pixel."""
LEVELS = 5
FRAME_PX = RADIUS_PX + 3
Floats = NDArray[np.float32]
# Filter to the coefficients of the interpolating cubic B-spline, truncated below 1e-5.
_POLE = np.sqrt(3.0) - 2.0
_SPLINE = _POLE ** np.abs(np.arange(-9, 10))
SIDE = 2 * RADIUS_PX + 1
SAMPLES = SIDE**2
# Least information along the weaker direction of a patch, relative to the stronger one.
MIN_ROUNDNESS = 0.015
# Contrast (standard deviation in grey levels) below which a patch shows only noise.
MIN_CONTRAST_GREY = 1.5
_ACROSS, _DOWN = np.meshgrid(*[np.arange(-RADIUS_PX, RADIUS_PX + 1, dtype=np.float32)] * 2)
OFFSETS = np.stack([_ACROSS.ravel(), _DOWN.ravel()])
_SIDE = np.float32(2 * RADIUS_PX)
SHAPES = np.concatenate(
    [
        OFFSETS,
        np.stack([OFFSETS[0] ** 2, OFFSETS[0] * OFFSETS[1], OFFSETS[1] ** 2]) / _SIDE,
        np.stack([OFFSETS[0] ** (3 - power) * OFFSETS[1] ** power for power in range(4)]) / _SIDE**2,
    ]
)
"""Shifts (9, SAMPLES) of a patch's samples along the view's position: by slants, curvatures and their changes."""

_SPLINE /= _SPLINE.sum()


class ImagePyramid:
    """The grey views (t, s, v, u) as mosaics; pixel x of level l is pixel x * 2**l of a view.

    Views are padded with their border pixels, so that a patch at the edge of a view contains that view alone.

    Raises InputError if the mosaic is larger than OpenCV's tables can address.
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
        """Level (n,) whose pixel size is closest to half a scale (n,).

        A smaller patch is closer to a plane, and shows more detail.
        """
        return np.clip(np.rint(np.log2(scale_px / 2.0)), 0, len(self.mosaics) - 1).astype(np.int64)

    def samples(self, level: int, across: Floats, down: Floats, *, exact: bool = True) -> Floats:
        """Sample a mosaic at its pixels (n, k); inexact samples are slightly sharper, and fast."""
        sampled = _spline_samples if exact else _linear_samples
        parts = [
            sampled(self.mosaics[level], across[start:end], down[start:end])
            for start, end in itertools.pairwise([*range(0, len(across), 2**14), len(across)])
        ]
        return np.concatenate(parts) if parts else np.zeros(across.shape, np.float32)


def _linear_samples(coefficients: Floats, across: Floats, down: Floats) -> Floats:
    return np.asarray(cv2.remap(coefficients, across, down, cv2.INTER_LINEAR))


def _spline_samples(coefficients: Floats, across: Floats, down: Floats) -> Floats:
    """Sample a cubic B-spline as mixtures of four bilinear samples, each of four of its sixteen coefficients.

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


def _linear_pairs(positions: Floats) -> tuple[Floats, Floats, Floats]:
    """Positions where linear samples blend the first two and last two B-spline weights, and the weight of the first."""
    start = np.floor(positions)
    fraction = positions - start
    fraction_squared, complement = fraction * fraction, np.float32(1.0) - fraction
    last = fraction_squared * fraction * np.float32(1.0 / 6.0)
    first = complement * complement * complement * np.float32(1.0 / 6.0)
    # The second weight is 2/3 - part^2 (1 - part / 2).
    second = np.float32(2.0 / 3.0) - fraction_squared + np.float32(3.0) * last
    weight = first + second
    return start - 1 + second / weight, start + 1 + last / (1 - weight), weight


@dataclass(frozen=True, eq=False)
class Templates:
    """Patches of the reference view at one level of the pyramid, SAMPLES each.

    Attributes
    ----------
    level
        Level of the pyramid.
    index
        Indices (m,) of the keypoints.
    patches
        Samples (m, SAMPLES), of mean zero and length one.
    gradients
        Derivatives (m, 2, SAMPLES) of the patch by shifts along u and v, per px of the level.
    steps
        Least-squares operator (m, 2, SAMPLES) from a patch difference to its shift, px of the level.
    shapes
        Derivatives (m, 9, 2, SAMPLES) of the patch by shifts along u and v proportional to each of SHAPES, without the
        part that a shift of the entire patch explains.
    products
        Inner products (m, 2, 2, 9, 9) of the shapes, with the shift axes first.
    leaning
        Apparent shift (m, 2, 9, 2) of the entire patch along u and v by each of these, px of the level.
    """

    level: int
    index: NDArray[np.int64]
    patches: Floats
    gradients: Floats
    steps: Floats
    shapes: Floats
    products: Floats
    leaning: Floats


def templates(pyramid: ImagePyramid, view: int, pixels: FloatArray, scale_px: FloatArray) -> list[Templates]:
    """Build templates for keypoints (n, 2) of a view, without those whose patch cannot be localised."""
    level_of = pyramid.level_of(scale_px)
    return [
        _templates(pyramid, view, level, np.flatnonzero(level_of == level), pixels) for level in np.unique(level_of)
    ]


def _templates(pyramid: ImagePyramid, view: int, level: int, index: NDArray[np.int64], pixels: FloatArray) -> Templates:
    offset = np.arange(-RADIUS_PX - 2, RADIUS_PX + 3, dtype=np.float32)
    across, down = (each.ravel() for each in np.meshgrid(offset, offset))
    centre = (pixels[index] / 2**level).astype(np.float32) + pyramid.origins[level][view]
    extended = pyramid.samples(level, centre[:, :1] + across, centre[:, 1:] + down)
    extended = extended.reshape(len(index), SIDE + 4, SIDE + 4)
    patches, length = normalized(extended[:, 2:-2, 2:-2].reshape(len(index), SAMPLES))
    rows, columns = extended[:, 2:-2], extended[:, :, 2:-2]
    gradients = np.stack(
        [
            8.0 * (rows[..., 3:-1] - rows[..., 1:-3]) - (rows[..., 4:] - rows[..., :-4]),
            8.0 * (columns[:, 3:-1] - columns[:, 1:-3]) - (columns[:, 4:] - columns[:, :-4]),
        ],
        axis=1,
    )
    gradients = gradients.reshape(len(index), 2, SAMPLES) / (12.0 * length[:, None, None])

    light = _light(extended[:, 1:-1, 1:-1], patches)

    def beyond_light(rows: Floats) -> Floats:
        """Remove the part that free brightness, contrast and sharpness explain."""
        flat = rows.reshape(len(rows), -1, SAMPLES)
        return np.asarray(flat - (flat @ light.transpose(0, 2, 1)) @ light, dtype=np.float32).reshape(rows.shape)

    shapes = beyond_light(gradients[:, None] * SHAPES[:, None])
    gradients = beyond_light(gradients)
    squares = np.einsum("nip,njp->nij", gradients, gradients).astype(np.float64)
    weaker, stronger = np.linalg.eigvalsh(squares).T
    usable = (weaker > MIN_ROUNDNESS * stronger) & (length >= MIN_CONTRAST_GREY * np.sqrt(SAMPLES))
    gradients, shapes = gradients[usable], shapes[usable]
    steps = np.linalg.inv(squares[usable]).astype(np.float32) @ gradients
    flat = shapes.reshape(len(shapes), 2 * len(SHAPES), SAMPLES)
    moves = flat @ steps.transpose(0, 2, 1)
    flat = flat - moves @ gradients
    leaning = moves.reshape(-1, len(SHAPES), 2, 2).transpose(0, 3, 1, 2)
    products = (flat @ flat.transpose(0, 2, 1)).reshape(-1, len(SHAPES), 2, len(SHAPES), 2)
    products = np.ascontiguousarray(products.transpose(0, 2, 4, 1, 3))
    shapes = flat.reshape(shapes.shape)
    return Templates(int(level), index[usable], patches[usable], gradients, steps, shapes, products, leaning)


def _light(extended: Floats, patches: Floats) -> Floats:
    """Orthonormal changes (n, 3, SAMPLES) of patches by brightness, contrast and sharpness, from their surroundings."""
    neighbours = extended[:, :-2, 1:-1] + extended[:, 2:, 1:-1] + extended[:, 1:-1, :-2] + extended[:, 1:-1, 2:]
    sharpness = (neighbours - np.float32(4.0) * extended[:, 1:-1, 1:-1]).reshape(patches.shape)
    sharpness = sharpness - sharpness.mean(axis=1, keepdims=True)
    sharpness -= np.einsum("np,np->n", sharpness, patches)[:, None] * patches
    sharpness /= np.maximum(np.linalg.norm(sharpness, axis=1, keepdims=True), np.float32(1e-6))
    return np.stack([np.full_like(patches, 1.0 / SIDE), patches, sharpness], axis=1)


def normalized(patches: Floats) -> tuple[Floats, Floats]:
    """Normalise patches (n, p) to mean zero and length one; also return their lengths."""
    centred = patches - patches.mean(axis=1, keepdims=True)
    length = np.maximum(np.sqrt(np.einsum("np,np->n", centred, centred)), np.float32(1e-6))
    return centred / length[:, None], length
