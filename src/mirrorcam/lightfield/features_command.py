"""`mirrorcam features`: features consistent in all views, as a figure, a table and arrays."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from cyclopts import Parameter

from mirrorcam.core.console.options import Force
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.lightfield.light_fields import AssumedViews, FrameLayout, LightFieldPaths, say_first
from mirrorcam.lightfield.requests import FeaturesRequest
from mirrorcam.optics.light_field.io.light_field_format import NOTHING

if TYPE_CHECKING:
    from mirrorcam.lightfield.light_field_inputs import LightFieldInputs
    from mirrorcam.optics.light_field.features import Features
    from mirrorcam.optics.light_field.light_field import LightField

ENDINGS = ("features.npz", "features.csv", "features.png")
WIDTH_IN, BAR_IN, TITLE_IN = 10.0, 1.1, 0.5
TICKS = 7
VIEW_CONTRAST = 0.35
"""Contrast of the view in the figure, low so that marks stand out."""
DISC_PT2, MAX_PT2 = 16.0, 150.0


def features(
    light_fields: LightFieldPaths,
    /,
    *,
    layout: FrameLayout = None,
    views: AssumedViews = NOTHING,
    request: FeaturesRequest = FeaturesRequest(),
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/features"),
    force: Force = False,
) -> int:
    """Find features on which all views agree.

    Writes, for each light field, NAME_features.png (coloured by depth), NAME_features.csv (pixel, depth, sigma, point
    in the rig frame and more per line) and NAME_features.npz (NumPy: the fields of Features, with descriptors and the
    pixels in each view). Exit code 1: a light field has no features.

    Examples:
        mirrorcam features decoded/frame_0000.npz
        mirrorcam features decoded/recording.zarr --detector ORB --near-mm 250 --far-mm 800
    """
    from mirrorcam.core.console.reporter import TERMINAL
    from mirrorcam.lightfield.light_field_inputs import LightFieldInputs

    inputs = LightFieldInputs(light_fields, layout, TERMINAL, views)
    with long_work("features", inputs.count_text, "files") as advance:
        summaries = write_features(inputs, out, request, force=force, progress=advance)
    lines = []
    for summary in summaries:
        sigma = f", median sigma {summary.median_sigma_mm:.2f} mm" if summary.count else ""
        lines.append(f"{summary.name}: {summary.count} features, {summary.refracted} of them with two slopes{sigma}")
    say_first("features", lines)
    say("features", f"pictures, tables (.csv) and arrays (.npz) written to {out}")
    return 0 if all(summary.count for summary in summaries) else 1


@dataclass(frozen=True)
class FeaturesSummary:
    """Features of one light field: their count, how many are refracted, and the median sigma of their depth."""

    name: str
    count: int
    refracted: int
    median_sigma_mm: float


def write_features(
    inputs: LightFieldInputs,
    folder: Path,
    request: FeaturesRequest = FeaturesRequest(),
    *,
    force: bool = False,
    progress: Progress = no_progress,
) -> list[FeaturesSummary]:
    """Find features in light fields, up to infinity unless the request or a file limits the depth.

    Writes NAME_features.npz, .csv and .png into a folder; `force` also replaces files that it did not write.
    """
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.optics.light_field.features import FeatureFinder
    from mirrorcam.optics.light_field.features.feature_set import save_csv, save_features

    finder: FeatureFinder | None = None
    depth_range_mm: tuple[float, float] | None = None
    summaries = []
    with output_folder(folder, "features", force=force) as output:
        for named in inputs.open_for(output, ENDINGS, progress):
            if finder is None or named.depth_range_mm != depth_range_mm or not finder.fits(named.light_field):
                depth_range_mm = named.depth_range_mm
                near, far = named.depths_to_search(request.near_mm, request.far_mm)
                finder = FeatureFinder(
                    named.light_field,
                    request.detector,
                    keypoints=request.keypoints,
                    min_views=request.min_views,
                    nearest_mm=near,
                    farthest_mm=np.inf if far is None else far,
                )
            features = finder.find(named.light_field)
            with output.staged(complete=False, result=f"{named.name}_features.csv") as staged:
                save_features(staged / f"{named.name}_features.npz", features)
                save_csv(staged / f"{named.name}_features.csv", features)
                draw_features(staged / f"{named.name}_features.png", named.light_field, features)
            sigma = float(np.median(features.depth_sigma_mm)) if len(features) else np.nan
            summaries.append(FeaturesSummary(named.name, len(features), int(features.refracted.sum()), sigma))
    return summaries


def draw_features(path: Path, light_field: LightField, features: Features) -> None:
    """Write a PNG, atomically: colour is linear in disparity, disc size shows the keypoint's scale.

    Crosses are features with two slopes.
    """
    from matplotlib.figure import Figure

    from mirrorcam.core.disk.files import atomic

    t, s = np.argwhere((light_field.positions_mm == 0).all(axis=-1))[0]
    samples = light_field.samples[t, s]
    view = samples / 255.0 if samples.dtype == np.uint8 else np.clip(samples, 0.0, 1.0)
    grey = np.repeat(view.mean(axis=2, keepdims=True), 3, axis=2) ** (1.0 / 2.2)
    height_in = (WIDTH_IN - BAR_IN) * view.shape[0] / view.shape[1] + TITLE_IN
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=100, layout="constrained")
    axes = figure.subplots()
    axes.imshow(1.0 - (1.0 - grey) * (1.0 - VIEW_CONTRAST))
    inverse_depth, single_slope = 1.0 / features.depth_mm, ~features.refracted
    sizes = np.minimum(DISC_PT2 * features.scale_px, MAX_PT2)
    visible_range = inverse_depth[single_slope] if single_slope.any() else np.array([0.0, 1.0])
    low, high = (float(edge) for edge in np.quantile(visible_range, (0.005, 0.995)))
    high = max(high, low + 1e-9)
    u, v = features.pixels.T
    discs = axes.scatter(
        u[single_slope],
        v[single_slope],
        sizes[single_slope],
        inverse_depth[single_slope],
        cmap="turbo",
        vmin=low,
        vmax=high,
    )
    discs.set_edgecolor("black")
    discs.set_linewidth(0.6)
    if not single_slope.all():
        axes.scatter(u[~single_slope], v[~single_slope], 2 * sizes[~single_slope], "black", marker="x", linewidths=2.2)
        axes.scatter(u[~single_slope], v[~single_slope], 2 * sizes[~single_slope], "white", marker="x", linewidths=1.0)
    if single_slope.any():
        ticks = np.linspace(low, high, TICKS)
        bar = figure.colorbar(discs, ax=axes, ticks=ticks, fraction=0.04, pad=0.01)
        bar.ax.set_yticklabels([f"{1.0 / tick:.0f}" if tick > 0 else "∞" for tick in ticks])
    crossed = f"; {(~single_slope).sum()} with two slopes, crossed" if not single_slope.all() else ""
    axes.set_title(f"{len(features)} {features.detector} features, depth from the pupil in mm{crossed}")
    axes.set_axis_off()
    axes.set_xlim(-0.5, view.shape[1] - 0.5)
    axes.set_ylim(view.shape[0] - 0.5, -0.5)
    with atomic(path) as temporary:
        figure.savefig(temporary, metadata={"Software": None})
