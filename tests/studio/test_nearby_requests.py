"""Requests that are solved ahead are valid, near, and none too large."""

from __future__ import annotations

from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio.nearby_requests import nearby_requests


def test_counts_come_first_then_scale_and_trade_off() -> None:
    found = nearby_requests(DesignSpec())
    assert [(spec.rows, spec.cols) for spec in found[:4]] == [(4, 3), (3, 4), (2, 3), (3, 2)]
    assert {spec.scale_mm for spec in found} == {80.0, 104.0, 62.0}
    assert {spec.tradeoff for spec in found} == {0.1, 0.3, 0.5}


def test_what_no_request_can_hold_is_left_out() -> None:
    assert all(spec.rows * spec.cols > 1 for spec in nearby_requests(DesignSpec(rows=1, cols=2)))
    assert all(0 <= spec.tradeoff <= 1 for spec in nearby_requests(DesignSpec(tradeoff=0.1)))
    assert max(len(spec.arrangement.steps) for spec in nearby_requests(DesignSpec(rows=5, cols=5))) == 25


def test_a_pattern_keeps_its_count() -> None:
    found = nearby_requests(DesignSpec(pattern=Pattern.hexagonal(1)))
    assert len(found) == 4
    assert {spec.arrangement.text for spec in found} == {"hex7"}
