"""All evidence about one calibration in one value, for its report and its metrics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.optics.base.values import FloatArray, Metric
from mirrorcam.optics.calibration.diagnostics.cross_validation import Split, splits
from mirrorcam.optics.calibration.diagnostics.depth_uncertainty import DepthUncertainty, depth_uncertainty
from mirrorcam.optics.calibration.diagnostics.free_views import FreeViews
from mirrorcam.optics.calibration.diagnostics.mirror_uncertainty import MirrorUncertainty, mirror_uncertainty
from mirrorcam.optics.calibration.diagnostics.model_selection import Climb, Rung
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import (
    ProjectionMap,
    known_of,
    projection_map,
    working_range_mm,
)
from mirrorcam.optics.calibration.diagnostics.weak_directions import WeakDirection, weak_directions
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.residuals import points_at_camera
from mirrorcam.optics.geometry.layout import Layout

MATCHING_PX = 0.1
RANGES = np.linspace(0.5, 2.5, 17)
"""Distances at which depth is judged, per working range."""


@dataclass(frozen=True)
class Evidence:
    """How sure a calibration is, and whether its model is right.

    `level` is the model's name on the ladder, `rungs` what was tried on the way. `reference` is the view that others
    are measured against (a mirror's, or DIRECT) and `range_mm` the working range of `projection` (a map per view) and
    `weak`. All uncertainties are `widened`, as a factor, against what independent errors of corners would make them, to
    what the data show. `alarms` say in words what speaks against the model, `notes` what could not be told.
    """

    level: str
    rungs: tuple[Rung, ...]
    free_views: FreeViews | None
    splits: tuple[Split, ...]
    mirrors: MirrorUncertainty
    weak: tuple[WeakDirection, ...]
    projection: tuple[ProjectionMap, ...]
    depth: DepthUncertainty
    reference: int
    range_mm: float
    widened: float
    alarms: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def metrics(self) -> dict[str, Metric]:
        """The figures that go into a layout's file."""
        mirrors = self.mirrors
        figures: dict[str, tuple[float, str]] = {
            "common_turn_sigma_deg": (float(np.linalg.norm(mirrors.common_turn_deg)), "deg"),
            "common_shift_sigma_mm": (float(np.linalg.norm(mirrors.common_shift_mm)), "mm"),
            "mirror_to_mirror_normal_sigma_deg": (float(mirrors.relative_normal_deg.max()), "deg"),
            "mirror_to_mirror_distance_sigma_mm": (float(mirrors.relative_distance_mm.max()), "mm"),
            "projection_sigma_px": (_rms([shown.in_rig_px for shown in self.projection]), "px"),
            "projection_against_reference_sigma_px": (
                _rms([shown.against_reference_px for shown in self.projection if shown.view != self.reference]),
                "px",
            ),
            "uncertainty_widened": (self.widened, "1"),
            "alarms": (float(len(self.alarms)), "1"),
        }
        for name, values in (("matching", self.depth.matching_mm), ("calibration", self.depth.calibration_mm)):
            at = float(np.interp(self.range_mm, self.depth.range_mm, values))
            figures[f"depth_{name}_sigma_mm"] = (at, "mm")
        if self.free_views is not None:
            figures["unexplained_px"] = (self.free_views.unexplained_px, "px")
        for split in self.splits:
            figures[f"split_{split.how.split()[1]}_ratio"] = (split.overall_ratio, "1")
        return {name: Metric(value=value, unit=unit) for name, (value, unit) in figures.items() if np.isfinite(value)}


def _rms(parts: list[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) if parts else float("nan")


def reference_of(observations: Observations, layout: Layout) -> int:
    """The direct view where a frame shows its board both directly and in a mirror, else the central mirror's view."""
    mirrored = observations.view != DIRECT
    both = np.intersect1d(observations.frame[mirrored], observations.frame[~mirrored])
    return DIRECT if len(both) else layout.central_index


def gather(climb: Climb, observations: Observations, layout: Layout) -> Evidence:
    """The evidence about the calibrated `layout`, which carries the covariance of the climb's solution.

    Where halves of the frames differ by more than that covariance allows, all uncertainties told here are wider than
    those of `layout`: `climb.widened_to(evidence.widened)` has the covariance that goes with them.
    """
    solution = climb.solution
    mirrored = observations.view != DIRECT
    _, in_rig, _ = points_at_camera(solution.estimate, observations, climb.model.board)
    range_mm = working_range_mm(layout, in_rig[mirrored], observations.view[mirrored])
    reference = reference_of(observations, layout)
    middle = np.median(observations.pixels[observations.view == reference], axis=0)
    views = sorted({reference, *range(len(layout.mirrors))})
    halves, notes = splits(solution, observations, climb.model, layout, reference=reference, range_mm=range_mm)
    widened = max(climb.widened, *(split.widening for split in halves), 1.0)
    known = known_of(layout)
    wider = known.replaced(covariance=(widened / climb.widened) ** 2 * known.covariance)
    layout = layout.replaced(uncertainty=wider)
    return Evidence(
        level=climb.level,
        rungs=climb.rungs,
        free_views=climb.free_views,
        splits=halves,
        mirrors=mirror_uncertainty(layout, lever_mm=range_mm),
        weak=weak_directions(layout, range_mm=range_mm),
        projection=tuple(projection_map(layout, view, reference=reference, range_mm=range_mm) for view in views),
        depth=depth_uncertainty(layout, range_mm * RANGES, reference=reference, at_px=middle, matching_px=MATCHING_PX),
        reference=reference,
        range_mm=range_mm,
        widened=widened,
        alarms=(*climb.alarms, *(split.alarm for split in halves if split.alarm is not None)),
        notes=(*climb.notes, *notes),
    )
