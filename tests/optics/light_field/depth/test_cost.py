"""Costs of planes where views agree, have no samples, or are occluded."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np
import pytest

from mirrorcam.optics.light_field.depth.competition import (
    BEST_FRACTION,
    HALF_SURCHARGE,
    OCCLUSION_SURCHARGE,
    TRUNCATION,
    UNITS,
    USUAL_OCCLUSION,
)
from mirrorcam.optics.light_field.depth.cost import (
    CHANNELS,
    CONTRAST_FLOOR,
    CONTRAST_GREY,
    average_weak,
    channels,
    matching_costs,
    mean_gradient,
)
from mirrorcam.optics.light_field.depth.parallax import parallax
from mirrorcam.optics.light_field.depth.sweep import Ranges, Sweep, range_around, sweep
from mirrorcam.optics.light_field.light_field import Views
from tests.nightly import a_few
from tests.optics.light_field.depth.surfaces import everywhere, grid_views

INVERSE_DISTANCES = np.linspace(1 / 900.0, 1 / 300.0, 20)


def texture(views: Views, seed: int = 6) -> Any:
    coarse = np.random.default_rng(seed).uniform(0, 255, (18, 24, 3)).astype(np.float32)
    return cv2.resize(coarse, (views.width_px, views.height_px), interpolation=cv2.INTER_CUBIC).clip(0, 255)


def compared(picture: Any) -> Any:
    """Return the channels of a picture (v, u, 3)."""
    return channels(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), 0.5 * (picture[..., 0] - picture[..., 2]))


def taken(views: Views, picture: Any, plane: int) -> tuple[Any, Any]:
    """Return channels of the reference view, and of the others that see its picture on a plane."""
    size = views.width_px, views.height_px
    others = []
    for index in np.ndindex(views.rows, views.cols):
        if views.positions_mm[index].any():
            matrix = parallax(views, index).affine(INVERSE_DISTANCES[plane])
            others.append(compared(np.asarray(cv2.warpAffine(picture, matrix, size, flags=cv2.INTER_CUBIC))))
    return compared(picture), np.stack(others)


def valid(others: Any) -> Any:
    return np.ones((len(others), others.shape[1] - 1, others.shape[2] // CHANNELS - 1), np.uint8)


def costs_of(*arguments: Any, **options: Any) -> Any:
    return everywhere(matching_costs(*arguments, **options))


def reference_cost(reference: Any, others: Any, planes: Sweep, y: int, x: int, plane: int) -> float:
    """Return the cost of one place by its definition, for views of one ring that all see it."""
    inverse_contrast = CONTRAST_GREY / (CONTRAST_FLOOR * CONTRAST_GREY + mean_gradient(reference, 7)[y, x])
    costs = []
    for view, other in enumerate(others):
        column = planes.mapping.scale[plane, view] * x + planes.mapping.offset_u[plane, view]
        row = planes.mapping.scale[plane, view] * y + planes.mapping.offset_v[plane, view]
        offset_u, offset_v = (np.full((1, 1), coordinate, np.float32) for coordinate in (column, row))
        sampled: Any = cv2.remap(other.reshape(len(other), -1, CHANNELS), offset_u, offset_v, cv2.INTER_LINEAR)[0, 0]
        difference = np.abs(sampled - reference[y, CHANNELS * x : CHANNELS * (x + 1)]).sum()
        costs.append(min(difference * inverse_contrast, TRUNCATION))
    ordered = np.sort(costs)

    def mean(count: float) -> float:
        weights = np.clip(count - np.arange(len(ordered)), 0.0, 1.0)
        return float((weights * ordered).sum() / count)

    return min(mean(8 * BEST_FRACTION), mean(4 * BEST_FRACTION) + HALF_SURCHARGE)


def test_the_cost_follows_its_definition() -> None:
    views = grid_views(3, 3, uneven=False)
    planes = sweep(views, INVERSE_DISTANCES)
    reference, others = taken(views, texture(views), 7)
    volume = costs_of(reference, others, valid(others), planes)
    strong = mean_gradient(reference, 9) > 4.0
    random = np.random.default_rng(1)
    for _ in range(200):
        y, x, plane = int(random.integers(25, 65)), int(random.integers(35, 85)), int(random.integers(20))
        if strong[y, x]:
            # OpenCV rounds places to 1/32 px.
            assert volume[y, x, plane] / UNITS == pytest.approx(
                reference_cost(reference, others, planes, y, x, plane), abs=0.2
            )


@pytest.mark.parametrize("ahead_mm", [0.0, 3.0, 40.0])
def test_the_true_plane_has_a_low_cost_although_views_lie_ahead(ahead_mm: float) -> None:
    views = grid_views(1, 2, positions_mm=np.array([[[0.0, 0.0, 0.0], [20.0, 5.0, ahead_mm]]]))
    planes = sweep(views, INVERSE_DISTANCES)
    for plane in (0, 7, 19):
        reference, others = taken(views, texture(views), plane)
        volume = costs_of(reference, others, valid(others), planes)[20:-20, 30:-30]
        costs = volume.mean(axis=(0, 1)) / UNITS
        assert int(np.argmin(costs)) == plane
        assert costs[plane] < 0.25 * np.median(costs)


def test_pixels_without_samples_in_a_view_are_matched_in_the_others() -> None:
    views = grid_views(1, 3, uneven=False)
    planes = sweep(views, INVERSE_DISTANCES)
    reference, others = taken(views, texture(views), 7)
    sight = valid(others)
    others[0, :, : 60 * CHANNELS] = 255.0
    sight[0, :, :61] = 0
    volume = costs_of(reference, others, sight, planes)
    seen_by_one = volume[10:-10, 15:55]
    assert np.median(seen_by_one[..., 7]) < 0.25 * np.median(seen_by_one)
    sight[:] = 0
    assert (costs_of(reference, others, sight, planes) == int(TRUNCATION * UNITS)).all()


def test_an_occluded_view_does_not_count() -> None:
    views = grid_views(3, 3, uneven=False)
    planes = sweep(views, INVERSE_DISTANCES)
    reference, others = taken(views, texture(views), 7)
    others[:6] = 255.0 - others[:6]
    nearest = np.full((8, views.height_px, views.width_px), -1e9, np.float32)
    before = costs_of(reference, others, valid(others), planes, nearest=nearest)
    nearest[:6] = 19.0
    after = costs_of(reference, others, valid(others), planes, nearest=nearest)
    inside = (slice(25, -25), slice(35, -35), 7)
    surcharge = UNITS * OCCLUSION_SURCHARGE * (6 / 8 - USUAL_OCCLUSION)
    assert np.median(after[inside]) - surcharge < 0.2 * np.median(before[inside])


@pytest.mark.slow
def test_threads_change_no_bit_and_weak_texture_is_averaged() -> None:
    views = grid_views(3, 3, uneven=False)
    planes = sweep(views, INVERSE_DISTANCES)
    picture = 128.0 + np.random.default_rng(3).normal(scale=0.3, size=(90, 120, 3)).astype(np.float32)
    reference, others = compared(picture), np.stack([compared(picture[:, ::-1])] * 8)
    volume = costs_of(reference, others, valid(others), planes)
    assert np.array_equal(volume, costs_of(reference, others, valid(others), planes, ThreadPoolExecutor(2).map))
    assert (
        np.abs(np.diff(volume[20:-20, 30:-30, 5].astype(int), axis=1)).mean() < 0.3 * volume[20:-20, 30:-30, 5].mean()
    )


@pytest.mark.parametrize("weak", a_few(1, [False, True]))
def test_costs_of_a_range_equal_those_of_a_search_of_all_planes(weak: bool) -> None:
    views = grid_views(3, 3)
    # So many planes that a search of all of them is not as cheap.
    step = INVERSE_DISTANCES[1] - INVERSE_DISTANCES[0]
    planes = sweep(views, INVERSE_DISTANCES[0] + step * np.arange(40))
    picture = texture(views)
    reference, others = taken(views, picture * 0.01 + 90.0 if weak else picture, 7)
    known = np.where(np.arange(120) < 50, np.float32(7.0), np.float32(11.0)) + np.zeros((90, 1), np.float32)
    ranges = range_around(known, planes.plane_count)
    nearest = np.full((8, 90, 120), -1e9, np.float32)
    nearest[:, :, 50:] = 11.0
    every = costs_of(reference, others, valid(others), planes, nearest=nearest)
    part = matching_costs(reference, others, valid(others), planes, nearest=nearest, ranges=ranges)
    assert ranges.size < every.size
    for v, u in ((0, 0), (40, 20), (41, 50), (89, 119), (60, 61)):
        low, count, start = (int(each[v, u]) for each in ranges)
        # Outside a neighbour's range, the pixel's own costs replace the missing ones.
        there = part.costs[start : start + count]
        if not weak or 16 < u < 30:
            assert np.array_equal(there, every[v, u, low : low + count])


def test_missing_costs_of_a_neighbour_are_replaced_by_the_pixels_own() -> None:
    random = np.random.default_rng(0)
    shape, planes, reach = (9, 11), 8, 2
    ranges = Ranges.of(random.integers(0, 4, shape).astype(np.int32), random.integers(3, 5, shape).astype(np.int32))
    costs = random.integers(0, 300, ranges.size).astype(np.uint16)
    weak = random.uniform(-0.5, 1.0, shape).astype(np.float32).clip(0.0)
    found = np.zeros_like(costs)
    average_weak(0, 9, weak, reach, ranges, costs, found)
    known = np.full((*shape, planes), -1.0)
    for v, u in np.ndindex(shape):
        low, count, start = (int(each[v, u]) for each in ranges)
        known[v, u, low : low + count] = costs[start : start + count]
    for v, u in np.ndindex(shape):
        low, count, start = (int(each[v, u]) for each in ranges)
        offsets = np.arange(-reach, reach + 1)
        square_of = np.ix_(np.clip(v + offsets, 0, shape[0] - 1), np.clip(u + offsets, 0, shape[1] - 1))
        for plane in range(low, low + count):
            square = known[square_of][..., plane]
            own = known[v, u, plane]
            mean = np.where(square >= 0, square, own).mean()
            expected = (1.0 - weak[v, u]) * own + weak[v, u] * mean
            assert abs(float(found[start + plane - low]) - expected) < 0.51
