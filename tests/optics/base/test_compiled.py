"""Loops as machine code."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.base.compiled import compiled


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
