"""The spline lens: a Brown-Conrady lens with a correction field of cubic B-splines over the view."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.bounds import Bounds
from mirrorcam.core.values import FloatArray, Value
from mirrorcam.optics.geometry.lenses.lens import Lens, Linearized
from mirrorcam.optics.geometry.lenses.polynomial import BrownConrady

FIELD_SIGMA = 3e-4
"""Prior standard deviation of the field, in distorted coordinates: 0.4 px for a webcam. Without data, it is 0."""
CELLS = 12
"""Cells along the longer side of the field. Waves of six cells are met to 1e-3 of their height."""
DIRECTIONS, RADII = 24, 24  # samples of the field's Jacobian
_CONTROLS = Bounds(4, 64)
_REACH = Bounds(1e-3, 100.0)


class LensGrid(Value):
    """Control points of a spline lens, row by row over a rectangle about the axis.

    Coordinates are stereographic: a ray at the angle a lies 2 tan(a / 2) from the axis.

    Attributes
    ----------
    cols, rows : int
        Number of control points, three more than cells.
    reach_x, reach_y : float
        Half the sides of the rectangle.
    """

    cols: int = _CONTROLS.field()
    rows: int = _CONTROLS.field()
    reach_x: float = _REACH.field()
    reach_y: float = _REACH.field()

    @classmethod
    def covering(cls, normalized: FloatArray) -> Self:
        """The grid of nearly square cells that covers rays with normalized coordinates (n, 2)."""
        x, y = np.abs(normalized).T
        half = 2.0 / (1.0 + np.sqrt(1.0 + x * x + y * y))
        reach = 1.02 * np.array([(half * x).max(), (half * y).max()])
        cols, rows = np.maximum(np.rint(CELLS * reach / reach.max()), 1).astype(int).tolist()
        return cls(cols=cols + 3, rows=rows + 3, reach_x=float(reach[0]), reach_y=float(reach[1]))

    @property
    def count(self) -> int:
        """Number of control points."""
        return self.cols * self.rows


@dataclass(frozen=True)
class _Weights:
    """The 16 control points (16, n) of each ray, their weights, and the derivatives d weights / du, dv."""

    index: NDArray[np.int64]
    weight: FloatArray
    d_u: FloatArray
    d_v: FloatArray


@dataclass(frozen=True)
class Spline(Lens):
    """Lens with the coefficients k1, k2, p1, p2, k3, then the field's x and then its y at all control points.

    The field is added to the distorted coordinates of the Brown-Conrady lens. It is twice differentiable over the
    grid's rectangle; outside, it keeps its value at the border. After the splined stereographic model of mrcal.
    """

    grid: LensGrid

    @property
    def names(self) -> tuple[str, ...]:
        nodes = [f"{row}-{col}" for row in range(self.grid.rows) for col in range(self.grid.cols)]
        return (*BrownConrady.NAMES, *(f"field {axis} {node}" for axis in "xy" for node in nodes))

    @property
    def _brown_conrady(self) -> BrownConrady:
        return BrownConrady(self.coefficients[:5])

    @property
    def _field(self) -> FloatArray:
        """The field's coefficients (2, controls)."""
        return self.coefficients[5:].reshape(2, -1)

    def _weights(self, u: FloatArray, v: FloatArray) -> _Weights:
        """The weights of the control points at stereographic coordinates (n,)."""
        col, weights_u, d_weights_u = _basis(u, self.grid.reach_x, self.grid.cols)
        row, weights_v, d_weights_v = _basis(v, self.grid.reach_y, self.grid.rows)
        step = np.arange(4)[:, None]
        index = ((row + step)[:, None] * self.grid.cols + (col + step)[None]).reshape(16, -1)
        return _Weights(
            index,
            (weights_v[:, None] * weights_u[None]).reshape(16, -1),
            (weights_v[:, None] * d_weights_u[None]).reshape(16, -1),
            (d_weights_v[:, None] * weights_u[None]).reshape(16, -1),
        )

    def distorted(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        xd, yd = self._brown_conrady.distorted(x, y)
        half = 2.0 / (1.0 + np.sqrt(1.0 + x * x + y * y))
        weights = self._weights((half * x).ravel(), (half * y).ravel())
        dx, dy = np.einsum("akn,kn->an", self._field[:, weights.index], weights.weight)
        return xd + dx.reshape(np.shape(x)), yd + dy.reshape(np.shape(y))

    def linearized(self, x: FloatArray, y: FloatArray, focal: tuple[float, float], out: FloatArray) -> Linearized:
        base = self._brown_conrady.linearized(x, y, focal, out[:, :, :5])
        root = np.sqrt(1.0 + x * x + y * y)
        half, d_half = 2.0 / (1.0 + root), -2.0 / (root * (1.0 + root) ** 2)  # d_half: d half / dx, divided by x
        weights = self._weights(half * x, half * y)
        controls = self._field[:, weights.index]
        dx, dy = np.einsum("akn,kn->an", controls, weights.weight)
        (x_u, y_u), (x_v, y_v) = (np.einsum("akn,kn->an", controls, d) for d in (weights.d_u, weights.d_v))
        u_x, cross, v_y = half + d_half * x * x, d_half * x * y, half + d_half * y * y
        rows, count = np.arange(len(x)), self.grid.count
        for index, weight in zip(weights.index, weights.weight, strict=True):
            out[rows, 0, 5 + index] = focal[0] * weight
            out[rows, 1, 5 + count + index] = focal[1] * weight
        return Linearized(
            base.x + dx,
            base.y + dy,
            base.xx + x_u * u_x + x_v * cross,
            base.xy + x_u * cross + x_v * v_y,
            base.yx + y_u * u_x + y_v * cross,
            base.yy + y_u * cross + y_v * v_y,
        )

    @property
    def valid_radius(self) -> float:
        """Smallest radius at which the Brown-Conrady lens stops increasing or the field makes the mapping ambiguous."""
        max_radius = min(self._brown_conrady.valid_radius, 1.5 * float(np.hypot(*self._normalized_reach)))
        angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
        radius = np.repeat(max_radius * (np.arange(RADII) + 1.0) / RADII, DIRECTIONS)
        x, y = radius * np.tile(np.cos(angle), RADII), radius * np.tile(np.sin(angle), RADII)
        lens = self.linearized(x, y, (1.0, 1.0), np.zeros((len(x), 2, len(self.coefficients))))
        folded = radius[lens.xx * lens.yy - lens.xy * lens.yx <= 0.0]
        return float(folded.min()) if folded.size else self._brown_conrady.valid_radius

    @property
    def _normalized_reach(self) -> tuple[float, float]:
        """Normalized coordinates of the ends of the grid's axes; 1e3 for ends beyond 90 degrees."""
        ends = np.array([self.grid.reach_x, self.grid.reach_y])
        x, y = np.where(ends < 1.99, ends / np.maximum(1.0 - (ends / 2.0) ** 2, 1e-3), 1e3)
        return float(x), float(y)

    @property
    def prior_sigmas(self) -> FloatArray:
        sigmas = np.full(len(self.coefficients), FIELD_SIGMA)
        sigmas[:5] = np.inf
        return sigmas

    def flipped(self, axis: int) -> Self:
        field = np.flip(self._field.reshape(2, self.grid.rows, self.grid.cols), axis=2 - axis).copy()
        field[axis] *= -1.0
        return replace(self, coefficients=np.append(self._brown_conrady.flipped(axis).coefficients, field.ravel()))


def _basis(position: FloatArray, reach: float, controls: int) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """First of the four control points at each position (n,), their cubic weights (4, n), d weights / d position."""
    cells = controls - 3
    per_unit = cells / (2.0 * reach)
    cell = np.clip((position + reach) * per_unit, 0.0, cells)
    first = np.clip(np.floor(np.nan_to_num(cell)), 0, cells - 1).astype(np.int64)
    t = cell - first
    weights = np.array([(1.0 - t) ** 3, 3.0 * t**3 - 6.0 * t**2 + 4.0, -3.0 * t**3 + 3.0 * t**2 + 3.0 * t + 1.0, t**3])
    derivatives = np.array([-3.0 * (1.0 - t) ** 2, 9.0 * t**2 - 12.0 * t, -9.0 * t**2 + 6.0 * t + 3.0, 3.0 * t**2])
    scale = np.where(np.abs(position) <= reach, per_unit, 0.0)
    return first, weights / 6.0, derivatives / 6.0 * scale
