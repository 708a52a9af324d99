"""Cameras in another lens model: exact if it contains the lens, else with the error of the fit."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lenses.families import LensName
from mirrorcam.optics.geometry.nearest_lens import nearest_lens, with_lens
from tests.optics.geometry.lenses.cameras import LENSES, camera_of, points


def test_a_larger_model_is_the_same_camera() -> None:
    plain = camera_of("brown_conrady", [0.1, -0.2, 3e-4, -5e-4, 0.05])
    prism = with_lens(with_lens(plain, "rational"), "thin_prism")
    np.testing.assert_array_equal(prism.project(points()), plain.project(points()))
    assert with_lens(prism, "brown_conrady") == plain
    assert not with_lens(plain, "fisheye").distortion.any()


@pytest.mark.parametrize(("model", "lens"), [("rational", 0), ("thin_prism", 0), ("fisheye", 1)])
def test_the_nearest_lens_is_off_by_no_more_than_it_says(model: LensName, lens: int) -> None:
    camera = camera_of(model, LENSES[model][lens])
    part = np.array([100.0, 80.0]), np.array([500.0, 400.0])
    near, error_px = nearest_lens(camera, "brown_conrady", part)
    pixels = np.random.default_rng(0).uniform(*part, (500, 2))
    off = np.linalg.norm(near.project(camera.unproject(pixels)) - pixels, axis=1)
    assert 0.1 * error_px < off.max() <= 1.01 * error_px < 0.2
    whole = nearest_lens(camera, "brown_conrady")[1]
    assert whole > error_px
    assert nearest_lens(camera, model) == (camera, 0.0)


def test_what_a_format_lacks_stays_zero() -> None:
    camera = camera_of("brown_conrady", [0.1, -0.2, 3e-4, -5e-4, 0.05])
    near, error_px = nearest_lens(camera, "brown_conrady", zero=("k3", "p1"))
    assert near.distortion[[2, 4]].tolist() == [0.0, 0.0]
    assert 0.01 < error_px < 2.0


def test_a_part_that_no_ray_reaches_is_refused() -> None:
    folding = Camera.c920().replaced(distortion=[-0.9, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="its lens is not defined from pixel"):
        nearest_lens(folding, "rational", (np.array([0.0, 0.0]), np.array([50.0, 50.0])))
