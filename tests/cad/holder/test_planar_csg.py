"""Union and difference of solids with flat faces, and the B-rep of the result.

Meshes of flat faces as B-reps: the same volume, one face per plane, holes, and ValueError for invalid solids.
"""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.holder.planar_csg import PlanarCsg, _planes_without_needles, _welded, brep
from mirrorcam.cad.plan.prisms import box
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.values import FloatArray

SQUARE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
UP = np.array([0.0, 0.0, 1.0])


def block(corner: tuple[float, float, float], size: tuple[float, float, float]) -> Frustum:
    base: FloatArray = SQUARE * size + corner
    return Frustum(base, base + size[2] * UP)


def test_faces_in_one_plane_become_one_face() -> None:
    csg = PlanarCsg()
    body = csg.joined([block((0, 0, 0), (4, 2, 3)), block((3, 0, 0), (4, 2, 3)), block((1, 1, 0), (2, 3, 3))])
    solid = brep(csg, body)
    assert solid.volume == pytest.approx(7 * 2 * 3 + 2 * 2 * 3)
    # A T: eight sides, floor and ceiling.
    assert len(solid.faces()) == 10
    assert len(solid.edges()) == 24


def test_a_ledge_cut_to_the_level_of_its_neighbour_is_one_face_with_it() -> None:
    """The cutter's floor and the block's top are in one plane, with opposite normals."""
    csg = PlanarCsg()
    body = csg.joined([block((0, 0, 0), (4, 2, 3)), block((3, 0, 0), (4, 2, 5))])
    solid = brep(csg, csg.cut(body, [block((2, -1, 3), (9, 4, 4))]))
    assert solid.volume == pytest.approx(7 * 2 * 3)
    assert len(solid.faces()) == 6


def test_a_hole_and_a_blind_hole_are_loops_of_their_faces() -> None:
    csg = PlanarCsg()
    body = csg.joined([block((0, 0, 0), (10, 10, 5))])
    body = csg.cut(body, [block((1, 1, -1), (2, 2, 7)), block((5, 5, 3), (2, 2, 3))])
    solid = brep(csg, body)
    assert solid.volume == pytest.approx(500 - 4 * 5 - 4 * 2)
    assert sorted(len(face.inner_wires()) for face in solid.faces()) == [0] * 13 + [1, 2]
    assert solid.is_valid


def test_planes_are_the_given_ones() -> None:
    """A cut at an odd angle: the face's normal is the cutter's up to rounding, not one fitted to corners."""
    csg = PlanarCsg()
    normal = np.array([0.1, 0.2, 1.0]) / np.linalg.norm([0.1, 0.2, 1.0])
    across = np.cross(normal, [1.0, 0.0, 0.0])
    along = np.cross(across, normal)
    square = np.array([3.0 * UP + 20.0 * (a * along + b * across) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    body = csg.cut(csg.joined([block((0, 0, 0), (2, 2, 9))]), [Frustum(square, square + 20.0 * normal)])
    solid = brep(csg, body)
    top = max(solid.faces(), key=lambda face: face.center().Z)
    assert 1.0 - abs(float(np.array(tuple(top.normal_at())) @ normal)) < 1e-15
    assert solid.volume == pytest.approx(4 * 3.0 - 0.1 * 4 - 0.2 * 4)


def test_corners_nearer_than_a_tenth_of_a_micrometre_are_one() -> None:
    csg = PlanarCsg()
    body = csg.joined([block((0, 0, 0), (4, 2, 3)), block((3, 0, 0), (4, 2 + 1e-6, 3))])
    solid = brep(csg, body)
    assert solid.is_valid
    assert min(edge.length for edge in solid.edges()) > 1e-4


def test_corners_at_one_place_are_merged_across_two_needles() -> None:
    """An edge of a tetrahedron, from corner 0 to 1, has corner 4 on one side and 5 on the other, at the same place."""
    corners = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10], [4, 0, 0], [4, 0, 0]])
    triangles = np.array([[0, 4, 2], [4, 1, 2], [0, 1, 4], [1, 0, 5], [1, 5, 3], [5, 0, 3], [0, 2, 3], [1, 3, 2]])
    found, planes = _welded(corners, triangles, np.array([0, 0, 0, 1, 1, 1, 2, 3]))
    assert found.tolist() == [[0, 4, 2], [4, 1, 2], [1, 4, 3], [4, 0, 3], [0, 2, 3], [1, 3, 2]]
    assert planes.tolist() == [0, 0, 1, 1, 2, 3]


def test_a_solid_inside_out_is_refused() -> None:
    class Wrong:
        faces = [face[::-1] for face in block((0, 0, 0), (1, 1, 1)).faces]  # noqa: RUF012

    with pytest.raises(ValueError, match="8 corners do not form a solid"):
        PlanarCsg().solid(Wrong())


def test_a_box_has_six_faces_and_its_volume() -> None:
    csg = PlanarCsg()
    solid = brep(csg, csg.joined([box((0.0, 0.0, 0.0), (30.0, 20.0, 10.0))]))
    assert len(solid.faces()) == 6
    assert solid.volume == pytest.approx(6000.0)


def test_faces_in_one_plane_become_one_and_a_hole_is_an_inner_loop() -> None:
    csg = PlanarCsg()
    two = [box((0.0, 0.0, 0.0), (30.0, 20.0, 10.0)), box((25.0, 0.0, 0.0), (60.0, 20.0, 10.0))]
    body = csg.cut(csg.joined(two), [box((10.0, 5.0, -1.0), (50.0, 15.0, 11.0))])
    solid = brep(csg, body)
    assert solid.is_valid
    assert len(solid.faces()) == 6 + 4
    assert sum(len(face.inner_wires()) for face in solid.faces()) == 2
    assert solid.volume == pytest.approx((60.0 * 20.0 - 40.0 * 10.0) * 10.0)


def test_faces_lie_in_the_given_planes_to_rounding() -> None:
    csg = PlanarCsg()
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    block = box((0.0, 0.0, 0.0), (30.0, 20.0, 10.0))
    turned = type(block)(block.base @ turn.T + 100.0, block.top @ turn.T + 100.0)
    normals, offsets = turned.half_spaces
    for face in brep(csg, csg.joined([turned])).faces():
        normal = np.array(tuple(face.normal_at()))
        nearest = int((normals @ normal).argmax())
        np.testing.assert_allclose(normal, normals[nearest], atol=1e-12)
        assert np.array(tuple(face.center())) @ normal == pytest.approx(offsets[nearest], abs=1e-9)


def test_a_triangle_that_is_a_line_belongs_to_the_face_beyond_its_longest_edge() -> None:
    """Two floors (plane 0) on one side of a line, a wall (plane 1) on the other, two degenerate triangles between.

    In the floors' plane these would join the floors, which have no edge in common.
    """
    corners = np.array([(0, 0, 0), (2, 0, 0), (3, 0, 0), (6, 0, 0), (1, 1, 0), (5, 1, 0), (3, 0, -1)], dtype=float)
    above = [(0, 1, 4), (2, 3, 5)]
    lines = [(0, 2, 1), (0, 3, 2)]
    wall = [(3, 0, 6)]
    # Triangles that close the surface, on their own planes.
    rest = [(4, 1, 5), (5, 1, 2), (0, 4, 6), (4, 5, 6), (5, 3, 6)]
    triangles = np.array([*above, *lines, *wall, *rest])
    planes = np.array([0, 0, 0, 0, 1, 2, 2, 3, 4, 5])
    assert _planes_without_needles(corners, triangles, planes).tolist() == [0, 0, 1, 1, 1, 2, 2, 3, 4, 5]
