"""The solver on corners with known truth: minimum, noise, outliers, uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.model_comparison import frames_of
from mirrorcam.optics.calibration.solver.levenberg_marquardt import (
    COMMON_ERROR_PX,
    UndeterminedError,
    common_error_covariance,
    fit,
    minimise,
)
from mirrorcam.optics.calibration.solver.observations import DIRECT, MIN_CORNERS
from mirrorcam.optics.calibration.solver.residuals import Estimate, residuals
from tests.optics.calibration.solver.four_mirrors import SIGMA_PX, FourMirrors, four_mirrors
from tests.optics.calibration.solver.peer import Peer
from tests.optics.calibration.solver.scenes import Scene, disturbed, small_scene, start_from
from tests.optics.calibration.solver.test_plates_and_curvature import built


@pytest.fixture(scope="module")
def scene() -> FourMirrors:
    return four_mirrors()


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


def test_exact_corners_lead_to_the_truth_from_a_wrong_start(scene: FourMirrors) -> None:
    start = _disturbed(scene.truth, 1, tilt_deg=2.0, offset_mm=2.0, focal_px=20.0)
    found, iterations = minimise(start, scene.clean, scene.model)
    np.testing.assert_allclose(found.virtual_centres_in_rig_mm, scene.truth.virtual_centres_in_rig_mm, atol=1e-6)
    np.testing.assert_allclose(found.camera.intrinsics, scene.truth.camera.intrinsics, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(found.rig_from_board, scene.truth.rig_from_board, atol=1e-6)
    assert iterations <= 15


@pytest.mark.parametrize("bend", [False, True])
def test_same_minimum_as_scipy(bend: bool) -> None:
    """To seven digits, with the solver's derivatives assembled without its sums over groups."""
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


def test_outliers_are_dropped_and_hardly_any_inliers(scene: FourMirrors) -> None:
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


def test_corners_that_mostly_contradict_the_model_are_not_outliers() -> None:
    """With the camera held, corners in mirrors at another focal length are not outliers."""
    scene = small_scene()
    seen, _ = scene.noisy(0)
    principal = scene.truth.camera.intrinsics[2:4]
    pixels = np.where((seen.view != DIRECT)[:, None], principal + 1.01 * (seen.pixels - principal), seen.pixels)
    frames = np.arange(len(scene.truth.rig_from_board))
    rows, start = frames_of(replace(seen, pixels=pixels), scene.truth, (frames < 1) | (frames >= 8))
    rows = rows.where(rows.view < 3)
    solution = fit(start, rows, replace(scene.model, intrinsics=(), mirrors=False))
    assert solution.inliers.mean() > 0.75
    assert set(rows.view[solution.inliers]) == set(rows.view)


def test_a_bent_misprinted_board_is_found_with_its_modes() -> None:
    scene = four_mirrors(modes=5)
    start = replace(scene.truth, shape=np.zeros(5))
    found, _ = minimise(start, scene.clean, scene.model)
    np.testing.assert_allclose(found.shape, scene.truth.shape, atol=1e-6)
    np.testing.assert_allclose(found.virtual_centres_in_rig_mm, scene.truth.virtual_centres_in_rig_mm, atol=1e-5)


def test_one_frame_of_one_mirror_does_not_determine_a_camera(scene: FourMirrors) -> None:
    rows = scene.clean.where((scene.clean.frame == 0) & (scene.clean.view == 0))
    alone = Estimate(scene.truth.camera, scene.truth.virtual_centres_in_rig_mm[:1], scene.truth.rig_from_board[:1])
    noisy = replace(rows, pixels=rows.pixels + np.random.default_rng(0).normal(0, 0.1, rows.pixels.shape))
    with pytest.raises(
        UndeterminedError, match="54 corners do not determine a direction of the problem, mostly of mirror 0"
    ):
        fit(alone, noisy, scene.model)


def shared_fields(of: Scene) -> FloatArray:
    """Return shared errors (2 n, k) px of all corners: six in each mirror."""
    seen, columns = of.clean, []
    for mirror in range(len(of.layout.mirrors)):
        own = seen.view == mirror
        at = (seen.pixels - seen.pixels[own].mean(axis=0)) / seen.pixels[own].std(axis=0)
        for field in (np.ones(len(seen)), at[:, 0], at[:, 1]):
            of_view = np.where(own, field, 0.0)[:, None]
            columns += [(axis * of_view).ravel() for axis in np.eye(2)]
    return COMMON_ERROR_PX * np.array(columns).T


def test_the_covariance_matches_fits_to_corners_with_shared_errors() -> None:
    scene = built("sheet")
    expected = np.linalg.lstsq(scene.jacobian, shared_fields(scene), rcond=None)[0][: len(scene.free)]
    found = common_error_covariance(scene.truth, scene.clean, scene.model)
    size = np.sqrt(np.diag(expected @ expected.T))
    np.testing.assert_allclose(found / np.outer(size, size), expected @ expected.T / np.outer(size, size), atol=2e-3)


def test_shared_errors_enter_the_covariance_and_do_not_average_out() -> None:
    scene = built("sheet")
    seen, _ = scene.noisy(0)
    solution = fit(scene.truth, seen, scene.model)
    shared = common_error_covariance(solution.estimate, seen.where(solution.inliers), scene.model)
    assert np.linalg.eigvalsh(solution.covariance - shared).min() > 0.0
    direct = scene.clean.view == DIRECT
    half = scene.clean.where(direct | (scene.clean.corner % 2 == 0))
    fewer = common_error_covariance(scene.truth, half, scene.model)
    complete = common_error_covariance(scene.truth, scene.clean, scene.model)
    assert 0.8 < np.median(np.sqrt(np.diag(fewer) / np.diag(complete))) < 1.25


def test_an_uncertain_refractive_index_shifts_the_mirrors_as_a_fit_with_another_index() -> None:
    scene = built("sheet")
    sigma = 0.02
    known, unknown = (
        common_error_covariance(scene.truth, scene.clean, replace(scene.model, index_sigma=index_sigma))
        for index_sigma in (0.0, sigma)
    )
    other = replace(scene.truth, refractive_index=scene.truth.refractive_index + sigma)
    fitted = fit(other, scene.clean, scene.model)
    start = fitted.parameters.index("mirror 0 x_mm")
    centres = slice(start, start + scene.truth.virtual_centres_in_rig_mm.size)
    shift = (fitted.estimate.virtual_centres_in_rig_mm - scene.truth.virtual_centres_in_rig_mm).ravel()
    added = (unknown - known)[centres, centres]
    np.testing.assert_allclose(np.sqrt(np.diag(added)), np.abs(shift), rtol=0.05, atol=0.05 * np.abs(shift).max())


def test_a_frame_keeps_corners_even_if_all_contradict_the_model(scene: FourMirrors) -> None:
    """Without them nothing would determine its pose; what is wrong with it is found from its residuals."""
    seen = scene.noisy(3)
    last = seen.frame == seen.frame.max()
    pixels = seen.pixels + np.where(last[:, None], np.random.default_rng(1).normal(0.0, 10.0, (len(seen), 2)), 0.0)
    solution = fit(scene.truth, replace(seen, pixels=pixels), scene.model)
    assert solution.inliers[last].sum() >= MIN_CORNERS


def test_corners_in_first_surface_mirrors_share_no_errors() -> None:
    scene = small_scene()
    assert not common_error_covariance(scene.truth, scene.clean, scene.model).any()
