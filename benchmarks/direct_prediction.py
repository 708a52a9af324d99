"""Predictions of mirrored corners in pictures not used in a calibration, from their direct views alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.nested_models import CAMERA_ADDITIONS, Fitted, fit_as, fit_with
from mirrorcam.optics.calibration.solver.levenberg_marquardt import fit
from mirrorcam.optics.calibration.solver.observations import DIRECT, IntArray, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, residuals


def predicted_mirrored(
    start: Estimate, observations: Observations, model: Model, fold: IntArray
) -> tuple[FloatArray, list[Estimate]]:
    """Predict the mirrored corners of each frame by a fit to the other folds and the frame's direct view.

    Parameters
    ----------
    start, observations
        The estimate to start from, and all corners (n).
    model
        The model of the fits.
    fold
        Fold (f,) of each frame.

    Returns
    -------
    residuals
        Predicted minus observed pixels (n, 2); NaN for direct corners and in frames without a direct view.
    estimates
        For each frame, the camera and mirrors of the fit without it, and the pose from its direct view.
    """
    errors = np.full((len(observations), 2), np.nan)
    estimates: list[Estimate] = [start] * len(start.rig_from_board)
    for held_fold in np.unique(fold):
        out = fold == held_fold
        number = np.cumsum(~out) - 1
        rows = observations.where(~out[observations.frame])
        remaining = replace(rows, frame=number[rows.frame])
        fitted = fit(start.of_frames(~out), remaining, model).estimate
        board = Board.rigid(model.board.shaped(fitted.shape))
        terms = model.frame_terms
        held = Model((), thickness=False, curvature=False, board=board, mirrors=False, frame_terms=terms)
        for frame in np.flatnonzero(out):
            in_frame = observations.frame == frame
            corners = observations.where(in_frame).with_frame_offset(-int(frame))
            posed = replace(fitted.with_poses(start.rig_from_board[[frame]]), shape=np.zeros(0))
            direct = corners.where(corners.view == DIRECT)
            if not len(direct):
                continue
            posed = fit(posed, direct, held).estimate
            predicted = residuals(posed, corners, board)
            predicted[corners.view == DIRECT] = np.nan
            errors[in_frame] = predicted
            estimates[frame] = replace(posed, shape=fitted.shape)
    return errors, estimates


def refitted(calibration: Calibration, observations: Observations, board: Board, additions: Sequence[str]) -> Fitted:
    """Fit a calibration's camera and planes to its corners, or to others of the same frames, with additions.

    Additions to the camera are those that the calibrated one has.
    """
    start = Estimate.of(calibration.layout.camera, calibration.layout.mirrors, calibration.rig_from_board)
    plain = replace(start, thickness_mm=np.zeros(len(calibration.layout.mirrors)))
    model = Model(start.camera.intrinsic_names, thickness=False, curvature=False, board=board)
    fitted = fit_as("joint", plain, observations, model)
    for addition in (name for name in additions if name not in CAMERA_ADDITIONS):
        fitted = fit_with("plates" if addition == "sheet" else addition, fitted, observations)
    return fitted


def prediction_floor(fitted: Fitted, observations: Observations, fold: IntArray, *, rounds: int = 3) -> FloatArray:
    """Return the prediction errors (n, 2) of mirrored corners that the model's noise alone causes, in simulations.

    Corners are simulated by the fit, with noise of its scale, and rotations and bows of frames drawn from their priors.
    """
    random = np.random.default_rng(0)
    solution, terms = fitted.solution, fitted.model.frame_terms
    errors = []
    for _ in range(rounds):
        truth = solution.estimate
        if terms.rotation_per_rad is not None:
            rotation = random.normal(0.0, solution.scale / terms.rotation_per_rad, truth.camera_rotation.shape)
            truth = replace(truth, camera_rotation=rotation)
        if terms.bow_per_mm is not None:
            truth = replace(truth, bow_mm=random.normal(0.0, solution.scale / terms.bow_per_mm, truth.bow_mm.shape))
        noise = random.normal(0.0, solution.scale * observations.sigma_px[:, None], (len(observations), 2))
        clean = observations.pixels + residuals(truth, observations, fitted.model.board)
        simulated = replace(observations, pixels=clean + noise)
        errors.append(predicted_mirrored(truth, simulated, fitted.model, fold)[0])
    return np.concatenate(errors)
