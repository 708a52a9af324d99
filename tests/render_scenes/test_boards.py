"""Prints of boards: exact with few texels, and where they lie on the board.

Motions: through the poses they are given, smooth, and rigid at every moment.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import AprilGrid, Charuco, Checkerboard
from mirrorcam.optics.geometry.transforms import rigid, transform
from mirrorcam.render_scenes.boards import (
    board_from_texels,
    poses_at,
    print_on_paper,
    printed_radiance,
    rig_from_rectangle,
    smooth_motion,
)
from mirrorcam.render_scenes.settings import RenderSettings


@pytest.mark.parametrize(
    ("board", "texels"),
    [
        (Checkerboard(cols=6, rows=5, square_mm=24.0), 1),
        (Charuco(cols=6, rows=5, square_mm=12.0, marker_mm=9.0), 8),
        (Charuco(cols=6, rows=5, square_mm=10.0, marker_mm=7.0, dictionary="DICT_5X5_100"), 20),
        (Charuco(cols=6, rows=5, square_mm=16.0, marker_mm=12.0, dictionary="DICT_4X4_50"), 8),
    ],
)
def test_the_print_is_exact_with_few_texels(board: Checkerboard | Charuco, texels: int) -> None:
    page = print_on_paper(board)
    assert page.shape == ((5 + 2) * texels, (6 + 2) * texels)
    printed = page[texels:-texels, texels:-texels]
    fine = board.image(8 * texels)
    np.testing.assert_array_equal(np.kron(printed, np.ones((8, 8), dtype=np.uint8)), fine)
    assert (np.delete(page, np.s_[texels:-texels], axis=0) == 255).all()


def test_markers_that_fit_no_texels_keep_their_squares() -> None:
    page = print_on_paper(Charuco(cols=6, rows=5, square_mm=12.0, marker_mm=8.7))
    texels = page.shape[0] // 7
    assert 8 < texels <= 64
    squares = page[texels:-texels, texels:-texels].reshape(5, texels, 6, texels)
    black = (np.add.outer(np.arange(5), np.arange(6)) % 2) == 0
    np.testing.assert_array_equal(squares.max(axis=(1, 3))[black], 0)
    np.testing.assert_array_equal(squares[:, 0, :, 0][~black], 255)  # the white rim around a marker


@pytest.mark.parametrize(
    "board", [Checkerboard(cols=6, rows=5, square_mm=24.0), Charuco(cols=6, rows=5, square_mm=12.0, marker_mm=9.0)]
)
def test_texels_and_mitsubas_rectangle_span_the_print_with_its_margin(board: Checkerboard | Charuco) -> None:
    rows, columns = print_on_paper(board).shape
    width, height = board.size_mm
    margin = board.square_mm
    corners = np.array([[0.0, 0.0, 1.0], [columns, rows, 1.0]]) @ board_from_texels(board).T
    np.testing.assert_allclose(corners[:, :2], [[-margin, -margin], [width + margin, height + margin]], atol=1e-9)
    # v is up, so that the rectangle's (-1, 1) is the top left corner; it emits along -z of the board.
    pose = rigid(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), [1.0, 2.0, 300.0])
    affine = rig_from_rectangle(board, pose)
    found = np.array([[-1.0, 1.0, 0.0], [1.0, -1.0, 0.0]]) @ affine[:3, :3].T + affine[:3, 3]
    on_board = np.column_stack([corners[:, :2], [0.0, 0.0]])
    np.testing.assert_allclose(found, transform(pose, on_board), atol=1e-9)
    np.testing.assert_allclose(affine[:3, :3] @ [0.0, 0.0, 1.0], -pose[:3, 2], atol=1e-12)


def test_radiance_is_that_of_paper_and_ink() -> None:
    radiance = printed_radiance(Checkerboard(cols=6, rows=5, square_mm=24.0), RenderSettings(paper=0.7, ink=0.1))
    assert set(np.unique(radiance.round(9))) == {0.1, 0.7}
    assert radiance[0, 0] == 0.7
    assert radiance[1, 1] == 0.1


@pytest.mark.parametrize(("spacing", "texels"), [(0.3, 10), (0.25, 20), (0.33, 100), (1 / 3, 30)])
def test_corners_of_an_aprilgrid_fall_on_texels(spacing: float, texels: int) -> None:
    board = AprilGrid(cols=3, rows=2, tag_mm=24.0, spacing=spacing)
    page = print_on_paper(board)
    board_from_page = board_from_texels(board)
    assert board_from_page[0, 0] == pytest.approx(24.0 / texels)
    at = np.linalg.solve(board_from_page, np.column_stack([board.corners_in_board_mm[:, :2], np.ones(24)]).T)[:2]
    np.testing.assert_allclose(at, at.round(), atol=1e-9)
    x, y = at.round().astype(int)
    # Black and white squares meet there.
    np.testing.assert_array_equal(page[y, x] == page[y - 1, x - 1], np.ones(24, dtype=bool))
    np.testing.assert_array_equal(page[y - 1, x] == page[y, x - 1], np.ones(24, dtype=bool))
    np.testing.assert_array_equal(page[y, x] == page[y - 1, x], np.zeros(24, dtype=bool))


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
    # A webcam's 30 ms of a motion of two poses a second: the error of constant acceleration is of the third order.
    keys = poses(4, seed=7)
    keys[:, :3, 3] *= 0.5
    middle, half = 1.37, 0.015 * 2.0
    parts = np.linspace(0.0, 1.0, 21)
    true = smooth_motion(keys, middle + (2.0 * parts - 1.0) * half)
    found = poses_at(smooth_motion(keys, middle + np.array([-half, 0.0, half])), parts)
    assert np.abs(found - true)[:, :3, 3].max() < 5e-3
    assert np.abs(found - true)[:, :3, :3].max() < 5e-5
    # The board moves by millimetres meanwhile, so the test is not trivial.
    assert np.linalg.norm(true[-1, :3, 3] - true[0, :3, 3]) > 3.0


def test_constant_speed_and_spin_are_kept() -> None:
    turns = Rotation.from_rotvec(np.outer([-1.0, 0.0, 1.0], [0.05, 0.1, -0.02])).as_matrix()
    keys = rigid(turns, np.outer([-1.0, 0.0, 1.0], [3.0, -2.0, 5.0]) + np.array([10.0, 20.0, 400.0]))
    quarter = poses_at(keys, np.array([0.25]))[0]
    np.testing.assert_allclose(quarter[:3, 3], [8.5, 21.0, 397.5])
    np.testing.assert_allclose(Rotation.from_matrix(quarter[:3, :3]).as_rotvec(), [-0.025, -0.05, 0.01], atol=1e-12)
