"""Residuals and solver on corners whose truth is known: derivatives, minimum, noise, outliers, uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.solver.levenberg_marquardt import UndeterminedError, fit, minimise
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import (
    Board,
    Estimate,
    global_names,
    residuals,
    residuals_with_jacobians,
)
from mirrorcam.optics.geometry.camera import INTRINSIC_NAMES, Camera
from mirrorcam.optics.geometry.transforms import rigid
from tests.optics.calibration.solver.peer import Peer
from tests.optics.calibration.solver.scenes import disturbed, small_scene, start_from

SIGMA_PX = 0.05
MIRRORS = 4


@dataclass(frozen=True)
class Scene:
    truth: Estimate
    board: Board
    clean: Observations

    @property
    def model(self) -> Model:
        return Model(INTRINSIC_NAMES, thickness=False, curvature=False, board=self.board)

    def noisy(self, seed: int, sigma_px: float = SIGMA_PX) -> Observations:
        noise = np.random.default_rng(seed).normal(0.0, sigma_px, self.clean.pixels.shape)
        return replace(self.clean, pixels=self.clean.pixels + noise)


def _make_scene(modes: int = 0) -> Scene:
    """Four mirrors, eight frames through them and six without; corners outside the sensor are left out."""
    random = np.random.default_rng(3)
    camera = Camera.c920().replaced(distortion=[0.05, -0.12, 4e-4, -6e-4, 0.01])
    chief = np.array([[-0.3, 0.18], [0.3, 0.18], [-0.3, -0.18], [0.3, -0.18]])
    t = 80.0 / (np.sqrt(1.0 + (chief**2).sum(axis=1)) - chief[:, 1])
    centres = np.column_stack([t * chief[:, 0], np.full(MIRRORS, -80.0), t]) + random.normal(0, 1.0, (MIRRORS, 3))
    y, x = np.mgrid[0:6, 0:9].reshape(2, -1) * 20.0
    corners = np.column_stack([x, y, np.zeros_like(x)])
    board = replace(Board.free(corners), modes=Board.free(corners).modes[:modes])
    fold = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    poses = []
    for number in range(14):
        mirrored = number < 8
        turn = Rotation.from_euler("xyz", random.uniform(-35, 35, 3), degrees=True).as_matrix()
        middle = [0.0, random.uniform(300, 500), 80.0] if mirrored else [0.0, 0.0, random.uniform(250, 400)]
        turn = fold @ turn if mirrored else turn
        poses.append(rigid(turn, np.array(middle) - turn @ corners.mean(axis=0)))
    truth = Estimate(camera, centres, np.array(poses), 0.3 * random.normal(size=modes))
    every = np.arange(len(corners))
    views = [(frame, view) for frame in range(8) for view in range(MIRRORS)] + [(f, DIRECT) for f in range(8, 14)]
    seen = Observations.join([Observations.of_view(f, v, every, np.zeros((len(corners), 2))) for f, v in views])
    pixels = residuals(truth, seen, board)
    inside = np.all((pixels > 0) & (pixels < [1919, 1079]), axis=1)
    return Scene(truth, board, replace(seen.where(inside), pixels=pixels[inside]))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return _make_scene()


def _disturbed(truth: Estimate, seed: int, *, tilt_deg: float, offset_mm: float, focal_px: float) -> Estimate:
    random = np.random.default_rng(seed)
    centres = []
    for centre in truth.virtual_centres_in_rig_mm:
        turn = Rotation.from_rotvec(np.radians(tilt_deg) * random.normal(size=3) / np.sqrt(3)).as_matrix()
        centres.append(turn @ centre * (1.0 + offset_mm * random.normal() / (np.linalg.norm(centre) / 2)))
    step = np.concatenate([[focal_px, focal_px, 3.0, -3.0, 0, 0, 0, 0, 0], np.zeros(6 * len(centres) + 1)])
    twists = np.column_stack([random.normal(0, 0.03, (14, 3)), random.normal(0, 4.0, (14, 3))])
    moved = truth.moved(np.concatenate([step, np.zeros(truth.shape.size)]), twists)
    return replace(moved, virtual_centres_in_rig_mm=np.array(centres))


MIRROR_KINDS = {
    "plain": ((0.0, 0.0, 0.0, 0.0), 0.0),
    "sheets": ((2.0, 3.0, 0.0, 2.0), 0.0),
    "bent": ((0.0, 0.0, 0.0, 0.0), 0.4),
    "bent sheets": ((2.0, 3.0, 0.0, 2.0), 0.4),
}


@pytest.mark.parametrize("kind", MIRROR_KINDS)
@pytest.mark.parametrize("modes", [0, 3])
def test_derivatives_agree_with_finite_differences(modes: int, kind: str) -> None:
    scene = _make_scene(modes)
    seen = scene.clean
    thickness, bend = MIRROR_KINDS[kind]
    at = replace(
        scene.truth,
        thickness_mm=np.array(thickness),
        refractive_index=np.array([1.49, 1.52, 1.6, 1.49]),
        curvature_per_m=bend * np.random.default_rng(1).normal(size=(MIRRORS, 3)),
        middles_in_rig_mm=scene.truth.virtual_centres_in_rig_mm / 2.0 + [3.0, -4.0, 5.0],
    )
    r, by_global, by_twist = residuals_with_jacobians(at, seen, scene.board)
    np.testing.assert_allclose(r, residuals(at, seen, scene.board), atol=1e-9)
    frames = len(at.rig_from_board)
    names = global_names(MIRRORS, modes)
    assert by_global.shape[2] == len(names)

    def difference(step: FloatArray, twists: FloatArray, h: float) -> FloatArray:
        ahead = residuals(at.moved(h * step, h * twists), seen, scene.board)
        back = residuals(at.moved(-h * step, -h * twists), seen, scene.board)
        return (ahead - back) / (2 * h)

    for k, name in enumerate(names):
        h = 1e-6 if 4 <= k < 9 else 1e-4
        found = difference(np.eye(len(names))[k], np.zeros((frames, 6)), h)
        assert (np.abs(found).max() > 1e-3) == (name != "sheet_mm" or "sheets" in kind), name
        scale = max(1.0, float(np.abs(found).max()))
        np.testing.assert_allclose(by_global[:, :, k] / scale, found / scale, atol=2e-7, err_msg=name)
    for k in range(6):
        found = difference(np.zeros(len(names)), np.tile(np.eye(6)[k], (frames, 1)), 1e-5)
        np.testing.assert_allclose(by_twist[:, :, k], found, atol=1e-6 * np.abs(found).max())


def test_clean_corners_give_back_the_truth_from_a_wrong_start(scene: Scene) -> None:
    start = _disturbed(scene.truth, 1, tilt_deg=2.0, offset_mm=2.0, focal_px=20.0)
    found, iterations = minimise(start, scene.clean, scene.model)
    np.testing.assert_allclose(found.virtual_centres_in_rig_mm, scene.truth.virtual_centres_in_rig_mm, atol=1e-6)
    np.testing.assert_allclose(found.camera.intrinsics, scene.truth.camera.intrinsics, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(found.rig_from_board, scene.truth.rig_from_board, atol=1e-6)
    assert iterations <= 15


@pytest.mark.parametrize("bend", [False, True])
def test_same_minimum_as_scipy(bend: bool) -> None:
    """To seven digits, with the solver's own derivatives, which are put together without its sums over groups."""
    scene = small_scene()
    model = replace(scene.model, curvature=bend)
    seen, _ = scene.noisy(5)
    start = start_from(scene.layout.camera, disturbed(scene.layout, 5, tilt_deg=0.5, offset_mm=0.5), seen, model.board)
    peer = Peer(start, seen, model)
    if bend:
        x = 1e-3 * np.random.default_rng(0).normal(size=peer.x0.size)
        slopes, h = peer.dense(x), 1e-5
        for place in range(0, x.size, 5):
            step = h * np.eye(x.size)[place]
            expected = (peer.residuals(x + step) - peer.residuals(x - step)) / (2 * h)
            np.testing.assert_allclose(slopes[:, place], expected, atol=2e-6 * max(1.0, np.abs(expected).max()))
    theirs = least_squares(
        peer.residuals, peer.x0, jac=peer.dense, x_scale="jac", method="trf", ftol=1e-15, xtol=1e-15, gtol=1e-15
    )
    ours, iterations = minimise(start, seen, model)
    assert iterations <= 10
    assert float(np.sum(residuals(ours, seen, model.board) ** 2)) == pytest.approx(2.0 * theirs.cost, rel=1e-7)
    best = peer.estimate(theirs.x)
    np.testing.assert_allclose(ours.camera.intrinsics[:4], best.camera.intrinsics[:4], rtol=1e-7)
    np.testing.assert_allclose(ours.virtual_centres_in_rig_mm, best.virtual_centres_in_rig_mm, atol=1e-5)
    np.testing.assert_allclose(ours.curvature_per_m, best.curvature_per_m, atol=1e-6)


