"""Residuals and their derivatives, and the shapes that a board can have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.calibration.solver.residuals import (
    Board,
    Estimate,
    global_names,
    points_at_camera,
    residuals,
    residuals_with_jacobians,
)
from mirrorcam.optics.geometry.mirror import reflect
from tests.optics.calibration.solver.four_mirrors import MIRRORS, four_mirrors

MIRROR_KINDS = {
    "plain": ((0.0, 0.0, 0.0, 0.0), 0.0),
    "plates": ((2.0, 3.0, 0.0, 2.0), 0.0),
    "bent": ((0.0, 0.0, 0.0, 0.0), 0.4),
    "bent plates": ((2.0, 3.0, 0.0, 2.0), 0.4),
}


@pytest.mark.parametrize("kind", MIRROR_KINDS)
@pytest.mark.parametrize("modes", [0, 3])
@pytest.mark.parametrize("own", ["rigid", "turned, bowed and in motion"])
def test_derivatives_agree_with_finite_differences(modes: int, kind: str, own: str) -> None:
    scene = four_mirrors(modes)
    seen = scene.clean
    thickness, bend = MIRROR_KINDS[kind]
    at = replace(
        scene.truth,
        thickness_mm=np.array(thickness),
        refractive_index=np.array([1.49, 1.52, 1.6, 1.49]),
        curvature_per_m=bend * np.random.default_rng(1).normal(size=(MIRRORS, 3)),
        centroids_in_rig_mm=scene.truth.virtual_centres_in_rig_mm / 2.0 + [3.0, -4.0, 5.0],
    )
    if own != "rigid":
        turn, bow = np.random.default_rng(2).normal(size=(2, len(at.rig_from_board), 3))
        motion = np.random.default_rng(3).normal(size=(len(at.rig_from_board), 12)) * ([*[0.1] * 3, *[1.0] * 3] * 2)
        at = replace(at, camera_rotation=0.01 * turn, bow_mm=0.5 * bow, motion=motion)
    r, d_global, d_frame = residuals_with_jacobians(at, seen, scene.board)
    np.testing.assert_allclose(r, residuals(at, seen, scene.board), atol=1e-9)
    frames = len(at.rig_from_board)
    names = global_names(at.camera.intrinsic_names, MIRRORS, modes)
    assert d_global.shape[2] == len(names)

    def difference(step: FloatArray, twists: FloatArray, h: float) -> FloatArray:
        ahead = residuals(at.moved(h * step, h * twists), seen, scene.board)
        back = residuals(at.moved(-h * step, -h * twists), seen, scene.board)
        return (ahead - back) / (2 * h)

    for k, name in enumerate(names):
        h = 1e-6 if 4 <= k < 9 else 1e-4
        found = difference(np.eye(len(names))[k], np.zeros((frames, 6)), h)
        assert (np.abs(found).max() > 1e-3) == (name != "sheet_mm" or "plates" in kind), name
        scale = max(1.0, float(np.abs(found).max()))
        np.testing.assert_allclose(d_global[:, :, k] / scale, found / scale, atol=2e-7, err_msg=name)
    for k in range(24):
        found = difference(np.zeros(len(names)), np.tile(np.eye(24)[k], (frames, 1)), 1e-5)
        np.testing.assert_allclose(d_frame[:, :, k], found, atol=1e-6 * np.abs(found).max())


def test_free_board_modes_exclude_motion_and_scaling() -> None:
    corners = np.array([[x, y, 0.0] for y in range(4) for x in range(5)])
    board = Board.free(corners)
    assert board.modes.shape == (3 * 20 - 7, 20, 3)
    flat = board.modes.reshape(-1, 60)
    np.testing.assert_allclose(flat @ flat.T, np.eye(53), atol=1e-12)
    centred = corners - corners.mean(axis=0)
    for gauge in (np.tile([0.0, 1.0, 0.0], (20, 1)), np.cross([0.2, 0.5, 1.0], centred), centred):
        np.testing.assert_allclose(flat @ gauge.ravel(), 0.0, atol=1e-12)


def test_a_bowed_board_has_its_sag_at_the_edge() -> None:
    corners = np.array([[x, y, 0.0] for y in range(5) for x in range(9)]) * 20.0 + [20.0, 20.0, 0.0]
    bowed = Board.warped(corners).shaped(np.array([0.5, -0.2]))[:, 2].reshape(5, 9)
    np.testing.assert_allclose(bowed[2, [0, 4, 8]], [0.5, 0.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(bowed[[0, 4], 4], -0.2, atol=1e-12)


def test_a_frame_bows_its_board_and_rotates_the_camera_about_the_pupil() -> None:
    scene = four_mirrors()
    at, corners = scene.truth, scene.board.corners_in_board_mm
    frames = len(at.rig_from_board)
    turn = Rotation.from_rotvec([0.004, -0.003, 0.006])
    turned = replace(at, camera_rotation=np.tile(turn.as_rotvec(), (frames, 1)))
    _, _, seen = points_at_camera(at, scene.clean, scene.board)
    _, _, from_turned = points_at_camera(turned, scene.clean, scene.board)
    np.testing.assert_allclose(from_turned, turn.apply(seen), atol=1e-9)
    x, y = ((c - (c.min() + c.max()) / 2.0) / (np.ptp(c) / 2.0) for c in corners[:, :2].T)
    bowed = Board.rigid(corners + np.outer(0.5 * x**2 - 0.2 * y**2 + 0.1 * x * y, [0.0, 0.0, 1.0]))
    own = replace(at, bow_mm=np.tile([0.5, -0.2, 0.1], (frames, 1)))
    np.testing.assert_allclose(residuals(own, scene.clean, scene.board), residuals(at, scene.clean, bowed), atol=1e-9)


def test_frames_keep_their_own_numbers() -> None:
    truth = four_mirrors().truth
    own = np.arange(3.0 * len(truth.rig_from_board)).reshape(-1, 3)
    some = replace(truth, camera_rotation=own, bow_mm=-own).of_frames(np.array([2, 0]))
    np.testing.assert_array_equal(some.camera_rotation, own[[2, 0]])
    np.testing.assert_array_equal(some.bow_mm, -own[[2, 0]])
    np.testing.assert_array_equal(some.rig_from_board, truth.rig_from_board[[2, 0]])
    assert not some.with_poses(truth.rig_from_board).bow_mm.any()


def test_a_corner_is_seen_where_its_plane_mirror_reflects_it() -> None:
    scene = four_mirrors()
    _, in_rig, seen = points_at_camera(scene.truth, scene.clean, scene.board)
    direct = scene.clean.view == DIRECT
    np.testing.assert_array_equal(seen[direct], in_rig[direct])
    for mirror, centre in enumerate(scene.truth.virtual_centres_in_rig_mm):
        rows = scene.clean.view == mirror
        np.testing.assert_allclose(seen[rows], reflect(in_rig[rows], centre), atol=1e-9)


def test_a_zero_step_changes_nothing_and_plates_change_jointly() -> None:
    scene = four_mirrors(2)
    at = replace(scene.truth, thickness_mm=np.array([2.0, 0.0, 3.0, 0.0]), refractive_index=np.full(4, 1.5))
    names = global_names(at.camera.intrinsic_names, MIRRORS, 2)
    nothing = np.zeros(len(names))
    same = at.moved(nothing, np.zeros((14, 6)))
    np.testing.assert_allclose(same.rig_from_board, at.rig_from_board, atol=1e-15)
    np.testing.assert_array_equal(same.camera.intrinsics, at.camera.intrinsics)
    nothing[names.index("sheet_mm")] = 0.25
    np.testing.assert_allclose(at.moved(nothing, np.zeros((14, 6))).thickness_mm, [2.25, 0.0, 3.25, 0.0])


def test_an_estimate_refuses_shapes_that_do_not_match() -> None:
    truth = four_mirrors().truth
    with pytest.raises(ValueError, match=r"thickness_mm has shape \(3,\), expected \(4,\)"):
        Estimate(truth.camera, truth.virtual_centres_in_rig_mm, truth.rig_from_board, thickness_mm=np.ones(3))
