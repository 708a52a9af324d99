"""Sub-pixel alignment of what a keypoint shows in the reference view with what the other views show.

Inverse compositional Gauss-Newton (Baker and Matthews, IJCV 2004) on patches of mean zero and length one, so that views
need be neither equally bright nor equally rich in contrast. A patch moves by itself in each view; that it lies on a
slanted surface is estimated from all views together: with the inverse distance w + n.o at an offset o, a view at p sees
the offset moved by -f p (n.o). Left out, a slant would move patches by unlike amounts along s and t, as refraction
does.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.light_field.features.image_pyramid import RADIUS_PX, Floats, ImagePyramid

SIDE = 2 * RADIUS_PX + 1
SAMPLES = SIDE**2
# Rounds that move patches only, then rounds that also slant them, then the last one, which again moves only.
MOVING_ROUNDS = 2
SLANTING_ROUNDS = 2
# A step of more than a pixel of its scale is cut: the patches' gradients are not valid beyond it.
MOST_STEP_PX = 1.0
# Of the two directions of a patch, the worse one must have this part of the information of the better one.
LEAST_ROUNDNESS = 0.015
# A patch of less contrast (standard deviation in grey levels) shows noise.
LEAST_CONTRAST_GREY = 1.5
# Views that look less like the reference's patch say nothing of its slant.
LEAST_ALIKE_FOR_SLANT = 0.7
# Standard deviation of tan(slant) of surfaces before anything is seen of them: 60 degrees.
USUAL_TAN_SLANT = 1.7
KEYPOINTS_AT_ONCE = 128

_ACROSS, _DOWN = np.meshgrid(*[np.arange(-RADIUS_PX, RADIUS_PX + 1, dtype=np.float32)] * 2)
OFFSETS = np.stack([_ACROSS.ravel(), _DOWN.ravel()])


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
    steps
        Least-squares operator (m, 2, SAMPLES) from a difference from the patch to its move, px of the level.
    slants
        Change (m, 2, 2, SAMPLES) of the patch by a move along u and v in proportion to the offset along u and v, less
        the part that a move of the whole patch explains.
    products
        Inner products (m, 2, 2, 2, 2) of the slants with each other.
    leaning
        Apparent move (m, 2, 2, 2) of the whole patch along u and v by each of these moves, px of the level.
    """

    level: int
    index: NDArray[np.int64]
    patches: Floats
    steps: Floats
    slants: Floats
    products: Floats
    leaning: Floats


def templates(pyramid: ImagePyramid, view: int, pixels: FloatArray, scale_px: FloatArray) -> list[Templates]:
    """Templates for aligning keypoints (n, 2) of a view; those whose patch cannot be localised are left out."""
    level_of = pyramid.level_of(scale_px)
    return [
        _templates(pyramid, view, level, np.flatnonzero(level_of == level), pixels) for level in np.unique(level_of)
    ]


def _templates(pyramid: ImagePyramid, view: int, level: int, index: NDArray[np.int64], pixels: FloatArray) -> Templates:
    offset = np.arange(-RADIUS_PX - 1, RADIUS_PX + 2, dtype=np.float32)
    across, down = (each.ravel() for each in np.meshgrid(offset, offset))
    centre = (pixels[index] / 2**level).astype(np.float32) + pyramid.origins[level][view]
    wide = pyramid.samples(level, centre[:, :1] + across, centre[:, 1:] + down)
    wide = wide.reshape(len(index), SIDE + 2, SIDE + 2)
    patches, length = _normalized(wide[:, 1:-1, 1:-1].reshape(len(index), SAMPLES))
    gradients = np.stack([wide[:, 1:-1, 2:] - wide[:, 1:-1, :-2], wide[:, 2:, 1:-1] - wide[:, :-2, 1:-1]], axis=1)
    gradients = gradients.reshape(len(index), 2, SAMPLES) / (2.0 * length[:, None, None])

    def beyond_light(rows: Floats) -> Floats:
        """Remove from rows what free brightness and contrast explain."""
        rows = rows - rows.mean(axis=-1, keepdims=True)
        return rows - np.einsum("n...p,np->n...", rows, patches)[..., None] * patches.reshape(
            len(patches), *(1,) * (rows.ndim - 2), SAMPLES
        )

    slants = beyond_light(gradients[:, :, None] * OFFSETS)
    gradients = beyond_light(gradients)
    squares = np.einsum("nip,njp->nij", gradients, gradients).astype(np.float64)
    least, most = np.linalg.eigvalsh(squares).T
    usable = (least > LEAST_ROUNDNESS * most) & (length >= LEAST_CONTRAST_GREY * np.sqrt(SAMPLES))
    steps = np.linalg.inv(squares[usable]).astype(np.float32) @ gradients[usable]
    slants = slants[usable]
    leaning = np.einsum("nkp,nijp->nkij", steps, slants)
    slants -= np.einsum("nkij,nkp->nijp", leaning, gradients[usable])
    products = np.einsum("nijp,nklp->nijkl", slants, slants)
    return Templates(int(level), index[usable], patches[usable], steps, slants, products, leaning)


