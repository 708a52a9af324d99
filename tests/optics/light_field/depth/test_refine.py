"""Refinement: planes found to a small part of a pixel, edges kept, and pixels without information unchanged."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.parallax import halved, other_views, parallax
from mirrorcam.optics.light_field.depth.photometry import ViewPicture
from mirrorcam.optics.light_field.depth.refine import GradientPicture, Refiner, align_to_picture_edges, depth_edges
from mirrorcam.optics.light_field.depth.sweep import Sweep, sweep
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

DISTANCE_MM = 500.0
INVERSE_DISTANCES = np.linspace(1 / 700.0, 1 / 350.0, 60)
INSIDE = (slice(15, -15), slice(15, -15))
"""Pixels that all views see."""


@pytest.fixture(scope="module")
def slanted() -> tuple[Refiner, Sweep, Any, Any, Any]:
    """Return for a slanted plane the refiner, the sweep, the reference picture, the others, and the true planes."""
    surface = Surface(DISTANCE_MM, slope=(0.4, -0.2), grain_mm=1.5)
    views = grid_views()
    light_field, depth, _ = photograph(views, [surface], noise=0.0)
    planes = sweep(views, INVERSE_DISTANCES)
    pictures = [ViewPicture.of(light_field, index) for index in ((1, 1), *other_views(views))]
    gradients = [GradientPicture.of(picture.grey, picture.interior) for picture in pictures]
    refiner = Refiner(planes, [parallax(views, index) for index in other_views(views)])
    truth = (1.0 / (depth - views.reference_view_depth_mm) - INVERSE_DISTANCES[0]) / planes.step
    return refiner, planes, gradients[0], gradients[1:], truth.astype(np.float32)


@pytest.mark.parametrize("wrong_px", [-0.3, 0.3])
def test_a_few_steps_find_a_slanted_plane_to_a_hundredth_of_a_pixel(slanted: Any, wrong_px: float) -> None:
    refiner, planes, reference, others, truth = slanted
    start = truth + np.float32(wrong_px / planes.step_px)
    found, match, smooth = refiner.refined(start, reference, others, 3, 30)
    error_px = np.abs(found - truth)[INSIDE] * planes.step_px
    assert np.median(error_px) < 0.02
    assert np.quantile(error_px, 0.95) < 0.08
    assert (match.view_count[INSIDE] == len(others)).all()
    assert (match.weight_sum <= match.view_count + 1e-4).all()
    assert (match.information[INSIDE] > 0.0).mean() > 0.99
    assert np.median(smooth[INSIDE]) > 0.95


def test_the_change_of_a_map_is_limited(slanted: Any) -> None:
    refiner, planes, reference, others, truth = slanted
    start = truth + np.float32(3.0 / planes.step_px)
    found = refiner.refined(start, reference, others, 2, 30)[0]
    assert np.abs(found - start).max() * planes.step_px <= 1.001
    torn = start + np.where(np.arange(120) > 60, np.float32(2.0 / planes.step_px), np.float32(0.0))
    found = refiner.refined(torn, reference, others, 2, 30)[0]
    at_jumps = depth_edges(torn * np.float32(planes.step_px))
    assert at_jumps.sum() == 2 * 90
    assert np.abs(found - torn)[at_jumps].max() * planes.step_px <= 0.1501


def test_pictures_without_texture_have_no_information(slanted: Any) -> None:
    refiner, _, _, others, truth = slanted
    blank = GradientPicture.of(np.full(truth.shape, 90.0, np.float32), others[0].valid)
    found, match, _ = refiner.refined(truth, blank, [blank] * len(others), 2, 30)
    assert np.abs(found - truth).max() < 0.01
    assert (match.information == 0.0).all()
    assert (match.residual[INSIDE] == 0.0).all()


def test_an_occluded_view_does_not_count(slanted: Any) -> None:
    refiner, planes, reference, others, truth = slanted
    near = truth.copy()
    near[:, 50:70] += np.float32(8.0 / planes.step_px)
    match, _ = refiner.match(near, reference, others)
    # Next to the strip, views on one side are occluded; far from it, none is.
    assert match.weight_sum[40, 72] < match.weight_sum[40, 95] - 1.5


def test_the_match_after_a_small_step_is_predicted(slanted: Any) -> None:
    refiner, planes, reference, others, truth = slanted
    shift_px = np.float32(0.2)
    shifted, gradient = refiner.match(truth + shift_px / np.float32(planes.step_px), reference, others)
    predicted = shifted.after_step(gradient, np.full_like(truth, -shift_px))
    found = refiner.match(truth, reference, others)[0]
    before, after = np.median(shifted.residual[INSIDE]), np.median(found.residual[INSIDE])
    assert before > 5.0 * after
    assert np.median(predicted.residual[INSIDE]) - after < 0.3 * (before - after)


def test_noise_lowers_the_weight_of_information(slanted: Any) -> None:
    refiner, _, reference, others, truth = slanted
    random = np.random.default_rng(0)

    def noisy(picture: GradientPicture) -> GradientPicture:
        noise = random.normal(scale=2.0, size=picture.gradients.shape).astype(np.float32)
        return GradientPicture(picture.gradients + noise, picture.valid)

    clean = refiner.match(truth, reference, others)[0]
    noisy_match = refiner.match(truth, noisy(reference), [noisy(other) for other in others])[0]
    assert np.median(noisy_match.residual[INSIDE]) > 2.0 * np.median(clean.residual[INSIDE])


def card() -> tuple[np.ndarray, np.ndarray]:
    """Return a near card that is a pixel too wide, and the picture with its true edge."""
    picture = np.full((40, 60, 3), 60.0, np.float32)
    picture[:, 30:] = 180.0
    planes = np.full((40, 60), 2.0, np.float32)
    planes[:, 29:] = 12.0
    return planes, picture


def test_an_edge_moves_to_the_pictures_edge() -> None:
    planes, picture = card()
    found = align_to_picture_edges(planes, picture, 1.2)
    assert (found[:, :30] == 2.0).all()
    assert (found[:, 30:] == 12.0).all()
    assert np.array_equal(found, align_to_picture_edges(planes, picture, 1.2, ThreadPoolExecutor(2).map))


def test_only_jumps_move_and_only_with_a_picture() -> None:
    planes, picture = card()
    slanted = (np.arange(60, dtype=np.float32) * 0.2)[None].repeat(40, axis=0)
    assert np.array_equal(align_to_picture_edges(slanted, picture, 1.2), slanted)
    assert np.array_equal(
        align_to_picture_edges(planes, np.full_like(picture, 90.0), 1.2)[:, [20, 40]], planes[:, [20, 40]]
    )


def test_a_single_wrong_pixel_is_outvoted() -> None:
    planes = np.full((20, 20), 5.0, np.float32)
    planes[10, 10] = 15.0
    assert (align_to_picture_edges(planes, np.full((20, 20, 3), 90.0, np.float32), 1.2) == 5.0).all()


def test_a_grid_of_half_the_pixels_finds_a_slanted_plane() -> None:
    views = grid_views()
    light_field, depth, _ = photograph(views, [Surface(DISTANCE_MM, slope=(0.4, -0.2), grain_mm=3.0)], noise=0.0)
    planes = sweep(halved(views), INVERSE_DISTANCES)
    pictures = [ViewPicture.of(light_field, index) for index in ((1, 1), *other_views(views))]
    reference, *others = (GradientPicture.of(picture.grey, picture.interior, 2) for picture in pictures)
    refiner = Refiner(planes, [parallax(views, index) for index in other_views(views)], spacing=2)
    inverse = 1.0 / (depth - views.reference_view_depth_mm)
    # Inverse distance is linear over a plane, so the mean of a block is that of its centre.
    truth = (inverse.reshape(45, 2, 60, 2).mean(axis=(1, 3)) - INVERSE_DISTANCES[0]) / planes.step
    start = (truth + 0.3 / refiner.step_px).astype(np.float32)
    found = refiner.refined(start, reference, others, 3, 30)[0]
    error_px = np.abs(found - truth)[8:-8, 8:-8] * refiner.step_px
    assert np.median(error_px) < 0.02
    assert np.quantile(error_px, 0.95) < 0.08
    cold, warm = (
        np.median(np.abs(refiner.refined(start, reference, others, 1, 30, earlier)[0] - truth)[8:-8, 8:-8])
        for earlier in (None, truth.astype(np.float32))
    )
    assert warm < 0.6 * cold