def test_outliers_are_dropped_and_nearly_nothing_else(scene: Scene) -> None:
    seen = scene.noisy(8)
    random = np.random.default_rng(0)
    bad = random.random(len(seen)) < 0.01
    pixels = seen.pixels.copy()
    pixels[bad] += 20 * SIGMA_PX * np.sign(random.normal(size=(bad.sum(), 2)))
    start = _disturbed(scene.truth, 2, tilt_deg=0.5, offset_mm=0.5, focal_px=5.0)
    solution = fit(start, replace(seen, pixels=pixels), scene.model)
    assert not solution.inliers[bad].any()
    assert solution.inliers[~bad].mean() > 0.999
    clean = fit(scene.truth, seen.where(~bad), scene.model)
    np.testing.assert_allclose(
        solution.estimate.virtual_centres_in_rig_mm, clean.estimate.virtual_centres_in_rig_mm, atol=0.005
    )


def test_a_bent_misprinted_board_is_found_with_its_modes() -> None:
    scene = _make_scene(modes=5)
    start = replace(scene.truth, shape=np.zeros(5))
    found, _ = minimise(start, scene.clean, scene.model)
    np.testing.assert_allclose(found.shape, scene.truth.shape, atol=1e-6)
    np.testing.assert_allclose(found.virtual_centres_in_rig_mm, scene.truth.virtual_centres_in_rig_mm, atol=1e-5)


