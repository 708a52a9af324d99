"""Screening of observations before a calibration: contradictory corners, views and frames are dropped or refused.

The nominal layout is only the start: every test compares the pictures with each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics import consistency
from mirrorcam.optics.calibration.diagnostics.corner_noise import with_noise_of_views
from mirrorcam.optics.calibration.diagnostics.nested_models import (
    free_intrinsics,
    further_lenses,
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
    seen, base
        Corners by frame, with and without mirrors, with standard deviations from the noise of each view.
    notes
        What was dropped, one sentence each.
    widened
        Factor on the error bounds of a common fit; 1 if both kinds of frames agree on the camera.
    """

    seen: list[Observations]
    base: list[Observations]
    notes: tuple[str, ...]
    widened: float


def screen(
    seen: Sequence[Observations], base: Sequence[Observations], layout: Layout, corners_in_board_mm: FloatArray
) -> ScreenedFrames:
    """Drop repeated pictures, corners off the board, and views that contradict the others on the board's pose.

    Parameters
    ----------
    seen, base
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
    names = [f"frame {n}" for n in range(len(seen))] + [f"base frame {n}" for n in range(len(base))]
    frames = [*seen, *base]
    notes = []
    for repeat, first in consistency.repeated_frames(frames).items():
        frames[repeat] = Observations.none()
        notes.append(f"{names[repeat]}: the same picture as {names[first]}, not used")

    rows = Observations.join([o.shifted(number) for number, o in enumerate(frames)])
    odd = consistency.odd_corners(rows, layout.camera, corners_in_board_mm)
    notes += consistency.board_fits(rows, odd, names, layout.mirror_names)
    rows = rows.where(~odd)

    mirrored, direct = rows.where(rows.frame < len(seen)), rows.where(rows.frame >= len(seen))
    consistency.every_mirror_shown(mirrored, len(seen), layout.mirror_names)
    mirrored, direct, widened, further = _agreeing_views(mirrored, direct, names, layout, corners_in_board_mm)
    return ScreenedFrames(
        seen=[mirrored.where(mirrored.frame == n).shifted(-n) for n in range(len(seen))],
        base=[direct.where(direct.frame == n).shifted(-n) for n in range(len(seen), len(frames))],
        notes=(*notes, *further),
        widened=widened,
    )


def _agreeing_views(
    mirrored: Observations,
    direct: Observations,
    names: Sequence[str],
    layout: Layout,
    corners_in_board_mm: FloatArray,
) -> tuple[Observations, Observations, float, tuple[str, ...]]:
    """Return the mirrored views that agree, the direct views, the widening that their difference requires, and notes.

    The standard deviations of both follow the noise of each view.
    """
    free = joint_model(layout.camera, corners_in_board_mm, pair_prior(layout))
    camera = initial_estimates.base_camera(direct, layout.camera, corners_in_board_mm)
    packed = _packed(mirrored)
    start = initial_estimates.first_estimate(packed, camera, layout, corners_in_board_mm)
    paper, _ = start_robustly(start, packed, replace(free, intrinsics=()))
    estimate, _ = start_robustly(paper, packed, free)
    numbers = np.unique(mirrored.frame)
    errors = residuals(estimate, packed, free.board)
    kept, notes = consistency.consistent_views(packed, errors, [names[n] for n in numbers], layout.mirror_names)
    mirrored = with_noise_of_views(mirrored.where(kept), errors[kept])
    if not len(direct):
        return mirrored, direct, 1.0, notes
    direct = with_noise_of_views(direct, _direct_residuals(_packed(direct), estimate, layout, free))
    remaining = np.isin(numbers, mirrored.frame)
    estimate = estimate.of_frames(remaining)
    ratio = _least_disagreement(estimate, _packed(mirrored), _packed(direct), layout, free)
    notes += consistency.drift_note(ratio, (estimate.camera.fx_px, camera.fx_px))
    return mirrored, direct, ratio if ratio > consistency.DRIFT_WIDENS else 1.0, notes


def _direct_residuals(direct: Observations, estimate: Estimate, layout: Layout, free: Model) -> FloatArray:
    """Residuals (n, 2), px, of frames without mirrors to their own robust fit, started from an estimate's camera."""
    start = initial_estimates.first_estimate(direct, estimate.camera, layout, free.board.corners_in_board_mm)
    direct_fit, _ = start_robustly(start, direct, replace(free, mirrors=False))
    return residuals(direct_fit, direct, free.board)


def _packed(observations: Observations) -> Observations:
    """Renumber the frames from 0 without gaps."""
    _, frame = np.unique(observations.frame, return_inverse=True)
    return replace(observations, frame=frame)


def _least_disagreement(
    estimate: Estimate, mirrored: Observations, direct: Observations, layout: Layout, free: Model
) -> float:
    """Camera disagreement; if large, the least one with plates, bent mirrors or other lenses.

    A plate or a bend missing from the layout also biases the intrinsics, as does an unsuitable lens model.
    """
    ratio = _camera_disagreement(estimate, mirrored, direct, layout, free)
    if ratio <= consistency.DRIFT_WIDENS:
        return ratio
    plates = np.where(estimate.thickness_mm > 0.0, estimate.thickness_mm, TRIAL_PLATE_MM)
    index = np.maximum(estimate.refractive_index, TRIAL_INDEX)
    for trial, richer in (
        (replace(estimate, thickness_mm=plates, refractive_index=index), replace(free, thickness=True)),
        (estimate, replace(free, curvature=True)),
    ):
        ratio = min(ratio, _camera_disagreement(trial, mirrored, direct, layout, richer))
    for addition in further_lenses(estimate.camera, ()):
        if ratio <= consistency.DRIFT_WIDENS:
            break
        camera = with_addition(estimate.camera, addition)
        richer = replace(free, intrinsics=free_intrinsics(camera, (addition,)))
        ratio = min(ratio, _camera_disagreement(replace(estimate, camera=camera), mirrored, direct, layout, richer))
    return ratio


def _camera_disagreement(
    with_mirrors: Estimate, mirrored: Observations, direct: Observations, layout: Layout, model: Model
) -> float:
    """`consistency.camera_disagreement` of fits to frames with mirrors, without mirrors, and to both.

    The common fit uses all corners that fit either kind alone, so that no contradiction is rejected as an outlier.
    """
    mirrored, with_mirrors = _without_outliers(mirrored, with_mirrors, model)
    start = initial_estimates.first_estimate(direct, with_mirrors.camera, layout, model.board.corners_in_board_mm)
    direct, without = _without_outliers(direct, start, model)
    both = Observations.join([mirrored, direct.shifted(len(with_mirrors.rig_from_board))])
    poses = np.concatenate([with_mirrors.rig_from_board, without.rig_from_board])
    common, _ = minimise(with_mirrors.with_poses(poses), both, model)
    intrinsics = common.camera.intrinsics.size
    return consistency.camera_disagreement(
        [_standardised(with_mirrors, mirrored, model), _standardised(without, direct, model)],
        _standardised(common, both, model),
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
