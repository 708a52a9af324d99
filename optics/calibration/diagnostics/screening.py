"""Screening of observations before a calibration: contradictory corners, views and frames are dropped or refused.

The nominal layout is only a starting point: every test compares the pictures with each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics import consistency
from mirrorcam.optics.calibration.diagnostics.corner_noise import with_view_noise
from mirrorcam.optics.calibration.diagnostics.nested_models import (
    free_intrinsics,
    further_cameras,
    joint_model,
    with_addition,
)
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.levenberg_marquardt import DROP_SIGMAS, minimise, start_robustly
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model, pair_prior
from mirrorcam.optics.calibration.solver.residuals import Estimate, residuals
from mirrorcam.optics.geometry.layout import Layout

TRIAL_PLATE_MM, TRIAL_INDEX = 1.0, 1.49


@dataclass(frozen=True)
class ScreenedFrames:
    """Observations that passed the screening.

    Attributes
    ----------
    mirrored, base
        Corners by frame, with and without mirrors, with standard deviations from the noise of each view.
    notes
        Dropped observations, one sentence each.
    inflation
        Factor on the error bounds of a common fit; 1 if frames with and without mirrors agree about the camera.
    """

    mirrored: list[Observations]
    base: list[Observations]
    notes: tuple[str, ...]
    inflation: float


def screen(
    mirrored: Sequence[Observations], base: Sequence[Observations], layout: Layout, corners_in_board_mm: FloatArray
) -> ScreenedFrames:
    """Drop repeated pictures, corners off the board's plane, and views that contradict the others on the board's pose.

    Parameters
    ----------
    mirrored, base
        Corners by frame, with and without mirrors.
    layout
        The nominal layout.
    corners_in_board_mm
        The board's corners (c, 3) in the board frame as drawn, mm.

    Returns
    -------
    ScreenedFrames
        As many frames as given.

    Raises
    ------
    InputError
        If the observations are too contradictory to calibrate.
    UndeterminedError
        If nothing can be solved.
    """
    names = [f"frame {n}" for n in range(len(mirrored))] + [f"base frame {n}" for n in range(len(base))]
    frames = [*mirrored, *base]
    notes = []
    for repeat, first in consistency.repeated_frames(frames).items():
        frames[repeat] = Observations.empty()
        notes.append(f"{names[repeat]}: the same picture as {names[first]}, not used")

    rows = Observations.join([o.with_frame_offset(number) for number, o in enumerate(frames)])
    off_plane = consistency.off_plane_corners(rows, layout.camera, corners_in_board_mm)
    notes += consistency.board_notes(rows, off_plane, names, layout.mirror_names)
    rows = rows.where(~off_plane)

    is_mirrored = rows.frame < len(mirrored)
    consistency.check_mirror_counts(rows.where(is_mirrored), len(mirrored), layout.mirror_names)
    consistent, direct, inflation, more_notes = _consistent_views(
        rows.where(is_mirrored), rows.where(~is_mirrored), names, layout, corners_in_board_mm
    )
    return ScreenedFrames(
        mirrored=[consistent.where(consistent.frame == n).with_frame_offset(-n) for n in range(len(mirrored))],
        base=[direct.where(direct.frame == n).with_frame_offset(-n) for n in range(len(mirrored), len(frames))],
        notes=(*notes, *more_notes),
        inflation=inflation,
    )


def _consistent_views(
    mirrored: Observations,
    direct: Observations,
    names: Sequence[str],
    layout: Layout,
    corners_in_board_mm: FloatArray,
) -> tuple[Observations, Observations, float, tuple[str, ...]]:
    """Return consistent mirrored views, direct views, the inflation that their disagreement requires, and notes.

    The standard deviations of both follow the noise of each view.
    """
    free = joint_model(layout.camera, corners_in_board_mm, pair_prior(layout))
    camera = initial_estimates.base_camera(direct, layout.camera, corners_in_board_mm)
    renumbered = _renumbered(mirrored)
    start = initial_estimates.first_estimate(renumbered, camera, layout, corners_in_board_mm)
    paper, _ = start_robustly(start, renumbered, replace(free, intrinsics=()))
    estimate, _ = start_robustly(paper, renumbered, free)
    numbers = np.unique(mirrored.frame)
    errors = residuals(estimate, renumbered, free.board)
    kept, notes = consistency.consistent_views(renumbered, errors, [names[n] for n in numbers], layout.mirror_names)
    mirrored = with_view_noise(mirrored.where(kept), errors[kept])
    if not len(direct):
        return mirrored, direct, 1.0, notes
    direct = with_view_noise(direct, _direct_residuals(_renumbered(direct), estimate, layout, free))
    remaining = np.isin(numbers, mirrored.frame)
    estimate = estimate.of_frames(remaining)
    ratio = _min_disagreement(estimate, _renumbered(mirrored), _renumbered(direct), layout, free)
    notes += consistency.drift_note(ratio, (estimate.camera.fx_px, camera.fx_px))
    return mirrored, direct, ratio if ratio > consistency.WIDENED_SIGMAS else 1.0, notes


def _direct_residuals(direct: Observations, estimate: Estimate, layout: Layout, free: Model) -> FloatArray:
    """Residuals (n, 2), px, of frames without mirrors to their own robust fit, started from an estimate's camera."""
    start = initial_estimates.first_estimate(direct, estimate.camera, layout, free.board.corners_in_board_mm)
    direct_fit, _ = start_robustly(start, direct, replace(free, mirrors=False))
    return residuals(direct_fit, direct, free.board)


