"""Residuals of a calibration over the sensor, and their distribution."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mirrorcam.core.disk.files import atomic
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.view_statistics import ARROWS_ACROSS, cell_means
from mirrorcam.optics.calibration.solver.observations import DIRECT

ARROW_CELLS = 0.8  # length at which the rms of those averages is drawn


def residual_figure(calibration: Calibration, path: Path) -> None:
    """Write a PNG: mean residuals in each part of the sensor, by view, beside their distribution.

    Averages over a cell show what the model misses; where it misses nothing, the directions of the arrows are random.
    """
    figure, (sensor, plot) = plt.subplots(1, 2, figsize=(13, 5), width_ratios=(2.3, 1), layout="constrained")
    _arrows(sensor, calibration)
    _distribution(plot, calibration)
    _save(figure, path)


def _arrows(axes: Axes, calibration: Calibration) -> None:
    camera = calibration.layout.camera
    cell_px = camera.width_px / ARROWS_ACROSS
    means = {int(view): cell_means(calibration, int(view)) for view in np.unique(calibration.observations.view)}
    rms = float(np.sqrt(np.mean(np.concatenate([cells.mean_px for cells in means.values()]) ** 2)))
    gain = ARROW_CELLS * cell_px / max(rms, 1e-12)
    colours = plt.get_cmap("tab10")
    for view, cells in means.items():
        name = "direct" if view == DIRECT else f"mirror {calibration.layout.mirror_names[view]}"
        colour = "0.65" if view == DIRECT else colours(view % 10)
        axes.quiver(
            *cells.at_px.T,
            *(gain * cells.mean_px.T),
            color=colour,
            angles="xy",
            scale_units="xy",
            scale=1,
            width=0.0015,
            label=name,
            zorder=1 if view == DIRECT else 2,
        )
    axes.set(xlim=(-0.5, camera.width_px - 0.5), ylim=(camera.height_px - 0.5, -0.5), aspect="equal")
    title = f"Mean residual in cells of {cell_px:.0f} px, scale {gain:.0f}:1 (rms {rms:.3f} px)"
    axes.set(xlabel="x px", ylabel="y px", title=title)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=5, frameon=False, fontsize=8)


def _distribution(axes: Axes, calibration: Calibration) -> None:
    used = calibration.residuals_px[calibration.inliers]
    reach = 4.0 * float(used.std())
    for axis, values in zip("xy", used.T, strict=True):
        axes.hist(
            values,
            bins=np.linspace(-reach, reach, 61).tolist(),
            histtype="step",
            label=f"{axis}: {values.std():.3f} px",
        )
    axes.set(
        xlabel="residual px", ylabel="corners", title=f"{len(used)} corners, {int((~calibration.inliers).sum())} out"
    )
    axes.legend(frameon=False)


def _save(figure: Figure, path: Path) -> None:
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=110)
    plt.close(figure)
