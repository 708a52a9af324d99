"""Motions: through the poses they are given, smooth, and rigid at every moment."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.boards.motion import poses_at, smooth_motion


def poses(count: int, seed: int = 0) -> FloatArray:
    random = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(random.normal(0.0, 0.5, (count, 3))).as_matrix()
    return rigid(turns, random.normal(0.0, 100.0, (count, 3)))


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_a_motion_passes_its_poses_at_whole_times_and_stays_there_before_and_after(count: int) -> None:
    keys = poses(count)
    np.testing.assert_allclose(smooth_motion(keys, np.arange(float(count))), keys, atol=1e-9)
    np.testing.assert_allclose(smooth_motion(keys, np.array([-3.0, count + 5.0])), keys[[0, -1]], atol=1e-9)


def test_every_moment_is_rigid() -> None:
    moments = smooth_motion(poses(6), np.linspace(-1.0, 6.0, 200))
    turns = moments[:, :3, :3]
    np.testing.assert_allclose(turns @ np.swapaxes(turns, 1, 2), np.tile(np.eye(3), (200, 1, 1)), atol=1e-12)
    assert np.linalg.det(turns).min() > 0.0
    assert (moments[:, 3] == [0.0, 0.0, 0.0, 1.0]).all()


def test_speed_has_no_jumps_and_is_nil_at_either_end() -> None:
    keys, step = poses(5), 1e-4
    times = np.arange(0.0, 4.0 + step / 2, step)
    places = smooth_motion(keys, times)[:, :3, 3]
    velocity = np.diff(places, axis=0) / step
    assert np.linalg.norm(velocity[[0, -1]], axis=1).max() < 0.001 * np.linalg.norm(velocity, axis=1).max()
    jumps = np.linalg.norm(np.diff(velocity, axis=0), axis=1)
    assert jumps.max() < 10.0 * step * np.linalg.norm(velocity, axis=1).max()


def test_between_two_poses_it_goes_straight_and_turns_about_one_axis() -> None:
    keys = poses(2, seed=3)
    moments = smooth_motion(keys, np.linspace(0.0, 1.0, 21))
    way = keys[1, :3, 3] - keys[0, :3, 3]
    aside = np.cross(moments[:, :3, 3] - keys[0, :3, 3], way / np.linalg.norm(way))
    assert np.abs(aside).max() < 1e-9
    turns = Rotation.from_matrix(keys[0, :3, :3].T @ moments[:, :3, :3]).as_rotvec()
    axis = turns[-1] / np.linalg.norm(turns[-1])
    assert np.abs(np.cross(turns, axis)).max() < 1e-9


def test_a_readout_passes_its_three_poses_and_is_rigid_between_them() -> None:
    keys = poses(3, seed=5)
    np.testing.assert_allclose(poses_at(keys, np.array([0.0, 0.5, 1.0])), keys, atol=1e-12)
    turns = poses_at(keys, np.linspace(0.0, 1.0, 50))[:, :3, :3]
    np.testing.assert_allclose(turns @ np.swapaxes(turns, 1, 2), np.tile(np.eye(3), (50, 1, 1)), atol=1e-12)


def test_a_readout_is_as_good_as_the_motion_it_is_part_of() -> None:
    # A webcam's 30 ms of a motion of two poses a second: what constant acceleration leaves is of the third order.
    keys = poses(4, seed=7)
    keys[:, :3, 3] *= 0.5
    middle, half = 1.37, 0.015 * 2.0
    parts = np.linspace(0.0, 1.0, 21)
    true = smooth_motion(keys, middle + (2.0 * parts - 1.0) * half)
    found = poses_at(smooth_motion(keys, middle + np.array([-half, 0.0, half])), parts)
    assert np.abs(found - true)[:, :3, 3].max() < 5e-3
    assert np.abs(found - true)[:, :3, :3].max() < 5e-5
    # And not trivially so: the board moves by millimetres meanwhile.
    assert np.linalg.norm(true[-1, :3, 3] - true[0, :3, 3]) > 3.0


def test_constant_speed_and_spin_are_kept() -> None:
    turns = Rotation.from_rotvec(np.outer([-1.0, 0.0, 1.0], [0.05, 0.1, -0.02])).as_matrix()
    keys = rigid(turns, np.outer([-1.0, 0.0, 1.0], [3.0, -2.0, 5.0]) + np.array([10.0, 20.0, 400.0]))
    quarter = poses_at(keys, np.array([0.25]))[0]
    np.testing.assert_allclose(quarter[:3, 3], [8.5, 21.0, 397.5])
    np.testing.assert_allclose(Rotation.from_matrix(quarter[:3, :3]).as_rotvec(), [-0.025, -0.05, 0.01], atol=1e-12)
