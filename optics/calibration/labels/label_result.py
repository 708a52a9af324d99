"""Calibrate from labels: the layout with covariances, points in space with their own, and the labels that are wrong."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.spatial import QhullError

from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.values import FloatArray, InvalidValue, Metric
from mirrorcam.optics.calibration.diagnostics.calibration_result import (
    Calibration,
    angle_between_mirrors,
    fit_metrics,
    layout_from_corners,
    uncertainty,
)
from mirrorcam.optics.calibration.diagnostics.mirror_uncertainty import mirror_covariance
from mirrorcam.optics.calibration.labels.consensus import consistent_labels, predicted_pixels
from mirrorcam.optics.calibration.labels.known_scale import CAMERA, KnownLength, Scaled, fitted_length, scaled
from mirrorcam.optics.calibration.labels.label_calibration import (
    LabelFit,
    fit_labels,
    label_observations,
)
from mirrorcam.optics.calibration.labels.label_checks import FreeMirrors, LabelSplit, free_mirrors, split_labels
from mirrorcam.optics.calibration.labels.label_table import LabelTable
from mirrorcam.optics.calibration.labels.point_adjustment import CameraPrior, covariance, points_estimate
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray, Solution, UndeterminedError
from mirrorcam.optics.calibration.solver.observations import DIRECT, IntArray, Observations
from mirrorcam.optics.calibration.solver.residuals import global_names
from mirrorcam.optics.geometry.layout import WORKING_DISTANCE, Layout

UNSCALED_MM = 100.0
"""Distance of the first mirror where no length is known."""
OUTLINE_WIDTHS = (6.0, 4.0, 3.0, 2.0)
"""Widths of a mirror's outline that are tried, in median deviations of its labels; 2 cover a uniform distribution."""
NEAR_SIGMAS = 5.0
"""Distance of a wrong label from where another one would be, up to which it counts as exchanged with it."""


@dataclass(frozen=True, eq=False)
class LabelledPoints:
    """Points in the rig frame: frame and label (p,), positions (p, 3), mm, and their covariances (p, 3, 3), mm^2."""

    frame: IntArray
    label: IntArray
    positions: FloatArray
    covariances: FloatArray


@dataclass(frozen=True)
class RejectedLabel:
    """A label that contradicts the others: indices of its frame and label, its view, and what is wrong with it.

    `error_px` is its distance from where its point is; NaN if that is unknown.
    """

    frame: int
    view: int
    label: int
    pixel: tuple[float, float]
    error_px: float
    remark: str


@dataclass(frozen=True, eq=False)
class LabelCalibration:
    """A calibration from labels.

    Attributes
    ----------
    calibration
        Layout, metrics and notes; its corners are the labels, its frames those of the table.
    table
        The labels.
    points
        The points in space.
    rejected
        Labels that were not used, by frame.
    splits, free
        Tests of the fit.
    spread
        Standard deviation of the known length between frames, relative to the predicted one.
    """

    calibration: Calibration
    table: LabelTable
    points: LabelledPoints
    rejected: tuple[RejectedLabel, ...]
    splits: tuple[LabelSplit, ...]
    free: FreeMirrors
    spread: float

    @property
    def layout(self) -> Layout:
        """The calibrated layout."""
        return self.calibration.layout