@dataclass(frozen=True, eq=False)
class AlignedPatches:
    """Positions at which views see the patches of keypoints.

    Attributes
    ----------
    pixels
        Pixels (views, n, 2) where the patches are seen; NaN where a view was not looked at.
    alike
        Normalized cross-correlation (views, n) with the patch; 0 where a view was not looked at, and for keypoints
        without a template.
    slant_covariance
        Covariance (n, 3, 3) of w, d, e (see `slope`) due to the uncertainty of the slants, as the whole movement in px
        per mm of view position. The error is common to all views, so that no residual shows it.
    """

    pixels: FloatArray
    alike: FloatArray
    slant_covariance: FloatArray


def align(
    pyramid: ImagePyramid,
    given: list[Templates],
    views: NDArray[np.int64],
    start_px: FloatArray,
    across_mm: FloatArray,
    distance_mm: FloatArray,
    run: Callable[..., Any] = map,
) -> AlignedPatches:
    """Move and slant the patches of keypoints until views look like them.

    Parameters
    ----------
    pyramid
        Image pyramid of all views.
    given
        Patches of the reference view.
    views
        Numbers of the views to look at.
    start_px
        Pixels (views, n, 2) where these are expected to see the keypoints; NaN where not to look.
    across_mm
        Positions (views, 2) of these views across the view axis.
    distance_mm
        Approximate distance (n,) of the keypoints.
    run
        `map`, or that of a pool of threads.
    """
    pixels, alike = start_px.copy(), np.zeros(start_px.shape[:2])
    covariance = np.zeros((start_px.shape[1], 3, 3))
    parts = [part for each in given for part in _parts(each)]

    def one(part: Templates) -> None:
        index = part.index
        pixels[:, index], alike[:, index], covariance[index] = _align_level(
            pyramid, part, views, start_px[:, index], across_mm.astype(np.float32), distance_mm[index]
        )

    list(run(one, parts))
    return AlignedPatches(pixels, alike, covariance)


def _parts(given: Templates) -> list[Templates]:
    """Templates in parts that fit into the caches of a processor's core, and keep several busy."""
    cuts = itertools.pairwise([*range(0, len(given.index), KEYPOINTS_AT_ONCE), len(given.index)])
    arrays = {field.name: getattr(given, field.name) for field in fields(given)}
    return [
        Templates(**{name: value if name == "level" else value[start:end] for name, value in arrays.items()})
        for start, end in cuts
    ]


