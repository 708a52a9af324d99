"""Pixels of views as sums of finer ones."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.light_field.render.fine_pixels import PHASES, back_project, pixel_taps, project

TILTED = np.array([[2.0, 0.1, 4.3], [-0.05, 1.9, 5.7], [1e-3, -2e-3, 1.0]])


@pytest.mark.parametrize("scale", [1.5, 2.0])
def test_waves_keep_the_contrast_that_a_larger_pixel_leaves(scale: float) -> None:
    table = pixel_taps(scale)
    np.testing.assert_allclose(table.sum(axis=1), 1.0, atol=1e-6)
    taps = table.shape[1]
    away = np.arange(taps) - (taps // 2 - 1) - (np.arange(PHASES + 1) / PHASES)[:, None]
    for frequency in (0.05, 0.2, 0.3, 0.35):
        response = (table * np.exp(2j * np.pi * frequency * away)).sum(axis=1)
        # Half the step of the phases, and what the window leaves out.
        np.testing.assert_allclose(response, np.sinc(scale * frequency) / np.sinc(frequency), atol=0.02)


def test_light_is_kept_at_every_scale() -> None:
    for scale in (1.1, 3.0, 8.0):
        table = pixel_taps(scale)
        picture, shown = np.full((1, 80, 90), 0.7, np.float32), np.zeros((1, 6, 7), np.float32)
        project(picture, np.array([[scale, 0.0, 14.3], [0.0, scale, 15.1], [0.0, 0.0, 1.0]]), table, shown)
        np.testing.assert_allclose(shown, 0.7, atol=1e-5)


def test_going_back_is_the_transpose() -> None:
    random, table = np.random.default_rng(0), pixel_taps(2.0)
    picture = random.normal(size=(3, 50, 60)).astype(np.float32)
    view = random.normal(size=(3, 22, 27)).astype(np.float32)
    shown, added = np.zeros_like(view), np.zeros_like(picture)
    project(picture, TILTED, table, shown)
    back_project(view, TILTED, table, added)
    assert (shown != 0).mean() > 0.5
    assert np.sum(shown * view, dtype=np.float64) == pytest.approx(np.sum(picture * added, dtype=np.float64), abs=1e-3)


def test_what_lies_beyond_the_picture_or_behind_the_view_is_left_alone() -> None:
    table, picture = pixel_taps(2.0), np.ones((1, 30, 30), np.float32)
    shown = np.full((1, 40, 40), np.nan, np.float32)
    project(picture, np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]]), table, shown)
    # Taps reach four finer pixels to the right and below, three to the left and above.
    assert np.isfinite(shown[0]).sum() == (30 - 8) ** 2
    assert np.isfinite(shown[0, 3:25, 3:25]).all()
    behind = np.full((1, 40, 40), np.nan, np.float32)
    project(picture, -np.eye(3), table, behind)
    assert np.isnan(behind).all()
