"""Refocusing, against pictures of planes by exact pinholes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import LightField, Views
from mirrorcam.optics.light_field.render.linear_light import levels_from_light, light_from_levels
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, aperture, homography, refocus, to_bytes
from tests.optics.light_field.depth.surfaces import Surface, grid_views, met, photograph

TILTED = Surface(320.0, slope=(0.4, -0.25), seed=3)
UPRIGHT = Surface(330.0, seed=4)


def truth(views: Views, surfaces: list[Surface], scale: int = 1) -> FloatArray:
    """Return the reference view's picture without noise, 0 to 1, integrated over pixels of a view or finer ones."""
    fine = replace(
        views,
        focal_px=views.focal_px * scale,
        centre_px=views.centre_px * scale + (scale - 1.0) / 2.0,
        width_px=views.width_px * scale,
        height_px=views.height_px * scale,
    )
    within = np.stack(np.meshgrid([-0.25, 0.25], [-0.25, 0.25]), axis=-1).reshape(-1, 2)
    grid, centre = fine.pixel_grid(), (views.rows // 2, views.cols // 2)
    return np.asarray(np.mean([met(fine, centre, grid + shift, surfaces)[0] for shift in within], axis=0))


def psnr(image: NDArray[Any], true: NDArray[Any], where: NDArray[np.bool_]) -> float:
    return float(-10.0 * np.log10(np.mean(np.square(image - true)[where])))


def plane_of(views: Views, surface: Surface) -> FocalPlane:
    """Return the plane of a surface: Z - a X - b Y = distance."""
    a, b = surface.slope
    return FocalPlane((-a / surface.distance_mm, -b / surface.distance_mm, 1.0 / surface.distance_mm))


def test_the_homography_maps_points_of_a_plane_to_their_pixels() -> None:
    views = grid_views()
    plane = plane_of(views, TILTED)
    pixels = np.array([[3.0, 5.0], [100.0, 20.0], [60.5, 80.25]])
    ways = np.concatenate([(pixels - views.centre_px) / views.focal_px, np.ones((3, 1))], axis=1)
    points = ways / (ways @ np.array(plane.normal_per_mm))[:, None]
    seen = views.project_in_view(points)
    for t, s in np.ndindex(views.rows, views.cols):
        moved = np.concatenate([pixels, np.ones((3, 1))], axis=1) @ homography(views, (t, s), plane).T
        np.testing.assert_allclose(moved[:, :2] / moved[:, 2:], seen[t, s], atol=1e-9)


def test_a_plane_is_given_by_its_depth_in_the_middle_and_its_tilt() -> None:
    views = grid_views()
    behind = views.reference_view_depth_mm
    inverse_distance = FocalPlane.at_depth(views, 400.0, (30.0, 0.0)).inverse_distance(views)
    middle = (views.height_px - 1) / 2.0, (views.width_px - 1) / 2.0
    rows, columns = (slice(int(np.floor(each)), int(np.ceil(each)) + 1) for each in middle)
    assert inverse_distance[rows, columns].mean() == pytest.approx(1.0 / (400.0 - behind), rel=1e-12)
    assert (np.diff(inverse_distance, axis=1) < 0).all()
    np.testing.assert_allclose(np.diff(inverse_distance, axis=0), 0.0, atol=1e-15)
    # Between two columns far apart the plane rises by tan 30 degrees.
    z = 1.0 / inverse_distance[40]
    x = (np.arange(views.width_px) - views.centre_px[0]) / views.focal_px * z
    assert (z[-1] - z[0]) / (x[-1] - x[0]) == pytest.approx(np.tan(np.radians(30.0)), rel=1e-9)
    assert FocalPlane.at_depth(views, np.inf).normal_per_mm == (0.0, 0.0, 0.0)


def test_a_plane_is_fitted_to_pixels_and_depths() -> None:
    views, plane = grid_views(), FocalPlane.at_depth(grid_views(), 390.0, (-20.0, 35.0))
    behind = views.reference_view_depth_mm
    pixels = np.array([[5, 7], [110, 12], [60, 80], [20, 60]])
    depths = 1.0 / plane.inverse_distance(views)[pixels[:, 1], pixels[:, 0]] + behind
    found = FocalPlane.through(views, pixels.astype(float), depths)
    np.testing.assert_allclose(found.normal_per_mm, plane.normal_per_mm, rtol=1e-9)
    with pytest.raises(InputError, match="are collinear"):
        FocalPlane.through(views, np.array([[0.0, 0.0], [5.0, 5.0], [9.0, 9.0]]), depths[:3])


@pytest.mark.parametrize("surface", [UPRIGHT, TILTED])
def test_a_plane_in_focus_is_as_sharp_as_the_pinhole_sees_it(surface: Surface) -> None:
    views = grid_views()
    light_field = photograph(views, [surface])[0]
    true = truth(views, [surface])
    picture = refocus(light_field, plane_of(views, surface))
    overlap = picture.weights > 8.99
    assert overlap.mean() > 0.5
    sharp = psnr(picture.image, true, overlap)
    assert sharp > 40.0
    median = refocus(light_field, plane_of(views, surface), combine="median")
    assert psnr(median.image, true, overlap) > 40.0
    # It is out of focus at other depths, and with views assumed on an even grid.
    assert psnr(refocus(light_field, FocalPlane((0.0, 0.0, 1.0 / 450.0))).image, true, overlap) < 25.0
    moved = LightField.of(views.on_regular_grid(), light_field.samples, light_field.weights)
    assert psnr(refocus(moved, plane_of(views, surface)).image, true, overlap) < sharp - 4.0


def test_noise_falls_with_the_root_of_the_number_of_views() -> None:
    views = grid_views()
    light_field = photograph(views, [UPRIGHT], noise=0.05)[0]
    true = truth(views, [UPRIGHT])
    picture = refocus(light_field, plane_of(views, UPRIGHT))
    overlap = picture.weights > 8.99
    central = light_field.samples[1, 1] / 255.0
    assert psnr(picture.image, true, overlap) > psnr(central, true, overlap) + 8.5


def test_the_median_removes_objects_in_few_views() -> None:
    views = grid_views()
    light_field = photograph(views, [UPRIGHT])[0]
    samples = light_field.samples.copy()
    samples[0, 0], samples[2, 1], samples[1, 1] = 255, 255, 0
    spoilt = LightField.of(views, samples, light_field.weights)
    true, plane = truth(views, [UPRIGHT]), plane_of(views, UPRIGHT)
    overlap = refocus(light_field, plane).weights > 8.99
    assert psnr(refocus(spoilt, plane, combine="median").image, true, overlap) > 35.0
    assert psnr(refocus(spoilt, plane).image, true, overlap) < 25.0


def test_the_median_uses_the_existing_samples() -> None:
    views = grid_views(1, 3, uneven=False)
    values = np.array([0.2, 0.8, 0.5], np.float32)
    samples = np.broadcast_to(values[None, :, None, None, None], (1, 3, 90, 120, 1)).copy()
    weights = np.ones((1, 3, 90, 120), np.float32)
    weights[0, 2, :, :40] = 0.0
    weights[0, :2, :, :20] = 0.0
    samples[weights == 0] = 0.0
    plane = FocalPlane.at_depth(views, views.reference_depth_mm)
    picture = refocus(LightField.of(views, samples, weights), plane, combine="median")
    np.testing.assert_allclose(picture.image[:, 41:, 0], 0.5, atol=1e-6)
    # In sRGB, levels 0.2 and 0.8 have light .0331 and .6038.
    np.testing.assert_allclose(picture.image[:, 21:39, 0], 1.055 * 0.31846 ** (1 / 2.4) - 0.055, atol=1e-4)
    assert not picture.valid[:, :19].any()
    assert (picture.weights[:, 21:39] == 2).all()
    weights[0, 0] = 0.0
    picture = refocus(LightField.of(views, samples * weights[..., None], weights), plane, combine="median")
    np.testing.assert_allclose(picture.image[:, 21:39, 0], 0.8, atol=1e-6)


def test_a_blur_is_a_mean_of_light() -> None:
    views = grid_views(1, 2, uneven=False)
    samples = np.zeros((1, 2, 90, 120, 3), np.uint8)
    samples[0, 1] = 255
    picture = refocus(
        LightField.of(views, samples, np.ones((1, 2, 90, 120), np.float32)),
        FocalPlane.at_depth(views, views.reference_depth_mm),
    )
    assert (to_bytes(picture)[10:-10, 10:-10] == 188).all()


def test_views_count_by_their_weights() -> None:
    views = grid_views()
    light_field = photograph(views, [UPRIGHT])[0]
    plane = FocalPlane.at_depth(views, 460.0)
    alone = np.zeros((3, 3), np.float32)
    alone[1, 1] = 1.0
    picture = refocus(light_field, plane, view_weights=alone)
    assert np.array_equal(to_bytes(picture), light_field.samples[1, 1])
    soft = aperture(views)
    assert soft[1, 1] == 1.0
    assert soft[0, 0] < soft[0, 1] < 1.0
    # Less weight of outer views gives less blur.
    true = truth(views, [UPRIGHT])
    middle = np.zeros(true.shape[:2], dtype=bool)
    middle[20:-20, 30:-30] = True
    weighted, even = (refocus(light_field, plane, view_weights=each).image for each in (soft, None))
    assert psnr(weighted, true, middle) > psnr(even, true, middle) + 0.5
    with pytest.raises(ValueError, match="expected the mean"):
        refocus(light_field, plane, combine="median", view_weights=soft)


def test_missing_samples_have_no_influence() -> None:
    views = grid_views()
    light_field = photograph(views, [UPRIGHT], noise=0.0)[0]
    samples, weights = light_field.samples.copy(), light_field.weights.copy()
    weights[0, :, 30:, :], samples[0, :, 30:, :] = 0.0, 0
    weights[:, :, :, :10], samples[:, :, :, :10] = 0.0, 0
    plane = plane_of(views, UPRIGHT)
    picture = refocus(LightField.of(views, samples, weights), plane)
    assert psnr(picture.image, truth(views, [UPRIGHT]), picture.weights > 3.0) > 38.0
    assert not picture.valid.all()
    assert (picture.image[~picture.valid] == 0).all()
    assert (to_bytes(picture)[~picture.valid] == 64).all()


def test_super_sampling_shows_more_than_one_view_has() -> None:
    views = grid_views()
    fine = Surface(330.0, seed=6, grain_mm=0.5, contrast=0.2)
    light = photograph(views, [fine])[0]
    coded = levels_from_light(light.samples.astype(np.float32) / np.float32(255.0))
    light_field = LightField.of(views, coded, light.weights)
    true, plane = truth(views, [fine], scale=2), plane_of(views, fine)
    picture = refocus(light_field, plane, scale=2)
    assert picture.image.shape == (180, 240, 3)
    where = np.zeros(picture.valid.shape, dtype=bool)
    where[40:-40, 60:-60] = True
    assert picture.valid[where].all()
    central = cv2.resize(light.samples[1, 1] / np.float32(255.0), (240, 180), interpolation=cv2.INTER_CUBIC)
    mean = cv2.resize(light_from_levels(refocus(light_field, plane).image), (240, 180), interpolation=cv2.INTER_CUBIC)
    reached = psnr(light_from_levels(picture.image), true, where)
    assert reached > psnr(np.asarray(central), true, where) + 2.0
    assert reached > psnr(np.asarray(mean), true, where) + 2.0


def test_floating_point_and_grey_samples_give_the_same() -> None:
    views = grid_views()
    light_field = photograph(views, [UPRIGHT])[0]
    plane = plane_of(views, UPRIGHT)
    picture = refocus(light_field, plane)
    floats = LightField.of(views, light_field.samples.astype(np.float32) / np.float32(255.0), light_field.weights)
    np.testing.assert_allclose(refocus(floats, plane).image, picture.image, atol=1e-6)
    grey = LightField.of(views, light_field.samples[..., :1].copy(), light_field.weights)
    np.testing.assert_allclose(refocus(grey, plane).image[..., 0], picture.image[..., 0], atol=2e-3)
    assert to_bytes(refocus(grey, plane)).shape == (90, 120, 3)


def test_beyond_a_steep_planes_horizon_the_picture_is_empty() -> None:
    views = grid_views()
    light_field = photograph(views, [UPRIGHT])[0]
    plane = FocalPlane.at_depth(views, 375.0, (84.0, 0.0))
    ahead = plane.inverse_distance(views) >= 0
    assert 0.2 < ahead.mean() < 0.9
    for scale in (1, 2):
        picture = refocus(light_field, plane, scale=scale)
        assert not picture.valid[:, ::scale][::scale][~ahead].any()


@pytest.mark.parametrize(
    ("depth_mm", "tilt_deg", "message"),
    [
        (-79.5, (0.0, 0.0), "focus at -79.5 mm, expected a depth beyond the views, more than -79 mm"),
        (float("nan"), (0.0, 0.0), "focus at nan mm"),
        (400.0, (89.0, 0.0), "tilt of 89 and 0 degrees, expected at most 85"),
        (400.0, (0.0, float("nan")), "tilt of 0 and nan degrees"),
    ],
)
def test_planes_that_no_view_sees_are_refused(depth_mm: float, tilt_deg: tuple[float, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        FocalPlane.at_depth(grid_views(), depth_mm, tilt_deg)


def test_a_plane_seen_from_behind_is_refused() -> None:
    views = grid_views(centre_px=np.array([-900.0, 46.5]))
    with pytest.raises(InputError, match="the back of the plane"):
        FocalPlane.at_depth(views, 400.0, (40.0, 0.0))


def test_a_scale_beyond_reason_is_refused() -> None:
    light_field = photograph(grid_views(), [UPRIGHT])[0]
    with pytest.raises(InputError, match="scale is 9, expected 1 to 8"):
        refocus(light_field, plane_of(light_field, UPRIGHT), scale=9)
