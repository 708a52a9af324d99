"""Figure of features on the central view, coloured by their depth, with a scale in mm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mirrorcam.core.disk.files import atomic
from mirrorcam.optics.light_field.features import Features
from mirrorcam.optics.light_field.light_field import LightField

WIDTH_IN, BAR_IN, TITLE_IN = 10.0, 1.1, 0.5
TICKS = 7
# The view is shown paler than it is, so that marks stand out.
PALE = 0.35
DISC_PT2, LARGEST_PT2 = 16.0, 150.0


def draw_features(path: Path, light_field: LightField, features: Features) -> None:
    """Write the figure, PNG, atomically; equal steps of colour are equal disparities, larger discs coarser keypoints.

    Features with two slopes are crosses.
    """
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
