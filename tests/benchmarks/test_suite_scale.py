"""The benchmark of suites: what its figures on paper are made of, and that fewer small sets are the first of more."""

from __future__ import annotations

import pytest

from benchmarks.suite_scale import PRICES, on_paper, paper_table, scale_table, small_sets


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


def test_tables_say_what_was_measured() -> None:
    paper = paper_table(on_paper(10_000))
    assert paper.rows[0][0] == "pictures"
    weak = [
        {"workers": n, "sets": 20 * n, "elapsed_s": 12.0 + n, "set_s": 0.5 + 0.1 * n, "efficiency_processor": 6.0 / 7.0}
        | {"efficiency_elapsed": 13.0 / 14.0}
        for n in (1, 2)
    ]
    cluster = {"sets": 200, "workers": 2, "killed": 1, "there": 199, "same_bytes": 199, "elapsed_s": 71.2, "set_s": 0.6}
    found = scale_table({"weak_scaling": weak, "cluster": cluster | {"missing": {"small-0007": "too small"}}})
    assert found.rows == (
        (
            "weak scaling, 20 sets a worker",
            "one worker: 0.60 processor seconds a set; 2: 0.70 (efficiency 0.86; by the clock 0.93)",
        ),
        (
            "200 sets on a Dask cluster of 2 workers, 1 worker killed after 100",
            "199 there, with every checksum; 71 s; small-0007: too small",
        ),
        ("of these, with the same bytes as rendered without a cluster", "199 of 200"),
    )
