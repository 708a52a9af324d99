"""The benchmark of suites: what its figures on paper are made of, and that fewer small sets are the first of more."""

from __future__ import annotations

import pytest

from benchmarks.suite_scale import PRICES, on_paper, small_sets


def test_costs_on_paper_follow_from_hours_and_bytes() -> None:
    found, twice = on_paper(10_000), on_paper(20_000)
    assert found["usd_processors"] == pytest.approx(found["processor_hours"] * PRICES["usd_per_core_hour"])
    assert found["usd_storage_a_month"] == pytest.approx(found["gb"] * PRICES["usd_per_gb_month"])
    assert twice["gb"] == pytest.approx(2.0 * found["gb"])
    # Designs are solved once, however many sets share them.
    assert 1.99 * found["processor_hours"] < twice["processor_hours"] < 2.0 * found["processor_hours"]


def test_fewer_small_sets_are_the_first_of_more() -> None:
    few, many = small_sets(3).sets, small_sets(8).sets
    assert few == many[:3]
    assert len({each.seed for each in many}) == 8
