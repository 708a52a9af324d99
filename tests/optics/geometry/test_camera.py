"""The camera: against OpenCV, its own inverse, and derivatives against differences."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mirrorcam.core.values import InvalidValue
from mirrorcam.optics.geometry.camera import Camera, _newton_step
from tests.optics.geometry.lenses.cameras import camera_of, points

DISTORTIONS = {
    "none": [0.0, 0.0, 0.0, 0.0, 0.0],
    "barrel": [-0.12, 0.03, 1e-3, -2e-3, -0.004],
    "pincushion": [0.1, 0.05, -1e-3, 5e-4, 0.01],
    "folding": [-0.35, 0.02, 5e-4, 5e-4, 0.0],
}


@pytest.fixture(params=list(DISTORTIONS))
def camera(request: pytest.FixtureRequest) -> Camera:
    return camera_of("brown_conrady", DISTORTIONS[request.param])


def test_it_projects_as_opencv_does(camera: Camera) -> None:
    expected, _ = cv2.projectPoints(points(), np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)
    assert np.abs(camera.project(points()) - expected[:, 0]).max() < 1e-9


def test_its_derivatives_are_those_of_opencv(camera: Camera) -> None:
    pixels, d_points, d_intrinsics = camera.project_with_jacobians(points())
    _, jacobian = cv2.projectPoints(points(), np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)
    jacobian = np.asarray(jacobian).reshape(-1, 2, 15)
    # OpenCV's columns: rotation, translation (as d/d point for a board at rest), fx fy cx cy, k1 k2 p1 p2 k3.
    assert np.abs(pixels - camera.project(points())).max() < 1e-12
    assert np.allclose(d_points, jacobian[:, :, 3:6], rtol=1e-9, atol=1e-9)
    assert np.allclose(d_intrinsics, jacobian[:, :, 6:15], rtol=1e-9, atol=1e-9)


def test_its_derivatives_agree_with_differences(camera: Camera) -> None:
    at = points(40)
    _, d_points, d_intrinsics = camera.project_with_jacobians(at)
    for column in range(3):
        step = np.zeros(3)
        step[column] = 1e-4
        difference = (camera.project(at + step) - camera.project(at - step)) / 2e-4
        assert np.allclose(d_points[:, :, column], difference, rtol=1e-6, atol=1e-7)
    for column, name in enumerate(camera.intrinsic_names):
        step = np.zeros(9)
        step[column] = 1e-2 if name.endswith("px") else 1e-6
        there, back = (camera.with_intrinsics(camera.intrinsics + sign * step) for sign in (1, -1))
        difference = (there.project(at) - back.project(at)) / (2 * step[column])
        assert np.allclose(d_intrinsics[:, :, column], difference, rtol=1e-6, atol=1e-6), name


def test_a_pixel_goes_out_and_comes_back(camera: Camera) -> None:
    u, v = np.meshgrid(np.linspace(0, camera.width_px - 1, 33), np.linspace(0, camera.height_px - 1, 21))
    pixels = np.stack([u, v], axis=-1)
    rays = camera.unproject(pixels)
    assert rays.shape == (21, 33, 3)
    assert (rays[..., 2] == 1).all()
    # A lens model that folds does not reach the corners of the sensor: only there, rays are NaN.
    largest = camera.pixels_from_normalized(np.array([0.999 * min(camera.valid_radius, 2.0), 0.0]))[0] - camera.cx_px
    reached = np.linalg.norm(pixels - [camera.cx_px, camera.cy_px], axis=-1) < 0.98 * largest
    assert reached.mean() > 0.8
    assert reached.all() or camera.valid_radius < 2
    assert np.abs(camera.project(rays * 123.0) - pixels)[reached].max() < 1e-8


def test_a_ray_goes_in_and_comes_back(camera: Camera) -> None:
    radius = 0.98 * min(camera.valid_radius, 1.2)
    r, angle = np.meshgrid(np.linspace(0, radius, 30), np.linspace(0, 2 * np.pi, 24))
    normalized = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=-1)
    found = camera.normalized_from_pixels(camera.pixels_from_normalized(normalized))
    assert np.abs(found - normalized).max() < 1e-9


def test_it_undistorts_as_opencv_does(camera: Camera) -> None:
    pixels = camera.project(points())
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-15)
    expected = np.asarray(cv2.undistortPoints(pixels, camera.matrix, camera.distortion, criteria=criteria))
    assert np.abs(camera.normalized_from_pixels(pixels) - expected.reshape(-1, 2)).max() < 1e-6


@pytest.mark.filterwarnings("error")
def test_undistorting_is_quiet_and_one_lost_pixel_loses_no_other(camera: Camera) -> None:
    centre = [camera.cx_px, camera.cy_px]
    found = camera.normalized_from_pixels(np.array([centre, [np.nan, 5.0], [700.0, 300.0]]))
    assert np.abs(found[0]).max() < 1e-12
    assert np.isnan(found[1]).any()
    assert np.isfinite(found[2]).all()
    assert camera.normalized_from_pixels(np.zeros((0, 2))).shape == (0, 2)


def test_what_the_lens_cannot_see_is_nan_not_a_wrong_pixel() -> None:
    folding = Camera(
        width_px=1280, height_px=720, fx_px=900, fy_px=900, cx_px=640, cy_px=360, distortion=DISTORTIONS["folding"]
    )
    radius = folding.valid_radius
    growth = [float(folding.pixels_from_normalized(np.array([r * radius, 0.0]))[0]) for r in (0.5, 0.9, 0.99, 0.9999)]
    assert (np.diff(growth) > 0).all()
    assert np.isnan(folding.pixels_from_normalized(np.array([1.001 * radius, 0.0]))).all()
    assert np.isnan(folding.project(np.array([2 * radius, 0.0, 1.0]))).all()
    # Past the largest distorted radius no ray exists.
    assert np.isnan(folding.unproject(np.array([640 + 900 * 1.5, 360.0]))[:2]).all()
    assert np.isfinite(folding.unproject(np.array([growth[2], 360.0]))).all()


@pytest.mark.parametrize(
    ("distortion", "expected"),
    [
        ([0, 0, 0, 0, 0], np.inf),
        ([0.1, 0, 0, 0, 0], np.inf),
        ([-1 / 3, 0, 0, 0, 0], 1.0),  # 1 - r^2 turns at 1
        ([0, -1 / 5, 0, 0, 0], 1.0),
        ([0, 0, 0, 0, -1 / 7], 1.0),
    ],
)
def test_the_valid_radius_is_where_distortion_turns_back(distortion: list[float], expected: float) -> None:
    assert Camera.c920().replaced(distortion=distortion).valid_radius == pytest.approx(expected)


def test_points_behind_or_in_the_pupil_have_no_pixel(camera: Camera) -> None:
    nowhere = np.array([[0.0, 0.0, -100.0], [10.0, 10.0, 0.0], [np.nan, 0.0, 1.0]])
    assert np.isnan(camera.project(nowhere)).all()
    assert camera.project(np.zeros((0, 3))).shape == (0, 2)
    assert camera.project(np.array([0.0, 0.0, 5.0])) == pytest.approx([camera.cx_px, camera.cy_px])


@given(
    st.lists(st.floats(-0.4, 0.4), min_size=5, max_size=5),
    st.lists(st.tuples(st.floats(-4000, 6000), st.floats(-4000, 6000)), min_size=1, max_size=5),
)
@example([0.0, 0.0, 0.0, 0.0, 2.2e-311], [(0.0, 0.0)])
@example([-2.2e-311, 0.0, 0.0, 0.0, 0.0], [(0.0, 0.0)])
def test_any_pixel_comes_back_to_itself_or_is_nan(distortion: list[float], pixels: list[tuple[float, float]]) -> None:
    distortion[2:4] = [0.05 * distortion[2], 0.05 * distortion[3]]
    any_camera = Camera.c920().replaced(distortion=distortion)
    given_pixels = np.array(pixels)
    back = any_camera.project(any_camera.unproject(given_pixels))
    found = np.isfinite(back).all(axis=1)
    assert np.abs(back - given_pixels)[found].max(initial=0.0) < 1e-5
    centre = np.array([[any_camera.cx_px, any_camera.cy_px]])
    assert np.abs(any_camera.normalized_from_pixels(centre)).max() < 1e-12


def test_the_preset_has_the_published_fields_of_view() -> None:
    camera = Camera.c920()
    assert np.rad2deg(2 * np.arctan(camera.width_px / 2 / camera.fx_px)) == pytest.approx(70.42, abs=0.005)
    assert np.rad2deg(2 * np.arctan(camera.height_px / 2 / camera.fy_px)) == pytest.approx(43.3, abs=0.05)
    diagonal_px = np.hypot(camera.width_px, camera.height_px)
    assert np.rad2deg(2 * np.arctan(diagonal_px / 2 / camera.fx_px)) == pytest.approx(78.0, abs=0.05)
    # The principal point is the sensor's centre, with pixel (0, 0) at a pixel's centre.
    assert (camera.cx_px, camera.cy_px) == (959.5, 539.5)


def test_intrinsics_are_taken_apart_and_put_together(camera: Camera) -> None:
    assert len(camera.intrinsics) == len(camera.intrinsic_names) == 9
    assert camera.with_intrinsics(camera.intrinsics) == camera
    changed = camera.with_intrinsics(camera.intrinsics + np.arange(9))
    assert changed.fx_px == camera.fx_px
    assert changed.cy_px == camera.cy_px + 3
    assert changed.distortion[4] == camera.distortion[4] + 8
    assert (changed.width_px, changed.height_px, changed.name) == (camera.width_px, camera.height_px, camera.name)


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"width_px": 0}, "width_px"),
        ({"height_px": 1080.5}, "height_px"),
        ({"fx_px": -1.0}, "fx_px"),
        ({"fy_px": float("nan")}, "fy_px"),
        ({"cx_px": float("inf")}, "cx_px"),
        ({"distortion": [0.0, 0.0, 0.0, 0.0]}, "distortion"),
        ({"distortion": [0.0, 0.0, 0.0, 0.0, float("nan")]}, "distortion"),
        ({"skew": 0.0}, "skew"),
    ],
)
def test_cameras_refuse_by_name(changes: dict[str, Any], where: str) -> None:
    with pytest.raises(InvalidValue) as caught:
        Camera.c920().replaced(**changes)
    assert caught.value.first is not None
    assert caught.value.first["loc"] == (where,)


def test_a_body_is_a_box() -> None:
    with pytest.raises(InvalidValue, match="the box's minimum corner, then its maximum"):
        Camera.c920().replaced(body_mm=((0.0, 0.0, 0.0), (1.0, -1.0, 1.0)))


def test_a_camera_survives_json_to_the_bit(camera: Camera) -> None:
    back = Camera.model_validate_json(camera.model_dump_json())
    assert back == camera
    assert back.intrinsics.tobytes() == camera.intrinsics.tobytes()


def test_a_binned_camera_sees_each_point_at_the_same_place_of_its_sensor() -> None:
    camera = Camera.c920().replaced(cx_px=931.25, cy_px=566.5, distortion=[0.05, -0.1, 1e-3, -1e-3, 0.01])
    half = camera.binned(0.5)
    assert (half.width_px, half.height_px) == (960, 540)
    points = np.random.default_rng(0).uniform([-200, -100, 300], [200, 100, 600], (50, 3))
    np.testing.assert_allclose((half.project(points) + 0.5) * 2.0 - 0.5, camera.project(points), atol=1e-9)


def test_a_singular_step_is_lost_and_no_other() -> None:
    by_point = np.stack([np.diag([2.0, 4.0]), np.ones((2, 2)), np.full((2, 2), np.nan), np.zeros((2, 2))])
    steps = _newton_step(by_point, np.ones((4, 2)))
    np.testing.assert_array_equal(steps[0], [0.5, 0.25])
    assert np.isnan(steps[1:]).all()
