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
from mirrorcam.lightfield.light_fields import FrameLayout, LightFieldPaths, say_some
from mirrorcam.lightfield.requests import FeaturesRequest

if TYPE_CHECKING:
    from mirrorcam.lightfield.light_field_inputs import LightFieldInputs
    from mirrorcam.optics.light_field.features import Features
    from mirrorcam.optics.light_field.light_field import LightField

ENDINGS = ("features.npz", "features.csv", "features.png")
WIDTH_IN, BAR_IN, TITLE_IN = 10.0, 1.1, 0.5
TICKS = 7
PALE = 0.35
"""Contrast of the view in the figure, so that marks stand out."""
DISC_PT2, LARGEST_PT2 = 16.0, 150.0


def features(
    light_fields: LightFieldPaths,
    /,
    *,
    layout: FrameLayout = None,
    request: FeaturesRequest = FeaturesRequest(),
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/features"),
    force: Force = False,
) -> int:
    """Find features that all views agree on.

    Writes, for each light field, NAME_features.png (coloured by depth), NAME_features.csv (pixel, depth, sigma, point
    in rig and more per line) and NAME_features.npz (NumPy: the fields of Features, with descriptors and the pixels in
    each view). Exit code 1: a light field has no features.

    Examples:
        mirrorcam features decoded/frame_0000.npz
        mirrorcam features decoded/recording.zarr --detector SIFT4D --near-mm 250 --far-mm 800
    """
    from mirrorcam.core.console.reporter import TERMINAL
    from mirrorcam.lightfield.light_field_inputs import LightFieldInputs

    inputs = LightFieldInputs(light_fields, layout, TERMINAL)
    with long_work("features", inputs.counted, "files") as advance:
        found = write_features(inputs, out, request, force=force, progress=advance)
    lines = []
    for each in found:
        sigma = f", median sigma {each.median_sigma_mm:.2f} mm" if each.count else ""
        lines.append(f"{each.name}: {each.count} features, {each.refracted} of them with two slopes{sigma}")
    say_some("features", lines)
    say("features", f"pictures, tables (.csv) and arrays (.npz) written to {out}")
    return 0 if all(each.count for each in found) else 1


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
        for each in inputs.into(output, ENDINGS, progress):
            if finder is None or each.depth_range_mm != depth_range_mm or not finder.fits(each.light_field):
                depth_range_mm = each.depth_range_mm
                near, far = each.depths_to_search(request.near_mm, request.far_mm)
                finder = FeatureFinder(
                    each.light_field,
                    request.detector,
                    keypoints=request.keypoints,
                    min_views=request.min_views,
                    nearest_mm=near,
                    farthest_mm=np.inf if far is None else far,
                )
            found = finder.find(each.light_field)
            with output.staged(complete=False, result=f"{each.name}_features.csv") as staged:
                save_features(staged / f"{each.name}_features.npz", found)
                save_csv(staged / f"{each.name}_features.csv", found)
                draw_features(staged / f"{each.name}_features.png", each.light_field, found)
            sigma = float(np.median(found.depth_sigma_mm)) if len(found) else np.nan
            summaries.append(FeaturesSummary(each.name, len(found), int(found.refracted.sum()), sigma))
    return summaries


def draw_features(path: Path, light_field: LightField, features: Features) -> None:
    """Write a PNG, atomically: colour is linear in disparity, and the size of a disc shows the scale of its keypoint.

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
    axes.imshow(1.0 - (1.0 - grey) * (1.0 - PALE))
    nearness, plain = 1.0 / features.depth_mm, ~features.refracted
    sizes = np.minimum(DISC_PT2 * features.scale_px, LARGEST_PT2)
    known = nearness[plain] if plain.any() else np.array([0.0, 1.0])
    low, high = (float(edge) for edge in np.quantile(known, (0.005, 0.995)))
    high = max(high, low + 1e-9)
    u, v = features.pixels.T
    shown = axes.scatter(u[plain], v[plain], sizes[plain], nearness[plain], cmap="turbo", vmin=low, vmax=high)
    shown.set_edgecolor("black")
    shown.set_linewidth(0.6)
    if not plain.all():
        axes.scatter(u[~plain], v[~plain], 2 * sizes[~plain], "black", marker="x", linewidths=2.2)
        axes.scatter(u[~plain], v[~plain], 2 * sizes[~plain], "white", marker="x", linewidths=1.0)
    if plain.any():
        ticks = np.linspace(low, high, TICKS)
        bar = figure.colorbar(shown, ax=axes, ticks=ticks, fraction=0.04, pad=0.01)
        bar.ax.set_yticklabels([f"{1.0 / tick:.0f}" if tick > 0 else "∞" for tick in ticks])
    crossed = f"; {(~plain).sum()} with two slopes, crossed" if not plain.all() else ""
    axes.set_title(f"{len(features)} {features.detector} features, depth from the pupil in mm{crossed}")
    axes.set_axis_off()
    axes.set_xlim(-0.5, view.shape[1] - 0.5)
    axes.set_ylim(view.shape[0] - 0.5, -0.5)
    with atomic(path) as temporary:
        figure.savefig(temporary, metadata={"Software": None})
