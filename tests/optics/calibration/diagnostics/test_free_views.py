"""The check by free virtual cameras: it finds motions that no plane can explain, and nothing in noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.free_views import _linearised, _Views, free_views
from mirrorcam.optics.calibration.solver.levenberg_marquardt import UndeterminedError, fit
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, residuals
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import reflect
from tests.optics.calibration.diagnostics.conftest import JOINT, Scene
from tests.optics.calibration.direct.two_mirrors import BOARD as BOARD_SEEN_DIRECTLY
from tests.optics.calibration.direct.two_mirrors import POSES, corner_of_two_mirrors, lying


@pytest.mark.slow
def test_noise_alone_has_uniform_probabilities(scene: Scene) -> None:
    chances = []
    for seed in range(20):
        seen = scene.noisy(300 + seed)
        found = free_views(fit(scene.start, seen, JOINT), seen, JOINT)
        assert found.parameters == 6 * 3 - 3 * 4
        chances.append(found.chance)
    assert kstest(chances, "uniform").pvalue > 0.01


def turned_views(scene: Scene, angle_deg: float) -> Observations:
    """Return the corners if one mirror's image were rotated about its own line of sight."""
    start = scene.start
    rows = scene.noisy(1)
    pixels = rows.pixels.copy()
    of = rows.view == 1
    points = np.einsum(
        "nij,nj->ni", start.rig_from_board[rows.frame[of], :3, :3], JOINT.board.corners_in_board_mm[rows.corner[of]]
    )
    seen = reflect(points + start.rig_from_board[rows.frame[of], :3, 3], start.virtual_centres_in_rig_mm[1])
    middle = seen.mean(axis=0)
    spin = Rotation.from_rotvec(np.radians(angle_deg) * middle / np.linalg.norm(middle)).as_matrix()
    moved = start.camera.project((seen - middle) @ spin.T + middle)
    pixels[of] += moved - start.camera.project(seen)
    return replace(rows, pixels=pixels)


def test_a_motion_of_no_plane_is_found(scene: Scene) -> None:
    """A plane mirror cannot only roll its image; free cameras must explain that down to the noise."""
    seen = turned_views(scene, 0.05)
    solution = fit(scene.start, seen, JOINT)
    found = free_views(solution, seen, JOINT)
    assert found.chance < 1e-12
    assert found.rms_px == pytest.approx(0.05, rel=0.04)
    excess = np.mean(solution.residuals[solution.inliers] ** 2) - found.rms_px**2
    assert found.unexplained_px == pytest.approx(np.sqrt(excess), rel=0.05)


def test_the_minimum_equals_that_of_a_general_solver(scene: Scene) -> None:
    """SciPy on an independent model: six numbers per mirror except the first, poses, intrinsics."""
    noisy = turned_views(scene, 0.05)
    frames = [0, 1, 2, 10, 11]
    some = noisy.where(np.isin(noisy.frame, frames))
    seen = replace(some, frame=np.searchsorted(frames, some.frame))
    start = scene.start.with_poses(scene.poses[frames])
    model = replace(JOINT, intrinsics=("fx_px", "fy_px"))
    solution = fit(start, seen, model)
    found = free_views(solution, seen, model)
    at = solution.estimate
    rows = seen.where(solution.inliers)
    mirrored = rows.view != DIRECT

    def misfit(x: FloatArray) -> FloatArray:
        focal = np.zeros(9)
        focal[:2] = x[:2]
        poses = at.rig_from_board.copy()
        twists = x[2:32].reshape(5, 6)
        poses[:, :3, :3] = Rotation.from_rotvec(0.01 * twists[:, :3]).as_matrix() @ poses[:, :3, :3]
        poses[:, :3, 3] += twists[:, 3:]
        points = np.einsum("nij,nj->ni", poses[rows.frame, :3, :3], JOINT.board.corners_in_board_mm[rows.corner])
        points += poses[rows.frame, :3, 3]
        views = np.concatenate([np.zeros((1, 6)), x[32:].reshape(3, 6)])[rows.view[mirrored]]
        image = reflect(points[mirrored], at.virtual_centres_in_rig_mm[rows.view[mirrored]])
        about = np.array([0.0, 0.0, 400.0])
        points[mirrored] = Rotation.from_rotvec(0.01 * views[:, :3]).apply(image - about) + about
        points[mirrored] += views[:, 3:]
        camera = at.camera.with_intrinsics(at.camera.intrinsics + focal)
        return (camera.project(points) - rows.pixels).ravel()

    peer = least_squares(misfit, np.zeros(50), method="lm", xtol=1e-12, ftol=1e-12)
    assert 2.0 * peer.cost == pytest.approx(found.rms_px**2 * 2 * len(rows), rel=1e-6)


