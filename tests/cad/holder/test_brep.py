"""Meshes of flat faces as B-reps: the same volume, one face per plane, holes, and what is no solid refused."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.holder.brep import _settled_needles, brep
from mirrorcam.cad.holder.planar_csg import PlanarCsg
from mirrorcam.cad.plan.prisms import box


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


def test_faces_lie_in_the_planes_asked_for_to_rounding() -> None:
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
    """Two floors (plane 0) on one side of a line, a wall (plane 1) on its other; two lines lie between them.

    In the floors' plane those would join the floors, which have no edge in common.
    """
    corners = np.array([(0, 0, 0), (2, 0, 0), (3, 0, 0), (6, 0, 0), (1, 1, 0), (5, 1, 0), (3, 0, -1)], dtype=float)
    above = [(0, 1, 4), (2, 3, 5)]
    lines = [(0, 2, 1), (0, 3, 2)]
    wall = [(3, 0, 6)]
    # What closes the surface, on planes of its own.
    rest = [(4, 1, 5), (5, 1, 2), (0, 4, 6), (4, 5, 6), (5, 3, 6)]
    triangles = np.array([*above, *lines, *wall, *rest])
    planes = np.array([0, 0, 0, 0, 1, 2, 2, 3, 4, 5])
    assert _settled_needles(corners, triangles, planes).tolist() == [0, 0, 1, 1, 1, 2, 2, 3, 4, 5]
