"""Keypoints lie within the samples of views, and descriptors are compared by their own distance."""

from __future__ import annotations

from typing import get_args

import cv2
import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features import FeatureFinder
from mirrorcam.optics.light_field.features.keypoints import (
    BORDER_PX,
    DetectorName,
    Keypoints,
    detect,
    detector,
    differing_bits,
    focal_slice,
    grey_views,
    inner_masks,
    pairwise_distances,
    slice_inverse_distances,
    stack_keypoints,
    to_comparable,
)
from mirrorcam.optics.light_field.features.slope import ViewGeometry
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.features.scenes import Plane, of_planes, uneven_views

NAMES = [
    pytest.param(
        name,
        marks=pytest.mark.skipif(
            name == "AKAZE" and not hasattr(cv2, "xfeatures2d"), reason="needs opencv-contrib-python-headless"
        ),
    )
    for name in get_args(DetectorName)
]
WALL: Plane = (560.0, (0.0, 0.0), None, 1)
BOARD: Plane = (430.0, (0.0, 0.0), (-30.0, -60.0, 55.0, 25.0), 2)
RANGE = (1.0 / 700.0, 1.0 / 380.0)


@pytest.fixture(scope="module")
def light_field() -> LightField:
    complete, _ = of_planes(uneven_views(), [(430.0, (0.2, 0.1), None, 1)])
    samples, weights = complete.samples.copy(), complete.weights.copy()
    weights[..., :100, :120] = 0
    samples[weights == 0] = 0
    return LightField.of(complete, samples, weights)


@pytest.mark.parametrize("name", NAMES)
def test_no_keypoint_stands_at_a_border(light_field: LightField, name: DetectorName) -> None:
    images, masks = grey_views(light_field), inner_masks(light_field)
    found = detect(images, masks, [detector(name, 400) for _ in images], name, map)
    assert len(found) == 9
    for each in found:
        assert len(each.pixels) > 60
        u, v = each.pixels.T
        assert (np.minimum(u, v) >= BORDER_PX - 0.5).all()
        assert (u <= 259.5 - BORDER_PX).all()
        assert (v <= 179.5 - BORDER_PX).all()
        assert not ((u < 119.5 + BORDER_PX) & (v < 99.5 + BORDER_PX)).any()
        assert (each.scale_px >= 1).all()
        assert each.scale_px.min() < 1.3
        assert len(each.descriptors) == len(each.angle) == len(each.pixels)
    plain = detector(name, 400).detect(images[0], None)
    corner = [point.pt for point in plain if abs(point.pt[0] - 120) < 3 or abs(point.pt[1] - 100) < 3]
    assert corner  # masks prevent this


def test_grey_is_the_same_from_colours_bytes_and_floats(light_field: LightField) -> None:
    images = grey_views(light_field)
    assert images.shape == (9, 180, 260)
    assert images.dtype == np.uint8
    floats = LightField.of(light_field, (light_field.samples / np.float32(255)).astype(np.float32), light_field.weights)
    one = LightField.of(light_field, light_field.samples[..., :1], light_field.weights)
    assert (grey_views(floats) == images).all()
    assert (grey_views(one) == images).all()


def test_bits_are_counted() -> None:
    random = np.random.default_rng(1)
    one, other = random.integers(0, 256, (2, 20, 61), dtype=np.uint8)
    expected = np.unpackbits(one ^ other, axis=1).sum(axis=1)
    assert (differing_bits(to_comparable(one), to_comparable(other)) == expected).all()


def test_descriptors_of_sift_are_compared_by_their_angle() -> None:
    random = np.random.default_rng(1)
    one = random.uniform(0, 100, (20, 128)).astype(np.float32)
    unit = to_comparable(one)
    assert np.allclose(np.linalg.norm(unit, axis=1), 1.0, atol=1e-5)
    between = pairwise_distances(unit, to_comparable(3 * one))
    assert np.allclose(np.diagonal(between), 0.0, atol=1e-5)
    assert (between + np.eye(20) > 0.01).all()


@pytest.mark.parametrize("name", NAMES)
def test_an_empty_picture_has_no_keypoints(name: DetectorName) -> None:
    blank = np.full((1, 90, 90), 70, np.uint8)
    (found,) = detect(blank, np.full_like(blank, 255), [detector(name, 100)], name, map)
    assert found.pixels.shape == (0, 2)
    assert found.descriptors.shape[0] == len(found.angle) == len(found.scale_px) == 0


