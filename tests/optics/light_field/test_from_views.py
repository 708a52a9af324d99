"""Light fields from arrays: even rows, positions, and cameras in any poses, against points that all of them see."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mirrorcam
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.optics.light_field.camera_array import arrangement
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph
from tests.optics.light_field.wall_cameras import DISTANCE_MM, FOCAL_PX, cameras, photographs, wall_error


def test_one_line_makes_a_light_field_of_an_array() -> None:
    views = grid_views(3, 3, step_mm=20.0, uneven=False, reference_view_in_rig_mm=np.zeros(3), reference_depth_mm=375.0)
    expected, _, _ = photograph(views, [Surface(500.0)])
    found = mirrorcam.LightField.from_views(
        expected.samples, step_mm=20.0, focal_px=views.focal_px, centre_px=views.centre_px, reference_depth_mm=375.0
    )
    np.testing.assert_allclose(found.matrices, expected.matrices)
    np.testing.assert_allclose(found.positions_mm, expected.positions_mm)
    np.testing.assert_array_equal(found.samples, expected.samples)
    row = mirrorcam.LightField.from_views(list(expected.samples[1]), step_mm=20.0, focal_px=400.0)
    assert row.samples.shape[:2] == (1, 3)
    assert np.isinf(row.reference_depth_mm)


def test_the_left_picture_of_a_pair_is_its_reference() -> None:
    left, right = np.zeros((2, 8, 9), np.uint8)
    pair = LightField.from_views([left, right], step_mm=60.0, focal_px=10.0)
    np.testing.assert_array_equal(pair.positions_mm[0, :, 0], [0.0, 60.0])
    row = LightField.from_views([left, right, right, right], step_mm=60.0, focal_px=10.0)
    np.testing.assert_array_equal(row.positions_mm[0, :, 0], [-120.0, -60.0, 0.0, 60.0])


@pytest.mark.parametrize(
    ("shape", "kind", "grid", "channels"),
    [
        ((2, 3, 8, 9, 3), "uint8", (2, 3), 3),
        ((2, 3, 8, 9), "uint8", (2, 3), 1),
        ((6, 8, 9, 3), "uint16", (1, 6), 3),
        ((6, 8, 9), "float64", (1, 6), 1),
    ],
)
def test_images_have_any_of_the_usual_shapes_and_types(
    shape: tuple[int, ...], kind: str, grid: tuple[int, int], channels: int
) -> None:
    images = np.full(shape, 0.5 if kind == "float64" else np.iinfo(kind).max // 2).astype(kind)
    found = LightField.from_views(images, step_mm=1.0, focal_px=10.0)
    assert (found.rows, found.cols, found.samples.shape[-1]) == (*grid, channels)
    assert found.samples.mean() == pytest.approx(127 if kind == "uint8" else 0.5, abs=1e-4)


def test_positions_in_any_order_are_arranged_in_rows_and_columns() -> None:
    positions = np.stack(np.meshgrid([0.0, 10.0, 20.0], [0.0, 10.0]), axis=-1).reshape(-1, 2)
    shuffled = np.random.default_rng(1).permutation(6)
    images = np.arange(6, dtype=np.uint8)[:, None, None] * np.ones((1, 4, 5), np.uint8)
    found = LightField.from_views(images[shuffled], positions_mm=positions[shuffled], focal_px=10.0)
    assert found.samples[..., 0, 0, 0].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert found.is_grid
    assert found.step_mm("t") == found.step_mm("s") == 10.0
    circle = np.stack([np.cos(np.arange(7)), np.sin(np.arange(7))], axis=1)
    assert arrangement(circle).tolist() == [list(range(7))]
    assert arrangement(positions[:1]).tolist() == [[0]]
    assert arrangement(np.zeros((3, 2))).tolist() == [[0, 1, 2]]
    assert arrangement(positions[[4, 1]]).tolist() == [[1], [0]]


def test_parallel_cameras_keep_their_pictures() -> None:
    poses = rigid(Rotation.from_rotvec([0.3, -0.2, 0.1]).as_matrix(), cameras(2, 2, 0.0)[:, :3, 3])
    images = np.random.default_rng(1).integers(0, 255, (4, 6, 8, 3), dtype=np.uint8)
    found = LightField.from_views(images, poses=poses, focal_px=100.0)
    assert np.isinf(found.reference_depth_mm)
    order = [found.samples[index] for index in np.ndindex(2, 2)]
    assert sorted(view.tobytes() for view in order) == sorted(view.tobytes() for view in images)


@pytest.mark.parametrize(("turn_deg", "has_sample"), [(0.5, 0.95), (4.0, 0.7)])
def test_cameras_that_are_not_parallel_are_rectified(turn_deg: float, has_sample: float) -> None:
    """Distorted pictures of different focal lengths show what the pinholes of the light field look at."""
    poses = cameras(3, 3, turn_deg)
    focal_px = FOCAL_PX * np.linspace(0.95, 1.05, 9)
    distortion = np.array([-0.1, 0.05, 1e-3, -1e-3, 0.0])
    images = photographs(poses, focal_px, distortion)
    with pytest.warns(UserWarning, match=r"rectified: cameras turned by up to [\d.]+ deg, [\d.]+% of their fields of"):
        found = LightField.from_views(images, poses=poses, focal_px=focal_px, distortion=distortion)
    error, valid = wall_error(found)
    assert error < 0.002
    assert valid > has_sample
    assert found.is_grid
    assert (found.rows, found.cols) == (3, 3)


def test_views_that_look_inwards_keep_their_field_of_view() -> None:
    """The plane of zero disparity is where the axes meet."""
    poses = cameras(1, 5, 0.0)
    poses[:, 2, 3] = 0.0
    inwards = np.arctan(-poses[:, 0, 3] / DISTANCE_MM)
    poses[:, :3, :3] = Rotation.from_rotvec(inwards[:, None] * [0.0, 1.0, 0.0]).as_matrix()
    images = photographs(poses, np.full(5, FOCAL_PX), np.zeros(5))
    with pytest.warns(UserWarning, match="rectified"):
        found = LightField.from_views(images, poses=poses, focal_px=FOCAL_PX)
    assert found.reference_depth_mm == pytest.approx(DISTANCE_MM, rel=0.01)
    error, valid = wall_error(found)
    assert error < 0.002
    assert valid > 0.9


def test_a_finer_camera_does_not_alias_and_weights_are_kept() -> None:
    poses = cameras(1, 3, 1.0)
    scales = np.array([2, 1, 3])
    images = [
        photographs(poses[[n]], np.array([FOCAL_PX * scale]), np.zeros(5), (96 * scale, 72 * scale))[0]
        for n, scale in enumerate(scales.tolist())
    ]
    weights = [np.ones(image.shape, np.float32) for image in images]
    weights[1][:, :20] = 0.0
    with pytest.warns(UserWarning, match="rectified"):
        found = LightField.from_views(images, poses=poses, focal_px=FOCAL_PX * scales, weights=weights)
    assert wall_error(found)[0] < 0.01
    assert found.valid[0, 1, 20:50, :15].sum() == 0
    assert found.valid[0, 0, 20:50, 20:50].all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, "no geometry given, expected one of step_mm, positions_mm, poses"),
        ({"step_mm": 1.0, "positions_mm": np.zeros((4, 2))}, "step_mm, positions_mm given, expected one"),
        ({"step_mm": -1.0}, "step_mm: -1.0, expected a positive number"),
        ({"step_mm": 1.0, "focal_px": np.nan}, "focal_px"),
        ({"positions_mm": np.zeros((3, 2))}, "expected 4 views with 2 or 3 numbers"),
        ({"poses": np.zeros((4, 4, 4))}, "poses are not rigid transforms"),
        ({"poses": np.eye(4)}, r"expected \(4, 4, 4\)"),
        ({"poses": cameras(2, 2, 0.0), "focal_px": [1.0, 2.0]}, "focal_px has shape"),
        ({"poses": cameras(2, 2, 60.0)}, "deg from the mean of all cameras, expected at most 45"),
        ({"step_mm": 1.0, "images": np.zeros((4, 8))}, "images have shape"),
        ({"step_mm": 1.0, "images": np.zeros((4, 8, 9), np.int64)}, "image 0 is int64"),
        ({"step_mm": 1.0, "images": np.full((4, 8, 9), 2.0)}, "values outside 0 to 1"),
        ({"step_mm": 1.0, "images": [np.zeros((8, 9)), np.zeros((8, 8))]}, "images differ in size"),
        ({"step_mm": 1.0, "images": []}, "no images"),
        ({"step_mm": 1.0, "weights": np.zeros((3, 8, 9))}, "weights do not have the shapes"),
    ],
)
def test_arrays_that_do_not_fit_are_refused_in_one_line(changes: dict[str, Any], message: str) -> None:
    given: dict[str, Any] = {"images": np.zeros((4, 8, 9), np.uint8), "focal_px": 20.0} | changes
    with pytest.raises(InputError, match=message) as refused:
        LightField.from_views(**given)
    assert "\n" not in str(refused.value)
