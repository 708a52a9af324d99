"""Figure of a depth map: the view, its depth with a scale in mm, and the confidence of that depth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mirrorcam.core.disk.files import atomic
from mirrorcam.optics.light_field.depth import DepthMap
from mirrorcam.optics.light_field.light_field import LightField

WIDTH_IN, TITLE_IN = 15.0, 0.5
TICKS = 7


def draw_depth(path: Path, light_field: LightField, depth: DepthMap) -> None:
    """Write the figure as PNG, atomically; colours are linear in inverse depth: equal steps are equal disparities."""
    samples = light_field.samples[depth.view]
    view = np.broadcast_to(samples, (*samples.shape[:2], 3))
    nearness = 1.0 / depth.depth_mm
    sure = depth.confidence > 0.5
    known = nearness[sure if sure.any() else depth.valid]
    low, high = (float(edge) for edge in np.quantile(known, (0.005, 0.995))) if known.size else (0.0, 1.0)
    height_in = WIDTH_IN / 3.0 * view.shape[0] / view.shape[1] + TITLE_IN
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=100, layout="constrained")
    axes = figure.subplots(1, 3)
    axes[0].imshow(view)
    shown = axes[1].imshow(_masked(nearness, depth.valid), cmap="turbo", vmin=low, vmax=high, interpolation="nearest")
    trusted = axes[2].imshow(_masked(depth.confidence, depth.valid), cmap="viridis", vmin=0.0, vmax=1.0)
    ticks = np.linspace(low, high, TICKS)
    bar = figure.colorbar(shown, ax=axes[1], ticks=ticks, fraction=0.03, pad=0.02)
    bar.ax.set_yticklabels([f"{1.0 / tick:.0f}" if tick > 0 else "∞" for tick in ticks])
    figure.colorbar(trusted, ax=axes[2], fraction=0.03, pad=0.02)
    for each, title in zip(axes, ("view", "depth from the pupil, mm", "confidence"), strict=True):
        each.set_title(title)
        each.set_axis_off()
    with atomic(path) as temporary:
        figure.savefig(temporary, metadata={"Software": None})


def _masked(values: NDArray[np.float32], valid: NDArray[np.bool_]) -> NDArray[np.float32]:
    return np.where(valid, values, np.float32(np.nan))
