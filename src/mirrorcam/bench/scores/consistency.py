"""Normalised estimation error squared (NEES): whether a calibration is as wrong as its covariance says.

After Bar-Shalom. The error is that of pixels over the working volume, with the motion of the rig taken out of it as
of what the covariance predicts, so that the gauge of a calibration does not matter. In the directions that the
covariance moves, it is a sum of squares of r independent standard normal numbers, where the covariance is right: chi
squared with r degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from mirrorcam.bench.scores.gauge import Gauge
from mirrorcam.bench.scores.stated_covariance import by_parameters, checked_root
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.calibration_difference import without_motion
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import NEGLIGIBLE_PX
from mirrorcam.optics.camera_files.camera_rig import CameraRig
from mirrorcam.optics.geometry.transforms import transform

LEVEL = 0.95
SMALLEST_SHARE = 1e-4
"""Directions whose sigma is below this share of the largest are left to rounding and to what is linear of the model."""


@dataclass(frozen=True)
class Nees:
    """The error in units of the covariance: a sum of squares and its degrees of freedom."""

    total: float
    freedom: int

    @property
    def mean(self) -> float:
        """For each degree of freedom: 1 where the covariance is right, larger where it is too small."""
        return self.total / self.freedom

    @property
    def interval(self) -> tuple[float, float]:
        """Where `mean` is in 95 of 100 calibrations whose covariance is right."""
        low, high = chi2.ppf([(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0], self.freedom) / self.freedom
        return float(low), float(high)


def nees(gauges: Sequence[Gauge], rig: CameraRig) -> Nees | None:
    """The NEES of a calibration; None without a covariance, or where it predicts no error at all."""
    if rig.uncertainty is None:
        return None
    root = checked_root(rig.uncertainty)
    predicted, errors = [], []
    for gauge in gauges:
        points = transform(gauge.rig_from_true, gauge.points.points_in_rig)
        slopes = by_parameters(rig, gauge.views, gauge.points.view, points)
        error = gauge.pixels - gauge.points.pixels
        kept = np.isfinite(error).all(axis=1) & np.isfinite(slopes).all(axis=(1, 2))
        columns = gauge.motion_columns[kept]
        predicted.append(without_motion(slopes[kept] @ root, columns, gauge.weights[kept]).reshape(-1, root.shape[1]))
        errors.append(error[kept].ravel())
    return _of(np.concatenate(predicted), np.concatenate(errors))


def _of(predicted: FloatArray, error: FloatArray) -> Nees | None:
    """The NEES of errors (2n,) whose covariance is P P^T, P (2n, g), in the directions that it moves at all."""
    along, sigmas, _ = np.linalg.svd(predicted, full_matrices=False)
    least = max(NEGLIGIBLE_PX * SMALLEST_SHARE * np.sqrt(len(error)), SMALLEST_SHARE * float(sigmas.max(initial=0.0)))
    kept = sigmas > least
    if not kept.any():
        return None
    parts = (along[:, kept].T @ error) / sigmas[kept]
    return Nees(float(parts @ parts), int(kept.sum()))


def pooled(found: Sequence[Nees]) -> Nees | None:
    """The NEES of several calibrations together."""
    if not found:
        return None
    return Nees(sum(each.total for each in found), sum(each.freedom for each in found))
