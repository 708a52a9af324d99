"""The geometry of parallel views, against an ordinary pinhole at each view's position."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, fields
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.layout import FOLD_90_VIEW_FROM_RIG
from mirrorcam.optics.light_field.light_field import LightField, Views

ROWS, COLS, HEIGHT, WIDTH = 2, 3, 40, 60
TURN = np.array(FOLD_90_VIEW_FROM_RIG)


def views(**changes: Any) -> Views:
    """Return 2x3 views, uneven in all three axes; the reference view is 90 mm above and behind the pupil."""
    positions = np.stack(np.meshgrid([-20.0, 0.0, 20.0], [-15.0, 0.0]), axis=-1)
    positions = np.concatenate([positions, np.zeros((ROWS, COLS, 1))], axis=-1)
    positions += np.array([[[1, 2, -3], [2, -1, 1.5], [-2, 1, 2]], [[0.5, -1, 2.5], [0, 0, 0], [1.5, 1, -2]]])
    given: dict[str, Any] = {
        "positions_mm": positions,
        "focal_px": 500.0,
        "centre_px": np.array([28.0, 21.5]),
        "width_px": WIDTH,
        "height_px": HEIGHT,
        "reference_depth_mm": 400.0,
        "reference_view_in_rig_mm": np.array([2.0, -80.0, 90.0]),
        "view_from_rig": TURN,
        "layout_identity": "0123456789abcdef",
    }
    return Views(**(given | changes))


def light_field(**changes: Any) -> LightField:
    given: dict[str, Any] = {
        "samples": np.full((ROWS, COLS, HEIGHT, WIDTH, 3), 77, np.uint8),
        "weights": np.ones((ROWS, COLS, HEIGHT, WIDTH), np.float32),
    }
    return LightField.of(views(), **(given | changes))


def points_in_rig(count: int, depths_mm: tuple[float, float]) -> FloatArray:
    random = np.random.default_rng(2)
    x, up = random.uniform(-60, 60, (2, count))
    return np.stack([x, random.uniform(*depths_mm, count), up + 90], axis=1)


def test_every_view_is_a_pinhole_at_its_own_position_with_its_own_matrix() -> None:
    grid = views()
    points = points_in_rig(50, (250.0, 900.0))
    found = grid.project(points)
    assert found.shape == (ROWS, COLS, 50, 2)
    for t, s in np.ndindex(ROWS, COLS):
        place = TURN @ grid.reference_view_in_rig_mm + grid.positions_mm[t, s]
        homogeneous = (points @ TURN.T - place) @ grid.matrices[t, s].T
        assert np.allclose(found[t, s], homogeneous[:, :2] / homogeneous[:, 2:], rtol=0, atol=1e-9)


def test_the_reference_view_has_the_plain_intrinsics() -> None:
    grid = views()
    assert np.allclose(grid.matrices[1, 1], [[500.0, 0.0, 28.0], [0.0, 500.0, 21.5], [0.0, 0.0, 1.0]])
    assert grid.reference_distance_mm == pytest.approx(400.0 + 80.0)


def test_disparity_is_zero_everywhere_on_the_reference_plane() -> None:
    grid = views()
    pixels = grid.project(points_in_rig(50, (400.0, 400.0)))
    assert np.abs(pixels - pixels[1, 1]).max() < 1e-9


def test_without_steps_along_z_the_pixel_follows_the_formula() -> None:
    positions = views().positions_mm.copy()
    positions[..., 2] = 0
    grid = views(positions_mm=positions)
    points = points_in_rig(50, (250.0, 900.0))
    x, y, z = (points @ TURN.T - TURN @ grid.reference_view_in_rig_mm).T
    shift = positions[:, :, None, :2] * (1 / grid.reference_distance_mm - 1 / z)[:, None] * grid.focal_px
    plain = grid.focal_px * np.stack([x / z, y / z], axis=1) + grid.centre_px
    assert np.allclose(grid.project(points), plain + shift, rtol=0, atol=1e-9)


def test_disparity_is_minus_the_slope_and_positive_at_nearer_depths() -> None:
    positions = np.zeros((ROWS, COLS, 3))
    positions[..., 0] = [-20.0, 0.0, 20.0]
    positions[..., 1] = [[-15.0], [0.0]]
    grid = views(positions_mm=positions)
    for depth in (250.0, 400.0, 900.0):
        pixels = grid.project(np.array([5.0, depth, 80.0]))
        along_s = float(grid.disparity_px_from_depth(depth))
        along_t = float(grid.disparity_px_from_depth(depth, "t"))
        assert np.allclose(np.diff(pixels[..., 0], axis=1), -along_s, atol=1e-9)
        assert np.allclose(np.diff(pixels[..., 1], axis=0), -along_t, atol=1e-9)
        assert np.sign(along_s) == np.sign(along_t) == np.sign(400.0 - depth)
    assert grid.step_mm("s") == 20.0
    assert grid.step_mm("t") == 15.0


@pytest.mark.parametrize("axis", ["s", "t"])
def test_depth_and_disparity_are_inverse(axis: Any) -> None:
    grid = views()
    depths = np.array([150.0, 400.0, 800.0, 1e5])
    disparity = grid.disparity_px_from_depth(depths, axis)
    assert np.all(np.diff(disparity) < 0)
    assert np.allclose(grid.depth_mm_from_disparity(disparity, axis), depths, rtol=1e-9)


def test_disparity_of_infinity_and_beyond() -> None:
    grid = views()
    at_infinity = -grid.focal_px * grid.step_mm() / grid.reference_distance_mm
    assert grid.depth_mm_from_disparity(at_infinity) == np.inf
    assert np.isnan(grid.depth_mm_from_disparity(at_infinity - 0.5))
    assert grid.disparity_px_from_depth(np.inf) == pytest.approx(at_infinity)


def test_a_single_row_has_no_step_along_t() -> None:
    grid = views(positions_mm=views().positions_mm[1:])
    with pytest.raises(ValueError, match="one view along t, expected at least two"):
        grid.disparity_px_from_depth(300.0, "t")


def test_points_behind_a_view_have_no_pixel() -> None:
    pixels = views().project(np.array([[0.0, 400.0, 90.0], [0.0, -300.0, 90.0]]))
    assert np.isfinite(pixels[:, :, 0]).all()
    assert np.isnan(pixels[:, :, 1]).all()


def test_pixels_survive_the_round_trip_to_a_plane() -> None:
    grid = views()
    pixels = grid.pixel_grid()
    assert pixels.shape == (HEIGHT, WIDTH, 2)
    assert tuple(pixels[5, 7]) == (7.0, 5.0)
    for depth in (300.0, 400.0, 700.0):
        points = grid.plane_points_in_rig(depth, pixels)
        assert np.allclose(points[..., 1], depth)
        assert np.allclose(grid.project(points)[1, 1], pixels, atol=1e-9)


def test_impossible_views_are_refused() -> None:
    with pytest.raises(ValueError, match=r"shape \(2, 3\), expected \(n, n, 3\)"):
        views(positions_mm=np.zeros((2, 3)))
    with pytest.raises(ValueError, match="NaN or infinite"):
        views(centre_px=np.array([np.nan, 1.0]))
    with pytest.raises(ValueError, match="focal_px"):
        views(focal_px=-1.0)
    with pytest.raises(ValueError, match="reference_depth_mm"):
        views(reference_depth_mm=np.nan)
    with pytest.raises(ValueError, match=r"depth -79\.0 mm lies behind a view"):
        views(reference_depth_mm=-79.0)


def test_light_fields_are_frozen_and_read_only() -> None:
    samples = np.zeros((ROWS, COLS, HEIGHT, WIDTH, 3), np.uint8)
    made = light_field(samples=samples)
    with pytest.raises(FrozenInstanceError):
        made.focal_px = 3.0  # type: ignore[misc]  # this must fail
    for array in (made.samples, made.weights, made.positions_mm):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1
    samples[0] = 9  # the caller's array stays writable
    assert all(np.array_equal(getattr(made, field.name), getattr(views(), field.name)) for field in fields(Views))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"samples": np.zeros((ROWS, COLS, HEIGHT, WIDTH, 4), np.uint8)}, r"samples have shape \(2, 3, 40, 60, 4\)"),
        ({"samples": np.zeros((ROWS, COLS, WIDTH, HEIGHT, 3), np.uint8)}, r"expected \(2, 3, 40, 60, 3\) or"),
        ({"samples": np.zeros((ROWS, COLS, HEIGHT, WIDTH, 3))}, "samples are float64, expected uint8 or float32"),
        ({"samples": np.full((ROWS, COLS, HEIGHT, WIDTH, 1), np.inf, np.float32)}, "samples hold a value that is NaN"),
        ({"weights": np.ones((ROWS, COLS, HEIGHT), np.float32)}, r"weights are float32 of shape \(2, 3, 40\)"),
        ({"weights": np.ones((ROWS, COLS, HEIGHT, WIDTH), bool)}, r"weights are bool .* expected float32"),
    ],
)
def test_inconsistent_light_fields_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        light_field(**changes)
    assert "\n" not in str(caught.value)


def test_metric_slope_is_px_per_mm_of_view_position() -> None:
    positions = views().positions_mm.copy()
    positions[..., 2] = 0
    grid = views(positions_mm=positions)
    for depth in (250.0, 400.0, 900.0):
        pixels = grid.project(np.array([5.0, depth, 80.0]))
        slope = grid.slope_from_depth(depth)
        assert np.allclose(pixels - pixels[1, 1], slope * positions[..., :2], atol=1e-9)
        assert grid.depth_mm_from_slope(slope) == pytest.approx(depth)
    assert grid.depth_mm_from_slope(grid.slope_from_depth(np.inf)) == np.inf
    assert np.isnan(grid.depth_mm_from_slope(grid.slope_from_depth(np.inf) + 1.0))


def test_pixels_of_every_view_survive_the_round_trip_to_a_plane() -> None:
    grid = views()
    for view in np.ndindex(ROWS, COLS):
        points = grid.plane_points_in_rig(300.0, grid.pixel_grid(), view)
        assert np.allclose(points[..., 1], 300.0)
        assert np.allclose(grid.project(points)[view], grid.pixel_grid(), atol=1e-9)
        on_reference = grid.plane_points_in_rig(400.0, grid.pixel_grid(), view)
        assert np.allclose(on_reference, grid.plane_points_in_rig(400.0, grid.pixel_grid()))


def test_the_regular_grid_is_the_nearest_one_through_the_reference_view() -> None:
    true = views()
    regular = true.on_regular_grid()
    assert not regular.positions_mm[1, 1].any()
    assert not regular.positions_mm[..., 2].any()
    steps = np.array([regular.step_mm("s"), regular.step_mm("t")])
    count = np.stack(np.meshgrid([-1, 0, 1], [-1, 0]), axis=-1)
    assert np.allclose(regular.positions_mm[..., :2], count * steps)
    away = np.square(true.positions_mm[..., :2] - count * steps).sum()
    for change in np.array([[0.01, 0], [-0.01, 0], [0, 0.01], [0, -0.01]]):
        assert np.square(true.positions_mm[..., :2] - count * (steps + change)).sum() > away
    assert np.array_equal(regular.on_regular_grid().positions_mm, regular.positions_mm)
    single = views(positions_mm=views().positions_mm[1:]).on_regular_grid()
    assert not single.positions_mm[..., 1:].any()


def test_numpy_converts_a_light_field_to_its_samples() -> None:
    made = light_field()
    assert np.asarray(made) is made.samples or np.shares_memory(np.asarray(made), made.samples)
    assert np.mean(made) == 77
    assert np.asarray(made, dtype=np.float32).dtype == np.float32


def test_a_reference_plane_at_infinity_is_the_limit_of_one_far_away() -> None:
    far, infinite = views(reference_depth_mm=1e9), views(reference_depth_mm=np.inf)
    points = np.array([[30.0, -20.0, 400.0], [-80.0, 10.0, 900.0]])
    assert np.allclose(infinite.project_in_view(points), far.project_in_view(points), atol=1e-4)
    assert np.ptp(infinite.matrices[..., :2, 2], axis=(0, 1)).max() == 0.0
    depths = np.array([300.0, 700.0, np.inf])
    assert np.allclose(infinite.disparity_px_from_depth(depths), far.disparity_px_from_depth(depths), atol=1e-4)
    assert infinite.disparity_px_from_depth(np.inf) == 0.0
    assert np.allclose(infinite.depth_mm_from_disparity(infinite.disparity_px_from_depth(depths)), depths)


def in_pattern(pattern: Pattern, step_mm: float = 20.0) -> Views:
    places = step_mm * (pattern.positions - pattern.positions[0])
    return views(positions_mm=np.column_stack([places, np.zeros(len(places))])[None])


@pytest.mark.parametrize("pattern", [Pattern.hexagonal(1), Pattern.hexagonal(2), Pattern.ring(3), Pattern.ring(8)])
def test_views_in_a_pattern_form_no_grid_and_have_the_step_of_nearest_neighbours(pattern: Pattern) -> None:
    found = in_pattern(pattern)
    assert not found.is_grid
    expected = 20.0 if pattern.name.startswith("hex") else 40.0 * np.sin(np.pi / len(pattern.positions))
    assert found.step_mm("s") == found.step_mm("t") == pytest.approx(expected)
    with pytest.raises(InputError, match="an even grid needs rows and columns of views, but these"):
        found.on_regular_grid()


def test_uneven_rows_and_columns_are_a_grid() -> None:
    assert views().is_grid
    assert in_pattern(Pattern(positions=[[0, 0], [3, 1]])).is_grid
    assert in_pattern(Pattern(positions=[[0, 0], [1, 0.2], [2.3, -0.2], [3, 0]])).is_grid
    assert views(positions_mm=np.zeros((1, 1, 3))).is_grid
