"""Bars of devices as built stand where the study has its figures."""

from __future__ import annotations

import pytest

from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.tolerance_bars import tolerance_bars


def test_bars_lie_around_their_median(default_layout: Layout) -> None:
    found = tolerance_bars(default_layout.replaced(spec=DesignSpec()))
    assert "0.3" in found.assumed
    assert 0.0 <= found.hidden <= 1.0
    labels = [bar.label for bar in found.bars]
    assert len(set(labels)) == len(labels) > 10
    for bar in found.bars:
        assert bar.low <= bar.median <= bar.high
        assert " to " in bar.text


def test_a_layout_without_depths_cannot_be_studied(default_layout: Layout) -> None:
    with pytest.raises(ValueError, match="without a spec"):
        tolerance_bars(default_layout.replaced(spec=None))
