"""Tests of a fit of labels: do halves of the frames and of the labels agree, and is every mirror a plane mirror?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.stats import chi2

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.labels.label_calibration import LabelFit
from mirrorcam.optics.calibration.labels.point_adjustment import (
    CameraPrior,
    adjust,
    covariance,
    in_basis,
    linearized_rows,
    point_equations,
    scale_free_basis,
)
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray, UndeterminedError
from mirrorcam.optics.calibration.solver.observations import IntArray

CHANCE = 1e-3
MIN_EIGENVALUE = 1e-9
"""Eigenvalue of the scaled information below which a rotation of a view is undetermined."""


@dataclass(frozen=True)
class LabelSplit:
    """Mirrors from two halves of the labels: their difference relative to the predicted one, and its largest by chance.

    `division` says what was divided.
    """

    division: str
    ratio: float
    limit: float


@dataclass(frozen=True, eq=False)
class FreeMirrors:
    """Mirrors as free cameras: what they explain besides plane mirrors.

    Attributes
    ----------
    turn_deg, sigma_deg
        Rotation (m, 3) of each view about the pupil, against a plane mirror's, and its standard deviations; NaN if
        undetermined.
    chance
        Probability of this much by noise.
    unexplained_px
        Rms error of labels, per axis, that free cameras explain.
    """

    turn_deg: FloatArray
    sigma_deg: FloatArray
    chance: float
    unexplained_px: float


def split_labels(fit: LabelFit, point_frame: IntArray, point_label: IntArray) -> tuple[LabelSplit, ...]:
    """Compare the mirrors of every second frame with the others, and of every second label.

    Labels show errors that all frames share: a body part is a patch of skin, and its sides are not one point.

    Parameters
    ----------
    fit
        The fit.
    point_frame, point_label
        Frame and label (p,) of the points of its rows.
    """
    splits = []
    for division, numbers in (("by frame", point_frame), ("by label", point_label)):
        _, order = np.unique(numbers, return_inverse=True)
        split = _split(fit, order % 2 == 0)
        if split is not None:
            splits.append(LabelSplit(division, *split))
    return tuple(splits)


def _split(fit: LabelFit, first: BoolArray) -> tuple[float, float] | None:
    """Ratio of the difference of two halves of the points to the predicted one, and its limit; None if impossible."""
    prior = CameraPrior.known(fit.estimate.camera)
    basis = scale_free_basis(fit.estimate.virtual_centres_in_rig_mm, 0)
    means, covariances = [], []
    for mask in (first, ~first):
        rows = fit.rows.where(mask[fit.rows.frame])
        rows = replace(rows, frame=(np.cumsum(mask) - 1)[rows.frame])
        if len(np.unique(rows.view)) <= len(fit.estimate.virtual_centres_in_rig_mm):
            return None
        try:
            estimate, _ = adjust(fit.estimate.of_frames(mask), rows, prior)
            uncertainty = covariance(estimate, rows, prior)
        except UndeterminedError:
            return None
        scale = float(np.linalg.norm(estimate.virtual_centres_in_rig_mm))
        means.append(basis.T @ estimate.virtual_centres_in_rig_mm.ravel() / scale)
        covariances.append(basis.T @ uncertainty.of_global @ basis / scale**2)
    difference = means[0] - means[1]
    squares = float(difference @ np.linalg.solve(covariances[0] + covariances[1], difference))
    freedom = len(difference)
    return float(np.sqrt(squares / freedom)), float(np.sqrt(chi2.isf(CHANCE, freedom) / freedom))


def free_mirrors(fit: LabelFit) -> FreeMirrors:
    """Score test of a rotation of each mirror's view: with it, the view is that of a camera at any pose."""
    centres = fit.estimate.virtual_centres_in_rig_mm
    mirrors, intrinsics = len(centres), len(fit.prior.free)
    rows = linearized_rows(fit.estimate, fit.rows, fit.prior.free, view_rotations=True)
    basis = block_diag(scale_free_basis(centres, intrinsics), np.eye(3 * mirrors))
    equations = in_basis(point_equations(rows, fit.rows, fit.prior, fit.estimate.camera), basis)
    matrix, solved = equations.reduced(0.0)
    gradient = equations.gradient_global - np.einsum("pij,pi->j", equations.w, solved[:, :, -1])
    others, turns = slice(-3 * mirrors), slice(-3 * mirrors, None)
    by_others = np.linalg.solve(matrix[others, others], np.column_stack([matrix[others, turns], gradient[others]]))
    information = matrix[turns, turns] - matrix[turns, others] @ by_others[:, :-1]
    score = gradient[turns] - matrix[turns, others] @ by_others[:, -1]
    scale = 1.0 / np.sqrt(np.diag(matrix)[turns])
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    known = values > MIN_EIGENVALUE
    vectors = vectors[:, known] * scale[:, None]
    step = -vectors @ ((vectors.T @ score) / values[known])
    variances = np.sum(vectors**2 / values[known], axis=1)
    squares = float(np.sum((vectors.T @ score) ** 2 / values[known]))
    freedom = int(known.sum())
    excess = max(squares - freedom, 0.0) / (2.0 * len(fit.rows))
    unclear = np.sqrt(variances) if known.all() else np.full(3 * mirrors, np.nan)
    return FreeMirrors(
        np.degrees(step).reshape(-1, 3),
        np.degrees(unclear).reshape(-1, 3),
        float(chi2.sf(squares, freedom)),
        fit.sigma_px * float(np.sqrt(excess)),
    )
