"""Scales of a print: as bright as the print, with a black border.

Maps to the print, compared with rays intersected with the board's plane.
"""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import Pupil
from mirrorcam.render_scenes.fast.print_map import build_mipmap, coefficients, map_to_print, virtual_views


def test_every_scale_of_a_print_is_as_bright_as_the_print() -> None:
    radiance = np.random.default_rng(0).random((37, 50))
    pyramid = build_mipmap(radiance)
    assert len(pyramid.levels) > 3
    for index, level in enumerate(pyramid.levels):
        texels = pyramid.texels[level.begin : level.begin + level.columns * level.rows].reshape(level.rows, -1)
        assert texels.sum() * 4.0**index == pytest.approx(radiance.sum(), rel=1e-5)
        assert not texels[[0, -1]].any()
        assert not texels[:, [0, -1]].any()


TEXELS_FROM_BOARD = np.array([[4.0, 0.1, 12.0], [-0.1, 4.0, 7.0], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def rig_from_board() -> FloatArray:
    pose = np.eye(4)
    tilt = np.radians(20.0)
    pose[:3, :3] = [[1.0, 0.0, 0.0], [0.0, np.cos(tilt), -np.sin(tilt)], [0.0, np.sin(tilt), np.cos(tilt)]]
    pose[:3, 3] = [-40.0, -30.0, 400.0]
    return pose


def intersect_board(start: FloatArray, along: FloatArray, rig_from_board: FloatArray) -> FloatArray:
    """Point (3,) where a ray in the rig frame meets the plane of the board."""
    normal = rig_from_board[:3, 2]
    return np.asarray(start + along * ((rig_from_board[:3, 3] - start) @ normal / (along @ normal)))


def texel_at(start: FloatArray, along: FloatArray, rig_from_board: FloatArray) -> FloatArray:
    """Texel (2,) where a ray in the rig frame meets the print."""
    point = intersect_board(start, along, rig_from_board)
    board = rig_from_board[:3, :3].T @ (point - rig_from_board[:3, 3])
    return TEXELS_FROM_BOARD[:2, :2] @ board[:2] + TEXELS_FROM_BOARD[:2, 2]


@pytest.mark.parametrize("pupil_mm", [(0.0, 0.0), (0.9, 0.0), (-0.4, 0.7)])
def test_rays_of_the_pupil_meet_the_print_in_its_plane(
    rig_from_board: FloatArray, pupil_mm: tuple[float, float]
) -> None:
    (view,), focus_mm = virtual_views(()), 500.0
    to_print = map_to_print(view, rig_from_board, TEXELS_FROM_BOARD, Pupil(0.0, focus_mm))
    ray, start = np.array([0.05, -0.08, 1.0]), np.array([*pupil_mm, 0.0])
    at = to_print.print @ ray + np.einsum("k,kij,j->i", pupil_mm, to_print.d_print, ray)
    depth = to_print.depth @ ray + to_print.d_depth @ np.array(pupil_mm)
    np.testing.assert_allclose(at / depth, texel_at(start, ray - start / focus_mm, rig_from_board), atol=2e-3)


def test_out_of_focus_a_ray_is_the_mean_of_those_through_the_pupil(rig_from_board: FloatArray) -> None:
    """Mean direction from the pupil's centre to the points on the board of rays from the whole pupil, 20 mm wide."""
    (view,), pupil = virtual_views(()), Pupil(20.0, 2000.0)
    whole = map_to_print(view, rig_from_board, TEXELS_FROM_BOARD, pupil)
    count = np.arange(400)
    radius, angle = np.sqrt((count + 0.5) / 400.0) * pupil.radius_mm, count * np.pi * (3.0 - np.sqrt(5.0))
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(400)])
    for ray in ([0.05, -0.08, 1.0], [-0.2, 0.1, 1.0]):
        along = pupil.focus_mm * np.array(ray)
        seen = np.array([intersect_board(a, along - a, rig_from_board) for a in np.concatenate([points, -points])])
        middle = np.array([*(seen[:, :2] / seen[:, 2:]).mean(axis=0), 1.0])
        expected = texel_at(np.zeros(3), middle, rig_from_board)
        shift = float(np.linalg.norm(expected - texel_at(np.zeros(3), along, rig_from_board)))
        assert shift > 0.05
        np.testing.assert_allclose(whole.print @ ray / (whole.depth @ ray), expected, atol=0.05 * shift)


def test_a_board_seen_from_behind_is_never_in_front_of_the_camera(rig_from_board: FloatArray) -> None:
    (view,) = virtual_views(())
    flipped = rig_from_board @ np.diag([1.0, -1.0, -1.0, 1.0])
    depths = [map_to_print(view, pose, TEXELS_FROM_BOARD, Pupil()).depth for pose in (rig_from_board, flipped)]
    assert sorted(float(depth[2]) > 0.0 for depth in depths) == [False, True]


def test_a_coarser_level_has_half_the_texels(rig_from_board: FloatArray) -> None:
    (view,) = virtual_views(())
    to_print = map_to_print(view, rig_from_board, TEXELS_FROM_BOARD, Pupil())
    ray = np.array([0.05, -0.08, 1.0])
    positions = []
    for scale in (1.0, 0.5):
        numbers = coefficients(to_print, np.diag([7e-4, 7e-4]), scale)
        assert len(numbers) == 35
        u, v, depth = np.reshape(numbers[:9], (3, 3)) @ ray
        positions.append(np.array([u, v]) / depth - 1.0)
    np.testing.assert_allclose(positions[1], 0.5 * positions[0])


def test_views_of_first_surface_mirrors_are_their_virtual_centres(small_layout: Layout) -> None:
    for view, mirror in zip(virtual_views(small_layout.mirrors), small_layout.mirrors, strict=True):
        np.testing.assert_allclose(view.centre_in_rig_mm, mirror.virtual_centre_in_rig_mm, atol=1e-9)
        np.testing.assert_allclose(np.linalg.det(view.orientation), -1.0)
