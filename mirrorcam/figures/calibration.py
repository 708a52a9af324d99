"""The picture of a calibration: what the model leaves unexplained, and where."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from optics.calibration.observations import DIRECT
from optics.calibration.result import Calibration
from optics.files import atomic

ARROW_PX = 30.0  # length at which the rms residual is drawn, of a picture 1920 px wide


def residual_figure(calibration: Calibration, path: Path) -> None:
    """Write a PNG: residual arrows over the sensor, coloured by view, beside the distribution of each axis."""
    figure, (sensor, plot) = plt.subplots(1, 2, figsize=(13, 5), width_ratios=(2.3, 1), layout="constrained")
    _arrows(sensor, calibration)
    _distribution(plot, calibration)
    _save(figure, path)


def _arrows(axes: Axes, calibration: Calibration) -> None:
    camera = calibration.layout.camera
    used, seen = calibration.inliers, calibration.observations
    rms = float(np.sqrt(np.mean(calibration.residuals_px[used] ** 2)))
    gain = ARROW_PX * camera.width_px / 1920.0 / max(rms, 1e-12)
    views = [int(view) for view in np.unique(seen.view)]
    colours = plt.get_cmap("tab10")
    for view in views:
        rows = used & (seen.view == view)
        x, y = seen.pixels[rows].T
        dx, dy = gain * calibration.residuals_px[rows].T
        name = "direct" if view == DIRECT else f"mirror {view}"
        colour = "0.65" if view == DIRECT else colours(view % 10)
        axes.quiver(
            x, y, dx, dy, color=colour, angles="xy", scale_units="xy", scale=1, width=0.0012, label=name,
            zorder=1 if view == DIRECT else 2,
        )  # fmt: skip
    axes.set(xlim=(-0.5, camera.width_px - 0.5), ylim=(camera.height_px - 0.5, -0.5), aspect="equal")
    axes.set(xlabel="x px", ylabel="y px", title=f"Residuals, {gain:.0f} times enlarged (rms {rms:.3f} px)")
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
