"""Defocus against its closed form: the variance of the circle of confusion of a thin lens."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.render_scenes.fast.defocus import ViewWindow, defocused


def variances(sigmas_px: list[float], subpixels: int, spread: float = 1.0) -> list[float]:
    """Variances (px^2) across lines, 41 px apart, of a view whose defocus grows from line to line."""
    width = 41 * subpixels
    lines = np.zeros((50, width * len(sigmas_px)), dtype=np.float32)
    lines[:, width // 2 :: width] = 1.0
    rays = np.zeros((*lines.shape, 3), dtype=np.float32)
    rays[..., 0] = np.repeat(np.arange(len(sigmas_px)), width)
    rays[..., 2] = 1.0
    whole = slice(0, 50), slice(0, lines.shape[1])
    window = ViewWindow(0, whole, np.ones(lines.shape, dtype=np.bool_), rays, np.full(lines.shape, spread, np.float32))
    slope = np.array([sigmas_px[1] - sigmas_px[0], 0.0, sigmas_px[0]])
    row = defocused(lines, [window], [slope], subpixels)[25].reshape(len(sigmas_px), width)
    x = (np.arange(width) - width // 2) / subpixels
    return [float((light * x**2).sum() / light.sum()) for light in row]


@pytest.mark.parametrize("subpixels", [1, 2])
def test_each_line_is_blurred_by_its_own_sigma(subpixels: int) -> None:
    found = variances([-0.5, 0.0, 0.5, 1.0, 1.5, 2.0], subpixels)
    np.testing.assert_allclose(
        found, [0.25, 0.0, 0.25, 1.0, 2.25, 4.0], rtol=0.04, atol=0.04
    )  # a narrow Gaussian in pixels


def test_a_part_of_the_pupil_blurs_less() -> None:
    np.testing.assert_allclose(variances([1.0, 2.0], 2, spread=0.5), [0.25, 1.0], rtol=0.04)


def test_views_keep_their_light() -> None:
    """What lies outside of the mask is not changed, and not taken away."""
    picture = np.random.default_rng(0).random((40, 60)).astype(np.float32)
    mask = np.zeros((40, 60), dtype=np.bool_)
    mask[:, :30] = True
    rays = np.ones((40, 60, 3), dtype=np.float32)
    window = ViewWindow(0, (slice(0, 40), slice(0, 60)), mask, rays, np.ones((40, 60), np.float32))
    blurred = defocused(picture, [window], [np.array([0.0, 0.0, 1.5])], 1)
    np.testing.assert_array_equal(blurred[:, 30:], picture[:, 30:])
    assert blurred[:, :20].std() < 0.5 * picture[:, :20].std()
    np.testing.assert_array_equal(defocused(picture, [window], [np.zeros(3)], 1), picture)
