"""Super-resolution of views whose pixels integrate sine waves in closed form."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.render.super_resolution import (
    PHASES,
    back_project,
    half_gradient,
    huber_weights,
    pixel_taps,
    project,
    super_resolve,
)

Float32 = NDArray[np.float32]
SIDE, CONTRAST = 48, 0.3
SHIFTS = np.stack(np.meshgrid([-1.3, 0.0, 0.7], [0.4, 0.0, 2.3]), axis=-1).reshape(-1, 2)
INNER = slice(16, -16), slice(16, -16)
TILTED = np.array([[2.0, 0.1, 4.3], [-0.05, 1.9, 5.7], [1e-3, -2e-3, 1.0]])


def wave(frequency: float, scale: float, shift: FloatArray) -> Float32:
    """Return the light (v, u, 1) of a mostly horizontal wave, over pixels of a view (scale 1) or finer ones."""
    samples = (np.arange(round(SIDE * scale)) + 0.5) / scale - 0.5
    phase = 2.0 * np.pi * frequency * (samples[None] + shift[0])
    down = 0.5 + 0.5 * np.cos(2.0 * np.pi * (samples[:, None] + shift[1]) / 40.0)
    light = 0.5 + CONTRAST * np.sinc(frequency / scale) * np.cos(phase) * down
    return np.asarray(light[..., None], dtype=np.float32)


def solved(
    views: list[Float32], scale: float, shifts: FloatArray = SHIFTS, *, absolute: bool = False
) -> tuple[Float32, Float32]:
    """Return the solution, and the mean of the views at which it starts."""
    to_fine, matrices = np.diag([scale, scale, 1.0]), []
    to_fine[:2, 2] = (scale - 1.0) / 2.0
    size = (round(SIDE * scale),) * 2
    total = np.zeros(size)
    for view, shift in zip(views, shifts, strict=True):
        moved = np.eye(3)
        moved[:2, 2] = shift
        matrices.append(to_fine @ moved)
        total = total + cv2.warpAffine(view, matrices[-1][:2], size, borderMode=cv2.BORDER_REPLICATE)
    mean = np.asarray(total / len(views), dtype=np.float32)[..., None]
    weights = [np.ones((SIDE, SIDE), np.float32)] * len(views)
    return super_resolve(views, weights, matrices, mean, scale, absolute=absolute), mean


def noisy(views: Iterator[Float32], level: float = 0.003) -> list[Float32]:
    random = np.random.default_rng(0)
    return [(view + random.normal(0.0, level, view.shape)).astype(np.float32) for view in views]


def rms(difference: Float32) -> float:
    return float(np.sqrt(np.square(difference[INNER]).mean()))


@pytest.mark.parametrize(("scale", "frequency"), [(1.5, 0.62), (2.0, 0.62), (2.0, 0.8)])
@pytest.mark.parametrize("absolute", [False, True])
def test_waves_finer_than_a_view_samples_are_found(scale: float, frequency: float, absolute: bool) -> None:
    true = wave(frequency, scale, np.zeros(2))
    views = noisy(wave(frequency, 1.0, shift) for shift in SHIFTS)
    found, mean = solved(views, scale, absolute=absolute)
    assert found.shape == true.shape
    assert found.dtype == np.float32
    assert rms(found - true) < 0.3 * rms(mean - true)
    assert rms(found - true) < 0.3 * rms(true - 0.5)


def test_views_that_do_not_show_the_plane_do_not_change_the_start() -> None:
    random = np.random.default_rng(1)
    views = []
    for _ in SHIFTS:
        grains = cv2.GaussianBlur(random.normal(0.5, 0.6, (SIDE, SIDE)), (0, 0), 1.0)
        views.append(grains.astype(np.float32)[..., None])
    flat = [np.where(np.arange(SIDE)[:, None, None] < SIDE // 2, view, np.float32(0.5)) for view in views]
    found, mean = solved(noisy(iter(flat)), 2.0)
    away = slice(16, SIDE - 12), slice(16, -16)
    assert np.abs(found - mean)[away].max() < 0.02


def test_absolute_differences_ignore_objects_in_one_view() -> None:
    views = noisy(wave(0.62, 1.0, shift) for shift in SHIFTS)
    true = wave(0.62, 2.0, np.zeros(2))
    views[3][20:28, 20:28] = 1.0
    squares, absolute = (solved(views, 2.0, absolute=each)[0] for each in (False, True))
    spot = slice(36, 60), slice(36, 60)
    errors = [float(np.abs(found - true)[spot].max()) for found in (squares, absolute)]
    assert errors[1] < 0.5 * errors[0]


def test_samples_without_weight_have_no_influence() -> None:
    views = noisy(wave(0.62, 1.0, shift) for shift in SHIFTS)
    to_fine = np.diag([2.0, 2.0, 1.0])
    to_fine[:2, 2] = 0.5
    matrices = []
    for shift in SHIFTS:
        moved = np.eye(3)
        moved[:2, 2] = shift
        matrices.append(to_fine @ moved)
    weights = [np.ones((SIDE, SIDE), np.float32) for _ in views]
    weights[2][10:20] = 0.0
    start = np.full((2 * SIDE, 2 * SIDE, 1), 0.5, np.float32)
    found = super_resolve(views, weights, matrices, start, 2.0)
    views[2] = np.where(weights[2][..., None] > 0, views[2], np.float32(0.0))
    np.testing.assert_allclose(super_resolve(views, weights, matrices, start, 2.0)[INNER], found[INNER], atol=2e-3)


def test_roughness_is_half_the_gradient_of_the_energy() -> None:
    random = np.random.default_rng(2)
    picture = random.normal(size=(2, 9, 11)).astype(np.float32)
    counts = huber_weights(picture, np.float32(0.5))
    assert all(each.min() > 0.0 and each.max() <= 1.0 for each in counts)

    def energy(picture: NDArray[np.floating]) -> float:
        return sum(
            float((counts[axis - 1] * np.square(np.diff(picture.astype(np.float64), axis=axis))).sum())
            for axis in (1, 2)
        )

    way, step = random.normal(size=picture.shape), 1e-4
    slope = (energy(picture + step * way) - energy(picture - step * way)) / (2.0 * step)
    assert float((2.0 * half_gradient(picture, counts) * way).sum()) == pytest.approx(slope, rel=1e-4)


@pytest.mark.parametrize("scale", [1.5, 2.0])
def test_waves_keep_the_contrast_of_larger_pixels(scale: float) -> None:
    table = pixel_taps(scale)
    np.testing.assert_allclose(table.sum(axis=1), 1.0, atol=1e-6)
    taps = table.shape[1]
    away = np.arange(taps) - (taps // 2 - 1) - (np.arange(PHASES + 1) / PHASES)[:, None]
    for frequency in (0.05, 0.2, 0.3, 0.35):
        response = (table * np.exp(2j * np.pi * frequency * away)).sum(axis=1)
        # Half the step of the phases, and the part outside of the window.
        np.testing.assert_allclose(response, np.sinc(scale * frequency) / np.sinc(frequency), atol=0.02)


def test_light_is_kept_at_every_scale() -> None:
    for scale in (1.1, 3.0, 8.0):
        table = pixel_taps(scale)
        picture, shown = np.full((1, 80, 90), 0.7, np.float32), np.zeros((1, 6, 7), np.float32)
        project(picture, np.array([[scale, 0.0, 14.3], [0.0, scale, 15.1], [0.0, 0.0, 1.0]]), table, shown)
        np.testing.assert_allclose(shown, 0.7, atol=1e-5)


def test_the_adjoint_is_the_transpose() -> None:
    random, table = np.random.default_rng(0), pixel_taps(2.0)
    picture = random.normal(size=(3, 50, 60)).astype(np.float32)
    view = random.normal(size=(3, 22, 27)).astype(np.float32)
    shown, added = np.zeros_like(view), np.zeros_like(picture)
    project(picture, TILTED, table, shown)
    back_project(view, TILTED, table, added)
    assert (shown != 0).mean() > 0.5
    assert np.sum(shown * view, dtype=np.float64) == pytest.approx(np.sum(picture * added, dtype=np.float64), abs=1e-3)


def test_points_outside_the_picture_or_behind_the_view_are_ignored() -> None:
    table, picture = pixel_taps(2.0), np.ones((1, 30, 30), np.float32)
    shown = np.full((1, 40, 40), np.nan, np.float32)
    project(picture, np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]]), table, shown)
    # Taps reach four finer pixels to the right and below, three to the left and above.
    assert np.isfinite(shown[0]).sum() == (30 - 8) ** 2
    assert np.isfinite(shown[0, 3:25, 3:25]).all()
    behind = np.full((1, 40, 40), np.nan, np.float32)
    project(picture, -np.eye(3), table, behind)
    assert np.isnan(behind).all()
