"""Projection uncertainty, proven by solving again with fresh noise."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import (
    derivatives_held_in,
    points_at_pixels,
    project,
    projection_map,
    uncertainty_of,
    virtual_centre,
    working_range_mm,
    worst_sigmas,
)
from mirrorcam.optics.calibration.solver.levenberg_marquardt import minimise
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.calibration.solver.residuals import Estimate
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror, cut
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.calibration.diagnostics.conftest import BOARD, JOINT, NOISE_PX, Scene

RANGE_MM = 420.0
TRIALS = 150


@pytest.fixture(scope="module")
def resolved(scene: Scene) -> list[Layout]:
    """The layout solved again and again, each time with other noise."""
    found = []
    for seed in range(TRIALS):
        estimate, _ = minimise(scene.start, scene.noisy(1000 + seed), JOINT)
        found.append(replaced(scene.truth, estimate))
    return found


def replaced(layout: Layout, estimate: Estimate) -> Layout:
    """The layout with the camera and the virtual centres of an estimate, cut along the same rays."""
    mirrors = tuple(
        Mirror(virtual_centre_in_rig_mm=centre, outline_in_rig_mm=cut(mirror.outline_normalized, centre))
        for mirror, centre in zip(layout.mirrors, estimate.virtual_centres_in_rig_mm, strict=True)
    )
    return layout.replaced(camera=estimate.camera, mirrors=mirrors)


def assert_in_proportion(predicted: FloatArray, sampled: FloatArray) -> None:
    """Predicted and sampled sigmas agree within the standard error of the trials.

    A sigma from TRIALS samples has a relative standard error of 1 / sqrt(2 TRIALS), 6 %; worst directions of two are a
    little more. Of neighbouring points the errors are nearly one, so that five of them are allowed and no less.
    """
    np.testing.assert_allclose(sampled, predicted, rtol=4.0 / np.sqrt(2.0 * TRIALS))
    assert np.mean(sampled) == pytest.approx(np.mean(predicted), rel=3.0 / np.sqrt(2.0 * TRIALS))


@pytest.mark.parametrize("view", [0, 1, 2])
def test_the_map_in_rig_is_what_resampling_shows(calibrated: Layout, resolved: list[Layout], view: int) -> None:
    predicted = projection_map(calibrated, view, reference=3, range_mm=RANGE_MM)
    points = points_at_pixels(calibrated, view, predicted.pixels, RANGE_MM)
    sampled = np.array([layout.project(points, view) for layout in resolved])
    assert_in_proportion(predicted.in_rig_px, worst_of(sampled))


@pytest.mark.parametrize("view", [0, 1, 2])
def test_the_map_against_the_reference_is_what_resampling_shows(
    calibrated: Layout, resolved: list[Layout], view: int
) -> None:
    predicted = projection_map(calibrated, view, reference=3, range_mm=RANGE_MM)
    points = points_at_pixels(calibrated, view, predicted.pixels, RANGE_MM)
    pixels = calibrated.project(points, 3)
    ranges = np.linalg.norm(points - virtual_centre(calibrated, 3), axis=1)
    sampled = []
    for layout in resolved:
        rays = layout.camera.unproject(pixels)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        sampled.append(layout.project(layout.mirrors[3].reflect(ranges[:, None] * rays), view))
    assert_in_proportion(predicted.against_reference_px, worst_of(np.array(sampled)))
    assert predicted.against_reference_px.mean() < 0.5 * predicted.in_rig_px.mean()


def worst_of(sampled: FloatArray) -> FloatArray:
    """Worst-direction standard deviations (n,) of pixels (trials, n, 2)."""
    centred = sampled - sampled.mean(axis=0)
    return worst_sigmas(np.einsum("tni,tnj->nij", centred, centred) / (len(sampled) - 1))


def test_a_wrong_covariance_would_be_noticed(calibrated: Layout, resolved: list[Layout]) -> None:
    known = uncertainty_of(calibrated)
    doubted = calibrated.replaced(uncertainty=known.replaced(covariance=1.7 * known.covariance))
    predicted = projection_map(doubted, 0, reference=3, range_mm=RANGE_MM)
    points = points_at_pixels(doubted, 0, predicted.pixels, RANGE_MM)
    sampled = np.array([layout.project(points, 0) for layout in resolved])
    with pytest.raises(AssertionError):
        assert_in_proportion(predicted.in_rig_px, worst_of(sampled))


def test_more_noise_is_more_uncertainty_and_pixels_are_pixels(scene: Scene, calibrated: Layout) -> None:
    found = projection_map(calibrated, 1, reference=3, range_mm=RANGE_MM)
    np.testing.assert_allclose(
        calibrated.project(points_at_pixels(calibrated, 1, found.pixels, RANGE_MM), 1), found.pixels, atol=1e-6
    )
    assert 0.0 < found.in_rig_px.max() < 10 * NOISE_PX


def test_the_reference_view_is_sure_of_itself(calibrated: Layout) -> None:
    found = projection_map(calibrated, 3, reference=3, range_mm=RANGE_MM)
    np.testing.assert_allclose(found.against_reference_px, 0.0, atol=1e-9)
    assert found.in_rig_px.min() > 0.0


def test_points_held_in_the_reference_view_stay_there(calibrated: Layout) -> None:
    points = points_at_pixels(calibrated, 1, np.array([[300.0, 200.0], [500.0, 300.0]]), RANGE_MM)
    moved = derivatives_held_in(calibrated, 3, points)
    shown = project(calibrated, 3, points)
    np.testing.assert_allclose(shown.by_parameter + shown.by_point @ moved, 0.0, atol=1e-8)


def test_the_direct_view_may_be_the_reference(calibrated: Layout) -> None:
    direct = projection_map(calibrated, DIRECT, reference=DIRECT, range_mm=RANGE_MM)
    np.testing.assert_allclose(direct.against_reference_px, 0.0, atol=1e-9)
    assert (projection_map(calibrated, 0, reference=DIRECT, range_mm=RANGE_MM).against_reference_px > 0.0).all()


def test_the_working_range_is_where_the_board_was(scene: Scene, calibrated: Layout) -> None:
    rows = scene.clean.where(scene.clean.view != DIRECT)
    points = np.array(
        [
            transform(scene.poses[frame], BOARD.corners_in_board_mm[corner])
            for frame, corner in zip(rows.frame, rows.corner, strict=True)
        ]
    )
    assert 350.0 < working_range_mm(calibrated, points, rows.view) < 500.0


def test_a_layout_without_covariance_is_refused(device: Layout) -> None:
    with pytest.raises(ValueError, match="carries no uncertainty"):
        projection_map(device, 0, reference=3, range_mm=RANGE_MM)
