"""Sub-pixel alignment of keypoints' patches from the reference view with the other views.

Inverse compositional Gauss-Newton (Baker and Matthews, IJCV 2004) on patches of zero mean and unit length, so views may
differ in brightness and contrast. A patch shifts separately in each view, while the shape of its surface, slanted and
curved, is estimated from all views jointly: with the inverse distance w + n.o + c(o) at an offset o, where c holds
powers of two and three, a view at p sees the offset shifted by -f p (n.o + c(o)). Without a shape, shifts along s and t
would differ, as by refraction. The part of the residuals that no shape explains gives the noise.
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
# Minimum correlation of a view with the reference patch for it to contribute to the shape.
MIN_CORRELATION_FOR_SHAPE = 0.7
KEYPOINTS_PER_BATCH = 128
# Prior standard deviations of surfaces: tan(slant) (60 degrees), and its change over half the side of the patch.
SHAPE_SIGMAS = np.array([1.7] * 2 + [0.7] * 7)
# Relative error of the contributions of curvatures and their changes to a slope, because surfaces are not polynomials;
# measured on rendered scenes of rough surfaces.
POLYNOMIAL_ERROR = 0.4
ORDERS = np.repeat(np.eye(3)[:, 1:], [2, 3, 4], axis=0)
# Matrices of the slopes w, d, e.
SLOPE_MATRICES = np.array([[[1.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, -1.0]], [[0.0, 1.0], [1.0, 0.0]]])
# Matrices of shifts that no surface causes: perpendicular to the view's position, and different ones along s and t.
NON_SURFACE_MATRICES = np.array([[[0.0, 1.0], [-1.0, 0.0]], SLOPE_MATRICES[1], SLOPE_MATRICES[2]])
# Minimum residual variance of patches of unit length: 8-bit pictures are not better, however similar.
MIN_VARIANCE = 1e-7


@dataclass(frozen=True, eq=False)
class PatchWarp:
    """Warp of patches into views of another light field: rotated, scaled, sheared, and bent by their surfaces.

    Attributes
    ----------
    linear
        Matrices (n, 2, 2) from shifts in the patch to shifts in a view.
    bend, shapes
        Position (n, 2) of the patch's view relative to the other view, mm, and coefficients (n, 9) of SHAPES that shift
        the patch's samples along it, in addition to `linear`.
    """

    linear: FloatArray
    bend: FloatArray
    shapes: FloatArray

    @classmethod
    def identity(cls, count: int) -> PatchWarp:
        return cls(np.broadcast_to(np.eye(2), (count, 2, 2)), np.zeros((count, 2)), np.zeros((count, len(SHAPES))))

    def take(self, index: NDArray[np.int64]) -> PatchWarp:
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
        Variance (n,) of residuals, from the part proportional to the views' positions, as the residuals of a wrong
        slope are: it does not decrease with more views if their errors are equal.
    shape_covariance
        Covariance (n, 3, 3) of w, d, e (see `slope`) from the uncertainty of the shapes, which shifts the entire patch,
        in px per mm of view position. The error is common to all views, so residuals do not reveal it.
    shapes
        Coefficients (n, 9) of SHAPES, px of the level per mm. The first two are also the derivative of the inverse
        distance with respect to direction in the template's view, 1/mm.
    """

    pixels: FloatArray
    correlation: FloatArray
    precision: FloatArray
    variance: FloatArray
    shape_covariance: FloatArray
    shapes: FloatArray


