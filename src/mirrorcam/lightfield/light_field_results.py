"""Measurements in light fields as files: depth, features and epipolar-plane images, each with a figure."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.files import write_npz
from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.core.images.pfm import write_pfm
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.lightfield.depth_figure import draw_depth
from mirrorcam.lightfield.epi_figure import draw_epi
from mirrorcam.lightfield.features_figure import draw_features
from mirrorcam.lightfield.kept_depths import keep_depth, write_depth
from mirrorcam.lightfield.light_field_inputs import LightFieldInputs, RecordingFilter
from mirrorcam.optics.light_field.depth import DepthEstimator, Quality
from mirrorcam.optics.light_field.features import FeatureDetector, FeatureFinder
from mirrorcam.optics.light_field.features.feature_files import save_csv, save_npz
from mirrorcam.optics.light_field.light_field import Axis
from mirrorcam.optics.light_field.render.epipolar_images import Epi, epi

SURE = 0.5
"""Confidence above which a depth counts as known."""
DEPTH_ENDINGS = ("depth.npz", "depth.pfm", "depth.png")
FEATURE_ENDINGS = ("features.npz", "features.csv", "features.png")
EPI_ENDINGS = ("epi.npz", "epi.png")


def result_names(name: str, endings: Sequence[str]) -> list[str]:
    """Names of the files of a light field's results, as patterns of `refuse_others`."""
    return [f"{glob.escape(name)}_{ending}" for ending in endings]


@dataclass(frozen=True)
class DepthSummary:
    """Depth of one light field: share of pixels with a depth and with a sure one, and the median of the sure ones.

    The median is NaN without any.
    """

    name: str
    known: float
    sure: float
    median_mm: float


def write_depths(
    inputs: LightFieldInputs,
    folder: Path,
    *,
    near_mm: float | None = None,
    far_mm: float | None = None,
    quality: Quality = "best",
    frames_apart: bool = False,
    force: bool = False,
    progress: Progress = no_progress,
) -> list[DepthSummary]:
    """Measure depth in light fields, between the depths given or those that their files state, in a quality.

    Frames of a recording are filtered in time first, unless they are kept apart; other light fields never are.
    Writes NAME_depth.npz, .pfm and .png into a folder, where `force` also replaces files of others.
    """
    estimator: DepthEstimator | None = None
    recording = RecordingFilter()
    summaries = []
    with output_folder(folder, "depth", force=force) as output:
        output.refuse_others(*(name for each in inputs.file_names for name in result_names(each, DEPTH_ENDINGS)))
        for each in inputs.each(progress):
            if estimator is None or not estimator.fits(each.light_field):
                near, far = each.depths_to_search(near_mm, far_mm)
                estimator = DepthEstimator(each.light_field, near_mm=near, far_mm=far, quality=quality)
            output.refuse_others(*result_names(each.name, DEPTH_ENDINGS))
            depth = estimator.estimate(each.light_field if frames_apart else recording.filtered(each))
            searched_mm = estimator.near_mm, estimator.far_mm
            with output.staged(complete=False, result=f"{each.name}_depth.pfm") as staged:
                write_depth(staged, each.name, depth, each.light_field, searched_mm)
                write_pfm(staged / f"{each.name}_depth.pfm", depth.depth_mm)
                draw_depth(staged / f"{each.name}_depth.png", each.light_field, depth)
            keep_depth(output, each.name, each.light_field, searched_mm)
            sure = depth.valid & (depth.confidence > SURE)
            median = float(np.median(depth.depth_mm[sure])) if sure.any() else np.nan
            summaries.append(DepthSummary(each.name, float(depth.valid.mean()), float(sure.mean()), median))
    return summaries


@dataclass(frozen=True)
class FeaturesSummary:
    """Features of one light field: their count, how many are refracted, and the median sigma of their depth."""

    name: str
    count: int
    refracted: int
    median_sigma_mm: float


