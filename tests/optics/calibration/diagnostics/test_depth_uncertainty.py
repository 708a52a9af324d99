"""Sigma of depth: the closed form of two views, and a Monte Carlo of the calibration's part."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from shapely import Point, Polygon

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.depth_uncertainty import depth_uncertainty
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import (
    outline_px,
    points_at_pixels,
    uncertainty_of,
    virtual_centre,
)
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout, Uncertainty
from mirrorcam.optics.geometry.mirror import reflect
from tests.optics.layouts import faceted_parabola

FOCAL_PX = 8000.0
RANGES_MM = np.array([200.0, 350.0, 600.0, 1000.0])


def middle_px(layout: Layout, view: int) -> FloatArray:
    return np.array(Polygon(outline_px(layout, view)).centroid.coords)[0]


@pytest.fixture(scope="module")
def pair() -> Layout:
    """Two mirrors side by side before a camera of so long a focal length that a pixel is an angle."""
    camera = Camera(width_px=1600, height_px=900, fx_px=FOCAL_PX, fy_px=FOCAL_PX, cx_px=799.5, cy_px=449.5)
    layout = faceted_parabola(camera, DesignSpec(camera=camera, rows=1, cols=2), fill=0.9)
    names = tuple(f"mirror {m} {axis}_mm" for m in range(2) for axis in "xyz")
    return layout.replaced(uncertainty=Uncertainty(parameters=names, covariance=np.zeros((6, 6))))


def test_matching_noise_of_two_views_follows_the_closed_form(pair: Layout) -> None:
    """With angular noise s per view, ranges r and q and the angle g between the rays, sigma of r is

    s sqrt(q^2 + r^2 cos^2 g) / sin g: an error of the other view moves the point along this ray by q s / sin g, one of
    this view along the other ray by r s / sin g, of which cos g counts.
    """
    found = depth_uncertainty(pair, RANGES_MM, reference=1, at_px=middle_px(pair, 1), matching_px=0.1)
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
    found = depth_uncertainty(pair, np.array([2000.0, 4000.0]), reference=1, at_px=middle_px(pair, 1), matching_px=0.1)
    baseline = np.linalg.norm(virtual_centre(pair, 0) - virtual_centre(pair, 1))
    expected = np.sqrt(2.0) * 0.1 / FOCAL_PX * np.array([2000.0, 4000.0]) ** 2 / baseline
    np.testing.assert_allclose(found.matching_mm, expected, rtol=0.02)
    assert found.matching_mm[1] == pytest.approx(4.0 * found.matching_mm[0], rel=0.02)


def test_the_calibration_part_is_what_drawing_calibrations_shows(calibrated: Layout) -> None:
    """Cameras and mirrors drawn from the covariance; each triangulates what the true one shows, exactly."""
    known = uncertainty_of(calibrated)
    reference = 3
    middle = middle_px(calibrated, reference)
    found = depth_uncertainty(calibrated, np.array([420.0]), reference=reference, at_px=middle, matching_px=0.1)
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


def test_a_point_that_one_view_shows_has_no_depth(pair: Layout) -> None:
    found = depth_uncertainty(pair, np.array([30.0]), reference=1, at_px=middle_px(pair, 1), matching_px=0.1)
    assert found.views[0] < 2
    assert np.isnan(found.matching_mm[0])
