"""Defocus against its closed form: the variance of the circle of confusion of a thin lens."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.render_scenes.fast.defocus import defocused


def variances(sigmas_px: list[float], subpixels: int) -> list[float]:
    """Variances (px^2) across lines, 41 px apart, of a view whose defocus grows from line to line."""
    width = 41 * subpixels
    lines = np.zeros((50, width * len(sigmas_px)), dtype=np.float32)
    lines[:, width // 2 :: width] = 1.0
    sigma = np.broadcast_to(np.repeat(sigmas_px, width).astype(np.float32), lines.shape)
    row = defocused(lines, sigma**2, subpixels)[25].reshape(len(sigmas_px), width)
    x = (np.arange(width) - width // 2) / subpixels
    return [float((light * x**2).sum() / light.sum()) for light in row]


@pytest.mark.parametrize("subpixels", [1, 2])
@pytest.mark.parametrize(
    "sigmas_px", [[0.0, 0.5, 1.0, 1.5, 2.0], [0.0, 0.05, 0.1, 0.2], [0.04], [0.1], [0.3, 0.3], [1.0, 1.1], [3.0]]
)
def test_each_line_is_blurred_by_its_own_sigma(sigmas_px: list[float], subpixels: int) -> None:
    """Also by less than a Gaussian that is sampled in each subpixel can have."""
    expected = np.square(sigmas_px)
    np.testing.assert_allclose(variances(sigmas_px, subpixels), expected, rtol=0.02, atol=1e-4)


def test_a_picture_in_focus_is_not_changed() -> None:
    picture = np.random.default_rng(0).random((40, 60)).astype(np.float32)
    np.testing.assert_array_equal(defocused(picture, np.zeros((40, 60), dtype=np.float32), 1), picture)
    blurred = defocused(picture, np.full((40, 60), 2.25, dtype=np.float32), 1)
    assert blurred.std() < 0.5 * picture.std()
    assert blurred.mean() == pytest.approx(picture.mean(), rel=0.02)
