"""The errors of a scored calibration over the sensor, as `compare` draws the difference of two."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mirrorcam.bench.scores.calibration_score import CalibrationScore
from mirrorcam.calibration.comparison import (
    BAR_IN,
    HEAD_IN,
    PANEL_IN,
    ROW_IN,
    SLIMMEST,
    draw_arrows,
    draw_map,
    panel_extent,
)
from mirrorcam.core.disk.files import atomic
from mirrorcam.optics.calibration.diagnostics.calibration_difference import ViewDifference
from mirrorcam.optics.geometry.layout import Layout


def score_figure(score: CalibrationScore, truth: Layout, path: Path, *, title: str) -> None:
    """Write a PNG: in every view, by how many px the calibration is wrong at the working distance, and where to."""
    views = view_errors(score)
    wide, high = np.diff(panel_extent(truth, views), axis=0)[0]
    height_in = PANEL_IN * float(np.clip(high / wide, *SLIMMEST)) + ROW_IN + HEAD_IN
    figure = Figure(figsize=(PANEL_IN + BAR_IN, height_in), layout="constrained")
    axes = figure.subplots()
    lengths = [view.length_px for view in views]
    shown = draw_map(axes, truth, views, lengths, max(float(length.max()) for length in lengths))
    longest_px = draw_arrows(axes, views)
    axes.set_title(
        f"{title}: error in px at {score.distance_mm:.0f} mm\n(RMS of each view; arrow: {longest_px:.2g} px)"
    )
    figure.colorbar(shown, ax=axes, label="px", fraction=0.03, pad=0.01)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=100, metadata={"Software": None})


def view_errors(score: CalibrationScore) -> list[ViewDifference]:
    """What the calibration shows less what the true device does, of each view, at the working distance."""
    found = []
    for gauge in score.placed:
        points = gauge.points
        error = gauge.pixels - points.pixels
        for view in gauge.views:
            at = (points.view == view.view) & points.at_distance & np.isfinite(error).all(axis=1)
            count = int(at.sum())
            if not count:
                continue
            zeros = np.zeros((count, 2, 2))
            found.append(
                ViewDifference(view.view, points.pixels[at], error[at], np.zeros(count), zeros, np.zeros(count))
            )
    return found