def test_without_its_module_akaze_is_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(cv2, "xfeatures2d", raising=False)
    with pytest.raises(InputError, match="AKAZE is not in this OpenCV: install opencv-contrib-python-headless"):
        detector("AKAZE", 100)


def test_other_detectors_are_refused_in_one_line() -> None:
    with pytest.raises(InputError, match="detector 'SURF', expected ORB, AKAZE"):
        detector("SURF", 100)  # type: ignore[arg-type]  # this must fail


@pytest.fixture(scope="module")
def scene() -> LightField:
    return of_planes(uneven_views(), [WALL, BOARD], noise_grey=1.0)[0]


def found(light_field: LightField, count: int = 400) -> tuple[Keypoints, FloatArray]:
    """Return the keypoints of the stack and their own inverse distances (n,), without competing ones."""
    images = grey_views(light_field)
    everywhere = np.full(images.shape, 255, np.uint8)
    keypoints, rows, inverse_distance = stack_keypoints(
        ViewGeometry.of(light_field), images, everywhere, everywhere[0], RANGE, count
    )
    own = len(keypoints.pixels)
    assert np.array_equal(rows[:own], np.arange(own))
    return keypoints, inverse_distance[:own]


def test_the_slice_of_a_plane_is_the_central_view_with_less_noise() -> None:
    clean, noisy = (of_planes(uneven_views(), [WALL], noise_grey=noise)[0] for noise in (0.0, 8.0))
    images, central = grey_views(noisy), grey_views(clean)[4]
    seen = np.full(images.shape, 255, np.uint8)
    inner = (slice(50, 130), slice(60, 200))
    rms = {
        depth: np.sqrt(np.mean((focal_slice(ViewGeometry.of(noisy), images, seen, 1.0 / depth) - central)[inner] ** 2))
        for depth in (WALL[0], 500.0)
    }
    assert rms[WALL[0]] < 0.6 * np.sqrt(np.mean((images[4].astype(float) - central)[inner] ** 2))
    assert rms[500.0] > 20.0


def test_slices_differ_by_a_pixel_in_the_farthest_view() -> None:
    geometry = ViewGeometry.of(uneven_views())
    slopes = slice_inverse_distances(geometry, RANGE)
    assert slopes[0] == RANGE[0] and slopes[-1] == pytest.approx(RANGE[1])
    step_px = np.diff(slopes) * 800.0 * np.hypot(*geometry.lateral_mm.T).max()
    assert (step_px > 0.8).all() and (step_px <= 1.0 + 1e-9).all()


def test_keypoints_have_the_slopes_of_their_surfaces(scene: LightField) -> None:
    keypoints, inverse_distance = found(scene)
    assert len(inverse_distance) > 150
    off = np.min([np.abs(1.0 / inverse_distance - depth) for depth in (WALL[0], BOARD[0])], axis=0)
    assert np.mean(off < 20.0) > 0.85
    assert np.mean(np.abs(1.0 / inverse_distance - BOARD[0]) < 20.0) > 0.1
    assert keypoints.descriptors.shape == (len(inverse_distance), 128)
    assert np.allclose(np.linalg.norm(keypoints.descriptors, axis=1), 1.0, atol=1e-3)


def test_a_keypoint_is_found_once(scene: LightField) -> None:
    keypoints, _ = found(scene)
    _, counts = np.unique(np.round(keypoints.pixels), axis=0, return_counts=True)
    # Orientations of one are several.
    assert counts.mean() < 1.3
    assert counts.max() <= 4


@pytest.mark.slow
def test_the_strongest_are_kept(scene: LightField) -> None:
    few, many = found(scene, 50), found(scene)
    assert len(few[1]) == 50
    assert np.array_equal(few[0].pixels, many[0].pixels[:50])


@pytest.mark.slow
def test_features_of_the_stack_lie_on_surfaces(scene: LightField) -> None:
    features = FeatureFinder(scene, "SIFT4D").find(scene)
    assert features.detector == "SIFT4D"
    assert len(features) > 120
    distance = features.depth_mm + 80.0
    off = np.min([np.abs(distance / depth - 1.0) for depth in (WALL[0], BOARD[0])], axis=0)
    assert np.mean(off < 0.01) > 0.97


def test_a_blank_scene_has_no_keypoints() -> None:
    views = uneven_views()
    blank = LightField.of(views, np.full((3, 3, 180, 260, 1), 80, np.uint8), np.ones((3, 3, 180, 260), np.float32))
    assert len(found(blank)[1]) == 0
    assert len(FeatureFinder(views, "SIFT4D").find(blank)) == 0
