"""Landmarks of a light field, seen from its own pose and after a motion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import inverse, rigid, transform
from mirrorcam.optics.light_field.features.slope import ViewGeometry
from mirrorcam.optics.light_field.motion.pose_fit import (
    Frame,
    Landmarks,
    Observations,
    SharedErrors,
    _equations,
    build_landmarks,
    fit_pose,
    observe,
    predict,
    rigid_motions,
    robust_motion,
)
from tests.optics.light_field.relief_scene import Relief, even_views, light_field_of

VIEWS = even_views(3, 10.0, width_px=200, height_px=150, centre_px=np.array([99.5, 74.5]))
SCENE = Relief(heights_mm=((20.0, 8.0),))
POSE = rigid(Rotation.from_euler("xyz", [3.0, -5.0, 8.0], degrees=True).as_matrix(), [30.0, -12.0, 9.0])
ALONE = SharedErrors(0.0, 0.0)
NOISE, SIGMA = 4e-5, 2e-6


def test_landmarks_match_the_scene() -> None:
    geometry = ViewGeometry.of(VIEWS)
    first, true_mm = light_field_of(SCENE, VIEWS, subsamples=1)
    pixels = np.stack(np.meshgrid(np.arange(30, 171, 10), np.arange(30, 121, 10)), axis=-1).reshape(-1, 2)
    exact = 1.0 / true_mm[pixels[:, 1], pixels[:, 0]]
    directions = geometry.directions(pixels.astype(float))
    known = build_landmarks(geometry, Frame.of(first), directions, exact * 1.001, np.full(len(pixels), 2.0), map)
    assert len(known.directions) > 0.8 * len(pixels)
    place = [np.flatnonzero((directions == each).all(axis=1))[0] for each in known.directions]
    ratio = (known.inverse_distance - exact[place]) / np.hypot(known.sigma_per_mm, known.shape_sigma_per_mm)
    assert np.median(np.abs(ratio)) < 1.0

    moved = rigid(np.eye(3), [15.0, 5.0, -10.0])
    second, _ = light_field_of(SCENE, VIEWS, world_from_view=moved, subsamples=1, seed=1)
    expected = predict(known, inverse(moved))
    seen = observe(geometry, Frame.of(second), known.templates, *expected, map)
    assert seen.valid.mean() > 0.7
    off_px = 500.0 * np.linalg.norm(seen.directions - expected[0], axis=1)[seen.valid]
    assert np.median(off_px) < 0.05
    assert np.median(np.abs(seen.inverse_distance / expected[1] - 1.0)[seen.valid]) < 0.002


def landmarks(count: int) -> Landmarks:
    random = np.random.default_rng(3)
    return Landmarks(
        directions=random.uniform([-0.3, -0.2], [0.3, 0.2], (count, 2)),
        inverse_distance=1.0 / random.uniform(350.0, 700.0, count),
        sigma_per_mm=np.full(count, SIGMA),
        shape_sigma_per_mm=np.zeros(count),
        shapes=np.zeros((count, 9)),
        templates=[],
    )


def seen_from(true: Landmarks, pose: FloatArray, random: np.random.Generator | None = None) -> Observations:
    directions, inverse_distance, _ = predict(true, pose)
    count = len(directions)
    if random is not None:
        directions = directions + random.normal(0.0, NOISE, (count, 2))
        inverse_distance = inverse_distance + random.normal(0.0, SIGMA, count)
    return Observations(
        valid=np.ones(count, dtype=bool),
        directions=directions,
        covariance=np.tile(NOISE**2 * np.eye(2), (count, 1, 1)),
        inverse_distance=inverse_distance,
        sigma_per_mm=np.full(count, SIGMA),
        shape_sigma_per_mm=np.zeros(count),
        shapes=np.zeros((count, 9)),
    )


def moved(pose: FloatArray, xi: FloatArray) -> FloatArray:
    return np.asarray(rigid(Rotation.from_rotvec(xi[3:]).as_matrix(), xi[:3]) @ pose)


def test_predicted_pixels_match_the_points() -> None:
    some = landmarks(30)
    points = np.c_[some.directions, np.ones(30)] / some.inverse_distance[:, None]
    there = transform(POSE, points)
    directions, inverse_distance, warp = predict(some, POSE)
    assert np.allclose(directions, there[:, :2] / there[:, 2:])
    assert np.allclose(inverse_distance, 1.0 / there[:, 2])
    # A step across the key frame's picture, at the same inverse distance.
    step = np.array([1e-6, 0.0])
    beside = Landmarks(**{**vars(some), "directions": some.directions + step})
    assert np.allclose((predict(beside, POSE)[0] - directions) / 1e-6, warp.linear[:, :, 0], atol=1e-5)


@pytest.mark.parametrize("number", range(6))
def test_derivatives_match_finite_differences(number: int) -> None:
    some = landmarks(10)
    seen = seen_from(some, POSE)
    _, jacobian, by_w, _ = _equations(some, seen, POSE)
    step = 1e-5 * np.eye(6)[number]
    ahead, back = (_equations(some, seen, moved(POSE, sign * step))[0] for sign in (1.0, -1.0))
    assert np.allclose(-(ahead - back) / 2e-5, jacobian[:, :, number], rtol=1e-5, atol=1e-9)
    nearer = Landmarks(**{**vars(some), "inverse_distance": some.inverse_distance + 1e-9})
    assert np.allclose(-(_equations(nearer, seen, POSE)[0]) / 1e-9, by_w, rtol=1e-3, atol=1e-3)


def test_an_exact_view_gives_the_exact_pose() -> None:
    some = landmarks(40)
    found = fit_pose(some, seen_from(some, POSE), moved(POSE, np.array([2.0, -1.0, 1.0, 0.01, 0.02, -0.01])), ALONE)
    assert found is not None
    assert np.allclose(found.frame_from_key, POSE, atol=1e-8)
    assert found.used.all()


def test_the_covariance_matches_drawn_errors() -> None:
    """Normalised squared errors are six on average, with uncertain landmarks and a tenth of outliers."""
    true = landmarks(400)
    squares = []
    for seed in range(60):
        random = np.random.default_rng(seed)
        known = Landmarks(**{**vars(true), "inverse_distance": true.inverse_distance + random.normal(0.0, SIGMA, 400)})
        seen = seen_from(true, POSE, random)
        seen.directions[:40] += random.uniform(-0.05, 0.05, (40, 2))
        found = fit_pose(known, seen, POSE, ALONE)
        assert found is not None
        assert not found.used[:40].mean() > 0.1
        off = POSE @ inverse(found.frame_from_key)
        xi = np.concatenate([off[:3, 3], Rotation.from_matrix(off[:3, :3]).as_rotvec()])
        squares.append(xi @ np.linalg.solve(found.covariance, xi))
    assert np.mean(squares) / 6.0 == pytest.approx(1.15, abs=0.35)


def test_shared_errors_do_not_average_out() -> None:
    share = SharedErrors(0.0, 1e-6)
    alone, shared = [], []
    for count in (200, 3200):
        some = landmarks(count)
        seen = seen_from(some, POSE, np.random.default_rng(1))
        found = [fit_pose(some, seen, POSE, each) for each in (ALONE, share)]
        traces = [np.trace(each.covariance[:3, :3]) for each in found if each is not None]
        alone.append(np.sqrt(traces[0]))
        shared.append(np.sqrt(traces[1] - traces[0]))
    assert alone[1] < 0.4 * alone[0]
    assert shared[1] == pytest.approx(shared[0], rel=0.2)


def test_too_few_landmarks_determine_no_pose() -> None:
    some = landmarks(40)
    seen = seen_from(some, POSE)
    seen.valid[6:] = False
    assert fit_pose(some, seen, POSE, ALONE) is None


def motion(seed: int) -> FloatArray:
    random = np.random.default_rng(seed)
    return rigid(Rotation.random(random_state=seed).as_matrix(), random.uniform(-100, 100, 3))


def points(count: int) -> FloatArray:
    return np.random.default_rng(7).uniform([-100, -80, 400], [100, 80, 600], (count, 3))


def test_motions_of_exact_points_are_exact() -> None:
    expected = np.stack([motion(seed) for seed in range(5)])
    src = np.broadcast_to(points(6), (5, 6, 3))
    dst = src @ np.swapaxes(expected[:, :3, :3], -1, -2) + expected[:, None, :3, 3]
    assert np.allclose(rigid_motions(src, dst, np.ones((5, 6))), expected, atol=1e-9)


def test_points_in_a_plane_are_not_mirrored() -> None:
    src = points(8) * [1.0, 1.0, 0.0]
    expected = motion(3)
    found = rigid_motions(src, transform(expected, src), np.ones(8))
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1.0)
    assert np.allclose(found, expected, atol=1e-9)


def test_points_count_by_their_weights() -> None:
    src = points(20)
    dst = src + np.array([5.0, 0.0, 0.0])
    dst[0, 1] += 40.0
    weights = np.ones(20)
    light = rigid_motions(src, dst, np.where(np.arange(20) == 0, 1e-6, weights))
    assert np.allclose(light, rigid(np.eye(3), [5.0, 0.0, 0.0]), atol=1e-3)
    assert not np.allclose(rigid_motions(src, dst, weights), light, atol=0.1)


def test_wrong_matches_do_not_change_the_motion() -> None:
    random, src, expected = np.random.default_rng(2), points(200), motion(4)
    dst = transform(expected, src) + random.normal(0.0, [0.3, 0.3, 1.0], (200, 3))
    wrong = random.random(200) < 0.4
    dst[wrong] = random.permutation(dst[wrong])
    found = robust_motion(src, dst, np.tile([0.3, 0.3, 1.0], (200, 1)))
    assert found is not None
    assert np.linalg.norm(transform(found[0], src) - transform(expected, src), axis=1).max() < 1.0
    assert np.mean(found[1] == ~wrong) > 0.95


def test_without_agreement_there_is_no_motion() -> None:
    random = np.random.default_rng(0)
    sigmas = np.full((40, 3), 0.1)
    assert robust_motion(points(40), random.uniform(-300, 300, (40, 3)), sigmas) is None
    assert robust_motion(points(5), points(5), sigmas[:5]) is None
