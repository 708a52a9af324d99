"""Sub-pixel alignment of keypoints' patches from the reference view with the other views.

Inverse compositional Gauss-Newton (Baker and Matthews, IJCV 2004) on patches normalised to mean zero and length one, so
views may differ in brightness and contrast. A patch shifts separately in each view, while the shape of its surface,
slanted and curved, is estimated from all views jointly: with the inverse distance w + n.o + c(o) at an offset o, where
c holds powers of two and three, a view at p sees the offset shifted by -f p (n.o + c(o)). Without a shape, shifts along
s and t would differ, as by refraction. The part of the residuals that no shape explains gives the noise.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features.patches import (
    OFFSETS,
    SAMPLES,
    SHAPES,
    Floats,
    ImagePyramid,
    Templates,
    normalized,
)

# Rounds that shift patches only, then rounds that also estimate shapes.
SHIFT_ROUNDS = 2
SHAPE_ROUNDS = 3
# Steps are limited to a pixel of the level, beyond which the patches' gradients are invalid.
MAX_STEP_PX = 1.0
# Least similarity of a view to the reference patch, to contribute to the shape.
MIN_CORRELATION_FOR_SHAPE = 0.7
KEYPOINTS_AT_ONCE = 128
# Prior standard deviations of surfaces: tan(slant) (60 degrees), and its change over half the side of the patch.
SHAPE_SIGMAS = np.array([1.7] * 2 + [0.7] * 7)
# Surfaces are no polynomials: the contributions of curvatures and their changes to a slope have errors of this share,
# measured on rendered scenes of rough surfaces.
POLYNOMIAL_ERROR = 0.4
ORDERS = np.repeat(np.eye(3)[:, 1:], [2, 3, 4], axis=0)
# Matrices of the slopes w, d, e.
SLOPES = np.array([[[1.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, -1.0]], [[0.0, 1.0], [1.0, 0.0]]])
# Matrices of shifts that no surface causes: across the view's position, and different ones along s and t.
NO_SHAPES = np.array([[[0.0, 1.0], [-1.0, 0.0]], SLOPES[1], SLOPES[2]])
# Least residual variance of patches of length one: 8-bit pictures are no better, however similar.
MIN_VARIANCE = 1e-7


@dataclass(frozen=True, eq=False)
class PatchWarp:
    """Warp of patches into views of another light field: rotated, scaled, sheared, and bent by their surfaces.

    Attributes
    ----------
    linear
        Shifts (n, 2, 2) in a view by shifts in the patch.
    bend, shapes
        Position (n, 2) of the patch's view relative to that view, mm, and coefficients (n, 9) of SHAPES that shift the
        patch along it, in addition to `linear`.
    """

    linear: FloatArray
    bend: FloatArray
    shapes: FloatArray

    @classmethod
    def none(cls, count: int) -> PatchWarp:
        return cls(np.broadcast_to(np.eye(2), (count, 2, 2)), np.zeros((count, 2)), np.zeros((count, len(SHAPES))))

    def of(self, index: NDArray[np.int64]) -> PatchWarp:
        return PatchWarp(self.linear[index], self.bend[index], self.shapes[index])


@dataclass(frozen=True, eq=False)
class AlignedPatches:
    """Positions of keypoints' patches in views.

    Attributes
    ----------
    pixels
        Pixels (views, n, 2) of the patches; NaN where a view was skipped.
    correlation
        Normalised cross-correlation (views, n) with the patch; 0 where a view was skipped, and for keypoints without a
        template.
    precision
        Inverse covariance (n, 2, 2) of a pixel in any view, for residuals of unit variance, 1/px^2.
    variance
        Variance (n,) of residuals, from their part proportional to the views' positions, as a wrong slope's residuals
        are: it does not decrease with more views if their errors are equal.
    shape_covariance
        Covariance (n, 3, 3) of w, d, e (see `slope`) from the uncertainty of the shapes, as a shift of the entire patch
        in px per mm of view position. The error is common to all views, so residuals do not reveal it.
    shapes
        Coefficients (n, 9) of SHAPES, px of the level per mm. The first two are also the derivative of the inverse
        distance by direction in the template's view, 1/mm.
    """

    pixels: FloatArray
    correlation: FloatArray
    precision: FloatArray
    variance: FloatArray
    shape_covariance: FloatArray
    shapes: FloatArray


def align(
    pyramid: ImagePyramid,
    given: list[Templates],
    views: NDArray[np.int64],
    start_px: FloatArray,
    across_mm: FloatArray,
    distance_mm: FloatArray,
    run: Callable[..., Any] = map,
    warp: PatchWarp | None = None,
) -> AlignedPatches:
    """Align the patches of keypoints with views, with shifts and surface shapes.

    Parameters
    ----------
    pyramid
        Image pyramid of all views.
    given
        Patches of the reference view.
    views
        Numbers of the views to align.
    start_px
        Expected pixels (views, n, 2) of the keypoints; NaN to skip a view.
    across_mm
        Positions (views, 2) of these views across the view axis.
    distance_mm
        Approximate distance (n,) of the keypoints.
    run
        `map`, or the `map` of a thread pool.
    warp
        Warp of the patches into the views, if they belong to another light field.
    """
    pixels, correlation = start_px.copy(), np.zeros(start_px.shape[:2])
    count = start_px.shape[1]
    precision, variance, covariance = np.zeros((count, 2, 2)), np.ones(count), np.zeros((count, 3, 3))
    precision[:] = np.eye(2)
    shapes = np.zeros((count, len(SHAPES)))
    used_warp = PatchWarp.none(count) if warp is None else warp
    parts = [part for each in given for part in _parts(each)]

    def align_part(part: Templates) -> None:
        index = part.index
        found = _align_level(
            *(pyramid, part, views, start_px[:, index]),
            *(across_mm.astype(np.float32), distance_mm[index], used_warp.of(index)),
        )
        pixels[:, index], correlation[:, index] = found.pixels, found.correlation
        precision[index], variance[index], covariance[index] = found.precision, found.variance, found.shape_covariance
        shapes[index] = found.shapes

    list(run(align_part, parts))
    return AlignedPatches(pixels, correlation, precision, variance, covariance, shapes)


def _parts(given: Templates) -> list[Templates]:
    """Split templates into parts that fit a core's cache and keep several cores busy."""
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
    warp: PatchWarp,
) -> AlignedPatches:
    """Align the keypoints of one level; see `align`."""
    linear = warp.linear.astype(np.float32)
    offsets = linear @ OFFSETS + (warp.bend[:, :, None] * (warp.shapes @ SHAPES)[:, None]).astype(np.float32)
    shape = (*start_px.shape[:2], SAMPLES)
    aligned = np.isfinite(start_px[..., 0])
    origin = pyramid.origins[each.level][views, None]
    # Skipped positions are computed with the others, at arbitrary pixels, and discarded at the end.
    centre = np.where(aligned[..., None], start_px, 0.0).astype(np.float32) / np.float32(2**each.level) + origin
    patch_shapes = PatchShapes(each, across_mm, distance_mm)
    correlation = np.zeros(shape[:2], np.float32)
    across, down = (np.empty(shape, np.float32) for _ in range(2))
    for number in range(SHIFT_ROUNDS + SHAPE_ROUNDS):
        np.add(centre[..., :1], offsets[:, 0], out=across)
        np.add(centre[..., 1:], offsets[:, 1], out=down)
        if number > SHIFT_ROUNDS:
            shape_shift = patch_shapes.shape @ SHAPES
            across -= across_mm[:, 0, None, None] * shape_shift
            down -= across_mm[:, 1, None, None] * shape_shift
        flat = pyramid.samples(
            each.level, across.reshape(-1, SAMPLES), down.reshape(-1, SAMPLES), exact=number >= SHIFT_ROUNDS
        )
        difference, _ = normalized(flat)
        difference = difference.reshape(shape)
        correlation = np.einsum("vnp,np->vn", difference, each.patches)
        difference -= each.patches
        step = (each.steps @ difference.transpose(1, 2, 0)).transpose(2, 0, 1)
        if number >= SHIFT_ROUNDS:
            step = step + patch_shapes.step(difference, aligned & (correlation >= MIN_CORRELATION_FOR_SHAPE))
        step = (linear @ step[..., None])[..., 0]
        length = np.sqrt((step**2).sum(axis=-1, keepdims=True))
        centre -= step * np.minimum(1.0, MAX_STEP_PX / np.maximum(length, np.float32(1e-9)))
    return AlignedPatches(
        pixels=np.where(aligned[..., None], (centre - origin).astype(np.float64) * 2**each.level, np.nan),
        correlation=np.where(aligned, correlation, 0.0).astype(np.float64),
        precision=(each.gradients @ each.gradients.transpose(0, 2, 1)).astype(np.float64) / 4.0**each.level,
        variance=patch_shapes.variance,
        shape_covariance=patch_shapes.covariance() * 4.0**each.level,
        shapes=patch_shapes.shape.astype(np.float64),
    )


