"""The recursive mean against its definition, written with complete arrays."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from mirrorcam.optics.light_field.temporal.recursive_mean import (
    DIFFERENCE_WEIGHT,
    INFORMATION,
    MAX_SQUARES,
    MEMORY,
    MOTION_SUMS,
    SIDE_PX,
    TILE_PX,
    filter_view,
)

SHAPE = (21, 37)


def over_square(values: Any) -> Any:
    """Return means over the square about each pixel, cropped to the view."""
    sums, counts = (
        cv2.boxFilter(each, cv2.CV_64F, (SIDE_PX, SIDE_PX), normalize=False, borderType=cv2.BORDER_CONSTANT)
        for each in (values, np.ones(SHAPE))
    )
    return sums / counts


@pytest.mark.parametrize("channels", [1, 3])
def test_a_view_is_filtered_as_defined(channels: int) -> None:
    random = np.random.default_rng(0)
    new = random.integers(90, 120, (*SHAPE, channels), dtype=np.uint8)
    new[:8, :10] += 60
    mean = random.uniform(0.3, 0.5, (*SHAPE, channels)).astype(np.float32)
    count = random.integers(1, MEMORY + 1, SHAPE).astype(np.float32)
    drift = random.normal(0.0, 0.02, SHAPE).astype(np.float32)
    gain = random.uniform(0.98, 1.02, (SHAPE[0], channels)).astype(np.float32)
    tables = np.broadcast_to(np.array([[150.0], [400.0]]) / channels, (2, 256)).astype(np.float32)
    limits = np.array([[0.8, 0.5], [1.4, 2.0]], np.float32)
    most = random.uniform(1.0, MEMORY, (2, 3)).astype(np.float32)
    out, out_count, out_drift = np.empty_like(mean), np.empty_like(count), np.empty_like(drift)
    lag = np.zeros((*most.shape, MOTION_SUMS), np.float32)
    full = np.float32(255.0)
    filter_view(
        *(new, full, mean, count, drift, gain, tables, INFORMATION, limits, most),
        *(out, out_count, out_drift, lag),
    )
    lit = mean * gain[:, None]
    difference = new / 255.0 - lit
    moved = drift + DIFFERENCE_WEIGHT * (difference.mean(axis=-1) - drift)
    times = count.astype(int)
    squares = np.minimum((difference**2).sum(axis=-1) * tables[0, 0] * INFORMATION[0, times], MAX_SQUARES)
    drifts = np.minimum(moved**2 * tables[1, 0] * INFORMATION[1, times], MAX_SQUARES)
    alike = (limits[1, 0] - over_square(squares)) / (limits[1, 0] - limits[0, 0])
    steady = (limits[1, 1] - over_square(drifts)) / (limits[1, 1] - limits[0, 1])
    kept = np.clip(np.minimum(alike, steady), 0.0, 1.0)
    assert 0.1 < kept.mean() < 0.9
    areas = np.kron(most, np.ones((TILE_PX, TILE_PX)))[: SHAPE[0], : SHAPE[1]]
    expected = np.minimum(count * kept, areas - 1.0) + 1.0
    assert out_count == pytest.approx(expected, rel=1e-4)
    assert out_drift == pytest.approx(moved * kept, abs=1e-6)
    assert out == pytest.approx(lit + difference / expected[..., None], abs=1e-5)
    down, across = np.gradient(lit.mean(axis=-1))
    weight = tables[1, 0] * INFORMATION[1, times]
    # Every other row, away from the sides.
    weight = np.pad(weight[1:-1, 1:-1], 1) * (np.arange(SHAPE[0]) % 2)[:, None]
    left = moved * kept
    factors = (1.0 + 0.0 * left, across, down, left, across**2, across * down, down**2, across * left, down * left)
    for found, factor in zip(np.moveaxis(lag, -1, 0), factors, strict=True):
        whole = np.zeros((2 * TILE_PX, 3 * TILE_PX))
        whole[: SHAPE[0], : SHAPE[1]] = weight * factor
        areas = whole.reshape(2, TILE_PX, 3, TILE_PX).sum(axis=(1, 3))
        assert found == pytest.approx(areas, rel=1e-3, abs=1e-3 * np.abs(whole).sum() / 6)
    new_only = out_count == 1.0
    assert np.array_equal(out[new_only], (new / full)[new_only].astype(np.float32))


def test_information_matches_independent_noise() -> None:
    """Differences of noise from its own mean, and their running mean, have the variances of the tables."""
    random = np.random.default_rng(1)
    samples = random.normal(size=(MEMORY, 20_000))
    drift = np.zeros(20_000)
    for number in range(1, MEMORY):
        difference = samples[number] - samples[:number].mean(axis=0)
        drift += DIFFERENCE_WEIGHT * (difference - drift)
        assert 1.0 / difference.var() == pytest.approx(INFORMATION[0, number], rel=0.06)
        assert 1.0 / drift.var() == pytest.approx(INFORMATION[1, number], rel=0.06)
