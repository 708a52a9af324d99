"""Surfaces: as large as asked, closed where they enclose, with texture coordinates in mm."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.depth_scenes.surfaces import Surface, ball, block, joined, leaf, sheet, tube, turned
from mirrorcam.core.values import FloatArray


def corners(surface: Surface) -> FloatArray:
    """Corners (m, 3, 3) of the triangles."""
    return surface.points[surface.faces]


def areas(surface: Surface) -> FloatArray:
    a, b, c = np.moveaxis(corners(surface), 1, 0)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0)


def volume(surface: Surface) -> float:
    return abs(float(np.linalg.det(corners(surface)).sum() / 6.0))


def test_a_block_stands_on_its_base_and_is_closed() -> None:
    found = block((30.0, 20.0, 50.0), (100.0, 200.0, 10.0), turn_deg=90.0)
    np.testing.assert_allclose(found.points.min(axis=0), [90.0, 185.0, 10.0])
    np.testing.assert_allclose(found.points.max(axis=0), [110.0, 215.0, 60.0])
    assert areas(found).sum() == pytest.approx(2.0 * (600.0 + 1500.0 + 1000.0))


@pytest.mark.parametrize("surface", [block((30.0, 20.0, 50.0)), sheet((1, 2, 3), (0, 40, 0), (0, 0, 25))])
def test_flat_textures_are_in_mm(surface: Surface) -> None:
    for one, two in ((0, 1), (1, 2), (2, 0)):
        way = np.linalg.norm(corners(surface)[:, one] - corners(surface)[:, two], axis=1)
        on_texture = surface.place_mm[surface.faces]
        np.testing.assert_allclose(np.linalg.norm(on_texture[:, one] - on_texture[:, two], axis=1), way)


def test_a_turned_cylinder_has_its_volume_and_points_outward_or_inward_everywhere() -> None:
    found = turned([(0.0, 0.0), (40.0, 0.0), (40.0, 100.0), (0.0, 100.0)], (5.0, 6.0, 7.0))
    assert volume(found) == pytest.approx(np.pi * 40.0**2 * 100.0, rel=0.01)
    assert found.normals is not None
    side = (np.abs(found.points[:, 2] - 57.0) < 20.0) & (np.hypot(*(found.points[:, :2] - [5.0, 6.0]).T) > 39.0)
    radial = (found.points[side] - [5.0, 6.0, 0.0]) * [1.0, 1.0, 0.0]
    cosine = (found.normals[side] * radial).sum(axis=1) / np.linalg.norm(radial, axis=1)
    assert np.abs(cosine).min() > 0.999
    assert len(np.unique(np.sign(cosine))) == 1


def test_a_ball_is_round() -> None:
    found = ball(30.0, (1.0, 2.0, 3.0))
    np.testing.assert_allclose(np.linalg.norm(found.points - [1.0, 2.0, 3.0], axis=1), 30.0)
    assert volume(Surface(found.points - [1.0, 2.0, 3.0], found.faces, found.place_mm)) == pytest.approx(
        4.0 / 3.0 * np.pi * 30.0**3, rel=0.01
    )


def test_a_tube_keeps_its_distance_from_its_path() -> None:
    angle = np.linspace(0.0, 1.0, 30)
    path = np.stack([100.0 * np.cos(angle), 100.0 * np.sin(angle), 40.0 * angle], axis=-1)
    found = tube(path, 3.0)
    nearest = np.linalg.norm(found.points[:, None] - path, axis=-1).min(axis=1)
    np.testing.assert_allclose(nearest, 3.0, rtol=1e-3)


def test_a_leaf_starts_where_asked_and_is_as_long_and_wide() -> None:
    found = leaf((10.0, 0.0, 0.0), np.eye(3), 100.0, 30.0, 0.0, (0.0, 0.0))
    assert found.points[:, 0].min() == pytest.approx(10.0)
    assert np.ptp(found.points[:, 0]) == pytest.approx(100.0)
    assert np.ptp(found.points[:, 1]) == pytest.approx(30.0, rel=0.05)


def test_joined_surfaces_keep_all_triangles() -> None:
    parts = [block((1.0, 2.0, 3.0), (number * 10.0, 0.0, 0.0)) for number in range(3)]
    found = joined(parts)
    assert areas(found).sum() == pytest.approx(sum(areas(part).sum() for part in parts))
    assert len(found.faces) == 36


def test_turning_moves_normals_alike() -> None:
    found = ball(5.0, (0.0, 0.0, 0.0)).moved((7.0, 0.0, 0.0), 30.0)
    assert found.normals is not None
    np.testing.assert_allclose(found.points - [7.0, 0.0, 0.0], 5.0 * found.normals, atol=1e-9)
