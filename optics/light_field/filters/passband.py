"""Passbands of 4-D filters of light fields, as the coherence of views at their true positions.

A point at a depth shifts by its metric slope m from view to view (`Views.slope_from_depth`), so the views show T(u - m
x): at the spatial frequency w = (wu, wv), view i holds T(w) exp(-j m w . x_i). A plane of constant depth is a plane in
the 4-D spectrum, and the depths between two planes form a fan (Dansereau, Pizarro and Williams, Linear Volumetric Focus
for Light Field Cameras, ACM Transactions on Graphics 34(2), 2015). The Light Field Toolbox defines passbands on even
grids of views. Here, they are coherences of two views: the passband's Fourier transform over the view frequencies, at
the distance between the two. So views keep their positions, and the last view does not wrap around to the first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Self

import numpy as np

from mirrorcam.core.compiled import compiled
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import Views

SMALL_ANGLE = 1e-4
"""Radians below which sin(x) / x is 1 - x^2 / 6 to the last digit."""

FilterKind = Literal["hyperfan", "dual-fan", "hypercone"]


@dataclass(frozen=True, eq=False)
class Passband:
    """A filter's passband: its range of slopes, and the relation between slopes along x and y.

    Attributes
    ----------
    kind
        "hyperfan": slopes of the range, equal along x and y, as for every point. "dual-fan": slopes of the range along
        x, and independently along y. "hypercone": any slope, equal along x and y.
    centre_px_per_mm, half_width_px_per_mm
        The range of metric slopes; unused for a hypercone.
    positions_mm
        Positions (n, 2) of the views, x and y.
    """

    kind: FilterKind
    centre_px_per_mm: float
    half_width_px_per_mm: float
    positions_mm: FloatArray

    @classmethod
    def of(cls, views: Views, kind: FilterKind, near_mm: float | None, far_mm: float | None) -> Self:
        """Build the passband of depths from the pupil between `near_mm` and `far_mm`; a hypercone needs none.

        Raises InputError for depths that are missing, out of order, or not in front of the views.
        """
        positions = views.positions_mm[..., :2].reshape(-1, 2)
        if len(positions) < 2:
            raise InputError("light field has one view, expected several: filters compare views")
        if kind == "hypercone":
            return cls(kind, 0.0, 0.0, positions)
        if near_mm is None or far_mm is None:
            raise InputError(f"a {kind} passes a range of depths, expected its nearest and farthest depth")
        min_mm = views.reference_view_depth_mm + max(float(views.positions_mm[..., 2].max()), 0.0)
        if not min_mm < near_mm < far_mm:
            raise InputError(
                f"depths {near_mm:g} to {far_mm:g} mm: the nearest must come first and be more than {min_mm:.0f} mm"
            )
        near, far = (float(views.slope_from_depth(depth)) for depth in (near_mm, far_mm))
        return cls(kind, (near + far) / 2.0, abs(far - near) / 2.0, positions)

    @property
    def max_shift_px(self) -> float:
        """Maximum shift of a point between two views, within the passband."""
        baseline_mm = float(np.ptp(self.positions_mm, axis=0).max())
        return (abs(self.centre_px_per_mm) + self.half_width_px_per_mm) * baseline_mm

    def phases(self, frequencies: FloatArray) -> FloatArray:
        """Return the phases (n, ...) of the views at frequencies (..., 2), rad per px, for the centre of the range."""
        return np.asarray(self.centre_px_per_mm * np.moveaxis(frequencies @ self.positions_mm.T, -1, 0))

    def coherence(self, frequencies: FloatArray) -> FloatArray:
        """Return the coherence (m, n, n) of the views at frequencies (m, 2), rad per px, after removing `phases`.

        It is real, symmetric and positive semidefinite, with ones on the diagonal.
        """
        if self.kind == "dual-fan":
            sinc_u, sinc_v = (
                _sinc(self.half_width_px_per_mm * frequencies[:, axis, None] * self.positions_mm[:, axis])
                for axis in (0, 1)
            )
            return sinc_u * sinc_v
        lags = frequencies @ self.positions_mm.T
        if self.kind == "hypercone":
            # Slopes up to a shift of a wave by half a period between adjacent views.
            length = np.linalg.norm(frequencies, axis=-1, keepdims=True)
            return _sinc(np.divide(lags, length, out=np.zeros_like(lags), where=length > 0) * (np.pi / self._step_mm))
        return _sinc(self.half_width_px_per_mm * lags)

    @property
    def _step_mm(self) -> float:
        distances = np.linalg.norm(self.positions_mm[:, None] - self.positions_mm, axis=-1)
        np.fill_diagonal(distances, np.inf)
        return float(distances.min(axis=1).mean())


def _sinc(phases: FloatArray) -> FloatArray:
    """Return sin(d) / d (m, n, n) of the differences d of phases (m, n)."""
    sinc = np.empty((*phases.shape, phases.shape[1]))
    _fill_sinc(np.ascontiguousarray(phases), np.sin(phases), np.cos(phases), sinc)
    return sinc


@compiled
def _fill_sinc(phases: FloatArray, sines: FloatArray, cosines: FloatArray, sinc: FloatArray) -> None:
    """Write sin(a - b) / (a - b), with sin(a - b) = sin a cos b - cos a sin b: a sine for each phase, not each pair."""
    for m in range(phases.shape[0]):
        for i in range(phases.shape[1]):
            sinc[m, i, i] = 1.0
            for j in range(i):
                difference = phases[m, i] - phases[m, j]
                value = 1.0 - difference * difference / 6.0
                if abs(difference) > SMALL_ANGLE:
                    value = (sines[m, i] * cosines[m, j] - cosines[m, i] * sines[m, j]) / difference
                sinc[m, i, j] = value
                sinc[m, j, i] = value
