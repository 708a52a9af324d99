"""Bars survive the way to the browser."""

from __future__ import annotations

from mirrorcam.studio.tolerance_values import ToleranceBar, ToleranceBars


def test_bars_are_the_same_after_json() -> None:
    bar = ToleranceBar(label="Grid error", design=0.1, low=0.1, median=0.2, high=0.3, text="0.1 to 0.3")
    bars = ToleranceBars(assumed="two devices", hidden=0.5, bars=[bar])
    assert ToleranceBars.model_validate_json(bars.model_dump_json()) == bars
