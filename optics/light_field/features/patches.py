"""Patches of the reference view around keypoints, and how they change as views move them and surfaces bend them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features.image_pyramid import RADIUS_PX, Floats, ImagePyramid

SIDE = 2 * RADIUS_PX + 1
SAMPLES = SIDE**2
# Of the two directions of a patch, the worse one must have this part of the information of the better one.
LEAST_ROUNDNESS = 0.015
# A patch of less contrast (standard deviation in grey levels) shows noise.
LEAST_CONTRAST_GREY = 1.5

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
"""Moves (9, SAMPLES) of a patch along the view's position: by slants, curvatures and their changes."""


@dataclass(frozen=True, eq=False)
class Templates:
    """Patches of the reference view on one level of the pyramid, SAMPLES each.

    Attributes
    ----------
    level
        Level of the pyramid.
    index
        Indices (m,) of the keypoints.
    patches
        Samples (m, SAMPLES), of mean zero and length one.
    gradients
        Change (m, 2, SAMPLES) of the patch by a move along u and v, px of the level.
    steps
        Least-squares operator (m, 2, SAMPLES) from a difference from the patch to its move, px of the level.
    shapes
        Change (m, 9, 2, SAMPLES) of the patch by a move along u and v in proportion to each of SHAPES, less the part
        that a move of the whole patch explains.
    products
        Inner products (m, 2, 2, 9, 9) of the shapes with each other, by the axes of moves first.
    leaning
        Apparent move (m, 2, 9, 2) of the whole patch along u and v by each of these moves, px of the level.
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
    """Templates for aligning keypoints (n, 2) of a view; those whose patch cannot be localised are left out."""
    level_of = pyramid.level_of(scale_px)
    return [
        _templates(pyramid, view, level, np.flatnonzero(level_of == level), pixels) for level in np.unique(level_of)
    ]


def _templates(pyramid: ImagePyramid, view: int, level: int, index: NDArray[np.int64], pixels: FloatArray) -> Templates:
    offset = np.arange(-RADIUS_PX - 2, RADIUS_PX + 3, dtype=np.float32)
    across, down = (each.ravel() for each in np.meshgrid(offset, offset))
    centre = (pixels[index] / 2**level).astype(np.float32) + pyramid.origins[level][view]
    wide = pyramid.samples(level, centre[:, :1] + across, centre[:, 1:] + down)
    wide = wide.reshape(len(index), SIDE + 4, SIDE + 4)
    patches, length = normalized(wide[:, 2:-2, 2:-2].reshape(len(index), SAMPLES))
    rows, columns = wide[:, 2:-2], wide[:, :, 2:-2]
    gradients = np.stack(
        [
            8.0 * (rows[..., 3:-1] - rows[..., 1:-3]) - (rows[..., 4:] - rows[..., :-4]),
            8.0 * (columns[:, 3:-1] - columns[:, 1:-3]) - (columns[:, 4:] - columns[:, :-4]),
        ],
        axis=1,
    )
    gradients = gradients.reshape(len(index), 2, SAMPLES) / (12.0 * length[:, None, None])

    light = _light(wide[:, 1:-1, 1:-1], patches)

    def beyond_light(rows: Floats) -> Floats:
        """Remove from rows what free brightness, contrast and sharpness explain."""
        flat = rows.reshape(len(rows), -1, SAMPLES)
        return np.asarray(flat - (flat @ light.transpose(0, 2, 1)) @ light, dtype=np.float32).reshape(rows.shape)

    shapes = beyond_light(gradients[:, None] * SHAPES[:, None])
    gradients = beyond_light(gradients)
    squares = np.einsum("nip,njp->nij", gradients, gradients).astype(np.float64)
    least, most = np.linalg.eigvalsh(squares).T
    usable = (least > LEAST_ROUNDNESS * most) & (length >= LEAST_CONTRAST_GREY * np.sqrt(SAMPLES))
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


def _light(wide: Floats, patches: Floats) -> Floats:
    """Orthonormal changes (n, 3, SAMPLES) of patches by brightness, contrast and sharpness, from their surroundings."""
    beside = wide[:, :-2, 1:-1] + wide[:, 2:, 1:-1] + wide[:, 1:-1, :-2] + wide[:, 1:-1, 2:]
    blur = (beside - np.float32(4.0) * wide[:, 1:-1, 1:-1]).reshape(patches.shape)
    blur = blur - blur.mean(axis=1, keepdims=True)
    blur -= np.einsum("np,np->n", blur, patches)[:, None] * patches
    blur /= np.maximum(np.linalg.norm(blur, axis=1, keepdims=True), np.float32(1e-6))
    return np.stack([np.full_like(patches, 1.0 / SIDE), patches, blur], axis=1)


def normalized(patches: Floats) -> tuple[Floats, Floats]:
    """Patches (n, p) of mean zero and length one, and what their lengths were."""
    centred = patches - patches.mean(axis=1, keepdims=True)
    length = np.maximum(np.sqrt(np.einsum("np,np->n", centred, centred)), np.float32(1e-6))
    return centred / length[:, None], length
