"""Where parts are cut: thin walls beside a cut in closed form, corners that it keeps off, pieces and their joints."""

from __future__ import annotations

import math

import numpy as np
import pytest
from manifold3d import CrossSection, Manifold

from mirrorcam.cad.plan.cuts import FAR_MM, cells_between, joints_between, off_corners, thin_beside_mm2
from mirrorcam.cad.splitting.body_cuts import triangles_of


def test_thin_walls_beside_a_cut_are_measured() -> None:
    # A step at x = 20: a cut 0.5 mm before or behind it leaves 6 x 10 mm of a wall 0.5 mm thick, on one side.
    stepped = Manifold.cube((20.0, 10.0, 10.0)) + Manifold.cube((40.0, 10.0, 4.0))
    thin = thin_beside_mm2(triangles_of(stepped), 0, np.array([10.0, 18.7, 18.9, 19.5, 20.5, 21.3, 39.5]), 1.2)
    np.testing.assert_allclose(thin, [0.0, 0.0, 60.0, 60.0, 0.0, 0.0, 40.0], atol=1e-9)
    # Of the mirrored step the other side is thin.
    turned = stepped.mirror((1.0, 0.0, 0.0))
    thin = thin_beside_mm2(triangles_of(turned), 0, np.array([-20.5, -19.5, -18.9]), 1.2)
    np.testing.assert_allclose(thin, [0.0, 60.0, 60.0], atol=1e-9)
    # Along y the step is a wall of its full length.
    assert thin_beside_mm2(triangles_of(stepped), 1, np.array([0.5]), 1.2) == pytest.approx(200.0 + 80.0)


@pytest.mark.parametrize(("lean_deg", "share"), [(0.0, 1.0), (10.0, 1.2 / (10.0 * math.tan(math.radians(10.0))))])
def test_of_a_face_that_leans_only_what_is_near_counts(lean_deg: float, share: float) -> None:
    # An end of 10 x 10 mm, its upper edge further out by the lean; the cut is at its lower edge.
    out = 10.0 * math.tan(math.radians(lean_deg))
    profile = CrossSection([np.array([(0.0, 0.0), (20.0, 0.0), (20.0 + out, 10.0), (0.0, 10.0)])])
    body = Manifold.extrude(profile, 10.0)
    area = 100.0 / math.cos(math.radians(lean_deg))
    cut = 20.0 - 1e-9
    assert thin_beside_mm2(triangles_of(body), 0, np.array([cut]), 1.2) == pytest.approx(share * area, rel=1e-6)
    steep = 10.0 * math.tan(math.radians(16.0))
    wedge = CrossSection([np.array([(0.0, 0.0), (20.0, 0.0), (20.0 + steep, 10.0), (0.0, 10.0)])])
    assert thin_beside_mm2(triangles_of(Manifold.extrude(wedge, 10.0)), 0, np.array([cut]), 1.2) == 0.0


def test_a_cut_moves_off_corners_to_the_side_that_leaves_less_thin_walls() -> None:
    # A step down at x = 20: in front of it the cut leaves a wall that is thin, behind it none.
    stepped = triangles_of(Manifold.cube((20.0, 10.0, 10.0)) + Manifold.cube((40.0, 10.0, 4.0)))
    assert off_corners(stepped, 0, (20.0,), 1.2) == pytest.approx((20.01,))
    assert off_corners(stepped, 0, (10.0, 30.0), 1.2) == (10.0, 30.0)
    assert off_corners(stepped, 0, (), 1.2) == ()


def test_neighbouring_pieces_share_a_joint_whose_pins_keep_off_cuts_that_cross() -> None:
    low, high = np.zeros(3), np.array([300.0, 200.0, 20.0])
    cells = cells_between(((100.0, 200.0), (90.0,)), low, high)
    assert list(cells) == [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)]
    assert cells[0, 0] == ((-1.0, 100.0), (-1.0, 90.0))
    assert cells[2, 1] == ((200.0, 301.0), (90.0, 201.0))
    joints = joints_between(cells, 16.0)
    assert len(joints) == 2 * 2 + 3
    assert {joint.cells for joint in joints if joint.axis == 1} == {((i, 0), (i, 1)) for i in range(3)}
    spans = {joint.cells: (joint.at_mm, joint.span_mm) for joint in joints}
    assert spans[(0, 0), (1, 0)] == (100.0, (-FAR_MM, 74.0))
    assert spans[(1, 1), (2, 1)] == (200.0, (106.0, FAR_MM))
    assert spans[(1, 0), (1, 1)] == (90.0, (116.0, 184.0))
    assert joints_between(cells_between(((), ()), low, high), 16.0) == []
