"""Sub-pixel alignment of what a keypoint shows in the reference view with what the other views show.

Inverse compositional Gauss-Newton (Baker and Matthews, IJCV 2004) on patches of mean zero and length one, so that views
need be neither equally bright nor equally rich in contrast. A patch moves by itself in each view; that it lies on a
slanted surface is told by all views together: with the inverse distance w + n.o at an offset o, a view at p sees the
offset moved by -f p (n.o). Left out, a slant would move patches by unlike amounts along s and t, as refraction does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from optics.values import FloatArray

RADIUS_PX = 4
SIDE = 2 * RADIUS_PX + 1
SAMPLES = SIDE**2
# Rounds that move patches only, then rounds that also slant them, then the last one, which again moves only.
MOVING_ROUNDS = 2
SLANTING_ROUNDS = 2
# A step of more than a pixel of its scale is cut: the patches' gradients tell no more.
MOST_STEP_PX = 1.0
# Of the two directions of a patch, the worse one must tell this part of what the better one tells.
LEAST_ROUNDNESS = 0.03
# A patch of less contrast (standard deviation in grey levels) shows noise.
LEAST_CONTRAST_GREY = 1.5
# Views that look less like the reference's patch say nothing of its slant.
LEAST_ALIKE_FOR_SLANT = 0.7
# Standard deviation of tan(slant) of surfaces before anything is seen of them: 60 degrees.
USUAL_SLANT = 1.7
LEVELS = 5

Floats = NDArray[np.float32]

_ACROSS, _DOWN = np.meshgrid(*[np.arange(-RADIUS_PX, RADIUS_PX + 1, dtype=np.float32)] * 2)
OFFSETS = np.stack([_ACROSS.ravel(), _DOWN.ravel()])


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

    def samples(self, view: int, level: int, where_px: Floats) -> Floats:
        """Samples (n, k) of a level at pixels (n, k, 2) of that level."""
        image, parts, second_map = self.levels[view][level], [], cast(Any, None)
        for start in range(0, len(where_px), 2**14):
            part = where_px[start : start + 2**14]
            parts.append(cv2.remap(image, part, second_map, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
        return np.concatenate(parts) if parts else np.zeros(where_px.shape[:2], np.float32)


@dataclass(frozen=True, eq=False)
class Templates:
    """Patches of the reference view on one level of the pyramid, SAMPLES each.

    Attributes:
        level: of the pyramid.
        index: (m,) which keypoints.
        patches: (m, SAMPLES) of mean zero and length one.
        steps: (m, 2, SAMPLES) what a difference from the patch says of how far it has moved, in px of the level.
        slants: (m, 2, 2, SAMPLES) how it changes, along u and v, by a move in proportion to the offset along u and v;
            less what a move of the whole patch explains.
        products: (m, 2, 2, 2, 2) of the slants with each other.
    """

    level: int
    index: NDArray[np.int64]
    patches: Floats
    steps: Floats
    slants: Floats
    products: Floats


def templates(pyramid: Pyramid, view: int, pixels: FloatArray, scale_px: FloatArray) -> list[Templates]:
    """What alignment needs of keypoints (n, 2) of a view; those whose patch cannot tell where it is are left out."""
    level_of = pyramid.level_of(scale_px)
    return [
        _templates(pyramid, view, level, np.flatnonzero(level_of == level), pixels) for level in np.unique(level_of)
    ]


def _templates(
    pyramid: Pyramid, view: int, level: int, index: NDArray[np.int64], pixels: FloatArray
) -> Templates:
    offset = np.arange(-RADIUS_PX - 1, RADIUS_PX + 2, dtype=np.float32)
    around = np.stack(np.meshgrid(offset, offset), axis=-1).reshape(-1, 2)
    where = (pixels[index, None] / 2**level).astype(np.float32) + around
    wide = pyramid.samples(view, level, where).reshape(len(index), SIDE + 2, SIDE + 2)
    patches, length = _normalized(wide[:, 1:-1, 1:-1].reshape(len(index), SAMPLES))
    gradients = np.stack([wide[:, 1:-1, 2:] - wide[:, 1:-1, :-2], wide[:, 2:, 1:-1] - wide[:, :-2, 1:-1]], axis=1)
    gradients = gradients.reshape(len(index), 2, SAMPLES) / (2.0 * length[:, None, None])

    def beyond_light(rows: Floats) -> Floats:
        """Brightness and contrast are free: what looks like them says nothing."""
        rows = rows - rows.mean(axis=-1, keepdims=True)
        return rows - np.einsum("n...p,np->n...", rows, patches)[..., None] * patches.reshape(
            len(patches), *(1,) * (rows.ndim - 2), SAMPLES
        )

    slants = beyond_light(gradients[:, :, None] * OFFSETS)
    gradients = beyond_light(gradients)
    squares = np.einsum("nip,njp->nij", gradients, gradients).astype(np.float64)
    least, most = np.linalg.eigvalsh(squares).T
    told = (least > LEAST_ROUNDNESS * most) & (length >= LEAST_CONTRAST_GREY * np.sqrt(SAMPLES))
    steps = np.linalg.inv(squares[told]).astype(np.float32) @ gradients[told]
    slants = slants[told]
    slants -= np.einsum("nijk,nkp->nijp", np.einsum("nijp,nkp->nijk", slants, steps), gradients[told])
    products = np.einsum("nijp,nklp->nijkl", slants, slants)
    return Templates(int(level), index[told], patches[told], steps, slants, products)


def align(
    pyramid: Pyramid,
    given: list[Templates],
    start_px: FloatArray,
    across_mm: FloatArray,
    distance_mm: FloatArray,
    run: Callable[..., Any],
) -> tuple[FloatArray, FloatArray]:
    """Where in views the patches of keypoints are, from starts (views, n, 2), and how like them it looks there.

    Args:
        pyramid, given: of the views; the patches of the reference view.
        start_px: NaN where a view is not to be looked at.
        across_mm: positions (views, 2) of the views.
        distance_mm: (n,) about how far away the keypoints are.
        run: `map`, or that of a pool of threads.

    Returns:
        Pixels (views, n, 2); the likeness (views, n), the normalized cross-correlation: 0 for keypoints without a start
        or a template.
    """
    pixels, alike = start_px.copy(), np.zeros(start_px.shape[:2])
    for each in given:
        _align_level(pyramid, each, pixels, alike, across_mm, distance_mm[each.index], run)
    return pixels, alike


def _align_level(
    pyramid: Pyramid,
    each: Templates,
    pixels: FloatArray,
    alike: FloatArray,
    across_mm: FloatArray,
    distance_mm: FloatArray,
    run: Callable[..., Any],
) -> None:
    """Improve `pixels` and `alike`, in place, of the keypoints of one level."""
    slant = np.zeros((len(each.index), 2))
    step_px = 2.0**each.level

    def one(view: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Move patches in a view; the sides of the equations for the slant that it adds, and its squared differences."""
        rows = np.flatnonzero(np.isfinite(pixels[view, each.index, 0]))
        keypoints, position = each.index[rows], across_mm[view].astype(np.float32)
        where = (pixels[view, keypoints] / step_px).astype(np.float32)[:, None] + OFFSETS.T
        where -= (slant[rows].astype(np.float32) @ OFFSETS)[..., None] * position
        seen, _ = _normalized(pyramid.samples(view, each.level, where))
        difference = seen - each.patches[rows]
        like = np.einsum("np,np->n", seen, each.patches[rows])
        alike[view, keypoints] = like
        step = np.einsum("nkp,np->nk", each.steps[rows], difference).astype(np.float64)
        length = np.hypot(step[:, 0], step[:, 1])[:, None]
        pixels[view, keypoints] -= step * (step_px * np.minimum(1.0, MOST_STEP_PX / np.maximum(length, 1e-9)))
        told = rows[like >= LEAST_ALIKE_FOR_SLANT]
        right, left, squares = np.zeros_like(slant), np.zeros((*slant.shape, 2)), np.zeros(len(slant))
        difference = difference[like >= LEAST_ALIKE_FOR_SLANT]
        right[told] = -np.einsum("j,njkp,np->nk", position, each.slants[told], difference)
        left[told] = np.einsum("i,nijkl,k->njl", position, each.products[told], position)
        squares[told] = np.einsum("np,np->n", difference, difference)
        return right, left, squares

    views = range(len(pixels))
    for number in range(MOVING_ROUNDS + SLANTING_ROUNDS + 1):
        parts = list(run(one, views))
        if MOVING_ROUNDS <= number < MOVING_ROUNDS + SLANTING_ROUNDS:
            right, left, squares = (np.sum(part, axis=0) for part in zip(*parts, strict=True))
            count = np.maximum(sum((part[2] > 0).astype(np.float64) for part in parts), 1.0)
            noise = squares / (count * SAMPLES)
            prior = noise * (distance_mm / USUAL_SLANT) ** 2
            slant -= np.linalg.solve(left + (prior[:, None, None] + 1e-12) * np.eye(2), right[..., None])[..., 0]


def _normalized(patches: Floats) -> tuple[Floats, Floats]:
    """Patches (n, p) of mean zero and length one, and what their lengths were."""
    centred = patches - patches.mean(axis=1, keepdims=True)
    length = np.maximum(np.sqrt(np.einsum("np,np->n", centred, centred)), np.float32(1e-6))
    return centred / length[:, None], length
