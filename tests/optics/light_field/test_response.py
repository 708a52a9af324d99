"""The exponent of grey levels over light: from light fields whose borders are known to fade."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.optics.light_field.light_field import LightField, Views
from mirrorcam.optics.light_field.response import Fading, measured_exponent


def faded(views: Views, exponent: float, *, seed: int = 0, kind: type = np.uint8, least: float = 0.4) -> LightField:
    """A light field of a texture, whose left border of 20 px fades; brightened as one of a linear camera."""
    shape = views.rows, views.cols, views.height_px, views.width_px
    random = np.random.default_rng(seed)
    coarse = random.uniform(40.0, 120.0, (views.rows * views.cols, views.height_px // 8, views.width_px // 8))
    texture = np.stack([cv2.resize(each, (views.width_px, views.height_px)) for each in coarse]).reshape(shape)
    share = np.broadcast_to(np.clip(least + np.arange(views.width_px) * 0.03, 0.0, 1.0), shape).astype(np.float32)
    frame = np.rint(texture * share**exponent + random.normal(0.0, 1.0, shape))
    samples = np.clip(frame / share, 0.0, 255.0)[..., None]
    samples = np.rint(samples).astype(np.uint8) if kind is np.uint8 else (samples / 255.0).astype(np.float32)
    return LightField.of(views, samples, share)


@pytest.fixture(scope="module")
def views() -> Views:
    across, down = np.meshgrid([-20.0, 0.0, 20.0], [-20.0, 0.0, 20.0])
    return Views(
        positions_mm=np.stack([across, down, 0.0 * across], axis=-1),
        focal_px=600.0,
        centre_px=np.array([119.5, 79.5]),
        width_px=240,
        height_px=160,
        reference_depth_mm=400.0,
        reference_view_in_rig_mm=np.array([0.0, -80.0, 90.0]),
        view_from_rig=np.eye(3),
        layout_identity="0" * 16,
    )


@pytest.mark.parametrize("exponent", [1.0 / 2.2, 0.7, 1.3])
@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_an_exponent_is_found(views: Views, exponent: float, kind: type) -> None:
    found = measured_exponent([Fading.of(faded(views, exponent, seed=seed, kind=kind)) for seed in range(2)])
    assert found == pytest.approx(exponent, abs=0.03)


def test_a_linear_camera_is_taken_for_one(views: Views) -> None:
    assert measured_exponent([Fading.of(faded(views, 1.0))]) == 1.0


def test_nothing_is_concluded_from_nothing(views: Views) -> None:
    assert measured_exponent([Fading.of(faded(views, 0.5, least=1.0))]) == 1.0
    light_field = faded(views, 0.5)
    dark = LightField.of(views, np.zeros_like(light_field.samples), light_field.weights)
    none = LightField.of(views, light_field.samples, np.zeros_like(light_field.weights))
    assert measured_exponent([Fading.of(dark), Fading.of(none)]) == 1.0
