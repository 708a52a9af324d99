"""All diagnostics of a calibration, for its report and its metrics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.calibration.diagnostics.free_views import FreeViews
from mirrorcam.optics.calibration.diagnostics.left_out import LeftOut
from mirrorcam.optics.calibration.diagnostics.mirror_uncertainty import (
    MirrorUncertainty,
    WeakDirection,
    mirror_uncertainty,
    weak_directions,
)
from mirrorcam.optics.calibration.diagnostics.model_comparison import ModelComparison
from mirrorcam.optics.calibration.diagnostics.model_selection import ModelSelection, OtherSurface
from mirrorcam.optics.calibration.diagnostics.next_picture import NextPicture, next_picture
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import (
    DepthUncertainty,
    ProjectionMap,
    depth_uncertainty,
    median_distance_mm,
    projection_map,
    uncertainty_of,
    views_of,
)
from mirrorcam.optics.calibration.diagnostics.score_test import Cause
from mirrorcam.optics.calibration.diagnostics.split_half import Split, splits
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.residuals import points_at_camera
from mirrorcam.optics.geometry.layout import Layout

MATCHING_PX = 0.1
MAX_PROJECTION_PX = 1.0
"""Median projection uncertainty of a bare camera above which it should not be used."""
DISTANCE_FACTORS = np.linspace(0.5, 2.5, 17)
"""Distances at which depth uncertainty is evaluated, in units of the working distance."""


@dataclass(frozen=True)
class Diagnostics:
    """Uncertainty of a calibration, and tests of its model.

    Attributes
    ----------
    model_name
        Name of the selected model, such as `joint+bend`.
    comparisons
        Each fitted model compared with the model nested in it.
    free_views
        Comparison with free virtual cameras, if possible.
    splits
        Agreement of halves of the frames.
    mirrors
        Standard deviations of the mirrors' planes; None for a bare camera.
    weak
        The least determined directions.
    projection
        Standard deviations of projected pixels at the working distance, one map per view.
    depth
        Standard deviations of depth as a function of distance.
    reference
        View that the others are measured against: a mirror's index, or DIRECT.
    range_mm
        Working distance, mm: median distance of the observed corners from the virtual centres.
    inflation
        Factor on all standard deviations here, relative to independent corner errors.
    alarms
        Evidence against the model, one sentence each.
    notes
        Undetermined quantities, one sentence each.
    other_surface
        Evidence that the mirrors reflect at a different surface from the one in the layout, if any.
    mismatches
        The alarms about pictures that do not match the given board or layout.
    causes
        What the model does not explain, the most probable cause first.
    left_out
        What is gained by leaving out pictures, if they are the first cause.
    next_picture
        The most useful further picture for a bare camera.
    """

    model_name: str
    comparisons: tuple[ModelComparison, ...]
    free_views: FreeViews | None
    splits: tuple[Split, ...]
    mirrors: MirrorUncertainty | None
    weak: tuple[WeakDirection, ...]
    projection: tuple[ProjectionMap, ...]
    depth: DepthUncertainty
    reference: int
    range_mm: float
    inflation: float
    alarms: tuple[str, ...]
    notes: tuple[str, ...]
    other_surface: OtherSurface | None = None
    mismatches: tuple[str, ...] = ()
    causes: tuple[Cause, ...] = ()
    left_out: LeftOut | None = None
    next_picture: NextPicture | None = None

    @property
    def metrics(self) -> dict[str, Metric]:
        """The metrics stored with a calibrated layout."""
        mirrors = self.mirrors
        figures: dict[str, tuple[float, str]] = {}
        compared = self.projection
        if mirrors is not None:
            figures = {
                "common_turn_sigma_deg": (float(np.linalg.norm(mirrors.common_rotation_deg)), "deg"),
                "common_shift_sigma_mm": (float(np.linalg.norm(mirrors.common_shift_mm)), "mm"),
                "mirror_to_mirror_normal_sigma_deg": (float(mirrors.relative_normal_deg.max()), "deg"),
                "mirror_to_mirror_distance_sigma_mm": (float(mirrors.relative_distance_mm.max()), "mm"),
            }
            compared = tuple(view for view in self.projection if view.view != self.reference)
        relative = "against_reference" if mirrors is not None else "apart_from_rotation"
        figures |= {
            "projection_sigma_px": (_rms([view.in_rig_px for view in self.projection]), "px"),
            f"projection_{relative}_sigma_px": (_rms([view.against_reference_px for view in compared]), "px"),
            "working_distance_mm": (self.range_mm, "mm"),
            "uncertainty_widened": (self.inflation, "1"),
            "alarms": (float(len(self.alarms)), "1"),
        }
        for name, values in (("matching", self.depth.matching_mm), ("calibration", self.depth.calibration_mm)):
            sigma_mm = float(np.interp(self.range_mm, self.depth.range_mm, values))
            figures[f"depth_{name}_sigma_mm"] = (sigma_mm, "mm")
        if self.free_views is not None:
            figures["unexplained_px"] = (self.free_views.unexplained_px, "px")
        for split in self.splits:
            figures[f"split_{split.key}_ratio"] = (split.overall_ratio, "1")
        return {name: Metric(value=value, unit=unit) for name, (value, unit) in figures.items() if np.isfinite(value)}


def _rms(parts: list[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) if parts else float("nan")


def reference_of(observations: Observations, layout: Layout) -> int:
    """The direct view if a frame shows its board in it and in a mirror, or none has one; else the central mirror's."""
    return DIRECT if observations.direct_and_mirrored or not layout.mirrors else layout.central_index


