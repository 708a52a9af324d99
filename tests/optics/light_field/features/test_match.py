"""Matches are searched on exact epipolar lines, and views vote for a common slope."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features.keypoints import Keypoints
from mirrorcam.optics.light_field.features.match import CANDIDATES_PER_VIEW, Candidates, find_candidates, vote
from mirrorcam.optics.light_field.features.slope import ViewGeometry
from tests.optics.light_field.features.scenes import uneven_views

RANGE = (1 / 5000.0, 1 / 200.0)


def keypoints(pixels: FloatArray, descriptors: NDArray[np.uint64], scale: float = 1.0, angle: float = 0.0) -> Keypoints:
    count = len(pixels)
    return Keypoints(pixels, np.full(count, scale), np.full(count, angle), descriptors)


def bits(count: int) -> NDArray[np.uint64]:
    """Return different descriptors (count, 4) of 256 bits."""
    return np.random.default_rng(0).integers(0, 2**64, (count, 4), dtype=np.uint64)


def scene(count: int = 30) -> tuple[ViewGeometry, FloatArray, FloatArray]:
    """Return the geometry, inverse distances (n,) and exact pixels (views, n, 2) of points before uneven views."""
    random = np.random.default_rng(7)
    at = np.stack([*random.uniform(-40, 40, (2, count)), random.uniform(250, 2000, count)], axis=1)
    return ViewGeometry.of(uneven_views()), 1.0 / at[:, 2], uneven_views().project_in_view(at).reshape(9, count, 2)


def test_matches_give_the_inverse_distance_for_any_view_positions() -> None:
    geometry, inverse, seen = scene()
    looks = bits(30)
    shuffled = np.random.default_rng(1).permutation(30)
    others = {view: keypoints(seen[view][shuffled], looks[shuffled]) for view in (0, 3, 7)}
    found = find_candidates(geometry, keypoints(seen[4], looks), others, "ORB", RANGE, np.full(30, 1.0), map)
    assert found.inverse_distance.shape == (30, 3, CANDIDATES_PER_VIEW)
    assert np.allclose(found.inverse_distance[..., 0], inverse[:, None], rtol=1e-9)
    assert np.abs(found.epipolar_distance_px[..., 0]).max() < 1e-9
    # The speed of a match, by differences of the prediction.
    for place, view in enumerate(others):
        here, there = (geometry.predict(view, geometry.directions(seen[4]), inverse + step) for step in (-1e-8, 1e-8))
        rate = np.linalg.norm(there - here, axis=1) / 2e-8
        assert np.allclose(found.rate_px_mm[:, place, 0], rate, rtol=2e-2)


def test_matches_off_the_line_out_of_range_or_of_other_appearance_are_left_out() -> None:
    geometry, inverse, seen = scene()
    looks = bits(30)
    line = geometry.predict(1, geometry.directions(seen[4]), inverse + 1e-5) - seen[1]
    across = np.stack([-line[:, 1], line[:, 0]], axis=1) / np.linalg.norm(line, axis=1, keepdims=True)

    def matched(other: Keypoints, reference: Keypoints | None = None) -> int:
        at = keypoints(seen[4], looks) if reference is None else reference
        found = find_candidates(geometry, at, {1: other}, "ORB", RANGE, np.full(30, 1.0), map)
        return int(np.isfinite(found.inverse_distance[:, 0, 0]).sum())

    assert matched(keypoints(seen[1], looks)) == 30
    assert matched(keypoints(seen[1] + 0.9 * across, looks)) == 30
    assert matched(keypoints(seen[1] + 1.1 * across, looks)) == 0
    assert matched(keypoints(seen[1], looks[::-1])) < 3
    assert matched(keypoints(seen[1], looks, scale=1.6)) == 0
    assert matched(keypoints(seen[1], looks, angle=np.deg2rad(30))) == 0
    assert matched(keypoints(seen[1], looks, angle=-0.1), keypoints(seen[4], looks, angle=2 * np.pi - 0.1)) == 30
    near = geometry.predict(1, geometry.directions(seen[4]), 1 / 150.0)
    assert matched(keypoints(near, looks)) == 0


def test_similar_matches_keep_their_order_and_too_many_are_dropped() -> None:
    geometry, _, seen = scene(1)
    looks = bits(1)
    steps = np.linspace(1 / 4000.0, 1 / 300.0, CANDIDATES_PER_VIEW + 1)
    pixels = np.concatenate([geometry.predict(1, geometry.directions(seen[4]), step) for step in steps])
    other = geometry.predict(3, geometry.directions(seen[4]), steps[1])
    described = np.repeat(looks, CANDIDATES_PER_VIEW + 1, axis=0)
    described[:, 0] ^= np.uint64(2) ** np.array([3, 1, 0, 2, 4], np.uint64) - np.uint64(1)  # so many bits differ

    def found(count: int) -> Candidates:
        others = {1: keypoints(pixels[:count], described[:count]), 3: keypoints(other, looks)}
        return find_candidates(geometry, keypoints(seen[4], looks), others, "ORB", RANGE, np.ones(1), map)

    assert np.allclose(found(CANDIDATES_PER_VIEW).inverse_distance[0, 0], steps[[2, 1, 3, 0]])
    assert np.allclose(found(CANDIDATES_PER_VIEW).inverse_distance[0, 1, 0], steps[1])
    assert np.isnan(found(CANDIDATES_PER_VIEW + 1).inverse_distance).all()


def found_of(inverse: FloatArray, off: FloatArray | float = 0.0) -> Candidates:
    return Candidates(inverse, np.where(np.isnan(inverse), np.nan, off), np.where(np.isnan(inverse), np.nan, 3e4))


def test_the_slope_of_most_views_wins_and_is_refined_by_them() -> None:
    inverse = np.full((1, 4, 3), np.nan)
    inverse[0, :, 0] = [2.00e-3, 2.01e-3, 3.0e-3, 1.99e-3]
    agreed, competing = vote(found_of(inverse), np.ones(1))
    assert np.allclose(agreed, [2.00e-3])
    assert np.isnan(competing).all()


def test_the_match_that_fits_counts_even_if_it_is_not_the_most_similar() -> None:
    inverse = np.full((1, 3, 3), np.nan)
    inverse[0] = [[9e-4, 2e-3, np.nan], [2e-3, 4e-3, np.nan], [3e-3, 3.5e-3, 2e-3]]
    agreed, _ = vote(found_of(inverse), np.ones(1))
    assert np.allclose(agreed, [2e-3])


def test_slopes_with_as_many_votes_compete() -> None:
    inverse = np.full((2, 4, 3), np.nan)
    inverse[0, :, 0] = [2e-3, 2e-3, 3e-3, 3e-3]
    agreed, competing = vote(found_of(inverse), np.ones(2))
    assert sorted([agreed[0], competing[0]]) == [2e-3, 3e-3]
    assert np.isnan([agreed[1], competing[1]]).all()


def test_without_matches_there_is_no_slope() -> None:
    agreed, competing = vote(found_of(np.full((3, 4, 3), np.nan)), np.ones(3))
    assert np.isnan(agreed).all()
    assert np.isnan(competing).all()
    agreed, _ = vote(found_of(np.full((0, 4, 3), np.nan)), np.ones(0))
    assert agreed.shape == (0,)