def align(
    pyramid: ImagePyramid,
    templates: list[Templates],
    views: NDArray[np.int64],
    start_px: FloatArray,
    lateral_mm: FloatArray,
    distance_mm: FloatArray,
    run: Callable[..., Any] = map,
    warp: PatchWarp | None = None,
) -> AlignedPatches:
    """Align the patches of keypoints with views, with shifts and surface shapes.

    Parameters
    ----------
    pyramid
        Image pyramid of all views.
    templates
        Patches of the reference view.
    views
        Indices of the views to align.
    start_px
        Expected pixels (views, n, 2) of the keypoints; NaN to skip a view.
    lateral_mm
        Positions (views, 2) of these views in the plane normal to the view axis.
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
    used_warp = PatchWarp.identity(count) if warp is None else warp
    batches = [batch for level_templates in templates for batch in _batches(level_templates)]

    def align_batch(batch: Templates) -> None:
        index = batch.index
        aligned = _align_level(
            *(pyramid, batch, views, start_px[:, index]),
            *(lateral_mm.astype(np.float32), distance_mm[index], used_warp.take(index)),
        )
        pixels[:, index], correlation[:, index] = aligned.pixels, aligned.correlation
        precision[index], variance[index], covariance[index] = (
            aligned.precision,
            aligned.variance,
            aligned.shape_covariance,
        )
        shapes[index] = aligned.shapes

    list(run(align_batch, batches))
    return AlignedPatches(pixels, correlation, precision, variance, covariance, shapes)


def _batches(templates: Templates) -> list[Templates]:
    """Split templates into batches that fit a core's cache and keep several cores busy."""
    bounds = itertools.pairwise([*range(0, len(templates.index), KEYPOINTS_PER_BATCH), len(templates.index)])
    arrays = {field.name: getattr(templates, field.name) for field in fields(templates)}
    shared: dict[str, Any] = {name: arrays.pop(name) for name in ("level", "window")}
    return [Templates(**shared, **{name: value[start:end] for name, value in arrays.items()}) for start, end in bounds]


def _align_level(
    pyramid: ImagePyramid,
    template: Templates,
    views: NDArray[np.int64],
    start_px: FloatArray,
    lateral_mm: Floats,
    distance_mm: FloatArray,
    warp: PatchWarp,
) -> AlignedPatches:
    """Align the keypoints of one level; see `align`."""
    linear = warp.linear.astype(np.float32)
    offsets = linear @ OFFSETS + (warp.bend[:, :, None] * (warp.shapes @ SHAPES)[:, None]).astype(np.float32)
    shape = (*start_px.shape[:2], SAMPLES)
    used = np.isfinite(start_px[..., 0])
    origin = pyramid.origins[template.level][views, None]
    # Skipped positions are computed with the others, at arbitrary pixels, and discarded at the end.
    centre = np.where(used[..., None], start_px, 0.0).astype(np.float32) / np.float32(2**template.level) + origin
    patch_shapes = PatchShapes(template, lateral_mm, distance_mm)
    correlation = np.zeros(shape[:2], np.float32)
    u, v = (np.empty(shape, np.float32) for _ in range(2))
    for round_number in range(SHIFT_ROUNDS + SHAPE_ROUNDS):
        np.add(centre[..., :1], offsets[:, 0], out=u)
        np.add(centre[..., 1:], offsets[:, 1], out=v)
        if round_number > SHIFT_ROUNDS:
            shape_shift = patch_shapes.shape @ SHAPES
            u -= lateral_mm[:, 0, None, None] * shape_shift
            v -= lateral_mm[:, 1, None, None] * shape_shift
        samples = pyramid.samples(
            template.level, u.reshape(-1, SAMPLES), v.reshape(-1, SAMPLES), exact=round_number >= SHIFT_ROUNDS
        )
        difference, _ = normalized(samples, template.window)
        difference = difference.reshape(shape)
        correlation = np.einsum("vnp,np->vn", difference, template.patches)
        difference -= template.patches
        step = (template.steps @ difference.transpose(1, 2, 0)).transpose(2, 0, 1)
        if round_number >= SHIFT_ROUNDS:
            step = step + patch_shapes.step(difference, used & (correlation >= MIN_CORRELATION_FOR_SHAPE))
        step = (linear @ step[..., None])[..., 0]
        length = np.sqrt((step**2).sum(axis=-1, keepdims=True))
        centre -= step * np.minimum(1.0, MAX_STEP_PX / np.maximum(length, np.float32(1e-9)))
    return AlignedPatches(
        pixels=np.where(used[..., None], (centre - origin).astype(np.float64) * 2**template.level, np.nan),
        correlation=np.where(used, correlation, 0.0).astype(np.float64),
        precision=(template.gradients @ template.gradients.transpose(0, 2, 1)).astype(np.float64) / 4.0**template.level,
        variance=patch_shapes.variance,
        shape_covariance=patch_shapes.covariance() * 4.0**template.level,
        shapes=patch_shapes.shape.astype(np.float64),
    )


