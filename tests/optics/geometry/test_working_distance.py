"""Where things are that a layout is used for."""

from __future__ import annotations

import pytest

from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.working_distance import working_distance_mm, working_range_mm


def test_boards_come_before_the_design_and_the_range_holds_both(parabola_layout: Layout) -> None:
    assert parabola_layout.spec is not None
    low, high = min(parabola_layout.spec.depths_mm), max(parabola_layout.spec.depths_mm)
    bare = parabola_layout.replaced(spec=None, metrics={})
    plain, calibrated = (
        layout.replaced(metrics={"working_distance_mm": Metric(value=100.0, unit="mm")})
        for layout in (bare, parabola_layout)
    )
    assert working_distance_mm(bare) is None
    assert working_range_mm(bare) is None
    assert working_range_mm(parabola_layout) == (low, high)
    assert working_distance_mm(plain) == working_distance_mm(calibrated) == 100.0
    assert working_range_mm(plain) == pytest.approx((70.0, 140.0))
    assert working_range_mm(calibrated) == pytest.approx((70.0, high))
