"""Calibration of a mirror camera, or a bare camera, from detected corners and the nominal layout.

1. Corners, views and frames that contradict the others are rejected (`screening`).
2. The base camera is estimated from the frames without mirrors, and the board poses from the nominal layout
   (`initial_estimates`).
3. For second-surface mirrors, corners are refined together with their ghost images (`ghost_images`), and screened
   again.
4. The lens's pupil is estimated from the mirrors' edges, and vignetted corners are left out (`pupil_estimate`).
5. The mirrors are solved with 3 parameters each, then all parameters jointly, then any more that the data support
   (`model_selection`).
6. The uncertainty and the validity of the result are assessed (`diagnostics`).

Without a design, the layout is measured from the same corners (`direct.direct_view`): it says nothing about the
mirrors' surface and edges, or about the scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.progress import Step, no_step
from mirrorcam.core.values import FloatArray, InvalidValue, Metric
from mirrorcam.optics.calibration.detection.ghost_images import refine_with_ghosts
from mirrorcam.optics.calibration.detection.segmentation import (
    DetectedEdge,
    Extremes,
    detected_edges,
    with_detected_outlines,
)
from mirrorcam.optics.calibration.diagnostics.board_scale import scale_doubt
from mirrorcam.optics.calibration.diagnostics.calibration_result import (
    Calibration,
    board_metrics,
    fit_metrics,
    held_out_metrics,
    spatial_rms_mm,
    uncertainty,
    with_estimate,
)
from mirrorcam.optics.calibration.diagnostics.consistency import (
    check_plausible,
    missing_views,
    pose_notes,
    refuse_implausible,
    unobserved_rows,
)
from mirrorcam.optics.calibration.diagnostics.diagnostics import diagnose
from mirrorcam.optics.calibration.diagnostics.layout_misfit import UnknownMirrors
from mirrorcam.optics.calibration.diagnostics.model_selection import ModelSelection, select_model
from mirrorcam.optics.calibration.diagnostics.nested_models import first_fit
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import views_of
from mirrorcam.optics.calibration.diagnostics.readout import readout
from mirrorcam.optics.calibration.diagnostics.requested_model import AUTO, RequestedModel
from mirrorcam.optics.calibration.diagnostics.screening import ScreenedFrames, frame_names, screen
from mirrorcam.optics.calibration.diagnostics.worst_views import with_worst_views
from mirrorcam.optics.calibration.pupil_estimate import BoardPictures, estimated_pupil, unvignetted
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.levenberg_marquardt import UndeterminedError
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.parameterisation import PAIR_DEG, prior_of
from mirrorcam.optics.calibration.solver.residuals import Estimate
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.lenses.families import LensName
from mirrorcam.optics.geometry.nearest_lens import nearest_lens

NO_UNKNOWN_MIRRORS = UnknownMirrors()


def calibrate_corners(
    mirrored: list[Observations],
    base: list[Observations],
    layout: Layout,
    corners_in_board_mm: FloatArray,
    *,
    model: RequestedModel = AUTO,
    extremes: Extremes | None = None,
    pictures: BoardPictures | None = None,
    unknown: UnknownMirrors = NO_UNKNOWN_MIRRORS,
    names: Sequence[str] | None = None,
    on_step: Step = no_step,
) -> Calibration:
    """Calibrate a mirror camera from detected corners.

    Parameters
    ----------
    mirrored, base
        Observations of each frame with and without mirrors; every element numbers its frame 0.
    layout
        Nominal layout; `Layout.bare` of a first estimate of the camera if there are no mirrors.
    corners_in_board_mm
        The board's corners (c, 3) in the board frame as drawn, mm.
    model
        Model to fit. `layout` already has the requested surface of the mirrors.
    extremes
        Pixel-wise extremes of the frames with mirrors; if given, the mirrors' outlines are moved to the edges that they
        show.
    pictures
        The frames, those with mirrors first; if given, the pupil of the lens is estimated from them.
    unknown
        Boards that belong to no mirror of the layout.
    names
        Names of all frames, `mirrored` first. Default: their numbers.
    on_step
        Called with each step in words.

    Raises
    ------
    InputError
        If the corners do not determine the camera and the mirrors.
    """
    if layout.mirrors:
        model.check_mirrored()
    else:
        model.check_plain()
    if not (mirrored if layout.mirrors else base):
        raise InputError("no pictures given")
    try:
        fitted = fit_corners(
            mirrored,
            base,
            layout,
            corners_in_board_mm,
            model=model,
            extremes=extremes,
            pictures=pictures,
            names=names,
            on_step=on_step,
        )
        on_step("comparing halves of the pictures")
        calibration = calibration_of(fitted, layout, extremes=extremes, unknown=unknown)
        if pictures is None:
            return calibration
        frames = pictures.frames
        return with_worst_views(calibration, lambda frame: frames[fitted.frames[frame]])
    except UndeterminedError as error:
        if not layout.mirrors:
            raise InputError(f"the pictures do not determine the camera: {error}; tilt the board in some") from None
        raise unknown.error_for(f"the frames do not determine camera and mirrors: {error}") from None
    except InvalidValue as error:
        raise unknown.error_for(f"the frames lead to impossible mirrors: {error}") from None
    except InputError as error:
        raise unknown.error_for(str(error)) from None


def check_names(names: Sequence[str], pictures: int) -> None:
    """Raise InputError unless there is one name for each picture."""
    if len(names) != pictures:
        raise InputError(f"names: {len(names)} for {pictures} pictures, expected one for each")


@dataclass(frozen=True)
class FittedCorners:
    """The selected model, and the corners that it was fitted to.

    Attributes
    ----------
    selection
        The selected model.
    observations
        The corners.
    frames
        Numbers of the frames that show corners, those with mirrors first.
    pictures
        Names of these frames.
    metrics, notes
        Of the pupil estimate, and of all observations that are missing or not used.
    is_designed
        Whether the layout states a design; otherwise it was measured from the same corners.
    """

    selection: ModelSelection
    observations: Observations
    frames: tuple[int, ...]
    pictures: tuple[str, ...]
    metrics: dict[str, Metric]
    notes: tuple[str, ...]
    is_designed: bool


def fit_corners(
    mirrored: list[Observations],
    base: list[Observations],
    layout: Layout,
    corners_in_board_mm: FloatArray,
    *,
    model: RequestedModel = AUTO,
    extremes: Extremes | None = None,
    pictures: BoardPictures | None = None,
    names: Sequence[str] | None = None,
    is_designed: bool = True,
    on_step: Step = no_step,
) -> FittedCorners:
    """Screen corners, and select and fit a model of camera, mirrors and board.

    Parameters
    ----------
    mirrored, base, layout, corners_in_board_mm, model, extremes, pictures, names, on_step
        As in `calibrate_corners`. Frames with mirrors may also show the board directly.
    is_designed
        Whether `layout` states a design; otherwise it was measured from the same corners.

    Raises
    ------
    InputError
        If corners contradict each other.
    UndeterminedError
        If the corners do not determine the camera and the mirrors.
    """
    names = frame_names(len(mirrored), len(base)) if names is None else names
    notes = (
        *missing_views(mirrored, base, names, layout.mirror_names),
        *_notes(mirrored, base, layout),
        *unobserved_rows([*mirrored, *base], corners_in_board_mm),
    )
    start = layout if model.lens is None else _with_lens(layout, model.lens)
    on_step("comparing the pictures with each other")
    screened = screen(mirrored, base, start, corners_in_board_mm, names=names)
    if pictures is not None and any(mirror.is_second_surface for mirror in layout.mirrors):
        on_step("refining the corners with their ghost images")
        mirrored = _refine_with_ghosts(screened, start, corners_in_board_mm, extremes, pictures)
        notes += (*screened.dropped, *_missing_pictures(screened.mirrored, pictures, names))
        screened = screen(mirrored, screened.base, start, corners_in_board_mm, names=names)
    frames, observations, estimate = _first_estimate(screened, start, corners_in_board_mm)
    metrics: dict[str, Metric] = {}
    pupil_notes: tuple[str, ...] = ()
    if layout.mirrors and (pictures is not None or estimate.camera.aperture_mm > 0.0):
        first, fitted_layout = _first_fit(estimate, observations, start, corners_in_board_mm, extremes)
        if pictures is not None:
            on_step("estimating the pupil of the lens")
            mirrored_numbers = [number for number in frames if number < len(mirrored)]
            posed = pictures.with_poses(mirrored_numbers, first.rig_from_board)
            pupil = estimated_pupil(fitted_layout, posed, pictures.board)
            metrics, pupil_notes = pupil.metrics, (pupil.note,)
            fitted_layout = fitted_layout.replaced(camera=pupil.camera)
        kept, left_out = unvignetted(fitted_layout, observations)
        observations, pupil_notes = observations.where(kept), (*pupil_notes, *left_out)
        estimate = replace(estimate, camera=estimate.camera.with_pupil(fitted_layout.camera.pupil))
    selection = select_model(
        estimate,
        observations,
        corners_in_board_mm,
        model=replace(model, surface=None),
        prior=prior_of(layout, observations),
        surface_known=is_designed or model.surface == "first",
        on_step=on_step,
    )
    return FittedCorners(
        selection.inflated_to(screened.inflation),
        observations,
        frames,
        tuple(names[number] for number in frames),
        metrics,
        (*notes, *screened.dropped, *screened.drift, *pupil_notes),
        is_designed,
    )


def _first_estimate(
    screened: ScreenedFrames, layout: Layout, corners_in_board_mm: FloatArray
) -> tuple[tuple[int, ...], Observations, Estimate]:
    """Return numbers of the frames that show corners, the corners with renumbered frames, and a starting estimate."""
    used = {number: o for number, o in enumerate((*screened.mirrored, *screened.base)) if len(o)}
    observations = Observations.join([o.with_frame_offset(index) for index, o in enumerate(used.values())])
    direct = observations.where(observations.frame >= sum(number < len(screened.mirrored) for number in used))
    camera = layout.camera
    if layout.mirrors:  # a bare camera is a first estimate from these frames already
        camera = initial_estimates.base_camera(direct, camera, corners_in_board_mm)
    start = initial_estimates.first_estimate(observations, camera, layout, corners_in_board_mm)
    return tuple(used), observations, start


def _first_fit(
    start: Estimate,
    observations: Observations,
    layout: Layout,
    corners_in_board_mm: FloatArray,
    extremes: Extremes | None,
) -> tuple[Estimate, Layout]:
    """Fit the smallest model; return the estimate, and its layout with the outlines detected in the frames."""
    first = first_fit(start, observations, corners_in_board_mm, prior_of(layout, observations))
    layout = with_estimate(layout, first)
    return first, layout if extremes is None else with_detected_outlines(layout, detected_edges(layout, extremes))[0]


def _refine_with_ghosts(
    screened: ScreenedFrames,
    layout: Layout,
    corners_in_board_mm: FloatArray,
    extremes: Extremes | None,
    pictures: BoardPictures,
) -> list[Observations]:
    """Refine the corners of the frames with mirrors together with the ghost images of second-surface mirrors."""
    numbers, observations, start = _first_estimate(screened, layout, corners_in_board_mm)
    first, layout = _first_fit(start, observations, layout, corners_in_board_mm, extremes)
    poses = dict(zip(numbers, first.rig_from_board, strict=True))
    return refine_with_ghosts(
        screened.mirrored,
        pictures.frames[: len(screened.mirrored)],
        poses,
        layout,
        pictures.board,
        workers=pictures.workers,
    )


def _missing_pictures(mirrored: list[Observations], pictures: BoardPictures, names: Sequence[str]) -> list[str]:
    return [
        f"{name}: not kept in memory, so its corners in second-surface mirrors are not used"
        for name, rows, picture in zip(names, mirrored, pictures.frames, strict=False)
        if len(rows) and picture is None
    ]


def calibration_of(
    fitted: FittedCorners,
    layout: Layout,
    *,
    extremes: Extremes | None = None,
    unknown: UnknownMirrors = NO_UNKNOWN_MIRRORS,
) -> Calibration:
    """Return the calibrated layout with diagnostics and metrics.

    Parameters
    ----------
    fitted
        The fit.
    layout
        The layout that it started from.
    extremes, unknown
        As in `calibrate_corners`.

    Raises
    ------
    InputError
        If the fit is implausible.
    """
    selection, observations = fitted.selection, fitted.observations
    measured_frames = len(np.unique(observations.frame[np.isin(observations.view, views_of(layout))]))
    calibrated = _calibrated(fitted, layout)
    notes = (*unknown.notes, *fitted.notes)
    mismatches: tuple[str, ...] = ()
    if fitted.is_designed and layout.mirrors:
        edges = [] if extremes is None else detected_edges(calibrated, extremes)
        mismatches, doubts = _scale_doubt(selection, layout, calibrated, edges)
        if edges:
            calibrated, outline_notes = with_detected_outlines(calibrated, edges)
            notes += outline_notes
        notes += doubts
    if fitted.is_designed:
        notes += check_plausible(selection.solution, layout, mirrored_frames=measured_frames)
    else:
        refuse_implausible(selection.solution, layout.mirror_names)
        notes += pose_notes(selection.solution.estimate.rig_from_board[:measured_frames])
    diagnostics = diagnose(selection, observations, calibrated, mismatches=(*unknown.alarms, *mismatches))
    selection = selection.inflated_to(diagnostics.inflation)
    solution, board = selection.solution, selection.model.board
    metrics = fit_metrics(observations, solution) | board_metrics(solution, board)
    spatial = spatial_rms_mm(solution.estimate, observations, solution.inliers, board)
    metrics["spatial_rms_mm"] = Metric(value=spatial, unit="mm")
    metrics |= held_out_metrics(solution, observations, selection.model, mirrored_frames=measured_frames)
    metrics |= diagnostics.metrics | unknown.metrics | fitted.metrics
    if (shutter := readout(selection, observations, fitted.frames[:measured_frames])) is not None:
        metrics["shutter_readout"] = Metric(value=shutter.periods, unit="1")
        metrics["shutter_readout_sigma"] = Metric(value=shutter.sigma, unit="1")
    return Calibration.of(
        solution,
        observations,
        calibrated,
        metrics=metrics,
        notes=notes,
        diagnostics=diagnostics,
        pictures=fitted.pictures,
    )


def _scale_doubt(
    selection: ModelSelection, layout: Layout, calibrated: Layout, edges: Sequence[Mapping[int, DetectedEdge]]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return alarms and notes about the stated size of the board."""
    side_mm, next_mm = np.diff(selection.model.board.corners_in_board_mm[:3, 0])
    element: Literal["square", "tag"] = "square" if np.isclose(side_mm, next_mm) or next_mm < 0.0 else "tag"
    mismatches, doubts = scale_doubt(layout, calibrated.virtual_centres_in_rig_mm, edges, float(side_mm), element)
    # Plates of another thickness or index also change the scale.
    return (mismatches if selection.other_surface is None else ()), doubts


