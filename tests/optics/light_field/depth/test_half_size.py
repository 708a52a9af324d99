"""Depth at half size: what is merged, and where depth edges end up."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.light_field.depth import DepthEstimator, VideoDepth
from mirrorcam.optics.light_field.depth.half_size import enlarged_by_picture, halved_light_field
from mirrorcam.optics.light_field.depth.parallax import halved
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.conftest import inner
from tests.optics.light_field.depth.surfaces import grid_views


@pytest.mark.parametrize("size", [(20, 24), (19, 25)])
def test_blocks_of_samples_are_averaged_and_missing_ones_leave_none(size: tuple[int, int]) -> None:
    height, width = size
    views = grid_views(1, 2, height_px=height, width_px=width)
    random = np.random.default_rng(0)
    samples = random.integers(0, 256, (1, 2, height, width, 3)).astype(np.uint8)
    weights = np.ones((1, 2, height, width), np.float32)
    weights[0, 1, 5, 8] = 0.0
    half = halved_light_field(LightField.of(views, samples, weights), halved(views))
    blocks = samples[:, :, : height // 2 * 2, : width // 2 * 2].reshape(1, 2, height // 2, 2, width // 2, 2, 3) / 255.0
    np.testing.assert_allclose(half.samples, blocks.mean(axis=(3, 5)), atol=1e-6)
    assert np.argwhere(half.weights == 0).tolist() == [[0, 1, 2, 4]]
    as_floats = LightField.of(views, (samples / 255.0).astype(np.float32), weights)
    np.testing.assert_allclose(halved_light_field(as_floats, halved(views)).samples, half.samples, atol=1e-6)


def test_a_plane_is_interpolated() -> None:
    v, u = np.mgrid[:10, :12].astype(np.float32)
    grey = np.full((20, 24, 3), 90.0, np.float32)
    found = enlarged_by_picture(0.3 * u - 0.2 * v, grey[::2, ::2], grey, 1.0)
    row, column = (np.mgrid[:20, :24].astype(np.float32) - 0.5) / 2.0
    np.testing.assert_allclose(found[1:-1, 1:-1], (0.3 * column - 0.2 * row)[1:-1, 1:-1], atol=1e-5)


@pytest.mark.parametrize("edge", [11, 12, 13])
@pytest.mark.parametrize("odd", [0, 1])
def test_a_depth_edge_lies_where_the_picture_has_its_edge(edge: int, odd: int) -> None:
    full = np.full((20 + odd, 24 + odd, 3), 60.0, np.float32)
    full[:, edge:] = 180.0
    half = full[:20, :24].reshape(10, 2, 12, 2, 3).mean(axis=(1, 3))
    planes = np.where(half[..., 0] < 121, np.float32(2.0), np.float32(9.0))
    found = enlarged_by_picture(planes, half, full, 1.0)
    assert (found == np.where(full[..., 0] < 100, 2.0, 9.0)).all()


def test_fast_measures_at_half_size_and_states_larger_errors(scene: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    light_field, depth, number = scene
    whole = DepthEstimator(light_field, quality="fast", workers=1).estimate(light_field)
    monkeypatch.setattr("mirrorcam.optics.light_field.depth.estimate.MIN_SEARCHED_PX", 24)
    found = DepthEstimator(light_field, quality="fast", workers=1).estimate(light_field)
    together = DepthEstimator(light_field, quality="fast", workers=2).estimate(light_field)
    for name in ("depth_mm", "sigma_mm", "confidence"):
        assert np.array_equal(getattr(found, name), getattr(together, name), equal_nan=True)
    for surface in (0, 1):
        error = np.abs(found.depth_mm - depth)[inner(number, surface)] / depth[inner(number, surface)]
        assert np.median(error) < 0.003
    assert np.nanmedian(found.sigma_mm) > 1.3 * np.nanmedian(whole.sigma_mm)
    first = VideoDepth(DepthEstimator(light_field, quality="fast", workers=1)).estimate(light_field)
    assert np.array_equal(first.depth_mm, found.depth_mm, equal_nan=True)
