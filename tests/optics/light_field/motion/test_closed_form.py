"""Rigid motions in closed form, against drawn ones, with wrong matches among the right."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid, transform
from mirrorcam.optics.light_field.motion.closed_form import rigid_motions, robust_motion


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


def test_heavier_points_count_more() -> None:
    src = points(20)
    dst = src + np.array([5.0, 0.0, 0.0])
    dst[0, 1] += 40.0
    weights = np.ones(20)
    light = rigid_motions(src, dst, np.where(np.arange(20) == 0, 1e-6, weights))
    assert np.allclose(light, rigid(np.eye(3), [5.0, 0.0, 0.0]), atol=1e-3)
    assert not np.allclose(rigid_motions(src, dst, weights), light, atol=0.1)


def test_wrong_matches_do_not_move_it() -> None:
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
