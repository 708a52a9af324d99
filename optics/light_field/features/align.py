"""Sub-pixel alignment of what a keypoint shows in the reference view with what other views show.

Inverse compositional Gauss-Newton (Baker and Matthews, IJCV 2004) on patches of mean zero and length one, so that views
need be neither equally bright nor equally rich in contrast.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from optics.values import FloatArray

RADIUS_PX = 4
SAMPLES = (2 * RADIUS_PX + 1) ** 2
ROUNDS = 4
# A step of more than a pixel of its scale is cut: the patches' gradients tell no more.
MOST_STEP_PX = 1.0
# Of the two directions of a patch, the worse one must tell this part of what the better one tells.
LEAST_ROUNDNESS = 0.03
# A patch of less contrast (standard deviation in grey levels) shows noise.
LEAST_CONTRAST_GREY = 1.5
LEVELS = 5

Floats = NDArray[np.float32]


class Pyramid:
    """The views (n, v, u) in grey, each level half as large; pixel x of level l is pixel x * 2**l of the views."""

    def __init__(self, images: NDArray[np.uint8], run: Callable[..., Any]) -> None:
        def halved(image: NDArray[np.uint8]) -> list[Any]:
            levels: list[Any] = [image.astype(np.float32)]
            while len(levels) < LEVELS and min(levels[-1].shape) > 8 * RADIUS_PX:
                levels.append(cv2.pyrDown(levels[-1]))
            return levels

        self.levels: list[list[Any]] = list(run(halved, images))

    def level_of(self, scale_px: FloatArray) -> NDArray[np.int64]:
        """The level (n,) on which a pixel is nearest to a scale (n,)."""
        return np.clip(np.rint(np.log2(scale_px)), 0, len(self.levels[0]) - 1).astype(np.int64)

    def patches(self, view: int, level: int, pixels: FloatArray, radius_px: int) -> Floats:
        """Samples (n, side, side) of one level around pixels (n, 2) of a view."""
        side = 2 * radius_px + 1
        offset = np.arange(-radius_px, radius_px + 1, dtype=np.float32)
        centre = (pixels / 2**level).astype(np.float32)
        where = np.empty((len(pixels), side, side, 2), np.float32)
        where[..., 0] = centre[:, 0, None, None] + offset
        where[..., 1] = centre[:, 1, None, None] + offset[:, None]
        flat, image, border = where.reshape(-1, side * side, 2), self.levels[view][level], cv2.BORDER_REPLICATE
        parts = [
            cv2.remap(image, flat[start : start + 2**14], None, cv2.INTER_LINEAR, borderMode=border)  # type: ignore[call-overload]
            for start in range(0, len(flat), 2**14)
        ]
        return np.concatenate(parts).reshape(-1, side, side) if parts else np.zeros((0, side, side), np.float32)


@dataclass(frozen=True, eq=False)
class Templates:
    """Patches of the reference view of one level of the pyramid.

    Attributes:
        level: of the pyramid.
        index: (m,) which keypoints.
        patches: (m, side²) of mean zero and length one.
        steps: (m, 2, side²) what a difference from the patch says of how far it has moved, in px of the level.
    """

    level: int
    index: NDArray[np.int64]
    patches: Floats
    steps: Floats


def templates(pyramid: Pyramid, view: int, pixels: FloatArray, scale_px: FloatArray) -> list[Templates]:
    """What alignment needs of keypoints (n, 2) of a view; those whose patch cannot tell where it is are left out."""
    level_of, made = pyramid.level_of(scale_px), []
    for level in range(len(pyramid.levels[view])):
        index = np.flatnonzero(level_of == level)
        wide = pyramid.patches(view, level, pixels[index], RADIUS_PX + 1)
        inner, contrast = _normalized(wide[:, 1:-1, 1:-1].reshape(len(index), SAMPLES))
        slopes = np.stack([wide[:, 1:-1, 2:] - wide[:, 1:-1, :-2], wide[:, 2:, 1:-1] - wide[:, :-2, 1:-1]], axis=1)
        slopes = slopes.reshape(len(index), 2, SAMPLES) / (2.0 * contrast[:, None, None])
        # Brightness and contrast are free: what of the gradients looks like them says nothing.
        slopes -= slopes.mean(axis=2, keepdims=True)
        slopes -= np.einsum("nkp,np->nk", slopes, inner)[..., None] * inner[:, None]
        squares = np.einsum("nip,njp->nij", slopes, slopes).astype(np.float64)
        least, most = np.linalg.eigvalsh(squares).T
        enough = contrast >= LEAST_CONTRAST_GREY * np.sqrt(SAMPLES)
        told = (least > LEAST_ROUNDNESS * most) & enough
        steps = np.linalg.inv(squares[told]).astype(np.float32) @ slopes[told]
        made.append(Templates(level, index[told], inner[told], steps))
    return made


def align(
    pyramid: Pyramid, given: list[Templates], view: int, start_px: FloatArray
) -> tuple[FloatArray, NDArray[np.float64]]:
    """Where in a view the patches of keypoints are, from a start (n, 2), and how like them it looks there (n,).

    The likeness is the normalized cross-correlation; 0 for keypoints without a start (NaN) or template.
    """
    pixels, alike = start_px.copy(), np.zeros(len(start_px))
    for each in given:
        index = np.isfinite(start_px[each.index]).all(axis=1)
        rows, patches, steps = each.index[index], each.patches[index], each.steps[index]
        for _ in range(ROUNDS):
            seen, _ = _normalized(
                pyramid.patches(view, each.level, pixels[rows], RADIUS_PX).reshape(len(rows), SAMPLES)
            )
            alike[rows] = np.einsum("np,np->n", seen, patches)
            step = np.einsum("nkp,np->nk", steps, seen - patches).astype(np.float64)
            length = np.hypot(step[:, 0], step[:, 1])[:, None]
            pixels[rows] -= step * (2**each.level * np.minimum(1.0, MOST_STEP_PX / np.maximum(length, 1e-9)))
    return pixels, alike


def _normalized(patches: Floats) -> tuple[Floats, Floats]:
    """Patches (n, p) of mean zero and length one, and what their lengths were."""
    centred = patches - patches.mean(axis=1, keepdims=True)
    length = np.maximum(np.sqrt(np.einsum("np,np->n", centred, centred)), np.float32(1e-6))
    return centred / length[:, None], length
