"""Damage changes what it is done to, differently for each seed and alike for the same."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from benchmarks.robustness.damage import damaged_bytes, damaged_value

RAW = bytes(range(256)) * 4
VALUE: dict[str, Any] = {"rows": 3, "camera": {"name": "a", "k": [0.1, 0.2]}, "mirrors": [{"n": 1.5}, {"n": 1.5}]}


def test_bytes_are_damaged_in_many_ways() -> None:
    found = [damaged_bytes(RAW, np.random.default_rng(seed)) for seed in range(200)]
    assert sum(each != RAW for each in found) > 195
    assert len({len(each) for each in found}) > 50
    assert found[7] == damaged_bytes(RAW, np.random.default_rng(7))
    assert damaged_bytes(b"", np.random.default_rng(0)) is not None


def test_values_are_damaged_in_many_ways_and_the_original_stays() -> None:
    before = json.dumps(VALUE)
    found = [json.dumps(damaged_value(VALUE, np.random.default_rng(seed))) for seed in range(200)]
    assert json.dumps(VALUE) == before
    assert sum(each != before for each in found) > 180
    assert len(set(found)) > 150