class PatchShapes:
    """Shapes (n, 9) of the patches' surfaces from all views jointly, with a prior, as few surfaces are seen edge-on."""

    def __init__(self, template: Templates, lateral_mm: Floats, distance_mm: FloatArray) -> None:
        self.template, self.lateral_mm = template, lateral_mm
        # tan(slant) and curvature are the shape's coefficients, 1/mm, times the distance.
        self.prior = (distance_mm[:, None] / SHAPE_SIGMAS) ** 2
        count = len(template.index)
        self.shape = np.zeros((count, len(SHAPES)), np.float32)
        self.variance = np.ones(count)
        self.normal = self.prior[:, :, None] * np.eye(len(SHAPES))

    def step(self, difference: Floats, usable: NDArray[np.bool_]) -> Floats:
        """Update the shapes from differences (views, n, SAMPLES) in the usable views (views, n).

        Returns the shifts (views, n, 2) of the patches' centres that compensate the update.
        """
        template = self.template
        weighted = usable.astype(np.float32)[..., None] * self.lateral_mm[:, None]
        positions = np.einsum("vni,vj->nij", weighted, self.lateral_mm).astype(np.float64)
        slopes = weighted.transpose(1, 2, 0) @ difference.transpose(1, 0, 2)
        projected = (template.shapes.reshape(len(slopes), -1, SAMPLES) @ slopes.transpose(0, 2, 1)).reshape(
            -1, len(SHAPES), 2, 2
        )
        count, shapes = len(projected), len(SHAPES)
        prior = self.prior[:, :, None] * np.eye(shapes)
        information = positions.reshape(count, 1, 4) @ template.products.reshape(count, 4, shapes**2)
        self.normal = information.reshape(count, shapes, shapes) / self.variance[:, None, None] + prior
        rhs = np.einsum("nbkk->nb", projected) / self.variance[:, None] - self.prior * self.shape
        change = np.linalg.solve(self.normal, rhs[..., None])
        explained = (template.products.reshape(count, 4 * shapes, shapes) @ change).reshape(count, 2, 2, shapes)
        explained = np.einsum("nkjb,nji->nbki", explained, positions)
        change = change[..., 0]
        self.variance = self._variance(projected - explained, positions)
        self.shape += change.astype(np.float32)
        shift = np.einsum("nkbj,nb->nkj", template.centre_shifts, change.astype(np.float32))
        return np.asarray(-(shift @ self.lateral_mm.T).transpose(2, 0, 1))

    def _variance(self, projected: FloatArray, positions: FloatArray) -> FloatArray:
        """Return residual variances (n,) from the part (n, 9, 2, 2) that no shape explains, off the epipolar lines."""
        squares = np.einsum("skj,nbkj->nsb", NON_SURFACE_MATRICES, projected) ** 2
        transformed = NON_SURFACE_MATRICES @ positions[:, None] @ NON_SURFACE_MATRICES.transpose(0, 2, 1)
        expected = np.einsum("nskm,nkmbb->nsb", transformed, self.template.products)
        ratio = squares / np.maximum(expected, 1e-12)
        # Collinear views determine only the first ratio.
        values = np.linalg.eigvalsh(positions)
        collinear = values[:, 0] < 1e-6 * values[:, 1]
        return np.maximum(np.where(collinear, ratio[:, 0].mean(axis=1), ratio.mean(axis=(1, 2))), MIN_VARIANCE)

    def covariance(self) -> FloatArray:
        """Return the covariance (n, 3, 3) of w, d, e from the uncertainty of the shapes, (px of the level per mm)^2."""
        slopes = 0.5 * np.einsum("skj,nkbj->nsb", SLOPE_MATRICES, self.template.centre_shifts.astype(np.float64))
        polynomial_error = np.einsum("nsb,nb,bo->nso", slopes, self.shape, ORDERS) * POLYNOMIAL_ERROR
        return np.asarray(
            slopes @ np.linalg.inv(self.normal) @ slopes.transpose(0, 2, 1)
            + polynomial_error @ polynomial_error.transpose(0, 2, 1)
        )
