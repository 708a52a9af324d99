"""Patches of the reference view around keypoints, sampled from an image pyramid, with derivatives for warps.

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
PADDING_PX = RADIUS_PX + 3
Floats = NDArray[np.float32]
# Filter to the coefficients of the interpolating cubic B-spline, truncated below 1e-5.
_POLE = np.sqrt(3.0) - 2.0
_SPLINE = _POLE ** np.abs(np.arange(-9, 10))
SIDE = 2 * RADIUS_PX + 1
SAMPLES = SIDE**2
# Minimum information along the weaker direction of a patch, relative to the stronger one.
MIN_ROUNDNESS = 0.015
# Contrast (standard deviation in grey levels) below which a patch shows only noise.
MIN_CONTRAST_GREY = 1.5
_U, _V = np.meshgrid(*[np.arange(-RADIUS_PX, RADIUS_PX + 1, dtype=np.float32)] * 2)
OFFSETS = np.stack([_U.ravel(), _V.ravel()])
_SIDE = np.float32(2 * RADIUS_PX)
SHAPES = np.concatenate(
    [
        OFFSETS,
        np.stack([OFFSETS[0] ** 2, OFFSETS[0] * OFFSETS[1], OFFSETS[1] ** 2]) / _SIDE,
        np.stack([OFFSETS[0] ** (3 - power) * OFFSETS[1] ** power for power in range(4)]) / _SIDE**2,
    ]
)
"""Shifts (9, SAMPLES) of a patch's samples along the view's position, due to slants, curvatures and their changes."""
WIDE: Floats = np.ones(SAMPLES, np.float32)
"""Square roots (SAMPLES,) of the weights of a patch's samples, with a mean weight of 1."""
NARROW_SIGMA_PX = 1.5
NARROW: Floats = np.exp((OFFSETS**2).sum(axis=0) / np.float32(-4.0 * NARROW_SIGMA_PX**2))
NARROW *= np.sqrt(SAMPLES / (NARROW**2).sum())
"""The same for a Gaussian window: it covers little beyond the keypoint itself."""
# Rounds in which a patch moves to what it measures, and the limit of the move, px of the level.
CENTROID_ROUNDS = 3
MAX_MOVE_PX = 2.0

_SPLINE /= _SPLINE.sum()


class ImagePyramid:
    """The grey views (t, s, v, u) as mosaics; pixel x of level l is pixel x * 2**l of a view.

    Views are padded with their border pixels, so that a patch at the edge of a view contains that view alone.

    Raises InputError if the mosaic is larger than OpenCV's tables can address.
    """

    def __init__(self, images: NDArray[np.uint8]) -> None:
        rows, cols, *size = images.shape
        if max(rows * (size[0] + 2 * PADDING_PX), cols * (size[1] + 2 * PADDING_PX)) >= 2**15 - 1:
            raise InputError(
                f"{rows}x{cols} views of {size[1]}x{size[0]} px, which must be less than 32767 px side by side"
            )
        self.mosaics: list[Floats] = []
        self.origins: list[Floats] = []
        views: list[Any] = [np.float32(image) for image in images.reshape(-1, *size)]
        while len(self.mosaics) < LEVELS and (not self.mosaics or min(views[0].shape) > 8 * RADIUS_PX):
            views = [cv2.pyrDown(view) for view in views] if self.mosaics else views
            tile_height, tile_width = views[0].shape[0] + 2 * PADDING_PX, views[0].shape[1] + 2 * PADDING_PX
            mosaic = np.empty((rows * tile_height, cols * tile_width), np.float32)
            tiles = mosaic.reshape(rows, tile_height, cols, tile_width).transpose(0, 2, 1, 3)
            for tile, view in zip(np.ndindex(rows, cols), views, strict=True):
                tiles[tile] = cv2.copyMakeBorder(
                    cv2.sepFilter2D(view, cv2.CV_32F, _SPLINE, _SPLINE),
                    PADDING_PX,
                    PADDING_PX,
                    PADDING_PX,
                    PADDING_PX,
                    cv2.BORDER_REPLICATE,
                )
            t, s = np.divmod(np.arange(rows * cols), cols)
            self.mosaics.append(mosaic)
            self.origins.append((np.stack([s * tile_width, t * tile_height], axis=1) + PADDING_PX).astype(np.float32))

    def level_of(self, scale_px: FloatArray) -> NDArray[np.int64]:
        """Return the level (n,) whose pixel size is closest to half a scale (n,).

        A smaller patch is closer to a plane, and shows more detail.
        """
        return np.clip(np.rint(np.log2(scale_px / 2.0)), 0, len(self.mosaics) - 1).astype(np.int64)

    def samples(self, level: int, u: Floats, v: Floats, *, exact: bool = True) -> Floats:
        """Sample a mosaic at its pixels (n, k); inexact samples are slightly sharper, and faster."""
        sample = _spline_samples if exact else _linear_samples
        parts = [
            sample(self.mosaics[level], u[start:end], v[start:end])
            for start, end in itertools.pairwise([*range(0, len(u), 2**14), len(u)])
        ]
        return np.concatenate(parts) if parts else np.zeros(u.shape, np.float32)


