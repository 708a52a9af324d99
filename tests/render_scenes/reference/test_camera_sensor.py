"""The Mitsuba sensor looks along exactly the rays of the camera."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lenses.families import LensName
from mirrorcam.optics.geometry.nearest_lens import with_lens
from mirrorcam.optics.geometry.pupil import Pupil
from mirrorcam.render_scenes.lens import true_camera
from mirrorcam.render_scenes.reference.camera_sensor import sensor
from mirrorcam.render_scenes.settings import SENSORS
from mirrorcam.render_scenes.variant import use_variant
from tests.optics.geometry.lenses.cameras import LENSES as ANY_LENS
from tests.optics.geometry.lenses.cameras import camera_of

LENSES = {
    "pinhole": (0.0, 0.0, 0.0, 0.0, 0.0),
    "barrel": (-0.25, 0.06, 0.0, 0.0, 0.0),
    "pincushion": (0.12, 0.05, 0.0, 0.0, 0.0),
    "all": (0.08, -0.18, 0.001, -0.0005, 0.02),
    "decentred": (0.05, -0.1, 0.003, -0.002, 0.0),
}


def directions(camera: Camera, px: FloatArray, crop: tuple[int, int, int, int]) -> FloatArray:
    """Directions (n, 3), z = 1, of the sensor's rays through pixels (n, 2) of a crop."""
    import mitsuba as mi

    x, y, width, height = crop
    relative = (px + 0.5 - [x, y]) / [width, height]
    ray, weight = sensor(camera, crop=crop).sample_ray(
        0.0, 0.5, mi.Point2f(relative.T.astype(np.float32)), mi.Point2f(0.5)
    )
    np.testing.assert_array_equal(np.array(ray.o), 0.0)
    np.testing.assert_array_equal(np.array(weight), 1.0)
    found = np.array(ray.d, dtype=np.float64).T
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-6)
    return found / found[:, 2:]


@pytest.mark.parametrize("lens", LENSES)
def test_rays_are_those_of_the_camera_to_a_thousandth_of_a_pixel(lens: str) -> None:
    use_variant()
    camera = Camera.c920().replaced(distortion=LENSES[lens])
    grid = np.stack(np.meshgrid(np.linspace(-0.5, 1919.5, 33), np.linspace(-0.5, 1079.5, 19)), axis=-1).reshape(-1, 2)
    found = directions(camera, grid, (0, 0, 1920, 1080))
    np.testing.assert_allclose(camera.project(found), grid, atol=1e-3, rtol=0)


@pytest.mark.parametrize("model", ["rational", "thin_prism", "fisheye"])
def test_rays_of_every_lens_are_those_of_the_camera(model: LensName) -> None:
    use_variant()
    camera = camera_of(model, ANY_LENS[model][-1])
    grid = np.random.default_rng(0).uniform(-0.5, [1279.5, 719.5], (500, 2))
    found = directions(camera, grid, (0, 0, 1280, 720))
    np.testing.assert_allclose(camera.project(found), grid, atol=1e-3, rtol=0)


def test_rays_of_a_spline_lens_are_those_of_the_camera() -> None:
    use_variant()
    camera = with_lens(camera_of("brown_conrady", [0.05, -0.12, 4e-4, -6e-4, 0.01]), "spline")
    field = 5e-4 * np.random.default_rng(1).standard_normal(len(camera.distortion) - 5)
    camera = camera.replaced(distortion=np.append(camera.distortion[:5], field))
    grid = np.random.default_rng(0).uniform(-0.5, [1279.5, 719.5], (500, 2))
    found = directions(camera, grid, (0, 0, 1280, 720))
    np.testing.assert_allclose(camera.project(found), grid, atol=1e-3, rtol=0)


def test_the_centre_of_a_pixel_is_where_opencv_puts_it() -> None:
    use_variant()
    camera = Camera(width_px=100, height_px=80, fx_px=90.0, fy_px=90.0, cx_px=30.0, cy_px=20.0)
    found = directions(camera, np.array([[30.0, 20.0], [0.0, 0.0]]), (0, 0, 100, 80))
    np.testing.assert_allclose(found[:, :2], [[0.0, 0.0], [-30 / 90, -20 / 90]], atol=1e-6)


