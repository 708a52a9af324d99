"""Projection uncertainty, checked by repeated solutions with new noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from shapely import Point, Polygon

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import (
    depth_uncertainty,
    derivatives_in_reference,
    median_distance_mm,
    outline_px,
    points_at_pixels,
    project_points,
    projection_map,
    uncertainty_of,
    virtual_centre,
    worst_sigmas,
)
from mirrorcam.optics.calibration.solver.levenberg_marquardt import minimise
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.calibration.solver.residuals import Estimate
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout, Uncertainty
from mirrorcam.optics.geometry.mirror import Mirror, intersect_plane, reflect
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.calibration.diagnostics.conftest import BOARD, JOINT, NOISE_PX, Scene
from tests.optics.layouts import faceted_parabola

RANGE_MM = 420.0
TRIALS = 150
FOCAL_PX = 8000.0
RANGES_MM = np.array([200.0, 350.0, 600.0, 1000.0])


@pytest.fixture(scope="module")
def resolved(scene: Scene) -> list[Layout]:
    """Return layouts solved repeatedly, each with different noise."""
    found = []
    for seed in range(TRIALS):
        estimate, _ = minimise(scene.start, scene.noisy(1000 + seed), JOINT)
        found.append(replaced(scene.truth, estimate))
    return found


def replaced(layout: Layout, estimate: Estimate) -> Layout:
    """The layout with the camera and the virtual centres of an estimate, cut along the same rays."""
    mirrors = tuple(
        Mirror(virtual_centre_in_rig_mm=centre, outline_in_rig_mm=intersect_plane(mirror.outline_normalized, centre))
        for mirror, centre in zip(layout.mirrors, estimate.virtual_centres_in_rig_mm, strict=True)
    )
    return layout.replaced(camera=estimate.camera, mirrors=mirrors)


def assert_in_proportion(predicted: FloatArray, sampled: FloatArray) -> None:
    """Predicted and sampled sigmas agree within the standard error of the trials.

    A sigma from TRIALS samples has a relative standard error of 1 / sqrt(2 TRIALS), 6 %; worst directions of two are a
    little more. Of neighbouring points the errors are nearly identical, so that the tolerance is five standard errors.
    """
    np.testing.assert_allclose(sampled, predicted, rtol=4.0 / np.sqrt(2.0 * TRIALS))
    assert np.mean(sampled) == pytest.approx(np.mean(predicted), rel=3.0 / np.sqrt(2.0 * TRIALS))


@pytest.mark.parametrize("view", [0, 1, 2])
def test_the_map_in_rig_matches_resampling(calibrated: Layout, resolved: list[Layout], view: int) -> None:
    predicted = projection_map(calibrated, view, reference=3, range_mm=RANGE_MM)
    points = points_at_pixels(calibrated, view, predicted.pixels, RANGE_MM)
    sampled = np.array([layout.project(points, view) for layout in resolved])
    assert_in_proportion(predicted.in_rig_px, worst_of(sampled))


@pytest.mark.parametrize("view", [0, 1, 2])
def test_the_map_against_the_reference_matches_resampling(
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


def test_uncertainty_scales_with_noise_in_pixels(scene: Scene, calibrated: Layout) -> None:
    found = projection_map(calibrated, 1, reference=3, range_mm=RANGE_MM)
    np.testing.assert_allclose(
        calibrated.project(points_at_pixels(calibrated, 1, found.pixels, RANGE_MM), 1), found.pixels, atol=1e-6
    )
    assert 0.0 < found.in_rig_px.max() < 10 * NOISE_PX


def test_the_reference_view_has_no_uncertainty_relative_to_itself(calibrated: Layout) -> None:
    found = projection_map(calibrated, 3, reference=3, range_mm=RANGE_MM)
    np.testing.assert_allclose(found.against_reference_px, 0.0, atol=1e-9)
    assert found.in_rig_px.min() > 0.0


def test_points_held_in_the_reference_view_stay_there(calibrated: Layout) -> None:
    points = points_at_pixels(calibrated, 1, np.array([[300.0, 200.0], [500.0, 300.0]]), RANGE_MM)
    moved = derivatives_in_reference(calibrated, 3, points)
    shown = project_points(calibrated, 3, points)
    np.testing.assert_allclose(shown.d_parameter + shown.d_point @ moved, 0.0, atol=1e-8)


def test_the_direct_view_may_be_the_reference(calibrated: Layout) -> None:
    direct = projection_map(calibrated, DIRECT, reference=DIRECT, range_mm=RANGE_MM)
    np.testing.assert_allclose(direct.against_reference_px, 0.0, atol=1e-9)
    assert (projection_map(calibrated, 0, reference=DIRECT, range_mm=RANGE_MM).against_reference_px > 0.0).all()


def test_the_working_range_is_that_of_the_board(scene: Scene, calibrated: Layout) -> None:
    rows = scene.clean.where(scene.clean.view != DIRECT)
    points = np.array(
        [
            transform(scene.poses[frame], BOARD.corners_in_board_mm[corner])
            for frame, corner in zip(rows.frame, rows.corner, strict=True)
        ]
    )
    assert 350.0 < median_distance_mm(calibrated, points, rows.view) < 500.0


def test_a_layout_without_covariance_is_refused(device: Layout) -> None:
    with pytest.raises(ValueError, match="has no uncertainty"):
        projection_map(device, 0, reference=3, range_mm=RANGE_MM)


def middle_px(layout: Layout, view: int) -> FloatArray:
    return np.array(Polygon(outline_px(layout, view)).centroid.coords)[0]


@pytest.fixture(scope="module")
def pair() -> Layout:
    """Two adjacent mirrors before a camera of long focal length, so that pixels are proportional to angles."""
    camera = Camera(width_px=1600, height_px=900, fx_px=FOCAL_PX, fy_px=FOCAL_PX, cx_px=799.5, cy_px=449.5)
    layout = faceted_parabola(camera, DesignSpec(camera=camera, rows=1, cols=2), fill=0.9)
    names = tuple(f"mirror {m} {axis}_mm" for m in range(2) for axis in "xyz")
    return layout.replaced(uncertainty=Uncertainty(parameters=names, covariance=np.zeros((6, 6))))


def test_matching_noise_of_two_views_follows_the_closed_form(pair: Layout) -> None:
    """With angular noise s per view, ranges r and q and the angle g between the rays, sigma of r is

    s sqrt(q^2 + r^2 cos^2 g) / sin g: an error of the other view moves the point along this ray by q s / sin g, one of
    this view along the other ray by r s / sin g, of which cos g counts.
    """
    found = depth_uncertainty(pair, RANGES_MM, reference=1, pixel=middle_px(pair, 1), matching_px=0.1)
    for range_mm, sigma, views in zip(RANGES_MM, found.matching_mm, found.views, strict=True):
        point = points_at_pixels(pair, 1, middle_px(pair, 1)[None], range_mm)[0]
        here, there = (point - virtual_centre(pair, view) for view in (1, 0))
        r, q = np.linalg.norm(here), np.linalg.norm(there)
        angle = np.arccos(here @ there / r / q)
        expected = 0.1 / FOCAL_PX * np.sqrt(q**2 + (r * np.cos(angle)) ** 2) / np.sin(angle)
        if views == 2:
            assert sigma == pytest.approx(expected, rel=0.01)
    assert (found.views == 2).sum() >= 2
    np.testing.assert_array_equal(found.calibration_mm[found.views == 2], 0.0)


def test_far_away_sigma_grows_with_the_square_of_range_over_baseline(pair: Layout) -> None:
    found = depth_uncertainty(pair, np.array([2000.0, 4000.0]), reference=1, pixel=middle_px(pair, 1), matching_px=0.1)
    baseline = np.linalg.norm(virtual_centre(pair, 0) - virtual_centre(pair, 1))
    expected = np.sqrt(2.0) * 0.1 / FOCAL_PX * np.array([2000.0, 4000.0]) ** 2 / baseline
    np.testing.assert_allclose(found.matching_mm, expected, rtol=0.02)
    assert found.matching_mm[1] == pytest.approx(4.0 * found.matching_mm[0], rel=0.02)


def test_the_calibration_part_matches_drawn_calibrations(calibrated: Layout) -> None:
    """Cameras and mirrors drawn from the covariance; each triangulates the true one's exact pixels."""
    known = uncertainty_of(calibrated)
    reference = 3
    middle = middle_px(calibrated, reference)
    found = depth_uncertainty(calibrated, np.array([420.0]), reference=reference, pixel=middle, matching_px=0.1)
    point = points_at_pixels(calibrated, reference, middle[None], 420.0)
    shown = [v for v in range(4) if Polygon(outline_px(calibrated, v)).contains_properly(_at(calibrated, point, v))]
    assert len(shown) == found.views[0] >= 2
    pixels = np.array([calibrated.project(point[0], view) for view in shown])
    values = np.concatenate(
        [calibrated.camera.intrinsics, *(mirror.virtual_centre_in_rig_mm for mirror in calibrated.mirrors)]
    )
    ranges = []
    for drawn in np.random.default_rng(1).multivariate_normal(values, known.covariance, size=300):
        camera, centres = calibrated.camera.with_intrinsics(drawn[:9]), drawn[9:].reshape(-1, 3)

        def misfit(x: FloatArray, camera: Camera = camera, centres: FloatArray = centres) -> FloatArray:
            seen = np.array([reflect(x, centres[view]) for view in shown])
            return (camera.project(seen) - pixels).ravel()

        triangulated = least_squares(misfit, point[0], x_scale=0.01, xtol=1e-12, ftol=1e-14).x
        ranges.append(np.linalg.norm(triangulated - centres[reference]))
    # 300 draws determine a sigma to 4 %.
    assert np.std(ranges) == pytest.approx(found.calibration_mm[0], rel=0.13)
    assert found.total_mm[0] == pytest.approx(np.hypot(found.matching_mm[0], found.calibration_mm[0]))


def _at(layout: Layout, point: FloatArray, view: int) -> Point:
    return Point(layout.project(point[0], view))


def test_a_point_in_only_one_view_has_no_depth(pair: Layout) -> None:
    found = depth_uncertainty(pair, np.array([30.0]), reference=1, pixel=middle_px(pair, 1), matching_px=0.1)
    assert found.views[0] < 2
    assert np.isnan(found.matching_mm[0])