def _linear_samples(coefficients: Floats, u: Floats, v: Floats) -> Floats:
    return np.asarray(cv2.remap(coefficients, u, v, cv2.INTER_LINEAR))


def _spline_samples(coefficients: Floats, u: Floats, v: Floats) -> Floats:
    """Sample a cubic B-spline as mixtures of four bilinear samples, each of four of its sixteen coefficients.

    Sigg and Hadwiger, "Fast third-order texture filtering", GPU Gems 2, 2005.
    """
    left, right, weight_left = _linear_pairs(u)
    above, below, weight_above = _linear_pairs(v)
    row_above, row_below = (
        b + weight_left * (a - b)
        for a, b in ([cv2.remap(coefficients, x, y, cv2.INTER_LINEAR) for x in (left, right)] for y in (above, below))
    )
    return np.asarray(row_below + weight_above * (row_above - row_below))


def _linear_pairs(positions: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the positions where linear samples blend the first and last two B-spline weights, and the first weight."""
    start = np.floor(positions)
    fraction = positions - start
    fraction_squared, complement = fraction * fraction, np.float32(1.0) - fraction
    last = fraction_squared * fraction * np.float32(1.0 / 6.0)
    first = complement * complement * complement * np.float32(1.0 / 6.0)
    # The second weight is 2/3 - fraction^2 (1 - fraction / 2).
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
    window
        Square roots (SAMPLES,) of the samples' weights, which all other arrays include.
    patches
        Samples (m, SAMPLES), of zero mean and unit length.
    gradients
        Derivatives (m, 2, SAMPLES) of the patch with respect to shifts along u and v, per px of the level.
    steps
        Least-squares operator (m, 2, SAMPLES) from a patch difference to its shift, in px of the level.
    shapes
        Derivatives (m, 9, 2, SAMPLES) of the patch with respect to shifts along u and v proportional to each of SHAPES,
        without the part that a shift of the entire patch explains.
    products
        Inner products (m, 2, 2, 9, 9) of the shapes, with the shift axes first.
    centre_shifts
        Apparent shifts (m, 2, 9, 2) of the entire patch along u and v due to each of these shapes, px of the level.
    """

    level: int
    index: NDArray[np.int64]
    window: Floats
    patches: Floats
    gradients: Floats
    steps: Floats
    shapes: Floats
    products: Floats
    centre_shifts: Floats


def gradient_centroids(
    pyramid: ImagePyramid, view: int, pixels: FloatArray, scale_px: FloatArray, lateral_mm: FloatArray
) -> FloatArray:
    """Return the pixels (n, 2) near keypoints (n, 2) whose depth their patches measure: the centroids of information.

    Only gradients along the views' positions (views, 2) inform of depth. Next to a depth edge, all of them may lie on
    the edge; at their centroid, a depth is independent of the surface's slant.
    """
    moved = pixels.copy()
    level_of = pyramid.level_of(scale_px)
    reach_mm = np.sqrt((lateral_mm**2).mean(axis=0)).astype(np.float32)
    offset = np.arange(-RADIUS_PX - 1, RADIUS_PX + 2, dtype=np.float32)
    u, v = (coordinates.ravel() for coordinates in np.meshgrid(offset, offset))
    for level in np.unique(level_of):
        index = np.flatnonzero(level_of == level)
        centre = (pixels[index] / 2**level).astype(np.float32) + pyramid.origins[level][view]
        shift = np.zeros_like(centre)
        for _ in range(CENTROID_ROUNDS):
            samples = pyramid.samples(level, centre[:, :1] + shift[:, :1] + u, centre[:, 1:] + shift[:, 1:] + v)
            square = samples.reshape(len(index), SIDE + 2, SIDE + 2)
            across, down = square[:, 1:-1, 2:] - square[:, 1:-1, :-2], square[:, 2:, 1:-1] - square[:, :-2, 1:-1]
            information = ((reach_mm[0] * across) ** 2 + (reach_mm[1] * down) ** 2).reshape(len(index), SAMPLES)
            information *= NARROW**2
            total = np.maximum(information.sum(axis=1, keepdims=True), np.float32(1e-6))
            shift = np.clip(shift + information @ OFFSETS.T / total, -MAX_MOVE_PX, MAX_MOVE_PX)
        moved[index] += shift * 2.0**level
    return moved


def templates(
    pyramid: ImagePyramid, view: int, pixels: FloatArray, scale_px: FloatArray, window: Floats
) -> list[Templates]:
    """Build templates for keypoints (n, 2) of a view, without those whose patch cannot be localised.

    `window` is NARROW or WIDE.
    """
    level_of = pyramid.level_of(scale_px)
    return [
        _templates(pyramid, view, level, np.flatnonzero(level_of == level), pixels, window)
        for level in np.unique(level_of)
    ]


def _templates(
    pyramid: ImagePyramid, view: int, level: int, index: NDArray[np.int64], pixels: FloatArray, window: Floats
) -> Templates:
    offset = np.arange(-RADIUS_PX - 2, RADIUS_PX + 3, dtype=np.float32)
    u, v = (coordinates.ravel() for coordinates in np.meshgrid(offset, offset))
    centre = (pixels[index] / 2**level).astype(np.float32) + pyramid.origins[level][view]
    extended = pyramid.samples(level, centre[:, :1] + u, centre[:, 1:] + v)
    extended = extended.reshape(len(index), SIDE + 4, SIDE + 4)
    patches, length = normalized(extended[:, 2:-2, 2:-2].reshape(len(index), SAMPLES), window)
    rows, columns = extended[:, 2:-2], extended[:, :, 2:-2]
    gradients = np.stack(
        [
            8.0 * (rows[..., 3:-1] - rows[..., 1:-3]) - (rows[..., 4:] - rows[..., :-4]),
            8.0 * (columns[:, 3:-1] - columns[:, 1:-3]) - (columns[:, 4:] - columns[:, :-4]),
        ],
        axis=1,
    )
    gradients = window * gradients.reshape(len(index), 2, SAMPLES) / (12.0 * length[:, None, None])

    photometric = _photometric_basis(extended[:, 1:-1, 1:-1], patches, window)

    def remove_photometric(rows: Floats) -> Floats:
        """Remove the part that changes of brightness, contrast and sharpness explain."""
        flat = rows.reshape(len(rows), -1, SAMPLES)
        return np.asarray(flat - (flat @ photometric.transpose(0, 2, 1)) @ photometric, dtype=np.float32).reshape(
            rows.shape
        )

    shapes = remove_photometric(gradients[:, None] * SHAPES[:, None])
    gradients = remove_photometric(gradients)
    squares = np.einsum("nip,njp->nij", gradients, gradients).astype(np.float64)
    weaker, stronger = np.linalg.eigvalsh(squares).T
    usable = (weaker > MIN_ROUNDNESS * stronger) & (length >= MIN_CONTRAST_GREY * np.sqrt(SAMPLES))
    gradients, shapes = gradients[usable], shapes[usable]
    steps = np.linalg.inv(squares[usable]).astype(np.float32) @ gradients
    flat = shapes.reshape(len(shapes), 2 * len(SHAPES), SAMPLES)
    shifts = flat @ steps.transpose(0, 2, 1)
    flat = flat - shifts @ gradients
    centre_shifts = shifts.reshape(-1, len(SHAPES), 2, 2).transpose(0, 3, 1, 2)
    products = (flat @ flat.transpose(0, 2, 1)).reshape(-1, len(SHAPES), 2, len(SHAPES), 2)
    products = np.ascontiguousarray(products.transpose(0, 2, 4, 1, 3))
    shapes = flat.reshape(shapes.shape)
    return Templates(
        *(int(level), index[usable], window, patches[usable], gradients, steps, shapes, products, centre_shifts)
    )


def _photometric_basis(extended: Floats, patches: Floats, window: Floats) -> Floats:
    """Return orthonormal changes (n, 3, SAMPLES) of patches in brightness, contrast and sharpness."""
    neighbours = extended[:, :-2, 1:-1] + extended[:, 2:, 1:-1] + extended[:, 1:-1, :-2] + extended[:, 1:-1, 2:]
    sharpness = (neighbours - np.float32(4.0) * extended[:, 1:-1, 1:-1]).reshape(patches.shape)
    sharpness = _centred(sharpness, window)
    sharpness -= np.einsum("np,np->n", sharpness, patches)[:, None] * patches
    sharpness /= np.maximum(np.linalg.norm(sharpness, axis=1, keepdims=True), np.float32(1e-6))
    return np.stack([np.broadcast_to(window / np.float32(SIDE), patches.shape), patches, sharpness], axis=1)


def normalized(patches: Floats, window: Floats) -> tuple[Floats, Floats]:
    """Normalise patches (n, SAMPLES), weighted by a window, to zero mean and unit length; also return their lengths."""
    centred = _centred(patches, window)
    length = np.maximum(np.sqrt(np.einsum("np,np->n", centred, centred)), np.float32(1e-6))
    return centred / length[:, None], length


def _centred(patches: Floats, window: Floats) -> Floats:
    mean = patches @ window**2 / np.float32(SAMPLES)
    return np.asarray(window * (patches - mean[:, None]))
