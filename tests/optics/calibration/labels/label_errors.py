"""Errors of calibrations from simulated labels, in their stated standard deviations and relative to the bound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.labels.known_scale import KnownLength
from mirrorcam.optics.calibration.labels.label_calibration import label_observations
from mirrorcam.optics.calibration.labels.label_result import LabelCalibration, calibrate_labels
from mirrorcam.optics.calibration.labels.point_adjustment import CameraPrior, covariance, points_estimate
from tests.optics.calibration.labels.simulated_labels import Simulated


def calibrated(labels: Simulated, prior: CameraPrior | None = None) -> LabelCalibration:
    """Calibrate with the true distance of the first mirror."""
    known = KnownLength("camera", labels.table.views[1], float(np.linalg.norm(labels.centres[0])) / 2.0)
    return calibrate_labels(labels.table, prior or CameraPrior.known(labels.camera), known)


def squares(error: FloatArray, matrix: FloatArray) -> tuple[float, int]:
    """Squared error in units of a covariance, and its degrees of freedom; directions without variance are left out."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    known = values > 1e-9
    return float(np.sum((vectors.T @ (error / scale))[known] ** 2 / values[known])), int(known.sum())


def errors(labels: Simulated, result: LabelCalibration) -> FloatArray:
    """Errors of free intrinsics and virtual centres, in the order of the layout's uncertainty."""
    uncertainty, layout = result.layout.uncertainty, result.layout
    assert uncertainty is not None
    lens = {
        name: value - true
        for name, value, true in zip(
            layout.camera.intrinsic_names, layout.camera.intrinsics, labels.camera.intrinsics, strict=True
        )
    }
    centres = np.array([mirror.virtual_centre_in_rig_mm for mirror in layout.mirrors]) - labels.centres
    free = [lens[name] for name in uncertainty.parameters if name in lens]
    return np.array([*free, *centres.ravel()])


def bound(labels: Simulated, prior: CameraPrior) -> FloatArray:
    """Cramer-Rao bound of centres, per mirror distance, from the correct labels alone and noise of 1 px."""
    table = labels.table
    clean = replace(
        table,
        frame=table.frame[labels.correct],
        view=table.view[labels.correct],
        label=table.label[labels.correct],
        pixels=table.pixels[labels.correct],
    )
    rows, frame, label = label_observations(clean)
    truth = points_estimate(labels.camera, labels.centres, labels.points[frame, label])
    first = len(prior.free)
    return covariance(truth, rows, prior).of_global[first:, first:]


def pooled(sets: list[tuple[Simulated, CameraPrior]]) -> tuple[float, float]:
    """NEES of all sets, and their rms error of centres (without a common scale) relative to the bound."""
    total, freedom, ratio = 0.0, 0, []
    for labels, prior in sets:
        result = calibrated(labels, prior)
        assert result.layout.uncertainty is not None
        square, count = squares(errors(labels, result), result.layout.uncertainty.covariance)
        total, freedom = total + square, freedom + count
        centres = np.array([mirror.virtual_centre_in_rig_mm for mirror in result.layout.mirrors])
        centres *= np.sum(centres * labels.centres) / np.sum(centres**2)
        square, count = squares((centres - labels.centres).ravel(), bound(labels, prior))
        ratio.append(square / count)
    return total / freedom, float(np.sqrt(np.mean(ratio)))
