"""Refinement of inverse distances: the guided filter's closed forms, and planes that are found to a part of a pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.geometry import other_views
from mirrorcam.optics.light_field.depth.photometry import grey
from mirrorcam.optics.light_field.depth.refine import Refiner, enlarged, guided
from mirrorcam.optics.light_field.light_field import Views
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

INVERSE = 1.0 / 500.0
"""Of the plane that all views see, 1/mm."""
INSIDE = (slice(15, -15), slice(15, -15))
"""Pixels that all views see."""


@pytest.fixture(scope="module")
def plane() -> tuple[Views, Any, list[Any]]:
    """A plane across the view axis: the views, the reference picture, and those of the others."""
    light_field = photograph(grid_views(), [Surface(1.0 / INVERSE, grain_mm=1.5)], noise=0.0)[0]
    return light_field, grey(light_field, (1, 1)), [grey(light_field, index) for index in other_views(light_field)]


def even(value: float, like: Any) -> Any:
    return np.full_like(like, value)


def test_what_is_linear_in_the_guide_passes_the_guided_filter() -> None:
    guide = np.random.default_rng(1).uniform(0.0, 100.0, (20, 30)).astype(np.float32)
    found = guided(np.float32(0.7) * guide + 3, guide, 2, 1e-3, np.ones_like(guide))
    np.testing.assert_allclose(found, 0.7 * guide + 3, rtol=1e-3)


def test_edges_of_less_contrast_than_the_spread_are_smoothed() -> None:
    guide = np.zeros((20, 40), np.float32)
    guide[:, 20:] = 10.0
    kept, smoothed = (guided(guide, guide, 3, spread, np.ones_like(guide)) for spread in (0.1, 1000.0))
    assert np.abs(kept - guide).max() < 0.01
    # Two means over windows of seven: at the edge, half of the step and a ramp on both sides.
    assert smoothed[10, 19] == pytest.approx(10.0 - smoothed[10, 20])
    assert 3.0 < smoothed[10, 19] < 5.0


def test_values_without_weight_count_for_nothing() -> None:
    random = np.random.default_rng(2)
    guide = random.uniform(0.0, 100.0, (20, 30)).astype(np.float32)
    weights = (random.random(guide.shape) > 0.3).astype(np.float32)
    values = np.where(weights > 0, guide, np.float32(1e3))
    np.testing.assert_allclose(guided(values, guide, 3, 1e-3, weights), guide, atol=0.05)


@pytest.mark.parametrize("shape", [(12, 16), (13, 17)])
def test_a_small_map_of_a_plane_is_that_plane_at_full_size(shape: tuple[int, int]) -> None:
    """The middle of pixel i of the small map lies at 2 i + 1/2 of the large one."""
    rows, cols = np.mgrid[: shape[0] // 2, : shape[1] // 2] * 2.0 + 0.5
    large = enlarged((3.0 * cols - 2.0 * rows).astype(np.float32), shape)
    v, u = np.mgrid[: shape[0], : shape[1]]
    assert large.shape == shape
    np.testing.assert_allclose(large[1:10, 1:14], (3.0 * u - 2.0 * v)[1:10, 1:14], atol=1e-4)
    np.testing.assert_array_equal(large[12:], large[11 : 11 + len(large[12:])])


def test_other_views_are_made_as_bright_as_the_reference(plane: tuple[Views, Any, list[Any]]) -> None:
    views, reference, others = plane
    dimmed = [np.float32(0.85) * picture for picture in others]
    for found, expected in zip(
        Refiner(views).matched(dimmed, reference, even(INVERSE, reference)), others, strict=True
    ):
        assert np.abs(found - expected)[INSIDE].mean() < 0.3
        assert np.abs(0.85 * expected - expected)[INSIDE].mean() > 10.0


def test_the_candidate_on_which_views_agree_is_chosen(plane: tuple[Views, Any, list[Any]]) -> None:
    views, reference, others = plane
    candidates = [even(INVERSE * factor, reference) for factor in (0.8, 1.0, 1.2)]
    chosen = Refiner(views).chosen(candidates, others, reference)
    assert (chosen[INSIDE] == np.float32(INVERSE)).mean() > 0.99


@pytest.mark.parametrize("wrong_px", [-0.4, 0.4])
def test_one_step_brings_inverse_distance_close_to_the_truth(
    plane: tuple[Views, Any, list[Any]], wrong_px: float
) -> None:
    views, reference, others = plane
    per_px = 1.0 / (views.focal_px * 20.0)
    start = even(INVERSE + wrong_px * per_px, reference)
    found, statistics = Refiner(views).stepped(start, others, reference, 1.0 * per_px)
    error_px = (found - INVERSE)[INSIDE] / per_px
    assert np.median(np.abs(error_px)) < 0.1
    assert (statistics.seeing[INSIDE] == len(others)).all()
    assert (statistics.agreeing <= statistics.seeing + 1e-4).all()
    assert (statistics.information[INSIDE] > 0.0).mean() > 0.99
    # A step is never longer than the longest.
    short = Refiner(views).stepped(start, others, reference, 0.05 * per_px)[0]
    assert np.abs(short - start).max() <= 0.0501 * per_px


def test_pictures_without_texture_hold_no_information(plane: tuple[Views, Any, list[Any]]) -> None:
    views, reference, others = plane
    blank = even(90.0, reference)
    found, statistics = Refiner(views).stepped(even(INVERSE, reference), [blank] * len(others), blank, 1e-4)
    np.testing.assert_array_equal(found, even(INVERSE, reference))
    assert (statistics.information == 0.0).all()
    assert (statistics.variance[INSIDE] == 0.0).all()
