"""Projection that depends on depth, by a pupil that walks and a picture that grows out of focus."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.truth.light_rays import image_px
from tests.optics.geometry.lenses.cameras import points


def camera(walk_mm: float | None = None, growth_mm2: float | None = None) -> Camera:
    lens = Camera.c920().replaced(distortion=[-0.12, 0.03, 1e-3, -2e-3, -0.004])
    return lens.replaced(pupil_walk_mm=walk_mm, defocus_growth_mm2=growth_mm2)


@pytest.mark.parametrize("walk_mm", [-3.0, 1.7, 20.0])
def test_points_of_a_chief_ray_have_one_pixel(walk_mm: float) -> None:
    pixels = np.array([[100.0, 900.0], [960.0, 540.0], [1900.0, 5.0]])
    across = camera(walk_mm).normalized_from_pixels(pixels)
    pupil_z = walk_mm * np.square(across).sum(axis=1)
    in_focus = 500.0 * np.column_stack([across, np.ones(3)])
    for part in (0.3, 1.0, 2.5):
        points = (1.0 - part) * pupil_z[:, None] * [0.0, 0.0, 1.0] + part * in_focus
        np.testing.assert_allclose(camera(walk_mm).project(points), pixels, atol=1e-9)


def test_it_is_the_pupil_of_the_truth() -> None:
    plain = camera()
    expected = image_px(camera(1.7), None, points())
    assert np.abs(camera(1.7).project(points()) - expected).max() < 1e-6
    assert np.abs(plain.project(points()) - expected).max() > 0.1


def test_a_picture_grows_with_the_square_of_defocus() -> None:
    plain, growing = camera(), camera(growth_mm2=2000.0)
    ray = np.array([0.3, -0.2, 1.0])
    for depth in (250.0, 500.0, 1000.0):
        factor = 1.0 + 2000.0 * (1.0 / depth - 1.0 / 500.0) ** 2
        np.testing.assert_allclose(growing.project(depth * ray), plain.project(ray * [factor, factor, 1.0]), atol=1e-9)


@pytest.mark.parametrize("lens", [camera(1.7), camera(growth_mm2=2000.0), camera(1.7, 2000.0)])
def test_derivatives_agree_with_differences(lens: Camera) -> None:
    at = points(40)
    pixels, d_points, d_intrinsics = lens.project_with_jacobians(at)
    np.testing.assert_allclose(pixels, lens.project(at), atol=1e-10)

    def differences(step: float, ahead: FloatArray, behind: FloatArray) -> FloatArray:
        return np.asarray((ahead - behind) / (2.0 * step))

    for column in range(3):
        step = 1e-4 * np.eye(3)[column]
        expected = differences(1e-4, lens.project(at + step), lens.project(at - step))
        np.testing.assert_allclose(d_points[:, :, column], expected, rtol=1e-6, atol=1e-7)
    for column, name in enumerate(lens.intrinsic_names):
        size = 1e-2 if name.endswith(("px", "mm", "mm2")) else 1e-6
        there, back = (
            lens.with_intrinsics(lens.intrinsics + s * size * np.eye(len(lens.intrinsics))[column]) for s in (1, -1)
        )
        expected = differences(size, there.project(at), back.project(at))
        np.testing.assert_allclose(d_intrinsics[:, :, column], expected, rtol=1e-6, atol=1e-6)


def test_a_walk_and_a_growth_of_zero_change_nothing() -> None:
    rest, walks = camera(), camera(0.0, 0.0)
    np.testing.assert_allclose(walks.project(points()), rest.project(points()), atol=1e-10)
    np.testing.assert_allclose(
        walks.project_with_jacobians(points())[1], rest.project_with_jacobians(points())[1], rtol=1e-9
    )


def test_points_behind_the_pupil_have_no_pixel() -> None:
    for lens in (camera(1.7), camera(growth_mm2=2.0)):
        assert np.isnan(lens.project(np.array([[1.0, 1.0, -5.0], [1.0, 0.0, 0.0]]))).all()
