"""Limits on the errors of a validation, from the bounds that the calibration states for them.

A figure's limit is what a calibration with the right covariance exceeds once in a thousand times, so that a good result
and an honest covariance are both needed to pass. A covariance so wide that it helps nobody does not help here either:
pixels must be nearer to the truth than matching can tell.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from mirrorcam.calibration.decoded_corners import DecodedCorners
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.calibration.diagnostics.calibration_result import HOLD_OUT_EVERY, Calibration
from mirrorcam.optics.calibration.diagnostics.diagnostics import MATCHING_PX
from mirrorcam.optics.calibration.diagnostics.mirror_uncertainty import mirror_covariance, normal_and_distance_sigmas
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import uncertainty_of, worst_sigmas
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.geometry.layout import Layout

CHANCE = 1e-3
"""Chance that a right calibration exceeds a limit."""
POSE_NUMBERS = 6
LIMITED = (
    *("normal_error_max_deg", "normal_error_between_mirrors_max_deg", "distance_error_max_mm"),
    *("held_out_rms_x_px", "held_out_rms_y_px", "held_out_spatial_rms_mm", "decoded_corner_rms_px"),
)
"""The figures with a limit."""
MAX_LIMITS = {
    "held_out_rms_x_px": MATCHING_PX,
    "held_out_rms_y_px": MATCHING_PX,
    "decoded_corner_rms_px": np.sqrt(2.0) * MATCHING_PX,
}
"""Largest limits: the noise of matching."""


def bounded(metrics: dict[str, Metric], bounds: dict[str, tuple[float, float]]) -> dict[str, Metric]:
    """Set the limits of figures from their bounds, standard deviation and factor, and add the bounds themselves."""
    limited = dict(metrics)
    for name, (sigma, factor) in bounds.items():
        if name in metrics:
            limit = min(factor * sigma, MAX_LIMITS.get(name, np.inf))
            limited[name] = metrics[name].replaced(limit=float(f"{limit:.2g}"))
            limited[bound_name(name)] = Metric(value=sigma, unit=metrics[name].unit)
    return limited


def bound_name(name: str) -> str:
    """Return the name of the bound of a figure: `x_bound_px` for `x_px`."""
    stem, _, unit = name.rpartition("_")
    return f"{stem}_bound_{unit}"


def mirror_bounds(layout: Layout) -> dict[str, tuple[float, float]]:
    """Bounds of the errors of mirrors of a calibrated layout: the largest standard deviation of a mirror, and a factor.

    The largest of m errors with k degrees of freedom each is within the factor with the probability 1 - `CHANCE`.
    """
    centres = np.array([mirror.virtual_centre_in_rig_mm for mirror in layout.mirrors])
    covariance = mirror_covariance(uncertainty_of(layout))
    tilt, distance = normal_and_distance_sigmas(centres, covariance)
    relative = worst_sigmas(_relative_tilt_covariances(centres, covariance))

    def factor(freedom: int) -> float:
        return float(np.sqrt(chi2.isf(CHANCE / len(centres), freedom)))

    return {
        "normal_error_max_deg": (float(np.degrees(tilt.max())), factor(2)),
        "normal_error_between_mirrors_max_deg": (float(np.degrees(relative.max())), factor(3)),
        "distance_error_max_mm": (float(distance.max()), factor(1)),
    }


def corner_bounds(calibration: Calibration, decoded: DecodedCorners) -> dict[str, tuple[float, float]]:
    """Bounds of the RMS errors of held-out corners and of corners in decoded views: standard deviations, and factors.

    The errors of a held-out frame are correlated, and count as the six numbers of its pose.
    """
    rows = calibration.observations
    mirrored = calibration.inliers & (rows.view != DIRECT)
    corner_px = float(np.sqrt(np.mean(calibration.corner_sigma_px[mirrored] ** 2)))
    frames = len(np.unique(rows.frame[mirrored]))
    held_out = _rms_factor(POSE_NUMBERS * max(frames // HOLD_OUT_EVERY, 1))
    mm_per_px = calibration.metrics["working_distance_mm"].value / calibration.layout.camera.fx_px
    bounds = {f"held_out_rms_{axis}_px": (corner_px, held_out) for axis in "xy"}
    bounds["held_out_spatial_rms_mm"] = (np.sqrt(2.0) * corner_px * mm_per_px, held_out)
    if len(decoded.errors_px):
        sigma_px, limit_px = decoded.bound_px(uncertainty_of(calibration.layout).covariance, corner_px, CHANCE)
        bounds["decoded_corner_rms_px"] = (sigma_px, limit_px / sigma_px)
    return bounds


def _rms_factor(freedom: int) -> float:
    """Factor on the standard deviation that the RMS of errors with some degrees of freedom exceeds by `CHANCE`."""
    return float(np.sqrt(chi2.isf(CHANCE, freedom) / freedom))


def _relative_tilt_covariances(centres: FloatArray, covariance: FloatArray) -> FloatArray:
    """Covariances (m, 3, 3) of the rotation vectors of mirrors, rad, without their mean."""
    count = len(centres)
    to_tilts = np.zeros((3 * count, 3 * count))
    for m, centre in enumerate(centres):
        length = np.linalg.norm(centre)
        x, y, z = centre / length
        to_tilts[3 * m : 3 * m + 3, 3 * m : 3 * m + 3] = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) / length
    without_mean = np.kron(np.eye(count) - 1.0 / count, np.eye(3)) @ to_tilts
    whole = (without_mean @ covariance @ without_mean.T).reshape(count, 3, count, 3)
    return np.asarray(whole[np.arange(count), :, np.arange(count)])