class PatchShapes:
    """Shapes (n, 9) of the patches' surfaces from all views jointly, with a prior, because few are seen edge-on."""

    def __init__(self, each: Templates, across_mm: Floats, distance_mm: FloatArray) -> None:
        self.each, self.across_mm = each, across_mm
        # tan(slant) and curvature are the shape's coefficients, 1/mm, times the distance.
        self.prior = (distance_mm[:, None] / SHAPE_SIGMAS) ** 2
        count = len(each.index)
        self.shape = np.zeros((count, len(SHAPES)), np.float32)
        self.variance = np.ones(count)
        self.normal = self.prior[:, :, None] * np.eye(len(SHAPES))

    def step(self, difference: Floats, usable: NDArray[np.bool_]) -> Floats:
        """Update the shapes from differences (views, n, SAMPLES) in the usable views (views, n).

        Returns the shift (views, n, 2) of the patches' centres that compensates the update.
        """
        each = self.each
        weighted = usable.astype(np.float32)[..., None] * self.across_mm[:, None]
        positions = np.einsum("vni,vj->nij", weighted, self.across_mm).astype(np.float64)
        slopes = weighted.transpose(1, 2, 0) @ difference.transpose(1, 0, 2)
        projected = (each.shapes.reshape(len(slopes), -1, SAMPLES) @ slopes.transpose(0, 2, 1)).reshape(
            -1, len(SHAPES), 2, 2
        )
        count, shapes = len(projected), len(SHAPES)
        prior = self.prior[:, :, None] * np.eye(shapes)
        information = positions.reshape(count, 1, 4) @ each.products.reshape(count, 4, shapes**2)
        self.normal = information.reshape(count, shapes, shapes) / self.variance[:, None, None] + prior
        rhs = np.einsum("nbkk->nb", projected) / self.variance[:, None] - self.prior * self.shape
        change = np.linalg.solve(self.normal, rhs[..., None])
        explained = (each.products.reshape(count, 4 * shapes, shapes) @ change).reshape(count, 2, 2, shapes)
        explained = np.einsum("nkjb,nji->nbki", explained, positions)
        change = change[..., 0]
        self.variance = self._variance(projected - explained, positions)
        self.shape += change.astype(np.float32)
        shift = np.einsum("nkbj,nb->nkj", each.leaning, change.astype(np.float32))
        return np.asarray(-(shift @ self.across_mm.T).transpose(2, 0, 1))

    def _variance(self, projected: FloatArray, positions: FloatArray) -> FloatArray:
        """Variance (n,) of residuals from the part (n, 9, 2, 2) that no shape explains, across epipolar lines."""
        squares = np.einsum("skj,nbkj->nsb", NO_SHAPES, projected) ** 2
        transformed = NO_SHAPES @ positions[:, None] @ NO_SHAPES.transpose(0, 2, 1)
        expected = np.einsum("nskm,nkmbb->nsb", transformed, self.each.products)
        share = squares / np.maximum(expected, 1e-12)
        # Collinear views determine only the first.
        values = np.linalg.eigvalsh(positions)
        flat = values[:, 0] < 1e-6 * values[:, 1]
        return np.maximum(np.where(flat, share[:, 0].mean(axis=1), share.mean(axis=(1, 2))), MIN_VARIANCE)

    def covariance(self) -> FloatArray:
        """Covariance (n, 3, 3) of w, d, e from the uncertainty of the shapes, px of the level per mm."""
        slopes = 0.5 * np.einsum("skj,nkbj->nsb", SLOPES, self.each.leaning.astype(np.float64))
        polynomial_error = np.einsum("nsb,nb,bo->nso", slopes, self.shape, ORDERS) * POLYNOMIAL_ERROR
        return np.asarray(
            slopes @ np.linalg.inv(self.normal) @ slopes.transpose(0, 2, 1)
            + polynomial_error @ polynomial_error.transpose(0, 2, 1)
        )
