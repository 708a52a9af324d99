"""Images in second-surface mirrors against rays followed surface by surface, and limits of the formula."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror_arrays import MirrorArrays, dot, plane_of
from mirrorcam.optics.geometry.plate_imaging import PlatePath
from tests.optics.geometry.followed_rays import (
    mirror,
    missed_px,
    scene_points,
)


@pytest.mark.parametrize("index", [1.0, 1.49, 1.9])
@pytest.mark.parametrize("thickness_mm", [0.5, 3.0])
def test_light_seen_at_the_image_in_a_plate_comes_from_the_point(thickness_mm: float, index: float) -> None:
    plate = mirror(surface="second", thickness_mm=thickness_mm, refractive_index=index)
    assert missed_px(plate, scene_points()).max() < 1e-8
    assert (missed_px(plate.replaced(surface="first"), scene_points()) < 1e-8).all()
    if index > 1.0:  # a plane mirror at the place of the reflecting surface shows the point elsewhere
        apart = np.cross(plate.image_of(scene_points()), plate.reflect(scene_points()))
        assert np.linalg.norm(apart, axis=1).min() > 1.0


def paths(thickness_mm: float) -> tuple[FloatArray, PlatePath]:
    """Points (3, n) and the light to them via the mirror with a plate of a thickness."""
    of, points = mirror(), scene_points(9).T
    one = np.ones(1)
    arrays = MirrorArrays(
        of.virtual_centre_in_rig_mm[:, None],
        of.outline_in_rig_mm.mean(axis=0)[:, None],
        thickness_mm * one,
        1.49 * one,
        np.zeros((3, 1)),
    )
    return points, PlatePath.through(points, plane_of(arrays.centre_mm), arrays)


def test_light_is_reflected_on_the_plane_between_pupil_and_image() -> None:
    _, path = paths(2.0)
    meets = path.reflection_point_mm()
    assert_allclose(dot(meets, path.normal) + path.distance_mm, 0.0, atol=1e-12)
    # Without a plate, the point of reflection lies on the ray to the image.
    _, plain = paths(0.0)
    ray, at = plain.image_mm(), plain.reflection_point_mm()
    assert_allclose(np.cross(ray, at, axis=0) / np.linalg.norm(ray, axis=0), 0.0, atol=1e-10)


def test_a_plate_of_no_thickness_is_a_plain_mirror() -> None:
    points, path = paths(0.0)
    assert_allclose(path.image_mm(), mirror().reflect(points.T).T, atol=1e-10)
    _, thin = paths(1e-7)
    assert_allclose(thin.image_mm(), path.image_mm(), atol=1e-5)


def test_derivatives_of_the_point_of_reflection_agree_with_finite_differences() -> None:
    points, path = paths(2.0)
    rows = np.random.default_rng(3).normal(size=(2, 3, points.shape[1]))
    found, arrays = path.reflection_point_vjp(rows), (np.full(1, 2.0), np.full(1, 1.49))

    def value(point: FloatArray, distance: float = 0.0, thickness: float = 0.0) -> FloatArray:
        moved = MirrorArrays(np.zeros((3, 1)), np.zeros((3, 1)), arrays[0] + thickness, arrays[1], np.zeros((3, 1)))
        through = PlatePath.through(point, (path.normal, path.distance_mm + distance), moved)
        return np.einsum("akn,kn->an", rows, through.reflection_point_mm())

    h = 1e-4
    for axis in range(3):
        step = h * np.eye(3)[:, axis : axis + 1]
        expected = (value(points + step) - value(points - step)) / (2 * h)
        assert_allclose(found.point[:, axis], expected, atol=1e-7)
    assert_allclose(found.distance, (value(points, h) - value(points, -h)) / (2 * h), atol=1e-7)
    assert_allclose(found.thickness, (value(points, 0.0, h) - value(points, 0.0, -h)) / (2 * h), atol=1e-7)