def calibrate_labels(table: LabelTable, camera: CameraPrior, known: KnownLength | None = None) -> LabelCalibration:
    """Calibrate a camera with mirrors from labels in the direct view and in the mirrors.

    Parameters
    ----------
    table
        The labels.
    camera
        What is known of the camera: a calibration (`CameraPrior.known`), a data sheet (`data_sheet_prior`), or the size
        of its pictures (`unknown_camera`).
    known
        A known length. Without one, the first mirror is at a distance of 100 mm.

    Returns
    -------
    LabelCalibration
        The layout has one row of mirrors, in the order of the table, in the rig frame, which is the camera's.

    Raises
    ------
    InputError
        If the labels do not determine the mirrors, or the known length is not in them.
    """
    observations, point_frame, point_label = label_observations(table)
    length = known or KnownLength(CAMERA, table.views[1], UNSCALED_MM)
    _check_inside(table, camera)
    fit = fit_labels(observations, camera, table.views)
    located = np.unique(fit.observations.frame[fit.consensus.used])
    frames, labels, intrinsics = point_frame[located], point_label[located], len(camera.free)
    try:
        splits = split_labels(fit, frames, labels)
        inflation = max([1.0, *(split.ratio for split in splits if split.ratio > split.limit)])
        raw = covariance(fit.estimate, fit.rows, camera)
        in_fit = fitted_length(length, table, fit.estimate, raw, intrinsics, frames, labels)
        result = scaled(fit.estimate, raw, intrinsics, in_fit, length.mm)
    except UndeterminedError as error:
        raise InputError(f"the labels do not determine camera and mirrors: {error}") from None
    result = replace(
        result,
        covariance=inflation**2 * result.covariance,
        point_covariances=inflation**2 * result.point_covariances,
    )
    free = free_mirrors(fit)
    errors = _errors(fit, located, len(point_frame))
    solution = _solution(fit, result, errors)
    rejected = _rejected(fit, errors, point_frame, point_label, table, located)
    rows = Observations(
        point_frame[fit.observations.frame],
        fit.observations.view,
        point_label[fit.observations.frame],
        fit.observations.pixels,
    )
    metrics = _metrics(solution, rows, result, splits, free, inflation)
    notes = _notes(table, rows, solution, known, inflation, splits)
    try:
        layout = _layout(solution, rows, table)
    except QhullError:
        raise InputError("fewer than three labels of a mirror agree with other views, expected more") from None
    calibration = Calibration(
        layout=layout.replaced(metrics=metrics),
        rig_from_board=np.zeros((0, 4, 4)),
        observations=rows,
        residuals_px=solution.residuals,
        inliers=solution.inliers,
        metrics=metrics,
        notes=notes,
        pictures=table.frames,
        residual_scale=fit.sigma_px,
    )
    points = LabelledPoints(frames, labels, result.points, result.point_covariances)
    return LabelCalibration(calibration, table, points, rejected, splits, free, in_fit.spread)


def _check_inside(table: LabelTable, prior: CameraPrior) -> None:
    size = np.array([prior.camera.width_px, prior.camera.height_px])
    outside = ((table.pixels < -size) | (table.pixels > 2 * size)).any(axis=1)
    if outside.mean() > 0.5:
        x, y = table.pixels[int(np.argmax(outside))]
        raise InputError(
            f"labels lie far outside the camera's picture of {size[0]} x {size[1]} px, like {x:.0f}, {y:.0f}: expected "
            "pixels of that picture"
        )


def _errors(fit: LabelFit, located: IntArray, points: int) -> FloatArray:
    """Predicted minus labelled pixels (n, 2) of all labels; NaN where the point is unknown or not visible."""
    estimate = fit.estimate
    predicted = np.full((points, 1 + len(estimate.virtual_centres_in_rig_mm), 2), np.nan)
    predicted[located] = predicted_pixels(
        estimate.camera, estimate.virtual_centres_in_rig_mm, estimate.rig_from_board[:, :3, 3]
    )
    rows = fit.observations
    return np.asarray(predicted[rows.frame, rows.view - DIRECT] - rows.pixels)


