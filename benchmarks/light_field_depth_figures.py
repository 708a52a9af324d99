"""Figures of `light_field_depth_scenes`: whether confidence is a probability, errors in sigmas, and maps of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, Normalize
from matplotlib.figure import Figure

from benchmarks.light_field_depth import BAD_PX
from benchmarks.light_field_depth_errors import RIGHT_PX, MeasuredScene, reliability
from mirrorcam.core.disk.files import atomic
from mirrorcam.core.values import FloatArray

BOUNDS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 1.0)
COLOURS = ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377")
MOST_SIGMAS = 6.0
ERROR_BOUNDS = BAD_PX * np.array([0.0, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0])
SIGMA_BOUNDS = np.array([0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0])


def draw_reliability(path: Path, scenes: Sequence[MeasuredScene]) -> None:
    """Write a PNG: how often depth is right over its stated probability, of each scene and of all; how many pixels
    state what; and how errors in sigmas are distributed, away from depth edges, beside the half-normal."""
    figure = Figure(figsize=(15.0, 6.0), dpi=110, layout="constrained")
    axes: Any = figure.subplot_mosaic(
        [["share", "near", "exceed"], ["count", "near", "exceed"]], height_ratios=(3, 1), width_ratios=(1.2, 1, 1)
    )
    _reliability(axes["share"], axes["count"], scenes)
    _distributions(axes["near"], axes["exceed"], scenes)
    with atomic(path) as temporary:
        figure.savefig(temporary, metadata={"Software": None})


def _reliability(share: Axes, count: Axes, scenes: Sequence[MeasuredScene]) -> None:
    share.plot([0.0, 1.0], [0.0, 1.0], color="0.6", linewidth=1.0, label="stated = right")
    for number, scene in enumerate(scenes):
        classes = reliability([scene], BOUNDS)
        colour = COLOURS[number % len(COLOURS)]
        stated, right = [c.stated for c in classes], [c.right for c in classes]
        share.plot(stated, right, ".-", color=colour, linewidth=0.8, ms=5, alpha=0.7, label=scene.name)
    pooled = reliability(scenes, BOUNDS)
    stated, right = [c.stated for c in pooled], [c.right for c in pooled]
    ends = np.array([[c.right - c.low for c in pooled], [c.high - c.right for c in pooled]])
    share.errorbar(
        stated, right, yerr=ends, fmt="o-", color="black", linewidth=1.6, ms=5, capsize=3, label="all, 95 % interval"
    )
    share.set(xlim=(0.0, 1.0), ylim=(0.0, 1.02))
    share.set_ylabel(f"share right to {RIGHT_PX:g} px of the farthest view")
    share.set_title("Reliability of confidence", fontsize=11)
    share.legend(fontsize=9, loc="lower right")
    share.tick_params(labelbottom=False)
    share.sharex(count)
    values = np.concatenate([scene.confidence[scene.judged] for scene in scenes])
    count.hist(values, bins=np.linspace(0.0, 1.0, 51).tolist(), color="0.5")
    count.set_yscale("log")
    count.set_xlabel("confidence: stated probability")
    count.set_ylabel("pixels")
    for axes in (share, count):
        axes.grid(alpha=0.3, linewidth=0.5)


def _distributions(near: Axes, exceed: Axes, scenes: Sequence[MeasuredScene]) -> None:
    at = np.linspace(0.0, MOST_SIGMAS, 241)
    pooled = np.concatenate([scene.flat_sigmas for scene in scenes])
    lines = [(scene.name, scene.flat_sigmas, COLOURS[n % len(COLOURS)], 1.2) for n, scene in enumerate(scenes)]
    for name, sigmas, colour, width in (*lines, ("all", pooled, "black", 1.8)):
        below = np.searchsorted(np.sort(sigmas), at, "right") / len(sigmas)
        near.plot(at, below, color=colour, linewidth=width, label=f"{name}: median {np.median(sigmas):.2f}")
        exceed.plot(
            at, 1.0 - below, color=colour, linewidth=width, label=f"{name}: {np.mean(sigmas > 3.0):.1%} > 3 sigma"
        )
    normal = half_normal(at)
    near.plot(at, normal, "--", color="0.4", linewidth=1.4, label="half-normal: median 0.67")
    exceed.plot(at, 1.0 - normal, "--", color="0.4", linewidth=1.4, label="half-normal: 0.3% > 3 sigma")
    near.set(xlim=(0.0, 3.0), ylim=(0.0, 1.0), ylabel="share of errors below")
    near.set_title("Errors in sigmas, away from depth edges", fontsize=11)
    exceed.set(xlim=(0.0, MOST_SIGMAS), ylim=(1e-4, 1.0), yscale="log", ylabel="share of errors beyond")
    exceed.set_title("Their tails", fontsize=11)
    near.legend(fontsize=9, loc="lower right")
    exceed.legend(fontsize=9, loc="best")
    for axes in (near, exceed):
        axes.set_xlabel("|error| / sigma")
        axes.grid(alpha=0.3, linewidth=0.5)


def half_normal(sigmas: FloatArray) -> FloatArray:
    """Probability (n,) that a normal error is less than a number (n,) of its sigmas either way."""
    from scipy.special import erf

    return np.asarray(erf(sigmas / np.sqrt(2.0)))


def draw_scene(path: Path, scene: MeasuredScene) -> None:
    """Write a PNG of a scene: central view, true disparity and that found; error, error in sigmas and confidence.

    Errors of disparity are px per view step of the full grid, as BadPix counts them: what is bad is yellow to red.
    """
    height, width = scene.truth_px.shape
    figure = Figure(figsize=(15.0, 2.0 * (4.2 * height / width + 0.35)), dpi=110, layout="constrained")
    axes: Any = figure.subplots(2, 3)
    error = np.where(scene.judged, scene.error_px / scene.reach, np.nan)
    known = scene.truth_px[np.isfinite(scene.truth_px)]
    span = Normalize(*np.quantile(known, (0.001, 0.999)))
    bad = float(np.mean(error[scene.judged] > BAD_PX))
    right = float(np.mean(scene.error_px[scene.judged] < RIGHT_PX))
    stated = float(scene.confidence[scene.judged].mean())
    sigmas = scene.error_px / scene.sigma_px
    beyond = float(np.mean(sigmas[scene.judged] > 3.0))
    axes[0, 0].imshow(scene.image)
    axes[0, 0].set_title(f"{scene.name}, central view of {scene.views}", fontsize=11)
    panels: list[tuple[Axes, Any, str, Any, Normalize]] = [
        (axes[0, 1], scene.truth_px, f"{scene.against}, px per view step", "turbo", span),
        (axes[0, 2], scene.disparity_px, "disparity found", "turbo", span),
        (
            axes[1, 0],
            error,
            f"|error|, px per view step: {bad:.1%} bad, beyond {BAD_PX:g}",
            *_two_part(ERROR_BOUNDS, 4),
        ),
        (axes[1, 1], sigmas, f"|error| / sigma: {beyond:.1%} beyond 3", *_two_part(SIGMA_BOUNDS, 4)),
        (
            axes[1, 2],
            scene.confidence,
            f"confidence: mean {stated:.1%}, right {right:.1%}",
            "viridis",
            Normalize(0.0, 1.0),
        ),
    ]
    for place, values, title, colours, norm in panels:
        shown = place.imshow(values, cmap=colours, norm=norm, interpolation="nearest")
        ends = "max" if isinstance(norm, BoundaryNorm) else "neither"
        figure.colorbar(shown, ax=place, fraction=0.046 * height / width, pad=0.02, extend=ends, format="%.3g")
        place.set_title(title, fontsize=11)
    for place in axes.ravel():
        place.set_facecolor("0.6")
        place.set(xticks=[], yticks=[])
    with atomic(path) as temporary:
        figure.savefig(temporary, metadata={"Software": None})


def _two_part(bounds: FloatArray, good: int) -> tuple[Colormap, BoundaryNorm]:
    """Colours of classes between bounds: the first `good` blue, the others and what is beyond yellow to red."""
    beyond = len(bounds) - 1 - good
    blues = matplotlib.colormaps["Blues"](np.linspace(0.05, 0.6, good))
    reds = matplotlib.colormaps["YlOrRd"](np.linspace(0.25, 1.0, beyond + 1))
    colours = ListedColormap([*blues, *reds[:-1]]).with_extremes(over=reds[-1], bad="0.6")
    return colours, BoundaryNorm(bounds.tolist(), len(bounds) - 1)
