"""Refraction in a plate: Snell's law, its limits, and second-surface mirrors equivalent to first-surface ones."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from shapely import Point, Polygon, contains_xy

from mirrorcam.core.values import FloatArray, InvalidValue
from mirrorcam.optics.design.assess.chief_rays import apparent_offset_mm, traced
from mirrorcam.optics.geometry.mirror import Mirror, intersect_plane
from mirrorcam.optics.geometry.mirror_arrays import MirrorArrays, dot, plane_of
from mirrorcam.optics.geometry.plate import PlatePath, rise_mm, solve_tangent_in_air, tangent_in_glass
from tests.optics.geometry.followed_rays import (
    mirror,
    missed_px,
    scene_points,
)

INDICES = st.floats(1.0, 2.5)
SQUARE = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]])
CENTRES = st.tuples(st.floats(-60, 60), st.floats(-120, -40), st.floats(60, 120)).map(np.array)


def appearing(
    centre: FloatArray, thickness_mm: float = 3.0, index: float = 1.49, corners: FloatArray = SQUARE
) -> Mirror:
    """The second-surface mirror whose apparent mirror has a virtual centre and normalized corners."""
    return Mirror.second_surface(
        centre, intersect_plane(corners, centre), thickness_mm=thickness_mm, refractive_index=index
    )


@given(st.floats(0.0, 1.55), INDICES)
def test_snells_law(angle: float, index: float) -> None:
    inside = np.arctan(tangent_in_glass(np.array(np.tan(angle)), index))
    assert np.sin(angle) == pytest.approx(index * np.sin(inside), rel=1e-9, abs=1e-12)


@given(st.floats(0.0, 20.0), st.floats(0.01, 200.0), st.floats(0.01, 20.0), INDICES)
def test_the_ray_with_a_given_lateral_offset_is_found(tangent: float, air: float, glass: float, index: float) -> None:
    across = air * tangent + glass * float(tangent_in_glass(np.array(tangent), index))
    assert solve_tangent_in_air(across, air, glass, index) == pytest.approx(tangent, rel=1e-9, abs=1e-12)


def test_a_plate_lifts_its_back_as_textbooks_say() -> None:
    # At normal incidence the apparent depth is t / n; at grazing incidence it vanishes.
    assert rise_mm(np.array(0.0), 3.0, 1.5) == pytest.approx(1.0)
    assert rise_mm(np.array(1e-9), 3.0, 1.5) == pytest.approx(1.0)
    assert rise_mm(np.array(1e6), 3.0, 1.5) == pytest.approx(3.0, abs=1e-4)
    assert np.all(rise_mm(np.array([0.0, 0.5, 1.0, 2.0]), 3.0, 1.0) == 0.0)
    assert np.all(np.diff(rise_mm(np.linspace(0.0, 5.0, 50), 3.0, 1.5)) > 0)


@given(CENTRES, st.floats(0.1, 8.0), st.floats(1.0, 1.9))
def test_apparent_undoes_second_surface(centre: FloatArray, thickness_mm: float, index: float) -> None:
    stored = appearing(centre, thickness_mm, index)
    assert (stored.surface, stored.thickness_mm, stored.refractive_index) == ("second", thickness_mm, index)
    assert np.allclose(stored.apparent.virtual_centre_in_rig_mm, centre, atol=1e-9)
    assert np.allclose(stored.apparent.outline_in_rig_mm, intersect_plane(SQUARE, centre), atol=1e-9)
    assert not stored.apparent.is_second_surface
    assert (stored.apparent.thickness_mm, stored.apparent.refractive_index) == (thickness_mm, index)
    # The reflecting surface lies behind the apparent plane, by less than the thickness.
    assert stored.apparent.distance_mm <= stored.distance_mm < stored.apparent.distance_mm + thickness_mm


def test_a_first_surface_mirror_is_what_it_looks_like() -> None:
    plain = appearing(np.array([3.0, -80.0, 82.0])).apparent
    assert plain.apparent is plain
    assert np.array_equal(plain.usable_normalized, plain.outline_normalized)


@given(CENTRES, st.floats(0.1, 8.0), st.floats(1.0, 1.9))
def test_the_chief_ray_leaves_where_the_apparent_mirror_reflects_it(
    centre: FloatArray, thickness_mm: float, index: float
) -> None:
    stored = appearing(centre, thickness_mm, index)
    middle = stored.apparent.outline_in_rig_mm.mean(axis=0)
    chief = (middle[:2] / middle[2])[None]
    met, leaving, direction = traced(stored, chief)
    assert np.allclose(stored.normal_in_rig @ leaving[0], -(stored.distance_mm - thickness_mm), atol=1e-9)
    # The line of the ray passes through the virtual centre, behind the apparent mirror.
    offset = leaving[0] - stored.apparent.virtual_centre_in_rig_mm
    assert np.linalg.norm(np.cross(offset, direction[0])) / np.linalg.norm(direction[0]) < 1e-9
    # The light enters and leaves at equal distances from its point of reflection.
    assert np.allclose(
        (met + leaving)[0] / 2 - thickness_mm * stored.normal_in_rig, stored.outline_in_rig_mm.mean(axis=0)
    )


def test_the_traced_path_is_the_quickest() -> None:
    # Fermat: of all ways from the pupil to the coating to a point outside, via two points of the front, the one
    # that light takes is stationary in optical length. Shares nothing with Snell's law as the trace applies it.
    stored = appearing(np.array([20.0, -85.0, 90.0]), 5.0, 1.6)
    normalized = np.array([[0.07, -0.05]])
    (met,), (leaving,), (direction,) = traced(stored, normalized)
    end = leaving + 3.0 * direction * 50.0
    across = stored.rig_from_plane[:3, :2]
    coating = (met + leaving) / 2 - stored.thickness_mm * stored.normal_in_rig

    def length(moves: FloatArray) -> float:
        a, b, c = (p + across @ m for p, m in zip((met, coating, leaving), moves.reshape(3, 2), strict=True))
        outside = np.linalg.norm(a) + np.linalg.norm(end - c)
        return float(outside + stored.refractive_index * (np.linalg.norm(b - a) + np.linalg.norm(c - b)))

    for step in np.eye(6):
        slope = (length(1e-4 * step) - length(-1e-4 * step)) / 2e-4
        assert abs(slope) < 1e-7
        assert length(0.1 * step) > length(np.zeros(6))


def test_the_apparent_offset_is_that_of_exact_rays() -> None:
    stored = appearing(np.array([20.0, -85.0, 90.0]), 5.0, 1.6)
    grid = np.stack(np.meshgrid(np.linspace(-0.1, 0.1, 101), np.linspace(-0.1, 0.1, 101)), axis=-1).reshape(-1, 2)
    usable = Polygon(stored.usable_normalized)
    grid = grid[contains_xy(usable, grid)]
    _, leaving, directions = traced(stored, grid)
    plain = stored.apparent.intersect(grid)
    beside = np.linalg.norm(np.cross(leaving - plain, directions), axis=1) / np.linalg.norm(directions, axis=1)
    assert apparent_offset_mm(stored) == pytest.approx(beside.max(), rel=0.03)
    assert apparent_offset_mm(stored) > 0.01
    assert apparent_offset_mm(stored.apparent) == 0.0
    assert apparent_offset_mm(stored.replaced(refractive_index=1.0)) == pytest.approx(0.0, abs=1e-12)


def test_light_through_the_usable_part_goes_in_and_out_by_the_front() -> None:
    # The part follows the chief ray's refraction: rays at its border miss the front only slightly.
    stored = appearing(np.array([0.0, -80.0, 80.0]), 4.0)
    turn, origin = stored.rig_from_plane[:3, :2], stored.rig_from_plane[:3, 3] + 4.0 * stored.normal_in_rig
    front = Polygon(stored.outline_in_plane_mm)
    met, leaving, _ = traced(stored, stored.usable_normalized)
    for points in (met, leaving):
        missed = max(front.distance(Point((p - origin) @ turn)) for p in points)
        assert missed < 0.35
    rim_in, rim_out, _ = traced(stored, stored.apparent.outline_normalized)
    assert max(front.distance(Point((p - origin) @ turn)) for p in (*rim_in, *rim_out)) > 1.0
    assert 0.5 < Polygon(stored.usable_normalized).area / Polygon(stored.apparent.outline_normalized).area < 0.95


def test_a_mirror_too_thick_for_its_size_shows_nothing() -> None:
    tiny = appearing(np.array([0.0, -80.0, 80.0]), 8.0, corners=SQUARE * 0.1)
    assert tiny.usable_normalized.shape == (0, 2)


def test_a_mirror_that_holds_the_pupil_is_refused() -> None:
    stored = appearing(np.array([3.0, -80.0, 82.0]))
    with pytest.raises(InvalidValue, match=r"second-surface mirror reaches 2\.5 mm past the pupil"):
        stored.replaced(thickness_mm=stored.distance_mm + 2.5)


@pytest.mark.parametrize("index", [1.0, 1.49, 1.9])
@pytest.mark.parametrize("thickness_mm", [0.5, 3.0])
def test_light_seen_at_the_image_in_a_plate_comes_from_the_point(thickness_mm: float, index: float) -> None:
    plate = mirror(surface="second", thickness_mm=thickness_mm, refractive_index=index)
    assert missed_px(plate, scene_points()).max() < 1e-8
    assert (missed_px(plate.replaced(surface="first"), scene_points()) < 1e-8).all()
    if index > 1.0:  # a first-surface mirror at the reflecting surface shows the point elsewhere
        apart = np.cross(plate.image_of(scene_points()), plate.reflect(scene_points()))
        assert np.linalg.norm(apart, axis=1).min() > 1.0


def paths(thickness_mm: float) -> tuple[FloatArray, PlatePath]:
    """Points (3, n) and the light to them via the mirror with a plate of given thickness."""
    of, points = mirror(), scene_points(9).T
    one = np.ones(1)
    arrays = MirrorArrays(
        of.virtual_centre_in_rig_mm[:, None],
        of.outline_in_rig_mm.mean(axis=0)[:, None],
        thickness_mm * one,
        1.49 * one,
        np.zeros((3, 1)),
    )
    return points, PlatePath.trace(points, plane_of(arrays.centre_mm), arrays)


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
        through = PlatePath.trace(point, (path.normal, path.distance_mm + distance), moved)
        return np.einsum("akn,kn->an", rows, through.reflection_point_mm())

    h = 1e-4
    for axis in range(3):
        step = h * np.eye(3)[:, axis : axis + 1]
        expected = (value(points + step) - value(points - step)) / (2 * h)
        assert_allclose(found.point[:, axis], expected, atol=1e-7)
    assert_allclose(found.distance, (value(points, h) - value(points, -h)) / (2 * h), atol=1e-7)
    assert_allclose(found.thickness, (value(points, 0.0, h) - value(points, 0.0, -h)) / (2 * h), atol=1e-7)