def _solution(fit: LabelFit, result: Scaled, errors: FloatArray) -> Solution:
    """The fit in mm as a solution of the solver."""
    camera, mirrors = fit.estimate.camera, len(result.centres)
    intrinsic_names = camera.intrinsic_names
    names = [intrinsic_names[index] for index in fit.prior.free]
    names += [name for name in global_names((), mirrors, 0) if name.endswith(("x_mm", "y_mm", "z_mm"))]
    return Solution(
        estimate=points_estimate(camera, result.centres, result.points),
        residuals=errors,
        inliers=fit.consensus.used,
        iterations=fit.iterations,
        standardised=errors,
        scale=fit.sigma_px,
        sigma_px=fit.sigma_px,
        parameters=tuple(names),
        covariance=result.covariance,
    )


def _layout(solution: Solution, rows: Observations, table: LabelTable) -> Layout:
    """The layout, whose mirrors are as large as the labels in them are spread.

    A wrong label can agree by chance, far from the others: where mirrors would overlap, their outlines end earlier.
    """
    invalid: InvalidValue | None = None
    for widths in OUTLINE_WIDTHS:
        shown = _near_others(rows, solution.inliers, widths)
        try:
            return layout_from_corners(solution.estimate, rows.where(shown)).replaced(
                provenance={"source": f"labels in the views {', '.join(table.views)}"},
                uncertainty=uncertainty(solution),
            )
        except InvalidValue as error:
            invalid = error
    raise InputError(f"the labels lead to impossible mirrors: {invalid}")


def _near_others(rows: Observations, used: BoolArray, widths: float) -> BoolArray:
    """Mask (n,) of the used labels within `widths` median deviations of the middle of their view, along x and y."""
    near = used.copy()
    for view in np.unique(rows.view):
        mine = np.flatnonzero(used & (rows.view == view))
        deviation = np.abs(rows.pixels[mine] - np.median(rows.pixels[mine], axis=0))
        near[mine] = (deviation <= widths * np.median(deviation, axis=0)).all(axis=1)
    return near


def _metrics(
    solution: Solution,
    rows: Observations,
    result: Scaled,
    splits: tuple[LabelSplit, ...],
    free: FreeMirrors,
    inflation: float,
) -> dict[str, Metric]:
    metrics = fit_metrics(rows, solution)
    own_names = {"corners": "labels", "outliers": "rejected_labels", "sigma_px": "label_sigma_px"}
    metrics = {own_names.get(name, name): metric for name, metric in metrics.items()}
    metrics["points"] = Metric(value=len(result.points), unit="1")
    distance = float(np.median(np.linalg.norm(result.points, axis=1)))
    metrics[WORKING_DISTANCE] = Metric(value=distance, unit="mm")
    sigmas = np.sqrt(np.linalg.eigvalsh(result.point_covariances)[:, -1])
    metrics["point_sigma_mm"] = Metric(value=float(np.median(sigmas)), unit="mm")
    centres, centre_covariance = result.centres, mirror_covariance(uncertainty(solution))
    for a, b in combinations(range(len(centres)), 2):
        index = [*range(3 * a, 3 * a + 3), *range(3 * b, 3 * b + 3)]
        angle, sigma = angle_between_mirrors(centres[a], centres[b], centre_covariance[np.ix_(index, index)])
        metrics[f"mirrors_{a}_{b}_angle_deg"] = Metric(value=np.degrees(angle), unit="deg")
        metrics[f"mirrors_{a}_{b}_angle_sigma_deg"] = Metric(value=np.degrees(sigma), unit="deg")
    for split in splits:
        name = f"split_{split.division.replace(' ', '_')}_ratio"
        metrics[name] = Metric(value=split.ratio, unit="1", limit=split.limit)
    metrics["covariance_inflation"] = Metric(value=inflation, unit="1")
    metrics["free_mirrors_turn_deg"] = Metric(value=float(np.abs(free.turn_deg).max()), unit="deg")
    metrics["free_mirrors_unexplained_px"] = Metric(value=free.unexplained_px, unit="px")
    return metrics


