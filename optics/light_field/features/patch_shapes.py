"""Shapes of the surfaces that patches lie on, from all views of a light field together.

With the inverse distance w + n.o + c(o) at an offset o, where c has powers of two and three, a view at p sees the
offset moved by -f p (n.o + c(o)). Residuals that move patches as no shape does tell how large they are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features.image_pyramid import Floats
from mirrorcam.optics.light_field.features.patches import SAMPLES, SHAPES, Templates

# Standard deviations of surfaces before anything is seen of them: tan(slant) (60 degrees), and how much it changes over
# half the side of the patch.
USUAL_SHAPE = np.array([1.7] * 2 + [0.7] * 7)
# Surfaces are no polynomials: what the curvatures, and what their changes, contribute to a slope has an error of this
# share of it. Measured on rendered scenes of rough surfaces.
UNSURE_SHARE = 0.4
ORDERS = np.repeat(np.eye(3)[:, 1:], [2, 3, 4], axis=0)
# w, d, e as matrices of slopes.
SLOPES = np.array([[[1.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, -1.0]], [[0.0, 1.0], [1.0, 0.0]]])
# Matrices of moves that no shape of a surface makes: across the view's position, and unlike ones along s and t.
NO_SHAPES = np.array([[[0.0, 1.0], [-1.0, 0.0]], SLOPES[1], SLOPES[2]])
# Of residuals of patches of length one: 8-bit pictures are no better, however alike they seem.
LEAST_VARIANCE = 1e-7


class PatchShapes:
    """Shapes (n, 9) of the surfaces of patches, from all views together, with a prior: few are seen edge-on."""

    def __init__(self, each: Templates, across_mm: Floats, distance_mm: FloatArray) -> None:
        self.each, self.across_mm = each, across_mm
        # tan(slant) and curvature are the shape's coefficients, 1/mm, times the distance.
        self.prior = (distance_mm[:, None] / USUAL_SHAPE) ** 2
        count = len(each.index)
        self.shape = np.zeros((count, len(SHAPES)), np.float32)
        self.variance = np.ones(count)
        self.normal = self.prior[:, :, None] * np.eye(len(SHAPES))

    def step(self, difference: Floats, usable: NDArray[np.bool_]) -> Floats:
        """Correct the shapes by differences (views, n, SAMPLES) in the views that tell them (views, n).

        Returns the move (views, n, 2) of the patches' middles for which the correction makes up.
        """
        each = self.each
        weighted = usable.astype(np.float32)[..., None] * self.across_mm[:, None]
        positions = np.einsum("vni,vj->nij", weighted, self.across_mm).astype(np.float64)
        slopes = weighted.transpose(1, 2, 0) @ difference.transpose(1, 0, 2)
        told = (each.shapes.reshape(len(slopes), -1, SAMPLES) @ slopes.transpose(0, 2, 1)).reshape(
            -1, len(SHAPES), 2, 2
        )
        count, shapes = len(told), len(SHAPES)
        prior = self.prior[:, :, None] * np.eye(shapes)
        information = positions.reshape(count, 1, 4) @ each.products.reshape(count, 4, shapes**2)
        self.normal = information.reshape(count, shapes, shapes) / self.variance[:, None, None] + prior
        right = np.einsum("nbkk->nb", told) / self.variance[:, None] - self.prior * self.shape
        change = np.linalg.solve(self.normal, right[..., None])
        explained = (each.products.reshape(count, 4 * shapes, shapes) @ change).reshape(count, 2, 2, shapes)
        explained = np.einsum("nkjb,nji->nbki", explained, positions)
        change = change[..., 0]
        self.variance = self._variance(told - explained, positions)
        self.shape += change.astype(np.float32)
        moved = np.einsum("nkbj,nb->nkj", each.leaning, change.astype(np.float32))
        return np.asarray(-(moved @ self.across_mm.T).transpose(2, 0, 1))

    def _variance(self, told: FloatArray, positions: FloatArray) -> FloatArray:
        """Variance (n,) of residuals by what they tell (n, 9, 2, 2) that no shape is: moves across epipolar lines."""
        squares = np.einsum("skj,nbkj->nsb", NO_SHAPES, told) ** 2
        moved = NO_SHAPES @ positions[:, None] @ NO_SHAPES.transpose(0, 2, 1)
        usual = np.einsum("nskm,nkmbb->nsb", moved, self.each.products)
        share = squares / np.maximum(usual, 1e-12)
        # Views in one line tell the first alone.
        values = np.linalg.eigvalsh(positions)
        flat = values[:, 0] < 1e-6 * values[:, 1]
        return np.maximum(np.where(flat, share[:, 0].mean(axis=1), share.mean(axis=(1, 2))), LEAST_VARIANCE)

    def covariance(self) -> FloatArray:
        """Covariance (n, 3, 3) of w, d, e by the uncertainty of the shapes, px of the level per mm."""
        moved = 0.5 * np.einsum("skj,nkbj->nsb", SLOPES, self.each.leaning.astype(np.float64))
        bent = np.einsum("nsb,nb,bo->nso", moved, self.shape, ORDERS) * UNSURE_SHARE
        return np.asarray(
            moved @ np.linalg.inv(self.normal) @ moved.transpose(0, 2, 1) + bent @ bent.transpose(0, 2, 1)
        )
