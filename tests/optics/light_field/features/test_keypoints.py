"""Keypoints stay where views show something, and descriptors are compared as meant."""

from __future__ import annotations

from typing import get_args

import cv2
import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.light_field.features.keypoints import (
    BORDER_PX,
    DetectorName,
    comparable,
    detect,
    detector,
    distances,
    grey_views,
    inner_masks,
)
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.features.scenes import of_planes, uneven_views

NAMES = [
    pytest.param(
        name,
        marks=pytest.mark.skipif(
            name == "AKAZE" and not hasattr(cv2, "xfeatures2d"), reason="needs opencv-contrib-python-headless"
        ),
    )
    for name in get_args(DetectorName)
]


@pytest.fixture(scope="module")
def light_field() -> LightField:
    whole, _ = of_planes(uneven_views(), [(430.0, (0.2, 0.1), None, 1)])
    samples, weights = whole.samples.copy(), whole.weights.copy()
    weights[..., :100, :120] = 0
    samples[weights == 0] = 0
    return LightField.of(whole, samples, weights)


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
    assert corner  # what the masks are for


def test_grey_is_the_same_of_colours_bytes_and_floats(light_field: LightField) -> None:
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
    assert (distances(comparable(one), comparable(other)) == expected).all()


def test_descriptors_of_sift_are_compared_by_their_angle() -> None:
    random = np.random.default_rng(1)
    one = random.uniform(0, 100, (20, 128)).astype(np.float32)
    unit = comparable(one)
    assert np.allclose(np.linalg.norm(unit, axis=1), 1.0, atol=1e-5)
    assert np.allclose(distances(unit, comparable(3 * one)), 0.0, atol=1e-5)
    assert distances(unit, unit[::-1].copy()).min() > 0.01


@pytest.mark.parametrize("name", NAMES)
def test_an_empty_picture_has_no_keypoints(name: DetectorName) -> None:
    blank = np.full((1, 90, 90), 70, np.uint8)
    (found,) = detect(blank, np.full_like(blank, 255), [detector(name, 100)], name, map)
    assert found.pixels.shape == (0, 2)
    assert found.descriptors.shape[0] == len(found.angle) == len(found.scale_px) == 0


def test_without_its_module_akaze_is_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(cv2, "xfeatures2d", raising=False)
    with pytest.raises(InputError, match="AKAZE is not in this OpenCV, expected opencv-contrib-python-headless"):
        detector("AKAZE", 100)


def test_other_detectors_are_refused_in_one_line() -> None:
    with pytest.raises(InputError, match="detector 'SURF', expected SIFT, ORB, AKAZE"):
        detector("SURF", 100)  # type: ignore[arg-type]  # the very thing that must fail