def _align_level(
    pyramid: ImagePyramid,
    each: Templates,
    views: NDArray[np.int64],
    start_px: FloatArray,
    across_mm: Floats,
    distance_mm: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Align the keypoints of one level, as `align` does."""
    shape = (*start_px.shape[:2], SAMPLES)
    count = shape[1]
    looked = np.isfinite(start_px[..., 0])
    origin = pyramid.origins[each.level][views, None]
    # Places that are not looked at are computed with the rest, somewhere, and left out at the end.
    centre = np.where(looked[..., None], start_px, 0.0).astype(np.float32) / np.float32(2**each.level) + origin
    slant, covariance = np.zeros((count, 2), np.float32), np.zeros((count, 2, 2))
    alike = np.zeros(shape[:2], np.float32)
    across, down = (np.empty(shape, np.float32) for _ in range(2))
    for number in range(MOVING_ROUNDS + SLANTING_ROUNDS + 1):
        np.add(centre[..., :1], OFFSETS[0], out=across)
        np.add(centre[..., 1:], OFFSETS[1], out=down)
        if number > MOVING_ROUNDS:
            moved = slant @ OFFSETS
            across -= across_mm[:, 0, None, None] * moved
            down -= across_mm[:, 1, None, None] * moved
        flat = pyramid.samples(each.level, across.reshape(-1, SAMPLES), down.reshape(-1, SAMPLES))
        difference, _ = _normalized(flat)
        difference = difference.reshape(shape)
        alike = np.einsum("vnp,np->vn", difference, each.patches)
        difference -= each.patches
        if MOVING_ROUNDS <= number < MOVING_ROUNDS + SLANTING_ROUNDS:
            usable = (looked & (alike >= LEAST_ALIKE_FOR_SLANT)).astype(np.float32)
            step, covariance = _slant_step(each, difference, usable, across_mm, distance_mm)
            slant -= step
        step = np.einsum("nkp,vnp->vnk", each.steps, difference)
        length = np.sqrt((step**2).sum(axis=-1, keepdims=True))
        centre -= step * np.minimum(1.0, MOST_STEP_PX / np.maximum(length, np.float32(1e-9)))
    pixels = (centre - origin).astype(np.float64) * 2**each.level
    leaning = each.leaning.astype(np.float64) * 2**each.level
    slant_per_pixel = np.stack(
        [
            leaning[:, 0, 0] + leaning[:, 1, 1],
            leaning[:, 0, 0] - leaning[:, 1, 1],
            leaning[:, 0, 1] + leaning[:, 1, 0],
        ],
        axis=1,
    )
    covariance = slant_per_pixel @ covariance @ slant_per_pixel.transpose(0, 2, 1) / 4.0
    return np.where(looked[..., None], pixels, np.nan), np.where(looked, alike, 0.0).astype(np.float64), covariance


def _slant_step(
    each: Templates, difference: Floats, usable: Floats, across_mm: Floats, distance_mm: FloatArray
) -> tuple[Floats, FloatArray]:
    """Corrections (n, 2) to subtract from the slants, and their covariance (n, 2, 2).

    Least squares over differences (views, n, SAMPLES) in the views that tell it (views, n), with a prior: surfaces are
    not seen edge-on.
    """
    weighted = usable[..., None] * across_mm[:, None]
    right = -np.einsum("njkp,njp->nk", each.slants, np.einsum("vnj,vnp->njp", weighted, difference))
    positions = np.einsum("vni,vj->nij", weighted, across_mm)
    left = np.einsum("nij,nikjl->nkl", positions, each.products).astype(np.float64)
    squares = np.einsum("vn,vnp,vnp->n", usable, difference, difference)
    noise = squares / (np.maximum(usable.sum(axis=0), 1.0) * SAMPLES)
    # tan(slant) is the slant's coefficient, 1/mm, times the distance.
    prior = np.maximum(noise, 1e-9) * (distance_mm / USUAL_TAN_SLANT) ** 2
    left += prior[:, None, None] * np.eye(2)
    inverse = np.linalg.inv(left)
    return np.einsum("nkl,nl->nk", inverse, right).astype(np.float32), noise[:, None, None] * inverse


def _normalized(patches: Floats) -> tuple[Floats, Floats]:
    """Patches (n, p) of mean zero and length one, and what their lengths were."""
    centred = patches - patches.mean(axis=1, keepdims=True)
    length = np.maximum(np.sqrt(np.einsum("np,np->n", centred, centred)), np.float32(1e-6))
    return centred / length[:, None], length