@dataclass(frozen=True)
class FeatureSearch:
    """Parameters of a search for features, as `FeatureFinder` documents them."""

    detector: FeatureDetector = "SIFT"
    keypoints: int = 600
    max_distance_px: float = 0.5
    min_views: int | None = None
    near_mm: float | None = None
    far_mm: float | None = None
    two_slope_sigma: float = 4.0


def write_features(
    inputs: LightFieldInputs,
    folder: Path,
    search: FeatureSearch,
    *,
    force: bool = False,
    progress: Progress = no_progress,
) -> list[FeaturesSummary]:
    """Find features in light fields, up to infinity where neither the search nor a file states a depth.

    Writes NAME_features.npz, .csv and .png into a folder, where `force` also replaces files of others.
    """
    finder: FeatureFinder | None = None
    depth_range_mm: tuple[float, float] | None = None
    summaries = []
    with output_folder(folder, "features", force=force) as output:
        output.refuse_others(*(name for each in inputs.file_names for name in result_names(each, FEATURE_ENDINGS)))
        for each in inputs.each(progress):
            if finder is None or each.depth_range_mm != depth_range_mm or not finder.fits(each.light_field):
                depth_range_mm = each.depth_range_mm
                near, far = each.depths_to_search(search.near_mm, search.far_mm)
                finder = FeatureFinder(
                    each.light_field,
                    search.detector,
                    keypoints=search.keypoints,
                    max_distance_px=search.max_distance_px,
                    min_views=search.min_views,
                    nearest_mm=near,
                    farthest_mm=np.inf if far is None else far,
                    two_slope_sigma=search.two_slope_sigma,
                )
            output.refuse_others(*result_names(each.name, FEATURE_ENDINGS))
            found = finder.find(each.light_field)
            with output.staged(complete=False, result=f"{each.name}_features.csv") as staged:
                save_npz(staged / f"{each.name}_features.npz", found)
                save_csv(staged / f"{each.name}_features.csv", found)
                draw_features(staged / f"{each.name}_features.png", each.light_field, found)
            sigma = float(np.median(found.depth_sigma_mm)) if len(found) else np.nan
            summaries.append(FeaturesSummary(each.name, len(found), int(found.refracted.sum()), sigma))
    return summaries


def write_epipolar_images(
    inputs: LightFieldInputs,
    folder: Path,
    *,
    axis: Axis = "s",
    line: int | None = None,
    depth_mm: float | None = None,
    force: bool = False,
    progress: Progress = no_progress,
) -> list[str]:
    """Cut epipolar-plane images out of light fields, at a line of the central view or in its middle.

    Points at `depth_mm` (by default the reference depth) form vertical lines. Writes NAME_epi.npz and .png, and returns
    the names of those without any sample.
    """
    empty = []
    with output_folder(folder, "epi", force=force) as output:
        output.refuse_others(*(name for each in inputs.file_names for name in result_names(each, EPI_ENDINGS)))
        for each in inputs.each(progress):
            output.refuse_others(*result_names(each.name, EPI_ENDINGS))
            light_field = each.light_field
            lines = light_field.height_px if axis == "s" else light_field.width_px
            found = epi(light_field, axis, lines // 2 if line is None else line, depth_mm=depth_mm)
            reference = light_field.reference_depth_mm
            depths_mm = each.depth_range_mm or (0.75 * reference, 2.0 * reference)
            with output.staged(complete=False, result=f"{each.name}_epi.npz") as staged:
                _save_epi(staged / f"{each.name}_epi.npz", found, light_field.layout_identity)
                draw_epi(staged / f"{each.name}_epi.png", light_field, found, depths_mm)
            if not found.weights.any():
                empty.append(each.name)
    return empty


def _save_epi(path: Path, found: Epi, layout_identity: str) -> None:
    arrays: dict[str, NDArray[Any]] = {
        "samples": found.samples,
        "weights": found.weights,
        "positions_mm": found.positions_mm,
        "axis": np.array(found.axis),
        "line": np.array(found.line),
        "plane_depth_mm": np.array(found.plane_depth_mm),
        "layout_identity": np.array(layout_identity),
    }
    write_npz(path, arrays)
