"""Screening of observations before a calibration: contradictory corners, views and frames are dropped or refused.

The nominal layout is only a starting point: every test compares the pictures with each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics import consistency
from mirrorcam.optics.calibration.diagnostics.causes import ranked_causes
from mirrorcam.optics.calibration.diagnostics.corner_noise import with_view_noise
from mirrorcam.optics.calibration.diagnostics.nested_models import (
    fit_as,
    joint_model,
)
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.levenberg_marquardt import DROP_SIGMAS, minimise, start_robustly
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model, prior_of
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, residuals
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout

MIN_CORNERS_OF_EACH = 12
"""Minimum number of observations of each of the board's corners, on average, that determine its error."""


@dataclass(frozen=True)
class ScreenedFrames:
    """Observations that passed the screening.

    Attributes
    ----------
    mirrored, base
        Corners by frame, with and without mirrors, with standard deviations from the noise of each view.
    dropped
        Dropped observations, one sentence each.
    drift
        A sentence on a change of the camera between frames with and without mirrors, if they show one.
    inflation
        Factor on the error bounds of a common fit; 1 without such a change.
    """

    mirrored: list[Observations]
    base: list[Observations]
    dropped: tuple[str, ...]
    drift: tuple[str, ...]
    inflation: float


def screen(
    mirrored: Sequence[Observations],
    base: Sequence[Observations],
    layout: Layout,
    corners_in_board_mm: FloatArray,
    *,
    names: Sequence[str] | None = None,
) -> ScreenedFrames:
    """Drop repeated pictures, corners off the board's plane, and views that contradict the others on the board's pose.

    Parameters
    ----------
    mirrored, base
        Corners by frame, with and without mirrors.
    layout
        The nominal layout; without mirrors for a bare camera.
    corners_in_board_mm
        The board's corners (c, 3) in the board frame as drawn, mm.
    names
        Names of all frames, `mirrored` first. Default: their numbers.

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
    names = frame_names(len(mirrored), len(base)) if names is None else names
    frames = [*mirrored, *base]
    notes = []
    for repeat, first in consistency.repeated_frames(frames).items():
        frames[repeat] = Observations.empty()
        notes.append(f"{names[repeat]}: the same picture as {names[first]}, not used")

    rows = Observations.join([o.with_frame_offset(number) for number, o in enumerate(frames)])
    off_plane = consistency.off_plane_corners(rows, layout.camera, corners_in_board_mm)
    notes += consistency.board_notes(rows, off_plane, names, layout.mirror_names)
    rows = rows.where(~off_plane)

    if not layout.mirrors:
        free = joint_model(layout.camera, corners_in_board_mm)
        rows = with_view_noise(rows, _direct_residuals(rows.renumbered(), layout.camera, layout, free))
        frames = [rows.where(rows.frame == number).with_frame_offset(-number) for number in range(len(frames))]
        return ScreenedFrames([], frames, tuple(notes), (), 1.0)
    is_mirrored = rows.frame < len(mirrored)
    consistency.check_mirror_counts(rows.where(is_mirrored), len(mirrored), layout.mirror_names)
    consistent, direct, inflation, inconsistent, drift = _consistent_views(
        rows.where(is_mirrored), rows.where(~is_mirrored), names, layout, corners_in_board_mm
    )
    return ScreenedFrames(
        mirrored=[consistent.where(consistent.frame == n).with_frame_offset(-n) for n in range(len(mirrored))],
        base=[direct.where(direct.frame == n).with_frame_offset(-n) for n in range(len(mirrored), len(frames))],
        dropped=(*notes, *inconsistent),
        drift=drift,
        inflation=inflation,
    )


def frame_names(mirrored: int, base: int) -> list[str]:
    """Names of frames by their numbers."""
    return [f"frame {n}" for n in range(mirrored)] + [f"base frame {n}" for n in range(base)]


def _consistent_views(
    mirrored: Observations,
    direct: Observations,
    names: Sequence[str],
    layout: Layout,
    corners_in_board_mm: FloatArray,
) -> tuple[Observations, Observations, float, tuple[str, ...], tuple[str, ...]]:
    """Return consistent mirrored views, direct views, and inflation, notes on dropped views, and drift of the camera.

    The standard deviations of both follow the noise of each view.
    """
    free = joint_model(layout.camera, corners_in_board_mm, prior_of(layout, mirrored))
    camera = initial_estimates.base_camera(direct, layout.camera, corners_in_board_mm)
    renumbered = mirrored.renumbered()
    start = initial_estimates.first_estimate(renumbered, camera, layout, corners_in_board_mm)
    paper, _ = start_robustly(start, renumbered, replace(free, intrinsics=()))
    estimate, _ = start_robustly(paper, renumbered, free)
    numbers = np.unique(mirrored.frame)
    errors = residuals(estimate, renumbered, free.board)
    kept, notes = consistency.consistent_views(renumbered, errors, [names[n] for n in numbers], layout.mirror_names)
    if renumbered.direct_and_mirrored and len(renumbered) >= MIN_CORNERS_OF_EACH * len(corners_in_board_mm):
        estimate, free = _with_measured_board(estimate, renumbered, free)
        errors = residuals(estimate, renumbered, free.board)
    mirrored = with_view_noise(mirrored.where(kept), errors[kept])
    if not len(direct):
        return mirrored, direct, 1.0, notes, ()
    direct = with_view_noise(direct, _direct_residuals(direct.renumbered(), estimate.camera, layout, free))
    remaining = np.isin(numbers, mirrored.frame)
    estimate = estimate.of_frames(remaining)
    ratio, focal_px = _camera_disagreement(estimate, mirrored.renumbered(), direct.renumbered(), layout, free)
    return mirrored, direct, ratio, notes, consistency.drift_note(ratio, focal_px)


def _with_measured_board(estimate: Estimate, observations: Observations, model: Model) -> tuple[Estimate, Model]:
    """Fit each corner of the board; return the estimate and the model with these corners as the drawn ones.

    Errors of a print would otherwise look like noise of the pictures, most of all where the board appears large.
    """
    board = Board.free(model.board.corners_in_board_mm)
    start = replace(estimate, shape=np.zeros(len(board.modes)))
    fitted, _ = start_robustly(start, observations, replace(model, board=board))
    measured = Board.rigid(board.shaped(fitted.shape))
    return replace(fitted, shape=np.zeros(0)), replace(model, board=measured)


def _direct_residuals(direct: Observations, camera: Camera, layout: Layout, free: Model) -> FloatArray:
    """Residuals (n, 2), px, of frames without mirrors to their own robust fit, started from a camera."""
    start = initial_estimates.first_estimate(direct, camera, layout, free.board.corners_in_board_mm)
    direct_fit, _ = start_robustly(start, direct, replace(free, mirrors=False))
    return residuals(direct_fit, direct, free.board)


def _camera_disagreement(
    mirrored_fit: Estimate, mirrored: Observations, direct: Observations, layout: Layout, model: Model
) -> tuple[float, tuple[float, float]]:
    """Disagreement of frames with and without mirrors on the camera, in sigmas, and the focal length of each, px.

    It is 1 if a common fit shows no change of the camera, or a more probable cause of its misfit.
    """
    start = initial_estimates.first_estimate(direct, mirrored_fit.camera, layout, model.board.corners_in_board_mm)
    direct_inliers, direct_fit = _without_outliers(direct, start, model)
    mirrored_inliers, mirrored_fit = _without_outliers(mirrored, mirrored_fit, model)
    rows = Observations.join([mirrored_inliers, direct_inliers.with_frame_offset(len(mirrored_fit.rig_from_board))])
    poses = np.concatenate([mirrored_fit.rig_from_board, direct_fit.rig_from_board])
    common = fit_as("joint", mirrored_fit.with_poses(poses), rows, model)
    focal_px = mirrored_fit.camera.fx_px, direct_fit.camera.fx_px
    causes = ranked_causes(common, rows)
    if not causes or causes[0].kind != "focus" or causes[0].frame is not None:
        return 1.0, focal_px
    intrinsics = mirrored_fit.camera.intrinsics.size
    common_fit, _ = minimise(common.solution.estimate, rows, model)  # without rejecting contradictions as outliers
    ratio = consistency.camera_disagreement(
        [_standardised(mirrored_fit, mirrored_inliers, model), _standardised(direct_fit, direct_inliers, model)],
        _standardised(common_fit, rows, model),
        unknowns=len(model.parameters(mirrored_fit.camera, len(layout.mirrors))) + intrinsics + 6 * len(poses),
        common=intrinsics,
    )
    return max(ratio, 1.0), focal_px


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
