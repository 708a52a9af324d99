"""Points as a calibration triangulates them from where the true device shows them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.bench.scores.gauge import Gauge
from mirrorcam.bench.scores.score_points import shown_by_all, with_slopes
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import transform

MOST_STEPS, STEADY_MM = 50, 1e-10
MOST_POINTS = 400


@dataclass(frozen=True, eq=False)
class Triangulated:
    """Points that all views show: the true ones (n, 3) in rig, mm, and those found, moved to the true rig."""

    true: FloatArray
    found: FloatArray

    @property
    def error_mm(self) -> FloatArray:
        """Found minus true (n, 3)."""
        return self.found - self.true

    @property
    def scale_error(self) -> float:
        """By how much the found points lie farther apart than the true ones, relative; of the best similarity."""
        true, found = self.true - self.true.mean(axis=0), self.found - self.found.mean(axis=0)
        sizes = np.linalg.svd(found.T @ true)[1]
        return float(sizes.sum() / np.sum(true**2) - 1.0)


def triangulated(gauge: Gauge, truth: Layout) -> Triangulated | None:
    """Points of the working volume that all views show, and where their pixels meet by the calibration.

    A point is where the sum of squares of its pixels' errors is least, as in a bundle adjustment. None where fewer than
    four points are shown by all, or there is one view.
    """
    numbers = [view.view for view in gauge.views]
    if len(numbers) < 2:
        return None
    candidates = gauge.points.points_in_rig
    true = candidates[shown_by_all(truth, numbers, candidates)]
    true = true[:: max(1, -(-len(true) // MOST_POINTS))]
    if len(true) < 4:
        return None
    seen = [truth.project(true, number) for number in numbers]
    points = transform(gauge.rig_from_true, true)
    for _ in range(MOST_STEPS):
        normal, right = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
        for view, pixels in zip(gauge.views, seen, strict=True):
            shown, slopes = with_slopes(view.project_in_rig, points)
            off = pixels - shown
            lost = ~(np.isfinite(off).all(axis=1) & np.isfinite(slopes).all(axis=(1, 2)))
            off[lost], slopes[lost] = 0.0, 0.0
            normal += np.einsum("nij,nik->njk", slopes, slopes)
            right += np.einsum("nij,ni->nj", slopes, off)
        step = np.einsum("nij,nj->ni", np.linalg.pinv(normal), right)
        points = points + step
        if np.abs(step).max() < STEADY_MM:
            break
    return Triangulated(true, transform(gauge.true_from_rig, points))
