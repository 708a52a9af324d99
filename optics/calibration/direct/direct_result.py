"""The result of a calibration with a direct view: layout, diagnostics, metrics, and notes on missing views."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy.spatial import ConvexHull

from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.calibration.diagnostics.calibration_result import (
    Calibration,
    angle_between_mirrors,
    fit_metrics,
    uncertainty,
)
from mirrorcam.optics.calibration.diagnostics.diagnostics import diagnose
from mirrorcam.optics.calibration.diagnostics.mirror_uncertainty import mirror_covariance
from mirrorcam.optics.calibration.diagnostics.model_selection import ModelSelection
from mirrorcam.optics.calibration.direct.motion import Shutter
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray, Solution
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.residuals import Estimate
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror, intersect_plane

MAX_LISTED = 8
"""Maximum number of pictures that notes list individually."""


def direct_result(
    selection: ModelSelection,
    flat_solution: Solution,
    observations: Observations,
    *,
    pictures: Sequence[int],
    names: Sequence[str],
    rotations: FloatArray | None,
    shutter: Shutter | None = None,
) -> Calibration:
    """Build the calibration of a selected model.

    Parameters
    ----------
    selection
        The selected model.
    flat_solution
        Best fit with the board exactly as drawn, for comparison.
    observations
        The corners, by frame.
    pictures
        Index into `names` for each frame.
    names
        Names of all pictures, for notes.
    rotations
        Rotation vectors (f, 3), rad, of the camera, if they were compensated.
    shutter
        The rolling shutter, if it was estimated; if supported, the corners are corrected to the middle row.

    Raises
    ------
    UndeterminedError
        If the corners do not determine the result.
    """
    layout = _layout(selection, observations)
    diagnostics = diagnose(selection, observations, layout)
    selection = selection.inflated_to(diagnostics.inflation)
    solution, board = selection.solution, selection.model.board
    estimate = solution.estimate
    metrics = fit_metrics(observations, solution)
    for axis, rms in zip("xy", flat_solution.rms_px, strict=True):
        metrics[f"flat_board_rms_{axis}_px"] = Metric(value=rms, unit="px")
    metrics |= _board_shape(board.shaped(estimate.shape) - board.corners_in_board_mm)
    if rotations is not None:
        largest_px = estimate.camera.fx_px * float(np.linalg.norm(rotations - rotations[0], axis=1).max())
        metrics["camera_turned_px"] = Metric(value=largest_px, unit="px")
    if shutter is not None:
        metrics["shutter_readout"] = Metric(value=shutter.readout, unit="1")
        metrics["shutter_readout_sigma"] = Metric(value=shutter.sigma, unit="1")
    if "sheet_mm" in solution.parameters:
        index = solution.parameters.index("sheet_mm")
        metrics["sheet_mm"] = Metric(value=estimate.thickness_mm[0], unit="mm")
        metrics["sheet_sigma_mm"] = Metric(value=np.sqrt(solution.covariance[index, index]), unit="mm")
    metrics |= _angles(solution)
    views, notes = _views(observations, len(board.corners_in_board_mm), pictures, names, layout.mirror_names)
    if shutter is not None and shutter.supported:
        sentence = (
            f"a rolling shutter reads a frame in {shutter.readout:.2f} ± {shutter.sigma:.1g} of the frame period: "
            "moving corners were corrected to the time of the middle row"
        )
        notes = (sentence, *notes)
    metrics["views"] = Metric(value=views, unit="1")
    metrics |= diagnostics.metrics
    base = range(len(estimate.rig_from_board) - len(pictures))
    return Calibration.of(
        solution,
        observations,
        layout,
        metrics=metrics,
        notes=notes,
        diagnostics=diagnostics,
        pictures=(*(names[number] for number in pictures), *(f"base frame {number}" for number in base)),
    )


def _board_shape(shift_mm: FloatArray) -> dict[str, Metric]:
    """Rms deviations of the board's corners (c, 3) from the drawing."""
    in_plane = np.sqrt(np.mean(np.sum(shift_mm[:, :2] ** 2, axis=1)))
    return {
        "board_shift_in_plane_rms_mm": Metric(value=in_plane, unit="mm"),
        "board_warp_rms_mm": Metric(value=np.sqrt(np.mean(shift_mm[:, 2] ** 2)), unit="mm"),
    }


