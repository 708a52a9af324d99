"""Motions: through the poses they are given, smooth, and rigid at every moment."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from optics.values import FloatArray
from render_scenes.motion import along, pose_at


def poses(count: int, seed: int = 0) -> FloatArray:
    random = np.random.default_rng(seed)
    made = np.tile(np.eye(4), (count, 1, 1))
    made[:, :3, :3] = Rotation.from_rotvec(random.normal(0.0, 0.5, (count, 3))).as_matrix()
    made[:, :3, 3] = random.normal(0.0, 100.0, (count, 3))
    return made


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_a_motion_passes_its_poses_at_whole_times_and_stays_there_before_and_after(count: int) -> None:
    keys = poses(count)
    np.testing.assert_allclose(along(keys, np.arange(float(count))), keys, atol=1e-9)
    np.testing.assert_allclose(along(keys, np.array([-3.0, count + 5.0])), keys[[0, -1]], atol=1e-9)


def test_every_moment_is_rigid() -> None:
    moments = along(poses(6), np.linspace(-1.0, 6.0, 200))
    turns = moments[:, :3, :3]
    np.testing.assert_allclose(turns @ np.swapaxes(turns, 1, 2), np.tile(np.eye(3), (200, 1, 1)), atol=1e-12)
    assert np.linalg.det(turns).min() > 0.0
    assert (moments[:, 3] == [0.0, 0.0, 0.0, 1.0]).all()


def test_speed_has_no_jumps_and_is_nil_at_either_end() -> None:
    keys, step = poses(5), 1e-4
    times = np.arange(0.0, 4.0 + step / 2, step)
    places = along(keys, times)[:, :3, 3]
    velocity = np.diff(places, axis=0) / step
    assert np.linalg.norm(velocity[[0, -1]], axis=1).max() < 0.001 * np.linalg.norm(velocity, axis=1).max()
    jumps = np.linalg.norm(np.diff(velocity, axis=0), axis=1)
    assert jumps.max() < 10.0 * step * np.linalg.norm(velocity, axis=1).max()


def test_between_two_poses_it_goes_straight_and_turns_about_one_axis() -> None:
    keys = poses(2, seed=3)
    moments = along(keys, np.linspace(0.0, 1.0, 21))
    way = keys[1, :3, 3] - keys[0, :3, 3]
    aside = np.cross(moments[:, :3, 3] - keys[0, :3, 3], way / np.linalg.norm(way))
    assert np.abs(aside).max() < 1e-9
    turns = Rotation.from_matrix(keys[0, :3, :3].T @ moments[:, :3, :3]).as_rotvec()
    axis = turns[-1] / np.linalg.norm(turns[-1])
    assert np.abs(np.cross(turns, axis)).max() < 1e-9


def test_a_readout_sees_the_pose_of_its_moment() -> None:
    keys = poses(3, seed=5)
    np.testing.assert_allclose([pose_at(keys, part) for part in (0.0, 0.5, 1.0)], keys, atol=1e-12)
    quarter = pose_at(keys, 0.25)
    np.testing.assert_allclose(quarter[:3, 3], keys[:2, :3, 3].mean(axis=0))
    halves = [(Rotation.from_matrix(keys[k, :3, :3]).inv() * Rotation.from_matrix(quarter[:3, :3])) for k in (0, 1)]
    assert halves[0].magnitude() == pytest.approx(halves[1].magnitude())