def _with_lens(layout: Layout, lens: LensName) -> Layout:
    camera, _ = nearest_lens(layout.camera, lens)
    return layout.replaced(camera=camera)


def _notes(mirrored: list[Observations], base: list[Observations], layout: Layout) -> tuple[str, ...]:
    """Notes on what no frame determines, if none shows the board directly and in a mirror."""
    notes = []
    if not layout.mirrors or any(rows.direct_and_mirrored for rows in mirrored):
        return ()
    if len(layout.mirrors) == 2:
        notes.append(
            "two mirrors without a direct view of the board: no picture determines their common rotation about their "
            f"line of intersection, which is assumed as designed, within {PAIR_DEG:g} deg; the pose of one view "
            "relative to the other does not depend on it"
        )
    if not any(len(o) for o in base):
        notes.append("no frame without mirrors: the intrinsics rest on the mirrored views alone")
    return tuple(notes)


def _calibrated(fitted: FittedCorners, layout: Layout) -> Layout:
    selection = fitted.selection
    source = {"nominal": layout.provenance.get("nominal", layout.identity)} if fitted.is_designed else layout.provenance
    return with_estimate(layout, selection.solution.estimate).replaced(
        provenance={**source, "level": selection.model_name}, uncertainty=uncertainty(selection.solution)
    )
