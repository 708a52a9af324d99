"""Sphere models where they are one another, or a pinhole; and what they do not show."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.sphere_lens import SphereLens, SphereName
from mirrorcam.optics.geometry.camera import Camera

CAMERA = Camera(
    width_px=640, height_px=480, fx_px=300.0, fy_px=310.0, cx_px=320.0, cy_px=240.0, distortion=[0.02, 0.0, 1e-3, 0, 0]
)


def rays() -> FloatArray:
    return np.random.default_rng(0).uniform([-0.8, -0.8, 0.5], [0.8, 0.8, 2.0], (60, 3))


def shown(model: SphereName, *numbers: float) -> FloatArray:
    return SphereLens(model, np.array(numbers), CAMERA).project(rays())


@pytest.mark.parametrize(
    ("model", "numbers"), [("unified", (0.0,)), ("extended_unified", (0.0, 1.3)), ("double_sphere", (0.0, 0.0))]
)
def test_without_a_sphere_they_are_pinholes(model: SphereName, numbers: tuple[float, ...]) -> None:
    np.testing.assert_allclose(shown(model, *numbers), CAMERA.project(rays()), atol=1e-9)


@pytest.mark.parametrize("alpha", [0.2, 0.5, 0.8])
def test_they_are_one_another(alpha: float) -> None:
    """alpha d + (1 - alpha) z of both, and (1 - alpha) (z + xi d) of the unified one with xi = alpha / (1 - alpha)."""
    extended = shown("extended_unified", alpha, 1.0)
    np.testing.assert_allclose(shown("double_sphere", 0.0, alpha), extended, atol=1e-9)
    scaled = CAMERA.replaced(distortion=[0.0] * 5)
    factor = 1.0 - alpha
    unified = SphereLens(
        "unified", np.array([alpha / factor]), scaled.replaced(fx_px=300.0 / factor, fy_px=310.0 / factor)
    )
    plain = SphereLens("extended_unified", np.array([alpha, 1.0]), scaled)
    np.testing.assert_allclose(unified.project(rays()), plain.project(rays()), atol=1e-9)


@pytest.mark.parametrize(
    ("model", "numbers"), [("unified", (0.8,)), ("extended_unified", (0.6, 1.1)), ("double_sphere", (-0.2, 0.55))]
)
def test_rays_from_behind_are_not_shown(model: SphereName, numbers: tuple[float, ...]) -> None:
    lens = SphereLens(model, np.array(numbers), CAMERA)
    found = lens.project(np.array([[0.0, 0.0, 1.0], [0.01, 0.0, -1.0], [0.0, 0.0, 0.0]]))
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1:]).all()


def test_parameters_are_those_of_sphere_and_camera() -> None:
    lens = SphereLens("double_sphere", np.array([-0.2, 0.55]), CAMERA)
    assert lens.intrinsic_names[:4] == ("xi", "alpha", "fx_px", "fy_px")
    other = lens.with_intrinsics(lens.intrinsics + 0.01)
    np.testing.assert_allclose(other.intrinsics, lens.intrinsics + 0.01)
