"""Verdict on a calibration, in words and figures, with advice on further pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

from mirrorcam.core.figures.figure_texts import SIGMA
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.cause_texts import cause_advice, cause_sentence
from mirrorcam.optics.calibration.diagnostics.diagnostics import Diagnostics
from mirrorcam.optics.calibration.diagnostics.split_half import ALARM_RATIO
from mirrorcam.optics.calibration.diagnostics.view_statistics import (
    SYSTEMATIC_CHANCE,
    CellMeans,
    ViewFigures,
    board_normals,
    calibrated_views,
    cell_means,
)
from mirrorcam.optics.calibration.solver.observations import DIRECT

MAX_OUTLIERS = 0.02
MAX_BEYOND_3_SIGMA = 0.01  # for Gaussian noise, 0.0027 is expected
MAX_RMS_RATIO = 1.5  # ratio of the noisiest to the quietest view and axis
MIN_COVERAGE = 0.6
MIN_FRAMES = 5
MIN_FRAMES_FOR_CAUSE = 10  # with fewer, errors of single pictures look like changes between them
MIN_ROTATION_DEG = 30.0  # between the most different boards
MIN_DISTANCE_RATIO = 1.25  # of the farthest to the nearest board
MAX_HELD_OUT_RATIO = 1.25
MAX_BIAS_SIGMAS = 1.0
CHANCE = 1e-3
State = Literal["good", "look", "stop"]
STATES: dict[State, str] = {"good": "Good to use", "look": "Look at this before you use it", "stop": "Do not use it"}
LARGE_FRACTION = 0.8  # of these corners: if so many are in few pictures, these are the cause
FEW_PICTURES_FRACTION = 0.15  # maximum fraction of all pictures that counts as few
MIN_VIEW_FRACTION = 0.6  # of these corners: if so many are in one view, it is the cause
MIN_FRACTION_RATIO = 2.0  # minimum ratio of that fraction to the view's fraction of all corners


@dataclass(frozen=True)
class Check:
    """A figure with its limit, and the reason and advice to give if it fails."""

    label: str
    metric: Metric
    reason: str
    advice: str


@dataclass(frozen=True)
class Verdict:
    """The state, its reasons, advice, and the checks behind it."""

    state: State
    reasons: tuple[str, ...]
    advice: tuple[str, ...]
    checks: tuple[Check, ...]


def check_solution(calibration: Calibration, views: Sequence[ViewFigures]) -> Verdict:
    """Return the verdict: alarms of the diagnostics forbid use, figures beyond their limits call for inspection.

    The first cause of a misfit explains alarms and figures, so its advice replaces theirs.
    """
    symptoms = (
        *_noise_checks(calibration, views),
        *_uniformity_checks(views),
        *_diagnostic_checks(calibration),
    )
    pictures = _picture_checks(calibration, views)
    diagnostics = calibration.diagnostics
    cause = _cause_check(calibration)
    alarms = diagnostics.alarms if diagnostics else ()
    failed = [check for check in (*cause, *symptoms, *pictures) if not check.metric.passed]
    reasons = [*alarms, *(check.reason for check in failed if check not in cause)]
    advice = [*_advice_on_alarms(diagnostics), *(check.advice for check in failed)]
    if cause and (reasons or cause[0] in failed):
        stated = diagnostics is not None and (diagnostics.mismatches or diagnostics.other_surface is not None)
        remaining = [check.advice for check in failed if check in pictures]
        reasons = [*reasons, cause[0].reason] if stated else [cause[0].reason, *reasons]
        advice = [*(_advice_on_alarms(diagnostics) if stated else [cause[0].advice]), *remaining]
    frames = len(np.unique(calibration.observations.frame))
    if not cause and frames < MIN_FRAMES_FOR_CAUSE and (alarms or any(check in failed for check in symptoms)):
        reasons.append(f"{frames} pictures are too few to find the cause")
        advice.append(f"Take {MIN_FRAMES_FOR_CAUSE} pictures or more: then a cause shows.")
    if diagnostics is None:
        reasons.append("the model was not checked")
        advice.append("Calibrate with a nominal layout, so that models can be compared.")
    state: State = "stop" if alarms else "look" if reasons else "good"
    return Verdict(state, tuple(dict.fromkeys(reasons)), tuple(dict.fromkeys(advice)), (*cause, *symptoms, *pictures))


def _cause_check(calibration: Calibration) -> tuple[Check, ...]:
    """Check how far the first cause of a misfit moves the mirrors; empty if no cause was found."""
    diagnostics = calibration.diagnostics
    if diagnostics is None or not diagnostics.causes:
        return ()
    cause = diagnostics.causes[0]
    shifted = "mirrors" if calibration.layout.mirrors else "camera"
    return (
        Check(
            f"Shift of the {shifted} due to the first cause of the misfit, relative to its bound",
            Metric(value=cause.bias_sigmas, unit="1", limit=MAX_BIAS_SIGMAS),
            cause_sentence(cause, calibration),
            cause_advice(cause, calibration),
        ),
    )


def _advice_on_alarms(diagnostics: Diagnostics | None) -> list[str]:
    """Advice on alarms: to use the model that the data support if one was tried, else to look for motion."""
    if diagnostics is None or not diagnostics.alarms:
        return []
    if diagnostics.mismatches:  # other failures may follow from these
        return ["Correct the board or layout as the alarm states, and calibrate again."]
    if diagnostics.other_surface is not None:
        kind = "second" if diagnostics.other_surface.is_second_surface else "first"
        option = f"--model {kind}_surface+auto"
        return [f"If the mirrors are {kind}-surface, calibrate again with {option}, or state it in the layout."]
    supported = [
        comparison
        for comparison in diagnostics.comparisons
        if comparison.supported and comparison.against == diagnostics.model_name
    ]
    if not supported:
        return ["Look for what moved or bent while the pictures were taken, and take them again."]
    best = max(supported, key=lambda comparison: comparison.information_gain)
    return [f"Calibrate again with --model {best.name}, which the pictures support."]


def _noise_checks(calibration: Calibration, views: Sequence[ViewFigures]) -> list[Check]:
    outliers = float((~calibration.inliers).mean())
    large = np.abs(calibration.standardised) > 3.0
    large_fraction = float(large[calibration.inliers].mean())
    means = [cell_means(calibration, view.view) for view in views]
    systematic = np.concatenate([cells.systematic for cells in means])
    limit = float(binom.isf(CHANCE, len(systematic), SYSTEMATIC_CHANCE)) / len(systematic)
    return [
        Check(
            "Corners rejected as outliers",
            Metric(value=outliers, unit="of the corners", limit=MAX_OUTLIERS),
            f"{outliers:.1%} of the corners fit no model",
            advice_on_corners(calibration, views, ~calibration.inliers),
        ),
        Check(
            f"Residuals beyond 3 {SIGMA}",
            Metric(value=large_fraction, unit="of the corners", limit=MAX_BEYOND_3_SIGMA),
            f"{large_fraction:.1%} of the residuals are beyond 3 {SIGMA}; noise alone gives 0.3 %",
            advice_on_corners(calibration, views, large.any(axis=1) & calibration.inliers),
        ),
        Check(
            "Cells with a significant mean residual",
            Metric(value=float(systematic.mean()), unit="of the cells", limit=limit),
            f"mean residuals are significant in {systematic.mean():.0%} of the cells, "
            f"by chance in {SYSTEMATIC_CHANCE:.0%}",
            advice_on_cells(means, views),
        ),
    ]


def _uniformity_checks(views: Sequence[ViewFigures]) -> list[Check]:
    """Check that all views and both axes fit equally well: the overall rms can hide an error in one view."""
    rms = {
        (view.name_in_sentence, axis): float(value)
        for view in views
        for axis, value in zip("xy", view.rms_sigmas, strict=True)
    }
    finite = {key: value for key, value in rms.items() if np.isfinite(value)}
    worst, best = max(finite, key=lambda key: finite[key]), min(finite, key=lambda key: finite[key])
    ratio = finite[worst] / finite[best]
    return [
        Check(
            "RMS of the noisiest view and axis, relative to the quietest",
            Metric(value=ratio, unit="1", limit=MAX_RMS_RATIO),
            f"relative to the scatter of corners, the residuals of {worst[0]} in {worst[1]} are {ratio:.1f} times "
            f"those of {best[0]} in {best[1]}",
            f"Look at the arrows of {worst[0]}: its residuals exceed the scatter of its corners.",
        )
    ]


def _diagnostic_checks(calibration: Calibration) -> list[Check]:
    diagnostics, metrics = calibration.diagnostics, calibration.metrics
    checks = []
    if "held_out_scale" in metrics:
        ratio = metrics["held_out_scale"].value
        checks.append(
            Check(
                "RMS of held-out frames, relative to the fit",
                Metric(value=ratio, unit="1", limit=MAX_HELD_OUT_RATIO),
                f"residuals of held-out frames are {ratio:.2f} times those of the fit",
                "Take more pictures: with these few, the model overfits.",
            )
        )
    if diagnostics is None:
        return checks
    checks += [
        Check(
            f"Frames split {split.division}: difference relative to the predicted one",
            Metric(value=split.overall_ratio, unit="1", limit=ALARM_RATIO),
            split.alarm
            or f"split {split.division}, calibrations differ by {split.overall_ratio:.1f} times the prediction",
            "Do not rely on the stated uncertainty until the halves agree: see the model selection below.",
        )
        for split in diagnostics.splits
    ]
    range_mm = diagnostics.range_mm
    calibration_mm, matching_mm = (
        float(np.interp(range_mm, diagnostics.depth.range_mm, values))
        for values in (diagnostics.depth.calibration_mm, diagnostics.depth.matching_mm)
    )
    if np.isfinite(calibration_mm) and matching_mm > 0.0:
        checks.append(
            Check(
                f"Depth {SIGMA} at {range_mm:.0f} mm, calibration relative to matching",
                Metric(value=calibration_mm / matching_mm, unit="1", limit=1.0),
                f"at {range_mm:.0f} mm the depth uncertainty from calibration ({calibration_mm:.2g} mm) exceeds that "
                "from matching",
                "Take more pictures with tilted boards: they reduce the calibration's depth uncertainty.",
            )
        )
    return checks


def _picture_checks(calibration: Calibration, views: Sequence[ViewFigures]) -> list[Check]:
    calibrated = calibrated_views(views)
    min_coverage_view = min(calibrated, key=lambda view: view.coverage)
    min_frames_view = min(calibrated, key=lambda view: view.frames)
    normals, mirrored = board_normals(calibration)
    rotation_deg = _largest_rotation_deg(normals[mirrored])
    spans = {
        view.name_in_sentence: float(view.distances_mm.max() / view.distances_mm.min())
        for view in calibrated
        if view.frames
    }
    flattest = min(spans, key=lambda name: spans[name])
    return [
        *_projection_check(calibration.diagnostics),
        Check(
            "Lowest coverage of a view",
            Metric(value=min_coverage_view.coverage, unit="of the view", limit=MIN_COVERAGE, lower_is_better=False),
            f"corners fill {min_coverage_view.coverage:.0%} of {min_coverage_view.name_in_sentence}",
            f"Show the board {empty_region(min_coverage_view)} of {min_coverage_view.name_in_sentence}"
            f"{', as seen in the picture' if min_coverage_view.view != DIRECT else ''}.",
        ),
        Check(
            "Fewest frames with a board in a view",
            Metric(value=min_frames_view.frames, unit="1", limit=MIN_FRAMES, lower_is_better=False),
            f"{min_frames_view.name_in_sentence} shows the board in {min_frames_view.frames} frames"
            if min_frames_view.view != DIRECT
            else f"{min_frames_view.frames} pictures show the board",
            f"Take {MIN_FRAMES - min_frames_view.frames} more pictures with the board"
            f"{f' in {min_frames_view.name}' if min_frames_view.view != DIRECT else ''}.",
        ),
        Check(
            "Largest rotation between two boards",
            Metric(value=rotation_deg, unit="deg", limit=MIN_ROTATION_DEG, lower_is_better=False),
            f"no two boards differ by more than {rotation_deg:.0f}° in orientation",
            f"Tilt the board more: {_missing_tilt(normals[mirrored])}.",
        ),
        Check(
            "Smallest ratio of farthest to nearest board in a view",
            Metric(value=spans[flattest], unit="1", limit=MIN_DISTANCE_RATIO, lower_is_better=False),
            f"{flattest} shows boards at nearly one distance",
            f"Hold the board nearer to and farther from {flattest if calibration.layout.mirrors else 'the camera'}.",
        ),
    ]


def _projection_check(diagnostics: Diagnostics | None) -> list[Check]:
    """Check the projection uncertainty of a bare camera, and recommend the next picture."""
    if diagnostics is None or diagnostics.next_picture is None:
        return []
    sigma_px, matching_px = diagnostics.next_picture.sigma_px, diagnostics.depth.matching_px
    return [
        Check(
            f"Projection {SIGMA} over the picture, apart from a rotation of the camera",
            Metric(value=sigma_px, unit="px", limit=matching_px),
            f"the projection of points is uncertain by {sigma_px:.2g} px over the picture, more than matching "
            f"({matching_px:g} px)",
            f"Take more pictures: {diagnostics.next_picture.sentence}.",
        )
    ]


def _largest_rotation_deg(normals: FloatArray) -> float:
    """Largest angle between two boards, from their unit normals (f, 3)."""
    return float(np.degrees(np.arccos(np.clip((normals @ normals.T).min(), -1.0, 1.0))))


def _missing_tilt(normals: FloatArray) -> str:
    """Describe the direction in which boards were tilted least, from their unit normals (f, 3) in view axes."""
    tilts = {
        "left edge nearer": -normals[:, 0].min(),
        "right edge nearer": normals[:, 0].max(),
        "top edge nearer": -normals[:, 1].min(),
        "bottom edge nearer": normals[:, 1].max(),
    }
    return f"{min(tilts, key=lambda tilt: tilts[tilt])}, by 30° or so"


def empty_region(view: ViewFigures) -> str:
    """Describe which of nine regions of a view has the fewest corners."""
    low, high = view.outline_px.min(axis=0), view.outline_px.max(axis=0)
    centres = (view.cells_px[:, :2] + view.cells_px[:, 2:]) / 2.0
    thirds = np.minimum((3 * (centres - low) / (high - low)).astype(int), 2)
    regions = {tuple(third): float("inf") for third in thirds.tolist()}
    for region in regions:
        inside = (thirds == region).all(axis=1)
        regions[region] = float((view.cell_counts[inside] > 0).mean()) + 1e-6 * float(view.cell_counts[inside].mean())
    column, row = min(regions, key=lambda region: regions[region])
    if (column, row) == (1, 1):
        return "in the middle"
    return "at the " + " ".join(word for word in (("top", "", "bottom")[row], ("left", "", "right")[column]) if word)


def advice_on_corners(calibration: Calibration, views: Sequence[ViewFigures], rows: NDArray[np.bool_]) -> str:
    """Give advice on the corners of a mask (n,) by where they lie: in few pictures, in one view, or spread out."""
    observations = calibration.observations
    count, frames = int(rows.sum()), len(np.unique(observations.frame))
    frame_counts = np.sort(np.bincount(observations.frame[rows], minlength=frames))[::-1]
    needed = int(np.searchsorted(np.cumsum(frame_counts), LARGE_FRACTION * count)) + 1
    if count and needed <= max(FEW_PICTURES_FRACTION * frames, 1.0):
        pictures = "1 picture" if needed == 1 else f"{needed} pictures"
        return (
            f"{LARGE_FRACTION:.0%} of these corners are in {pictures} of {frames}: look there for glare, motion blur "
            "or an obstacle in front of the board, and take these pictures again."
        )
    for view in views:
        in_view = observations.view == view.view
        fraction, expected = rows[in_view].sum() / max(count, 1), in_view.mean()
        if fraction > MIN_VIEW_FRACTION and fraction > MIN_FRACTION_RATIO * expected:
            name = view.name_in_sentence
            return f"{fraction:.0%} of these corners are in {name}: look for dirt, an edge or glare there."
    return "These corners are spread over pictures and views, so there is no single cause: the noise has long tails."


def advice_on_cells(cells: Sequence[CellMeans], views: Sequence[ViewFigures]) -> str:
    """Give advice on cells with significant mean residuals, in some views or in all."""
    systematic_views = [
        view.name_in_sentence
        for view, means in zip(views, cells, strict=True)
        if means.systematic.sum() > binom.isf(CHANCE, len(means.systematic), SYSTEMATIC_CHANCE)
    ]
    if 0 < len(systematic_views) <= len(views) / 2.0:
        return f"See the red arrows of {', '.join(systematic_views)}: a mirror there may be bent or displaced."
    if not any(view.view != DIRECT for view in views):
        return "See the red arrows: the board may be bent, or the lens beyond its model."
    return "See the red arrows, which are in most views: the board may be bent, or the lens beyond its model."
