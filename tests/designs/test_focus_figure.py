"""The figure of circles of confusion has a curve for three mirrors and two distances in focus, with marks on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.designs.focus_figure import focus_figure
from mirrorcam.optics.design.assess.focus import focus_metrics
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import fields_of_view
from tests.drawn import drawn
from tests.optics.seeing_mirrors import two_rectangles

DEPTHS_MM = (300.0, 500.0)


def test_worst_marks_are_the_figures_of_the_layout(fold_90_layout: Layout, tmp_path: Path) -> None:
    path = tmp_path / "focus.png"
    axes = drawn(lambda: focus_figure(fold_90_layout, DEPTHS_MM, path), path).axes[0]
    marks = np.array([line.get_ydata() for line in axes.lines if line.get_marker() == "o"])
    curves = [line for line in axes.lines if line.get_linewidth() == 1.6]
    assert len(marks) == len(curves) == 6
    found = focus_metrics(fields_of_view(fold_90_layout), DEPTHS_MM)
    given = [found[f"circle_of_confusion_{depth:g}mm"].value for depth in DEPTHS_MM]
    assert marks[:3].max(axis=0) == pytest.approx(given)
    assert marks[3:].max() == pytest.approx(found["circle_at_best_focus_px"].value)
    for curve, mark in zip(curves, marks, strict=True):
        depths, circles = (np.asarray(data, dtype=np.float64) for data in curve.get_data())
        assert np.interp(DEPTHS_MM, depths, circles) == pytest.approx(mark, abs=0.02)
    legend = axes.get_legend()
    assert legend is not None
    texts = [text.get_text() for text in legend.get_texts()]
    assert "central mirror, 1-1" in texts
    assert {"in focus at 500 mm", "best focus, 402 mm", "limit, 2 px"} <= set(texts)


def test_a_mirror_that_is_nearest_and_central_has_one_curve(tmp_path: Path) -> None:
    path = tmp_path / "focus.png"
    axes = drawn(lambda: focus_figure(two_rectangles(), (300.0,), path), path).axes[0]
    assert len([line for line in axes.lines if line.get_linewidth() == 1.6]) == 4
    legend = axes.get_legend()
    assert legend is not None
    # Of two mirrors, the second counts as the middle, and 80 mm above the pupil it is the nearer one.
    texts = [text.get_text() for text in legend.get_texts()]
    assert texts[:2] == ["nearest and central mirror, 1-0", "farthest mirror, 0-0"]
    assert axes.get_xscale() == "linear"


def test_depths_far_apart_are_on_a_logarithmic_axis(default_layout: Layout, tmp_path: Path) -> None:
    path = tmp_path / "focus.png"
    axes = drawn(lambda: focus_figure(default_layout, (200.0, 2500.0), path), path).axes[0]
    assert axes.get_xscale() == "log"