def _angles(solution: Solution) -> dict[str, Metric]:
    """Angle between each pair of mirrors, and its standard deviation."""
    centres = solution.estimate.virtual_centres_in_rig_mm
    covariance = mirror_covariance(uncertainty(solution))
    metrics = {}
    for a, b in combinations(range(len(centres)), 2):
        rows = [*range(3 * a, 3 * a + 3), *range(3 * b, 3 * b + 3)]
        angle, sigma = angle_between_mirrors(centres[a], centres[b], covariance[np.ix_(rows, rows)])
        metrics[f"mirrors_{a}_{b}_angle_deg"] = Metric(value=np.degrees(angle), unit="deg")
        metrics[f"mirrors_{a}_{b}_angle_sigma_deg"] = Metric(value=np.degrees(sigma), unit="deg")
    return metrics


def _views(
    observations: Observations, corners: int, pictures: Sequence[int], names: Sequence[str], mirrors: Sequence[str]
) -> tuple[int, tuple[str, ...]]:
    """Return the number of views that show corners, and notes on views that show none or only some."""
    unused = [f"{picture}: no board found, not used" for n, picture in enumerate(names) if n not in pictures]
    names_used = [names[number] for number in pictures]
    observations = observations.where(observations.frame < len(names_used))
    view_count, notes = 0, []
    for view in range(DIRECT, len(mirrors)):
        name = "direct view" if view == DIRECT else f"mirror {mirrors[view]}"
        counts = np.bincount(observations.frame[observations.view == view], minlength=len(names_used))
        view_count += int((counts > 0).sum())
        missing = np.flatnonzero(counts == 0)
        partial = np.flatnonzero((counts > 0) & (counts < corners))
        if len(missing) > MAX_LISTED:
            notes.append(f"{name} not found in {len(missing)} of {len(names_used)} pictures")
        else:
            notes += [f"{names_used[number]}: {name} not found" for number in missing]
        if len(partial) > MAX_LISTED:
            low, high = counts[partial].min(), counts[partial].max()
            notes.append(
                f"{name} shows {low} to {high} of {corners} corners in {len(partial)} of {len(names_used)} pictures"
            )
        else:
            notes += [f"{names_used[number]}: {name} shows {counts[number]} of {corners} corners" for number in partial]
    return view_count, (*unused, *notes)


def _layout(selection: ModelSelection, observations: Observations) -> Layout:
    solution = selection.solution
    mirrors = len(solution.estimate.virtual_centres_in_rig_mm)
    return Layout(
        kind="calibrated",
        rows=1,
        cols=mirrors,
        camera=solution.estimate.camera,
        mirrors=tuple(visible_mirror(solution.estimate, observations, solution.inliers, m) for m in range(mirrors)),
        view_from_rig=np.eye(3),
        provenance={
            "source": "pictures of a checkerboard seen directly and in the mirrors",
            "level": selection.model_name,
        },
        uncertainty=uncertainty(solution),
    )


def visible_mirror(estimate: Estimate, observations: Observations, inliers: BoolArray, mirror: int) -> Mirror:
    """Return a mirror clipped to the convex hull of its observed corners, because nothing is known beyond them."""
    centre = estimate.virtual_centres_in_rig_mm[mirror]
    pixels = observations.pixels[inliers & (observations.view == mirror)]
    normalized = estimate.camera.normalized_from_pixels(pixels)
    hull = normalized[ConvexHull(normalized).vertices]
    if estimate.thickness_mm[mirror] <= 0.0:
        return Mirror(virtual_centre_in_rig_mm=centre, outline_in_rig_mm=intersect_plane(hull, centre))
    return Mirror(
        virtual_centre_in_rig_mm=centre,
        outline_in_rig_mm=intersect_plane(hull, centre),
        surface="second",
        thickness_mm=estimate.thickness_mm[mirror],
        refractive_index=estimate.refractive_index[mirror],
    )