def test_a_crop_looks_the_same_way_as_the_whole_sensor() -> None:
    use_variant()
    camera = Camera.c920().replaced(distortion=LENSES["all"])
    px = np.random.default_rng(0).uniform([400, 700], [600, 900], (50, 2))
    whole, crop = directions(camera, px, (0, 0, 1920, 1080)), directions(camera, px, (400, 700, 200, 200))
    np.testing.assert_allclose(crop, whole, atol=2e-7)


def test_the_rays_of_a_pixel_start_all_over_the_pupil_and_meet_in_focus() -> None:
    use_variant()
    import mitsuba as mi

    camera = Camera.c920().replaced(distortion=LENSES["all"])
    lens = sensor(camera, pupil=Pupil(1.8, 450.0), near_mm=3.0)
    places = np.random.default_rng(0).random((2, 5000)).astype(np.float32)
    ray = lens.ray_through(mi.Float(300.5), mi.Float(801.5), mi.Float(places[0]), mi.Float(places[1]))
    start, direction = np.array(ray.o, dtype=np.float64).T, np.array(ray.d, dtype=np.float64).T
    np.testing.assert_allclose(start[:, 2], 3.0, atol=1e-6)
    direction /= direction[:, 2:]
    pupil = start - start[:, 2:] * direction
    radius = np.linalg.norm(pupil[:, :2], axis=1)
    assert 0.88 < radius.max() < 0.9 + 1e-5
    np.testing.assert_allclose(pupil[:, :2].mean(axis=0), 0.0, atol=0.03)
    np.testing.assert_allclose((radius**2).mean(), 0.9**2 / 2.0, rtol=0.03)
    met = pupil + 450.0 * direction
    np.testing.assert_allclose(
        met, np.broadcast_to(450.0 * camera.unproject(np.array([300.0, 801.0])), met.shape), atol=2e-3
    )


def test_rays_of_a_pupil_that_walks_start_where_it_is_and_meet_in_focus() -> None:
    use_variant()
    import mitsuba as mi

    camera, pupil = Camera.c920().replaced(distortion=LENSES["all"]), Pupil(1.8, 400.0, 0.5)
    px = np.array([[960.0, 540.0], [100.0, 200.0], [1800.0, 1000.0]])
    relative = mi.Point2f(((px + 0.5) / [1920, 1080]).T.astype(np.float32))
    x, y = camera.normalized_from_pixels(px).T
    in_focus = 400.0 * np.column_stack([x, y, np.ones(3)])
    starts = []
    for u, v in ((0.5, 0.5), (0.1, 0.7), (0.9, 0.3)):
        ray, _ = sensor(camera, pupil=pupil).sample_ray(0.0, 0.5, relative, mi.Point2f(u, v))
        start, along = (np.array(values, dtype=np.float64).T for values in (ray.o, ray.d))
        length = (400.0 - start[:, 2]) / along[:, 2]
        np.testing.assert_allclose(start + length[:, None] * along, in_focus, atol=2e-4)
        starts.append(start + 0.5 * (x**2 + y**2)[:, None] / along[:, 2:] * along)
    # In the plane of the pupil of each pixel, the centre is on the axis.
    np.testing.assert_allclose(starts[0][:, :2], 0.0, atol=1e-5)
    assert (np.linalg.norm(starts[1][:, :2], axis=1) <= 0.9).all()
    assert (np.linalg.norm(starts[1][:, :2], axis=1) > 0.3).all()


def test_rays_of_a_lens_off_its_model_are_off_it_by_the_same_waves() -> None:
    use_variant()
    camera = true_camera(Camera.c920().replaced(distortion=LENSES["all"]), SENSORS["ideal"].replaced(lens_waves_px=0.5))
    grid = np.stack(np.meshgrid(np.linspace(0.0, 1919.0, 33), np.linspace(0.0, 1079.0, 19)), axis=-1).reshape(-1, 2)
    found = directions(camera, grid, (0, 0, 1920, 1080))
    np.testing.assert_allclose(camera.project(found), grid, atol=1e-3, rtol=0)
