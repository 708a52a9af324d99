"""Plate thickness and mirror curvature as parameters of a fit: estimates, uncertainties, and necessity."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from mirrorcam.optics.calibration.diagnostics.calibration_result import tilted_to
from mirrorcam.optics.calibration.solver.levenberg_marquardt import UndeterminedError, fit
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Estimate, residuals
from mirrorcam.optics.geometry.boards import Checkerboard
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import transform
from tests.nightly import a_few
from tests.optics.calibration.solver.scenes import (
    LENS,
    SIGMA_PX,
    Scene,
    disturbed,
    nominal_layout,
    scene,
    small_scene,
    start_from,
)

NOMINAL_MM, TRUE_MM = 2.0, 2.12
KINDS = ["sheet", "bend", "sheet and bend"]


@lru_cache(maxsize=3)
def built(kind: str) -> Scene:
    """Return nine mirrors with 2.12 mm acrylic plates, or bent by some 0.1 mm, or both, and their model."""
    random = np.random.default_rng(4)
    nominal = nominal_layout()
    mirrors = []
    for plain in nominal.mirrors:
        mirror = plain
        if "sheet" in kind:
            mirror = Mirror.second_surface(
                plain.virtual_centre_in_rig_mm, plain.outline_in_rig_mm, thickness_mm=TRUE_MM, refractive_index=1.49
            )
        if "bend" in kind:
            mirror = mirror.replaced(curvature_per_m=random.normal(0.0, 0.2, 3))
        mirrors.append(mirror)
    layout = nominal.replaced(mirrors=tuple(mirrors), camera=nominal.camera.replaced(distortion=LENS))
    found = scene(layout, frames=8, base_frames=4, board=Checkerboard(cols=9, rows=7, square_mm=16.0), seed=1)
    return replace(found, model=replace(found.model, thickness="sheet" in kind, curvature="bend" in kind))


def wrong_start(of: Scene, seed: int) -> Estimate:
    """Return flat mirrors with errors of half a degree and half a millimetre, and plates of nominal thickness."""
    ordered = tuple(
        mirror.replaced(curvature_per_m=np.zeros(3), thickness_mm=NOMINAL_MM)
        for mirror in disturbed(of.layout, seed, tilt_deg=0.5, offset_mm=0.5)
    )
    return start_from(of.layout.camera, ordered, of.clean, of.model.board)


@pytest.mark.parametrize("kind", KINDS)
def test_exact_corners_lead_to_thickness_and_curvature(kind: str) -> None:
    of = built(kind)
    start = wrong_start(of, 3)
    found = fit(start, of.clean, of.model).estimate
    same_frames = replace(of.truth, centroids_in_rig_mm=start.centroids_in_rig_mm)
    assert np.abs(residuals(found, of.clean, of.model.board)).max() < 1e-6
    np.testing.assert_allclose(found.thickness_mm, of.truth.thickness_mm, atol=1e-5)
    assert np.abs(residuals(same_frames, of.clean, of.model.board)).max() < (0.2 if "bend" in kind else 1e-9)
    if "bend" not in kind:
        np.testing.assert_allclose(found.virtual_centres_in_rig_mm, of.truth.virtual_centres_in_rig_mm, atol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_the_fitted_layout_shows_what_the_fit_predicts(kind: str) -> None:
    of = built(kind)
    seen, _ = of.noisy(0)
    start = wrong_start(of, 0)
    solution = fit(start, seen, of.model)
    found = solution.estimate
    mirrors = tuple(
        tilted_to(mirror, centre).replaced(
            thickness_mm=thickness if mirror.is_second_surface else mirror.thickness_mm, curvature_per_m=curvature
        )
        for mirror, centre, thickness, curvature in zip(
            disturbed(of.layout, 0, tilt_deg=0.5, offset_mm=0.5),
            found.virtual_centres_in_rig_mm,
            found.thickness_mm,
            found.curvature_per_m,
            strict=True,
        )
    )
    layout = of.layout.replaced(kind="calibrated", camera=found.camera, mirrors=mirrors)
    points = np.array(
        [
            transform(found.rig_from_board[f], of.model.board.corners_in_board_mm)
            for f in range(len(found.rig_from_board))
        ]
    )
    for view in range(9):
        rows = seen.view == view
        shown = layout.project(points[seen.frame[rows], seen.corner[rows]], view)
        np.testing.assert_allclose(shown - seen.pixels[rows], solution.residuals[rows], atol=1e-7)


@pytest.mark.parametrize("kind", a_few(1, KINDS))
def test_claims_equal_the_bound_and_errors_match_them(kind: str) -> None:
    of = built(kind)
    errors, linear, nees = [], [], []
    for seed in range(8 if of.model.curvature else 20):
        seen, noise = of.noisy(seed)
        solution = fit(of.truth, seen, of.model)
        errors.append(of.errors(solution.estimate))
        linear.append(of.linear @ noise.ravel())
        nees.append(errors[-1] @ np.linalg.solve(solution.covariance, errors[-1]) / len(solution.parameters))
    claimed, bound = np.sqrt(np.diag(solution.covariance)), np.sqrt(np.diag(of.bound))
    # Each claim depends on a sigma from some 5400 residuals, which scatters by 1 %; the bound's curvature adds to it.
    np.testing.assert_allclose(claimed / bound, solution.sigma_px / SIGMA_PX, rtol=0.02)
    spread = np.sqrt(2.0 / (len(nees) * len(bound)))
    assert np.mean(nees) == pytest.approx(1.0, abs=4.0 * spread)
    # Each error is close to that of the linear estimate, whose covariance is the bound.
    assert (np.abs(np.array(errors) - np.array(linear)) / bound).max() < 0.35
    if "sheet" in kind:
        place = solution.parameters.index("sheet_mm")
        assert claimed[place] < (0.15 if of.model.curvature else 0.04)
        assert abs(solution.estimate.thickness_mm[0] - TRUE_MM) < 4.0 * claimed[place]


@pytest.mark.parametrize("kind", a_few(1, KINDS))
def test_mirrors_far_off_lead_to_the_same_minimum(kind: str) -> None:
    """Errors of 2 deg and 2 mm each; in the last draw, free curvatures once led to a plate of zero thickness."""
    of = built(kind)
    camera = of.layout.camera.replaced(distortion=np.zeros(5))
    for seed in (0, 7):
        seen, _ = of.noisy(seed)
        ordered = tuple(
            mirror.replaced(curvature_per_m=np.zeros(3), thickness_mm=NOMINAL_MM)
            for mirror in disturbed(of.layout, seed, tilt_deg=2.0, offset_mm=2.0)
        )
        found = fit(start_from(camera, ordered, seen, of.model.board), seen, of.model)
        best = fit(of.truth, seen, of.model)
        assert np.sum(found.residuals**2) == pytest.approx(np.sum(best.residuals**2), rel=1e-6)
        np.testing.assert_allclose(found.estimate.thickness_mm, best.estimate.thickness_mm, atol=1e-3)


def test_a_fit_without_them_cannot_explain_the_corners() -> None:
    """Residuals of flat first-surface mirrors with plates and with bends, against 0.05 px of noise."""
    left = {}
    for kind in KINDS:
        of = built(kind)
        plain = tuple(mirror.apparent.replaced(curvature_per_m=np.zeros(3)) for mirror in of.layout.mirrors)
        start = start_from(of.layout.camera, plain, of.clean, of.model.board)
        solution = fit(start, of.clean, replace(of.model, thickness=False, curvature=False))
        left[kind] = float(np.sqrt(np.mean(solution.residuals[solution.inliers] ** 2)))
    assert left["sheet"] > 0.01
    assert left["bend"] > 0.2
    assert left["sheet and bend"] > 0.2


def test_a_thickness_without_plates_is_refused() -> None:
    plain = small_scene()
    with pytest.raises(UndeterminedError, match="no mirror is second-surface"):
        fit(plain.truth, plain.noisy(0)[0], replace(plain.model, thickness=True))


def test_direct_views_do_not_determine_the_thickness() -> None:
    of = built("sheet")
    direct = of.clean.where(of.clean.view == DIRECT)
    used = sorted(set(direct.frame.tolist()))
    direct = replace(direct, frame=np.searchsorted(used, direct.frame))
    start = of.truth.of_frames(np.array(used))
    with pytest.raises(UndeterminedError, match="nothing in 171 corners depends on sheet_mm"):
        fit(
            start,
            direct,
            Model(of.model.intrinsics, thickness=True, curvature=False, board=of.model.board, mirrors=False),
        )