def test_free_board_modes_leave_out_moving_turning_and_scaling() -> None:
    corners = np.array([[x, y, 0.0] for y in range(4) for x in range(5)])
    board = Board.free(corners)
    assert board.modes.shape == (3 * 20 - 7, 20, 3)
    flat = board.modes.reshape(-1, 60)
    np.testing.assert_allclose(flat @ flat.T, np.eye(53), atol=1e-12)
    centred = corners - corners.mean(axis=0)
    for gauge in (np.tile([0.0, 1.0, 0.0], (20, 1)), np.cross([0.2, 0.5, 1.0], centred), centred):
        np.testing.assert_allclose(flat @ gauge.ravel(), 0.0, atol=1e-12)


def test_one_frame_of_one_mirror_does_not_determine_a_camera(scene: Scene) -> None:
    rows = scene.clean.where((scene.clean.frame == 0) & (scene.clean.view == 0))
    alone = Estimate(scene.truth.camera, scene.truth.virtual_centres_in_rig_mm[:1], scene.truth.rig_from_board[:1])
    noisy = replace(rows, pixels=rows.pixels + np.random.default_rng(0).normal(0, 0.1, rows.pixels.shape))
    with pytest.raises(
        UndeterminedError, match="54 corners leave a direction of the problem open, most of it mirror 0"
    ):
        fit(alone, noisy, scene.model)


def test_models_name_what_they_free() -> None:
    board = Board.warped(np.array([[x, y, 0.0] for y in range(3) for x in range(4)]))
    names = Model(("k1", "fx_px"), thickness=True, curvature=True, board=board).parameters(2)
    assert names[:4] == ("fx_px", "k1", "mirror 0 x_mm", "mirror 0 y_mm")
    assert names[-4:] == ("mirror 1 curvature_xy_per_m", "sheet_mm", "board mode 0_mm", "board mode 1_mm")
    assert len(names) == len(set(names)) == 2 + 2 * 6 + 1 + 2
    held = Model((), thickness=False, curvature=False, board=Board.rigid(board.corners_in_board_mm), mirrors=False)
    assert held.parameters(2) == ()
    with pytest.raises(ValueError, match=r"unknown intrinsics k9, expected some of fx_px, "):
        Model(("k9",), thickness=False, curvature=False, board=board)


def test_a_bowed_board_is_bowed_by_its_sag_at_the_edge() -> None:
    corners = np.array([[x, y, 0.0] for y in range(5) for x in range(9)]) * 20.0 + [20.0, 20.0, 0.0]
    bowed = Board.warped(corners).shaped(np.array([0.5, -0.2]))[:, 2].reshape(5, 9)
    np.testing.assert_allclose(bowed[2, [0, 4, 8]], [0.5, 0.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(bowed[[0, 4], 4], -0.2, atol=1e-12)


def test_observations_refuse_what_does_not_fit() -> None:
    one = np.array([0])
    with pytest.raises(ValueError, match="pixels has shape"):
        Observations(one, one, one, np.zeros((2, 2)))
    with pytest.raises(ValueError, match="NaN"):
        Observations(one, one, one, np.full((1, 2), np.nan))
    with pytest.raises(ValueError, match="sorted by frame"):
        Observations(np.array([1, 0]), np.array([0, 0]), np.array([0, 1]), np.zeros((2, 2)))
    assert len(Observations.join([])) == 0
