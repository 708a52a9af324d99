"""Flat mirrors: the laws of reflection, and the outlines that are refused."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, InvalidValue
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror, reflect

CENTRES = st.tuples(*[st.floats(-200, 200)] * 3).map(np.array).filter(lambda c: bool(np.linalg.norm(c) > 1))
POINTS: st.SearchStrategy[FloatArray] = st.lists(st.tuples(*[st.floats(-1000, 1000)] * 3), min_size=1).map(np.array)
QUAD = ((-0.1, -0.1), (0.1, -0.1), (0.12, 0.1), (-0.08, 0.1))
CROSSING = [QUAD[0], QUAD[2], QUAD[1], QUAD[3]]
DENT = [*QUAD[:2], (0.0, 0.0), *QUAD[2:]]
SADDLE = (0.25, -0.2, 0.15)
CORNERS = np.array([[-9.0, -7.0, 73.0], [9.0, -7.0, 73.0], [8.0, 6.0, 86.0], [0.0, 9.0, 89.0], [-8.0, 6.0, 86.0]])


def mirror(normalized: Any = QUAD, centre: Any = (3.0, -80.0, 82.0), **fields: Any) -> Mirror:
    """The mirror with a virtual centre and an outline in normalized image coordinates."""
    centre, rays = np.array(centre), np.column_stack([normalized, np.ones(len(normalized))])
    points = rays * (centre @ centre / 2 / (rays @ centre))[:, None]
    return Mirror(virtual_centre_in_rig_mm=centre, outline_in_rig_mm=points, **fields)


def refusal(**changes: Any) -> str:
    with pytest.raises(InvalidValue) as caught:
        mirror().replaced(**changes)
    assert caught.value.first is not None
    return str(caught.value.first["msg"])


@given(POINTS, CENTRES)
def test_reflecting_twice_changes_nothing(points: FloatArray, centre: FloatArray) -> None:
    assert np.allclose(reflect(reflect(points, centre), centre), points, atol=1e-8)


@given(POINTS, CENTRES)
def test_the_pupil_and_its_virtual_centre_are_each_others_reflection(points: FloatArray, centre: FloatArray) -> None:
    assert np.allclose(reflect(np.zeros(3), centre), centre)
    assert np.allclose(reflect(centre, centre), 0, atol=1e-9)
    # A point is as far from the pupil as its reflection is from the virtual centre.
    there = np.linalg.norm(reflect(points, centre) - centre, axis=-1)
    assert np.allclose(there, np.linalg.norm(points, axis=-1), atol=1e-8)


@given(POINTS, CENTRES)
def test_points_on_the_plane_stay(points: FloatArray, centre: FloatArray) -> None:
    unit = centre / np.linalg.norm(centre)
    on_plane = points - np.outer(points @ unit, unit) + centre / 2
    assert np.allclose(reflect(on_plane, centre), on_plane, atol=1e-8)


@given(CENTRES)
def test_the_linear_part_is_a_reflection(centre: FloatArray) -> None:
    assume(centre[2] > 0.1 * np.linalg.norm(centre))
    linear = mirror(centre=centre, normalized=((-0.01, 0), (0.01, 0), (0, 0.01))).reflection
    assert np.linalg.det(linear) == pytest.approx(-1)
    assert np.allclose(linear @ linear, np.eye(3))
    assert np.allclose(linear, linear.T)
    assert np.allclose(linear @ centre, -centre)


def test_reflecting_is_the_linear_part_about_the_plane() -> None:
    one = mirror()
    points = np.random.default_rng(1).normal(size=(4, 5, 3)) * 100
    expected = points @ one.reflection.T + one.virtual_centre_in_rig_mm
    assert np.allclose(one.reflect(points), expected)
    assert one.reflect(points).shape == points.shape


def test_many_mirrors_reflect_many_points_at_once() -> None:
    centres = np.random.default_rng(2).normal(size=(4, 1, 3)) * 50
    points = np.random.default_rng(3).normal(size=(1, 6, 3)) * 50
    found = reflect(points, centres)
    assert found.shape == (4, 6, 3)
    assert np.allclose(found[2, 5], reflect(points[0, 5], centres[2, 0]))


def test_the_textbook_45_degree_fold() -> None:
    fold = mirror(centre=(0.0, -80.0, 80.0))
    assert fold.distance_mm == pytest.approx(80 / np.sqrt(2))
    assert np.allclose(fold.normal_in_rig, np.array([0, 1, -1]) / np.sqrt(2))
    assert np.allclose(fold.reflection @ [0, 0, 1], [0, 1, 0])  # up the optical axis, then forward
    assert np.allclose(fold.reflect(np.array([0.0, 0.0, 80.0])), [0, 0, 80])
    assert fold.normal_in_rig @ fold.normal_in_rig == pytest.approx(1)
    assert np.allclose(fold.outline_in_rig_mm @ fold.normal_in_rig, -fold.distance_mm)


@given(CENTRES, st.floats(0.1, 10), st.sampled_from([-1, 1]))
def test_a_plane_gives_its_mirror_whatever_the_length_and_sign_of_its_normal(
    centre: FloatArray, length: float, sign: int
) -> None:
    assume(centre[2] > 0.1 * np.linalg.norm(centre))
    given_mirror = mirror(centre=centre, normalized=((-0.01, 0), (0.01, 0), (0, 0.01)))
    found = Mirror.from_plane(
        given_mirror.outline_in_rig_mm[1],
        sign * length * given_mirror.normal_in_rig,
        outline_in_rig_mm=given_mirror.outline_in_rig_mm,
    )
    assert np.allclose(found.virtual_centre_in_rig_mm, centre, rtol=1e-9, atol=1e-9)


def test_viewing_rays_intersect_the_plane() -> None:
    one = mirror()
    assert np.allclose(one.outline_normalized, QUAD)
    assert np.allclose(one.intersect(np.array(QUAD)), one.outline_in_rig_mm)
    inside = one.intersect(np.zeros((2, 7, 2)))
    assert inside.shape == (2, 7, 3)
    assert np.allclose(inside @ one.normal_in_rig, -one.distance_mm)


def test_its_own_frame_is_rigid_lies_in_the_plane_and_faces_the_pupil() -> None:
    one = mirror()
    turn, origin = one.rig_from_plane[:3, :3], one.rig_from_plane[:3, 3]
    assert np.allclose(turn.T @ turn, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1)
    assert np.allclose(turn[:, 2], one.normal_in_rig)
    assert -origin @ one.normal_in_rig > 0  # z points to the side of the pupil
    assert turn[0, 0] > 0.9
    assert np.allclose(origin, one.outline_in_rig_mm.mean(axis=0))
    flat = np.column_stack([one.outline_in_plane_mm, np.zeros(4)])
    assert np.allclose(flat @ turn.T + origin, one.outline_in_rig_mm)
    edges = [np.linalg.norm(np.roll(points, 1, axis=0) - points, axis=1) for points in (flat, one.outline_in_rig_mm)]
    assert np.allclose(*edges)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_mirror_that_faces_sideways_has_a_frame_too(side: float) -> None:
    wall = Mirror.from_plane(
        np.array([50.0 * side, 0, 0]),
        np.array([1.0, 0, 0]),
        outline_in_rig_mm=np.array([[50 * side, -9, 50], [50 * side, 9, 50], [50 * side, 9, 90]]),
    )
    turn = wall.rig_from_plane[:3, :3]
    assert np.allclose(turn.T @ turn, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1)
    assert np.allclose(turn[:, 2], [-side, 0, 0])


def test_moving_a_mirror_moves_its_plane_and_its_outline_as_one_body() -> None:
    one = mirror(surface="second", thickness_mm=3.0, refractive_index=1.5)
    turn = Rotation.from_rotvec([0.02, -0.01, 0.03]).as_matrix()
    shift = np.array([1.0, -2.0, 0.5])
    moved = one.moved(turn, shift)
    centre = one.outline_in_rig_mm.mean(axis=0)
    assert np.allclose(moved.outline_in_rig_mm, (one.outline_in_rig_mm - centre) @ turn.T + centre + shift)
    assert np.allclose(moved.normal_in_rig, turn @ one.normal_in_rig)
    assert np.allclose(moved.outline_in_rig_mm @ moved.normal_in_rig, -moved.distance_mm)
    assert (moved.surface, moved.thickness_mm, moved.refractive_index) == ("second", 3.0, 1.5)
    assert np.allclose(one.moved(np.eye(3), np.zeros(3)).outline_in_rig_mm, one.outline_in_rig_mm)


def test_a_slide_along_the_plane_leaves_the_plane() -> None:
    one = mirror()
    moved = one.moved(np.eye(3), 4.0 * one.rig_from_plane[:3, 0])
    assert np.allclose(moved.virtual_centre_in_rig_mm, one.virtual_centre_in_rig_mm)


@pytest.mark.parametrize(
    ("normalized", "message"),
    [
        (QUAD[:2], "outline has 2 corners, expected at least 3"),
        (CROSSING, "outline crosses itself, expected a convex polygon"),
        (DENT, "outline is not convex, expected a convex polygon"),
        ([(-0.1, 0.0), (0.0, 0.0), (0.1, 0.0)], "expected a convex polygon"),
        ([(-0.1, 0.1), (0.0, 0.0), (0.1, -0.1)], "expected a convex polygon"),
        ([(-0.1, 0.0), (0.0, 1e-9), (0.1, 0.0)], "outline has no area, expected a convex polygon"),
        ([(0.0, 0.0)] * 3, "expected a convex polygon"),
    ],
)
def test_outlines_that_cannot_be_cut_are_refused(normalized: Any, message: str) -> None:
    with pytest.raises(InvalidValue) as caught:
        mirror(normalized=normalized)
    assert caught.value.first is not None
    assert message in caught.value.first["msg"]


def test_either_order_of_corners_and_more_than_four_are_fine() -> None:
    angle = np.linspace(0, 2 * np.pi, 9)[:-1]
    octagon = 0.1 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert len(mirror(octagon).outline_in_rig_mm) == len(mirror(octagon[::-1]).outline_in_rig_mm) == 8


def test_a_corner_on_a_straight_edge_is_fine() -> None:
    assert len(mirror([(-0.1, -0.1), (0.0, -0.1), (0.1, -0.1), (0.0, 0.1)]).outline_in_rig_mm) == 4


def test_invalid_mirrors_are_refused() -> None:
    lifted = mirror().outline_in_rig_mm + np.array([0, 0, 1e-3])
    assert "outline leaves the mirror plane by" in refusal(outline_in_rig_mm=lifted)
    corners = [[0, -50, -1], [9, -50, 5], [0, -50, 9]]
    with pytest.raises(InvalidValue, match="outline has a corner behind the camera, expected z > 0"):
        Mirror.from_plane(np.array([0.0, -50, 0]), np.array([0.0, 1, 0]), outline_in_rig_mm=corners)
    assert "coincides with the pupil" in refusal(virtual_centre_in_rig_mm=[0.0, 0.0, 1e-4])
    assert "NaN or infinite" in refusal(virtual_centre_in_rig_mm=[np.nan, -80, 80])
    assert "shape (2,), expected (3)" in refusal(virtual_centre_in_rig_mm=[-80, 80])
    assert "shape (3, 2), expected (n, 3)" in refusal(outline_in_rig_mm=np.zeros((3, 2)))
    assert "'first' or 'second'" in refusal(surface="third")
    assert "greater than or equal to 0.001" in refusal(thickness_mm=0.0)
    assert "greater than or equal to 1" in refusal(refractive_index=0.9)
    assert "Extra inputs" in refusal(tilt_deg=45.0)


def test_a_mirror_survives_json_to_the_bit() -> None:
    one = mirror(centre=(1 / 3, -80 * np.pi, 81.7))
    back = Mirror.model_validate_json(one.model_dump_json())
    assert back == one
    assert back.outline_in_rig_mm.tobytes() == one.outline_in_rig_mm.tobytes()


def test_a_mirror_moved_as_a_body_bends_as_before() -> None:
    bent = mirror(1.5 * np.array(QUAD), curvature_per_m=SADDLE)
    turn = Rotation.from_rotvec([0.02, -0.03, 0.25]).as_matrix()
    shift = np.array([0.4, -0.3, 0.8])
    moved = bent.moved(turn, shift)
    corners = bent.outline_in_rig_mm
    np.testing.assert_allclose(moved.sag_mm(moved.outline_in_rig_mm), bent.sag_mm(corners), atol=1e-12)
    assert np.abs(bent.sag_mm(corners)).max() > 0.02
    assert np.abs(moved.curvature_per_m - bent.curvature_per_m).max() > 0.01


def test_a_flat_mirror_is_filed_as_it_was_before_mirrors_could_bend() -> None:
    assert "curvature" not in mirror().model_dump_json()
    bent = mirror(curvature_per_m=(0.0, 0.35, 0.0))
    assert Mirror.model_validate_json(bent.model_dump_json()) == bent


def pentagon(surface: Literal["first", "second"]) -> Mirror:
    """A pentagon, 2 mm thick, 80 mm in front of the camera, that folds its view upwards."""
    return Mirror.from_plane(
        np.array([0.0, 0.0, 80.0]),
        np.array([0.0, 1.0, -1.0]),
        outline_in_rig_mm=CORNERS,
        surface=surface,
        thickness_mm=2.0,
    )


@pytest.mark.parametrize(("surface", "front_mm", "back_mm"), [("first", 0.0, -2.0), ("second", 2.0, 0.0)])
def test_the_solid_reaches_from_the_back_to_the_front(
    surface: Literal["first", "second"], front_mm: float, back_mm: float
) -> None:
    of = pentagon(surface)
    assert (of.front_mm, of.back_mm) == (front_mm, back_mm)
    face, opposite = np.split(of.solid.corners_in_rig_mm, 2)
    np.testing.assert_array_equal(face, CORNERS)
    heights_mm = opposite @ of.normal_in_rig + of.distance_mm
    np.testing.assert_allclose(heights_mm, front_mm + back_mm, atol=1e-9)


@pytest.mark.parametrize("surface", ["first", "second"])
def test_half_spaces_touch_every_corner_and_hold_all_of_them(surface: Literal["first", "second"]) -> None:
    solid = pentagon(surface).solid
    normals, offsets = solid.half_spaces
    heights_mm = solid.corners_in_rig_mm @ normals.T - offsets
    assert heights_mm.max() < 1e-9
    # Three faces of a prism meet in each corner.
    np.testing.assert_array_equal((np.abs(heights_mm) < 1e-9).sum(axis=1), 3)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert (solid.corners_in_rig_mm.mean(axis=0) @ normals.T < offsets).all()


def test_a_point_is_inside_between_the_faces_and_within_the_outline() -> None:
    of = pentagon("first")
    middle = CORNERS.mean(axis=0)
    normals, offsets = of.solid.half_spaces
    for height_mm, inside in ((0.1, False), (-0.1, True), (-1.9, True), (-2.1, False)):
        assert (normals @ (middle + height_mm * of.normal_in_rig) <= offsets).all() == inside
    assert not (normals @ (CORNERS[0] - [1.0, 0.0, 0.0] - of.normal_in_rig) <= offsets).all()


def test_half_spaces_of_a_designed_mirror_hold_its_corners(default_layout: Layout) -> None:
    for surface in ("first", "second"):
        pentagon = default_layout.mirrors[2].replaced(surface=surface, thickness_mm=3.0)
        normals, offsets = pentagon.solid.half_spaces
        heights = pentagon.solid.corners_in_rig_mm @ normals.T - offsets
        assert heights.max() < 1e-6
        # Each corner of a prism lies on three faces.
        np.testing.assert_array_equal(np.sum(np.abs(heights) < 1e-6, axis=1), 3)


def test_an_outline_in_the_plane_has_the_axes_of_the_mirror() -> None:
    corners = np.array([(-10.0, -8.0), (12.0, -8.0), (12.0, 8.0), (-14.0, 8.0)])
    for sign in (1, -1):
        point, normal = (3.0, -5.0, 90.0), sign * np.array([0.3, 1.0, -1.0])
        made = Mirror.from_plane(point, normal, outline_in_plane_mm=corners.tolist(), surface="second", thickness_mm=2)
        # The frame has its origin at the mean of the corners; corners are given about the point.
        np.testing.assert_allclose(made.outline_in_plane_mm, corners - corners.mean(axis=0), atol=1e-9)
        np.testing.assert_allclose((made.outline_in_rig_mm - point) @ normal, 0.0, atol=1e-9)
        assert made.is_second_surface


@pytest.mark.parametrize(
    ("point", "normal", "outline", "reason"),
    [
        ((0, 0, 90), (0, 0, 0), [(0, 0), (1, 0), (0, 1)], "^normal_in_rig: zero, expected a direction"),
        ((0, 90), (0, 0, 1), [(0, 0), (1, 0), (0, 1)], r"^point_in_rig_mm: shape \(2,\), expected \(3,\)"),
        ((0, 0, 90), (0, 0, 1), np.eye(3), r"^outline_in_plane_mm: shape \(3, 3\), expected \(n, 2\)"),
        ((0, 5, 90), (1, 0, 0), [(0, 0), (1, 0), (0, 1)], "coincides with the pupil"),
        ((0, 0, -90), (0, 0, 1), [(0, 0), (1, 0), (0, 1)], "behind the camera"),
    ],
)
def test_planes_that_are_no_mirror_are_refused(point: Any, normal: Any, outline: Any, reason: str) -> None:
    with pytest.raises(InputError, match=reason) as caught:
        Mirror.from_plane(point, normal, outline_in_plane_mm=outline)
    assert "\n" not in str(caught.value)


def test_a_mirror_has_one_outline() -> None:
    outline = [(-5.0, -5.0, 90.0), (5.0, -5.0, 90.0), (0.0, 5.0, 90.0)]
    with pytest.raises(InputError, match="expected one of them"):
        Mirror.from_plane((0, 0, 90), (0, 0, 1), outline_in_plane_mm=np.eye(3, 2), outline_in_rig_mm=outline)
