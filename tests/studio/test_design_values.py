"""Drawings survive the way to the browser."""

from __future__ import annotations

from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.design_values import DesignDrawing, ToleranceBar, ToleranceBars
from mirrorcam.studio.drawing import design_drawing


def test_a_drawing_is_the_same_after_json(default_layout: Layout) -> None:
    drawing = design_drawing(default_layout, DesignSpec(), "exact")
    text = drawing.model_dump_json()
    assert DesignDrawing.model_validate_json(text) == drawing
    assert len(text) < 25_000


def test_bars_are_the_same_after_json() -> None:
    bar = ToleranceBar(label="Grid error", design=0.1, low=0.1, median=0.2, high=0.3, text="0.1 to 0.3")
    bars = ToleranceBars(assumed="two devices", hidden=0.5, bars=[bar])
    assert ToleranceBars.model_validate_json(bars.model_dump_json()) == bars
