"""Loops as machine code."""

from __future__ import annotations

import numpy as np

from mirrorcam.core.compiled import compiled, inlined


@compiled
def _shares(values: np.ndarray, whole: np.float32) -> np.ndarray:
    out = np.empty_like(values)
    for number in range(len(values)):
        out[number] = values[number] / whole
    return out


def test_what_is_compiled_does_what_is_written_and_divides_as_numpy() -> None:
    values = np.array([-1.0, 0.0, 3.0], np.float32)
    np.testing.assert_array_equal(_shares(values, np.float32(3.0)), values / np.float32(3.0))
    np.testing.assert_array_equal(_shares(values, np.float32(0.0)), [-np.inf, np.nan, np.inf])


def test_rounding_is_that_of_numpy() -> None:
    values = np.random.default_rng(0).normal(size=1000).astype(np.float32)
    np.testing.assert_array_equal(_shares(values, np.float32(0.3)), values / np.float32(0.3))


@inlined
def _third(value: float) -> float:
    return value / 3.0


@compiled
def _thirds(values: np.ndarray) -> float:
    total = 0.0
    for value in values:
        total += _third(value)
    return total


def test_what_is_inlined_does_the_same_within_what_calls_it() -> None:
    assert _thirds(np.array([1.0, 2.0])) == 1.0 / 3.0 + 2.0 / 3.0
    assert _third(1.0) == 1.0 / 3.0