def _notes(
    table: LabelTable,
    rows: Observations,
    solution: Solution,
    known: KnownLength | None,
    inflation: float,
    splits: tuple[LabelSplit, ...],
) -> tuple[str, ...]:
    mirrors = ", ".join(f"mirror 0-{m} is the view {name!r}" for m, name in enumerate(table.views[1:]))
    notes = [*table.notes, mirrors]
    if known is None:
        notes.append(
            f"no length is known: lengths are in units of 1/{UNSCALED_MM:.0f} of the distance from the camera to "
            f"the mirror {table.views[1]!r}, not in mm"
        )
    single = len(table.frame) - len(rows)
    if single:
        notes.append(f"{count_text(single, 'label')} of points that only one view shows, not used")
    if inflation > 1.0:
        failed = " and ".join(split.division for split in splits if split.ratio > split.limit)
        notes.append(
            f"split {failed}, halves of the labels differ: all standard deviations are multiplied by {inflation:.2g}"
        )
    return tuple(notes)


def _rejected(
    fit: LabelFit,
    errors: FloatArray,
    point_frame: IntArray,
    point_label: IntArray,
    table: LabelTable,
    located: IntArray,
) -> tuple[RejectedLabel, ...]:
    """Describe every label that was not used."""
    estimate, rows, used = fit.estimate, fit.observations, fit.consensus.used
    centres = estimate.virtual_centres_in_rig_mm
    predicted = np.full((len(point_frame), 1 + len(centres), 2), np.nan)
    predicted[located] = predicted_pixels(estimate.camera, centres, estimate.rig_from_board[:, :3, 3])
    near_px = NEAR_SIGMAS * fit.sigma_px
    starts = np.searchsorted(point_frame, np.arange(len(table.frames) + 1))
    exchanged = _exchanged_views(fit, len(point_frame))
    is_located = np.zeros(len(point_frame), dtype=bool)
    is_located[located] = True
    found = []
    for row in np.flatnonzero(~used):
        point, view = int(rows.frame[row]), int(rows.view[row])
        frame = int(point_frame[point])
        remark = (
            "contradicts the other views" if is_located[point] else "the labels of this point contradict each other"
        )
        in_frame = np.arange(starts[frame], starts[frame + 1])
        at_others = np.linalg.norm(predicted[in_frame, view - DIRECT] - rows.pixels[row], axis=1)
        in_views = np.linalg.norm(predicted[point] - rows.pixels[row], axis=1)
        if exchanged[row]:
            remark = "exchanged between its views"
        elif (at_others < near_px).any():
            remark = f"is at {table.labels[point_label[in_frame[int(np.nanargmin(at_others))]]]!r}"
        elif (in_views < near_px).any():
            remark = f"is where the view {table.views[int(np.nanargmin(in_views))]!r} shows it"
        x, y = rows.pixels[row].tolist()
        error_px = float(np.linalg.norm(errors[row]))
        found.append(RejectedLabel(frame, view, int(point_label[point]), (x, y), error_px, remark))
    return tuple(found)


def _exchanged_views(fit: LabelFit, points: int) -> BoolArray:
    """Mask (n,) of the labels of points with two labels that agree once they are exchanged."""
    rows = fit.observations
    counts = np.bincount(rows.frame, minlength=points)
    used = np.bincount(rows.frame[fit.consensus.used], minlength=points)
    pairs = np.flatnonzero(((counts == 2) & (used == 0))[rows.frame])
    exchanged = np.zeros(len(rows), dtype=bool)
    if len(pairs):
        other = pairs.reshape(-1, 2)[:, ::-1].ravel()
        _, numbers = np.unique(rows.frame[pairs], return_inverse=True)
        swapped = Observations(numbers, rows.view[pairs], rows.corner[pairs], rows.pixels[other], rows.sigma_px[pairs])
        estimate = fit.estimate
        agreeing = consistent_labels(estimate.camera, estimate.virtual_centres_in_rig_mm, swapped, int(numbers[-1]) + 1)
        exchanged[pairs] = agreeing.used
    return exchanged
