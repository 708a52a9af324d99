"""Figures of a calibration with a direct view besides those with a layout: angles between mirrors, and motion."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration, angle_between_mirrors
from mirrorcam.optics.calibration.diagnostics.mirror_uncertainty import mirror_covariance
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import uncertainty_of
from mirrorcam.optics.calibration.direct.motion import Shutter
from mirrorcam.optics.geometry.layout import Layout


def with_direct_figures(calibration: Calibration, rotations: FloatArray | None, shutter: Shutter | None) -> Calibration:
    """Add the figures of a calibration with a direct view.

    Parameters
    ----------
    calibration
        The calibration.
    rotations
        Rotation vectors (f, 3), rad, of the camera, if they were compensated.
    shutter
        The rolling shutter, if it was estimated; if supported, the corners are corrected to the middle row.
    """
    metrics, notes = _angles(calibration.layout), []
    if rotations is not None:
        largest_rad = float(np.linalg.norm(rotations - rotations[0], axis=1).max())
        metrics["camera_turned_px"] = Metric(value=calibration.layout.camera.fx_px * largest_rad, unit="px")
    if shutter is not None:
        metrics["shutter_readout"] = Metric(value=shutter.readout, unit="1")
        metrics["shutter_readout_sigma"] = Metric(value=shutter.sigma, unit="1")
        if shutter.supported:
            notes.append(
                f"a rolling shutter reads a frame in {shutter.readout:.2f} ± {shutter.sigma:.1g} of the frame period: "
                "moving corners were corrected to the time of the middle row"
            )
    return calibration.with_figures(metrics, notes)


def _angles(layout: Layout) -> dict[str, Metric]:
    """Angle between each pair of mirrors, and its standard deviation."""
    centres = np.array([mirror.virtual_centre_in_rig_mm for mirror in layout.mirrors])
    covariance = mirror_covariance(uncertainty_of(layout))
    metrics = {}
    for a, b in combinations(range(len(centres)), 2):
        rows = [*range(3 * a, 3 * a + 3), *range(3 * b, 3 * b + 3)]
        angle, sigma = angle_between_mirrors(centres[a], centres[b], covariance[np.ix_(rows, rows)])
        metrics[f"mirrors_{a}_{b}_angle_deg"] = Metric(value=np.degrees(angle), unit="deg")
        metrics[f"mirrors_{a}_{b}_angle_sigma_deg"] = Metric(value=np.degrees(sigma), unit="deg")
    return metrics
