"""The figures of a calibration's result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.calibration_result import (
    angle_between_mirrors,
    fit_metrics,
    mirror_sigmas,
    spatial_rms_mm,
    tilted_to,
    uncertainty,
    with_estimate,
)
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution
from mirrorcam.optics.calibration.solver.residuals import Estimate
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.diagnostics.conftest import JOINT, NOISE_PX, Scene


def test_angle_and_its_sigma_agree_with_finite_differences_and_sampling() -> None:
    random = np.random.default_rng(2)
    a, b = np.array([100.0, 20.0, 5.0]), np.array([10.0, 150.0, -30.0])
    root = random.normal(0.0, 0.05, (6, 6))
    covariance = root @ root.T
    angle, sigma = angle_between_mirrors(a, b, covariance)
    assert angle == pytest.approx(np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b)))
    drawn = random.multivariate_normal(np.concatenate([a, b]), covariance, size=4000)
    angles = [angle_between_mirrors(d[:3], d[3:], covariance)[0] for d in drawn]
    assert np.std(angles) == pytest.approx(sigma, rel=0.05)


def test_metrics_are_the_residuals_per_axis_and_view(scene: Scene, solution: Solution) -> None:
    seen = scene.noisy(0)
    metrics = fit_metrics(seen, solution)
    rows = solution.inliers & (seen.view == 2)
    expected = np.sqrt(np.mean(solution.residuals[rows] ** 2, axis=0))
    assert metrics["mirror_2_rms_x_px"].value == pytest.approx(expected[0])
    assert metrics["mirror_2_rms_y_px"].value == pytest.approx(expected[1])
    assert metrics["corners"].value + metrics["outliers"].value == len(seen)
    assert {f"mirror_{m}_normal_sigma_deg" for m in range(4)} <= metrics.keys()
    assert metrics["sigma_px"].value == pytest.approx(NOISE_PX, rel=0.05)


def test_the_layouts_sigmas_equal_the_metrics(scene: Scene, solution: Solution, calibrated: Layout) -> None:
    metrics = fit_metrics(scene.noisy(0), solution)
    for mirror, (tilt_rad, distance_mm) in enumerate(mirror_sigmas(calibrated)):
        assert np.degrees(tilt_rad) == pytest.approx(metrics[f"mirror_{mirror}_normal_sigma_deg"].value)
        assert distance_mm == pytest.approx(metrics[f"mirror_{mirror}_distance_sigma_mm"].value)
    with pytest.raises(ValueError, match="has no uncertainty"):
        mirror_sigmas(calibrated.replaced(uncertainty=None))


def test_the_modes_of_a_board_are_marginalised(solution: Solution) -> None:
    size = len(solution.parameters) + 1
    covariance = np.eye(size)
    covariance[:-1, :-1] = solution.covariance
    found = uncertainty(replace(solution, parameters=(*solution.parameters, "board mode 0_mm"), covariance=covariance))
    assert found.parameters == solution.parameters
    np.testing.assert_allclose(found.covariance, solution.covariance, rtol=1e-9)


def test_the_spatial_error_is_that_of_pixels_at_their_distance(scene: Scene) -> None:
    """Isotropic noise of sigma px at distance z is off by sigma sqrt(2) z / f, which at some 400 mm is 0.02 mm."""
    every = np.ones(len(scene.clean), dtype=bool)
    assert spatial_rms_mm(scene.start, scene.clean, every, JOINT.board) < 1e-6
    found = spatial_rms_mm(scene.start, scene.noisy(0), every, JOINT.board)
    assert found == pytest.approx(NOISE_PX * np.sqrt(2.0) * 420.0 / scene.truth.camera.fx_px, rel=0.2)


def test_a_mirror_moves_to_a_measured_plane_as_a_rigid_body(default_layout: Layout) -> None:
    nominal = default_layout.mirrors[0]
    board = nominal.virtual_centre_in_rig_mm + np.array([0.4, -0.3, 0.5])
    moved = tilted_to(nominal, board)
    np.testing.assert_allclose(moved.virtual_centre_in_rig_mm, board, atol=1e-9)

    def sides(outline: FloatArray) -> FloatArray:
        return np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1)

    np.testing.assert_allclose(sides(moved.outline_in_rig_mm), sides(nominal.outline_in_rig_mm), atol=1e-9)
    assert np.abs(moved.outline_in_rig_mm - nominal.outline_in_rig_mm).max() < 2.0


def test_an_estimated_layout_has_camera_planes_and_curvatures_but_no_metrics(default_layout: Layout) -> None:
    camera = default_layout.camera.replaced(fx_px=1300.0)
    estimate = Estimate.of(camera, default_layout.mirrors, np.zeros((0, 4, 4)))
    curved = Estimate(
        camera,
        1.01 * estimate.virtual_centres_in_rig_mm,
        estimate.rig_from_board,
        curvature_per_m=np.full((9, 3), 0.01),
    )
    found = with_estimate(default_layout, curved)
    assert (found.kind, found.camera, found.metrics, found.verdict) == ("calibrated", camera, {}, {})
    for mirror, nominal in zip(found.mirrors, default_layout.mirrors, strict=True):
        np.testing.assert_allclose(mirror.virtual_centre_in_rig_mm, 1.01 * nominal.virtual_centre_in_rig_mm)
        np.testing.assert_allclose(mirror.curvature_per_m, 0.01)