def _renumbered(observations: Observations) -> Observations:
    """Renumber the frames from 0 without gaps."""
    _, frame = np.unique(observations.frame, return_inverse=True)
    return replace(observations, frame=frame)


def _min_disagreement(
    estimate: Estimate, mirrored: Observations, direct: Observations, layout: Layout, free: Model
) -> float:
    """Camera disagreement; if large, the smallest one over models with plates, bent mirrors or other lenses.

    A plate or a bend missing from the layout also biases the intrinsics, as does an unsuitable lens model.
    """
    ratio = _camera_disagreement(estimate, mirrored, direct, layout, free)
    if ratio <= consistency.WIDENED_SIGMAS:
        return ratio
    plates = np.where(estimate.thickness_mm > 0.0, estimate.thickness_mm, TRIAL_PLATE_MM)
    index = np.maximum(estimate.refractive_index, TRIAL_INDEX)
    for trial, larger in (
        (replace(estimate, thickness_mm=plates, refractive_index=index), replace(free, thickness=True)),
        (estimate, replace(free, curvature=True)),
    ):
        ratio = min(ratio, _camera_disagreement(trial, mirrored, direct, layout, larger))
    for addition in further_cameras(estimate.camera, ()):
        if ratio <= consistency.WIDENED_SIGMAS:
            break
        camera = with_addition(estimate.camera, addition)
        larger = replace(free, intrinsics=free_intrinsics(camera, (addition,)))
        ratio = min(ratio, _camera_disagreement(replace(estimate, camera=camera), mirrored, direct, layout, larger))
    return ratio


def _camera_disagreement(
    mirrored_fit: Estimate, mirrored: Observations, direct: Observations, layout: Layout, model: Model
) -> float:
    """`consistency.camera_disagreement` of fits to frames with mirrors, without mirrors, and to both.

    The common fit uses all inliers of the separate fits, so that no contradiction is rejected as an outlier.
    """
    mirrored, mirrored_fit = _without_outliers(mirrored, mirrored_fit, model)
    start = initial_estimates.first_estimate(direct, mirrored_fit.camera, layout, model.board.corners_in_board_mm)
    direct, direct_fit = _without_outliers(direct, start, model)
    all_rows = Observations.join([mirrored, direct.with_frame_offset(len(mirrored_fit.rig_from_board))])
    poses = np.concatenate([mirrored_fit.rig_from_board, direct_fit.rig_from_board])
    common, _ = minimise(mirrored_fit.with_poses(poses), all_rows, model)
    intrinsics = common.camera.intrinsics.size
    return consistency.camera_disagreement(
        [_standardised(mirrored_fit, mirrored, model), _standardised(direct_fit, direct, model)],
        _standardised(common, all_rows, model),
        unknowns=len(model.parameters(common.camera, len(layout.mirrors))) + intrinsics + 6 * len(poses),
        common=intrinsics,
    )


def _standardised(estimate: Estimate, observations: Observations, model: Model) -> FloatArray:
    return observations.standardised(residuals(estimate, observations, model.board))


def _without_outliers(observations: Observations, start: Estimate, model: Model) -> tuple[Observations, Estimate]:
    """Return the inliers of a robust fit, and the least-squares fit to them."""
    if not (observations.view != DIRECT).any():
        model = replace(model, mirrors=False, thickness=False, curvature=False)
    estimate, _ = start_robustly(start, observations, model)
    errors = np.abs(_standardised(estimate, observations, model)).max(axis=1)
    inliers = observations.where(errors <= DROP_SIGMAS * 1.4826 * np.median(errors))
    estimate, _ = minimise(estimate, inliers, model)
    return inliers, estimate