def test_one_mirror_is_free_anyway(scene: Scene, device: Layout) -> None:
    """If only one view determines the board's pose, a free virtual camera changes nothing."""
    seen = scene.noisy(0)
    seen = seen.where((seen.view == DIRECT) | (seen.view == 0))
    start = Estimate.of(device.camera, device.mirrors[:1], scene.poses)
    solution = fit(start, seen, replace(JOINT, mirrors=False))
    with pytest.raises(UndeterminedError, match="1 mirrors are free virtual cameras already"):
        free_views(solution, seen, JOINT)


def test_a_direct_view_in_the_same_frame_checks_every_mirror() -> None:
    truth = corner_of_two_mirrors(90.0)
    poses = np.array([lying(*pose) for pose in POSES])
    start = Estimate.of(truth.camera, truth.mirrors, poses)
    every = np.arange(len(BOARD_SEEN_DIRECTLY.corners_in_board_mm))
    model = replace(JOINT, intrinsics=("fx_px", "fy_px"), board=Board.rigid(BOARD_SEEN_DIRECTLY.corners_in_board_mm))
    rows = Observations.join(
        [
            Observations.of_view(frame, view, every, np.zeros((len(every), 2)))
            for frame in range(len(poses))
            for view in (DIRECT, 0, 1)
        ]
    )
    noise = np.random.default_rng(0).normal(0.0, 0.05, (len(rows), 2))
    seen = replace(rows, pixels=residuals(start, rows, model.board) + noise)
    found = free_views(fit(start, seen, model), seen, model)
    assert found.parameters == 6
    assert found.chance > 0.01
    moved = replace(seen, pixels=seen.pixels + [0.3, 0.0] * (seen.view == 1)[:, None])
    assert free_views(fit(start, moved, model), moved, model).chance < 1e-6


def test_views_do_not_run_away_from_planes_that_the_lens_cannot_show() -> None:
    """A view of few corners may rotate so far that its unconstrained plane puts them behind the camera."""
    truth = corner_of_two_mirrors(90.0)
    start = Estimate.of(truth.camera, truth.mirrors, np.array([lying(*pose) for pose in POSES]))
    model = replace(JOINT, intrinsics=("fx_px", "fy_px"), board=Board.rigid(BOARD_SEEN_DIRECTLY.corners_in_board_mm))
    rows = Observations.of_view(0, 0, np.arange(8), np.zeros((8, 2)))
    nothing = _Views(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)))
    assert np.isfinite(_linearised(start, nothing, rows, model, [0, 1], 0)[1]).all()
    behind = np.array([[0.0, 0.0, 2.0], start.virtual_centres_in_rig_mm[1]])
    turned = replace(start, virtual_centres_in_rig_mm=behind)
    shifted = replace(nothing, shifts=np.array([[0.0, 0.0, 2000.0], [0.0, 0.0, 0.0]]))
    r, d_global, _ = _linearised(turned, shifted, rows, model, [0, 1], 0)
    assert np.isinf(r).all()
    assert np.isfinite(d_global).all()