def diagnose(
    selection: ModelSelection, observations: Observations, layout: Layout, *, mismatches: tuple[str, ...] = ()
) -> Diagnostics:
    """Determine the uncertainty of a calibration and test its model.

    If halves of the frames differ by more than their covariances allow, all uncertainties in the result are larger than
    those of `layout`; `selection.inflated_to(diagnostics.inflation)` has the matching covariance.

    Parameters
    ----------
    selection
        The selected model and its fit.
    observations
        The fitted corners.
    layout
        The calibrated layout, with the covariance of the fit.
    mismatches
        Earlier alarms about the board or the nominal layout.
    """
    solution = selection.solution
    measured = np.isin(observations.view, views_of(layout))
    _, in_rig, _ = points_at_camera(solution.estimate, observations, selection.model.board)
    range_mm = median_distance_mm(layout, in_rig[measured], observations.view[measured])
    reference = reference_of(observations, layout)
    median_px = np.median(observations.pixels[observations.view == reference], axis=0)
    views = sorted({reference, *range(len(layout.mirrors))})
    halves, notes = splits(solution, observations, selection.model, layout, reference=reference, range_mm=range_mm)
    harmless = [split for split in halves if layout.mirrors and split.alarm is not None and not split.is_harmful]
    inflation = max(selection.inflation, *(split.inflation for split in halves), 1.0)
    uncertainty = uncertainty_of(layout)
    inflated = uncertainty.replaced(covariance=(inflation / selection.inflation) ** 2 * uncertainty.covariance)
    layout = layout.replaced(uncertainty=inflated)
    maps = tuple(projection_map(layout, view, reference=reference, range_mm=range_mm) for view in views)
    following = None
    if not layout.mirrors:
        following = next_picture(selection.inflated_to(inflation).solution, selection.model, layout, range_mm=range_mm)
    return Diagnostics(
        model_name=selection.model_name,
        comparisons=selection.comparisons,
        free_views=selection.free_views,
        splits=halves,
        mirrors=mirror_uncertainty(layout, lever_mm=range_mm) if layout.mirrors else None,
        weak=weak_directions(layout, range_mm=range_mm),
        projection=maps,
        depth=depth_uncertainty(
            layout, range_mm * DISTANCE_FACTORS, reference=reference, pixel=median_px, matching_px=MATCHING_PX
        ),
        reference=reference,
        range_mm=range_mm,
        inflation=inflation,
        alarms=(
            *mismatches,
            *([other.sentence(inflation)] if (other := selection.other_surface) is not None else []),
            *selection.alarms,
            *_alarms(halves, None if layout.mirrors else maps[0]),
        ),
        other_surface=selection.other_surface,
        notes=(*selection.notes, *notes, *(f"{split.alarm}: all uncertainties allow for it" for split in harmless)),
        mismatches=mismatches,
        causes=tuple(replace(cause, bias_sigmas=cause.bias_sigmas / inflation) for cause in selection.causes),
        left_out=selection.left_out,
        next_picture=following,
    )


def _alarms(halves: Sequence[Split], bare: ProjectionMap | None) -> Iterator[str]:
    """Yield alarms on halves that differ; for a bare camera, whose bounds allow for that, only if these are wide."""
    if bare is None:
        yield from (split.alarm for split in halves if split.alarm is not None and split.is_harmful)
        return
    sigma_px = float(np.median(bare.against_reference_px))
    if sigma_px > MAX_PROJECTION_PX:
        yield (
            f"the pictures determine the projection of points only to {sigma_px:.2g} px (median over the picture), "
            f"expected under {MAX_PROJECTION_PX:g} px"
        )
