"""Keypoints of the focal stack: they have the slopes of what they show, and noise hides few of them."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features import FeatureFinder
from mirrorcam.optics.light_field.features.focal_stack import slice_of, slopes_of, stack_keypoints
from mirrorcam.optics.light_field.features.keypoints import Keypoints, grey_views
from mirrorcam.optics.light_field.features.slope import Geometry
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.features.scenes import Plane, of_planes, uneven_views

WALL: Plane = (560.0, (0.0, 0.0), None, 1)
BOARD: Plane = (430.0, (0.0, 0.0), (-30.0, -60.0, 55.0, 25.0), 2)
RANGE = (1.0 / 700.0, 1.0 / 380.0)


@pytest.fixture(scope="module")
def scene() -> LightField:
    return of_planes(uneven_views(), [WALL, BOARD], noise_grey=1.0)[0]


def found(light_field: LightField, count: int = 400) -> tuple[Keypoints, FloatArray]:
    images = grey_views(light_field)
    everywhere = np.full(images.shape, 255, np.uint8)
    return stack_keypoints(Geometry.of(light_field), images, everywhere, everywhere[0], RANGE, count)


def test_the_slice_of_a_plane_is_the_central_view_with_less_noise() -> None:
    clean, noisy = (of_planes(uneven_views(), [WALL], noise_grey=noise)[0] for noise in (0.0, 8.0))
    images, central = grey_views(noisy), grey_views(clean)[4]
    seen = np.full(images.shape, 255, np.uint8)
    inner = (slice(50, 130), slice(60, 200))
    rms = {
        depth: np.sqrt(np.mean((slice_of(Geometry.of(noisy), images, seen, 1.0 / depth) - central)[inner] ** 2))
        for depth in (WALL[0], 500.0)
    }
    assert rms[WALL[0]] < 0.6 * np.sqrt(np.mean((images[4].astype(float) - central)[inner] ** 2))
    assert rms[500.0] > 20.0


def test_slopes_are_a_pixel_apart_in_the_farthest_view() -> None:
    geometry = Geometry.of(uneven_views())
    slopes = slopes_of(geometry, RANGE)
    assert slopes[0] == RANGE[0] and slopes[-1] == pytest.approx(RANGE[1])
    step_px = np.diff(slopes) * 800.0 * np.hypot(*geometry.across_mm.T).max()
    assert (step_px > 0.8).all() and (step_px <= 1.0 + 1e-9).all()


def test_keypoints_have_the_slopes_of_what_they_show(scene: LightField) -> None:
    keypoints, inverse_mm = found(scene)
    assert len(inverse_mm) > 150
    off = np.min([np.abs(1.0 / inverse_mm - depth) for depth in (WALL[0], BOARD[0])], axis=0)
    assert np.mean(off < 20.0) > 0.85
    assert np.mean(np.abs(1.0 / inverse_mm - BOARD[0]) < 20.0) > 0.1
    assert keypoints.descriptors.shape == (len(inverse_mm), 128)
    assert np.allclose(np.linalg.norm(keypoints.descriptors, axis=1), 1.0, atol=1e-3)


def test_a_keypoint_is_found_once(scene: LightField) -> None:
    keypoints, _ = found(scene)
    _, counts = np.unique(np.round(keypoints.pixels), axis=0, return_counts=True)
    # Orientations of one are several.
    assert counts.mean() < 1.3
    assert counts.max() <= 4


def test_the_strongest_are_kept(scene: LightField) -> None:
    few, many = found(scene, 50), found(scene)
    assert len(few[1]) == 50
    assert np.array_equal(few[0].pixels, many[0].pixels[:50])


def test_features_of_the_stack_are_where_surfaces_are(scene: LightField) -> None:
    features = FeatureFinder(scene, "SIFT4D").find(scene)
    assert features.detector == "SIFT4D"
    assert len(features) > 120
    distance = features.depth_mm + 80.0
    off = np.min([np.abs(distance / depth - 1.0) for depth in (WALL[0], BOARD[0])], axis=0)
    assert np.mean(off < 0.01) > 0.97


def test_nothing_has_no_keypoints() -> None:
    views = uneven_views()
    blank = LightField.of(views, np.full((3, 3, 180, 260, 1), 80, np.uint8), np.ones((3, 3, 180, 260), np.float32))
    assert len(found(blank)[1]) == 0
    assert len(FeatureFinder(views, "SIFT4D").find(blank)) == 0
