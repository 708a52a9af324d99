"""The spline lens: derivatives against differences, the inverse, smoothness, and waves that it can fit."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lenses.spline import LensGrid, Spline
from mirrorcam.optics.geometry.nearest_lens import nearest_lens, with_lens
from mirrorcam.render_scenes.lens import WavyCamera
from tests.optics.geometry.lenses.cameras import LENSES, assert_comes_back, assert_derivatives, camera_of, points

PLAIN = camera_of("brown_conrady", [0.05, -0.12, 4e-4, -6e-4, 0.01])


def waving(size: float = 1e-3) -> Camera:
    """A camera whose field is random, about a pixel."""
    empty = with_lens(PLAIN, "spline")
    field = size * np.random.default_rng(0).standard_normal(len(empty.distortion) - 5)
    return empty.replaced(distortion=np.append(PLAIN.distortion, field))


def test_without_a_field_it_is_the_plain_lens() -> None:
    empty = with_lens(PLAIN, "spline")
    np.testing.assert_allclose(empty.project(points()), PLAIN.project(points()), atol=1e-11)
    assert empty.lens_grid is not None
    assert (empty.lens_grid.cols, empty.lens_grid.rows) == (15, 10)
    assert with_lens(empty, "brown_conrady") == PLAIN


def test_derivatives_are_those_of_differences_and_pixels_come_back() -> None:
    camera = waving()
    assert np.abs(camera.project(points()) - PLAIN.project(points())).max() > 0.5
    assert_derivatives(camera, points(60))
    assert_comes_back(camera)
    assert Camera.model_validate_json(camera.model_dump_json()) == camera


def test_its_field_is_a_partition_of_unity_and_smooth_across_cells() -> None:
    lens = waving().lens
    assert isinstance(lens, Spline)
    grid = lens.grid
    same = Spline(np.append(np.zeros(5), np.full(2 * grid.count, 0.01)), grid)
    x = np.linspace(-0.6, 0.6, 50)
    np.testing.assert_allclose(same.distorted(x, 0.3 * x), [x + 0.01, 0.3 * x + 0.01], atol=1e-15)
    # Second differences of a twice differentiable function are continuous, its third ones bounded.
    fine = np.linspace(-0.6, 0.6, 20001)
    second = np.diff(lens.distorted(fine, 0.1 + 0.0 * fine)[0], 2) / np.diff(fine[:2]) ** 2
    assert np.abs(np.diff(second)).max() < 0.01 * np.ptp(second)


def test_beyond_its_grid_the_field_stays() -> None:
    lens = Spline(np.append(np.zeros(5), np.full(2 * 16, 0.01)), LensGrid(cols=4, rows=4, reach_x=0.3, reach_y=0.3))
    assert lens.distorted(np.array([2.0]), np.array([0.0]))[0] == pytest.approx(2.01)


def test_a_field_that_folds_ends_where_it_does() -> None:
    empty = with_lens(PLAIN, "spline")
    assert empty.valid_radius == PLAIN.valid_radius
    folding = waving(0.3)
    assert 0.0 < folding.valid_radius < 0.9
    assert np.isnan(folding.project(np.array([folding.valid_radius * 1.01, 0.0, 1.0]))).all()


def test_it_follows_waves_that_no_formula_has() -> None:
    wavy = WavyCamera(**PLAIN.model_dump(), waves_px=0.3)
    random = np.random.default_rng(1)
    some, others = (random.uniform([-0.5, -0.5], [1279.5, 719.5], (2000, 2)) for _ in range(2))
    empty = with_lens(PLAIN, "spline")
    _, _, by_intrinsics = empty.project_with_jacobians(wavy.unproject(some))
    columns, off = by_intrinsics[:, :, 9:].reshape(4000, -1), some - PLAIN.project(wavy.unproject(some))
    assert np.sqrt(np.mean(off**2)) > 0.25
    field = np.linalg.lstsq(columns, off.ravel(), rcond=1e-6)[0]
    fitted = empty.replaced(distortion=np.append(PLAIN.distortion, field))
    assert np.sqrt(np.mean((fitted.project(wavy.unproject(others)) - others) ** 2)) < 0.01


def test_the_nearest_formula_is_near_a_mild_field_and_the_nearest_field_near_a_formula() -> None:
    camera = waving(2e-5)
    assert nearest_lens(camera, "thin_prism")[1] < 0.1
    rational = camera_of("rational", LENSES["rational"][0])
    assert nearest_lens(rational, "spline")[1] < 0.01
