"""Cuts of parts: thin walls next to a cut in closed form, corners that it avoids, pieces and their joints.

The printer's bed: the rotation of a part on it, its height limit, and the slack of cuts.

Pins between pieces: frames of their holes, the wall round them, and the farthest two positions.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from manifold3d import CrossSection, Manifold

from mirrorcam.cad.plan.cuts import (
    FAR_MM,
    MAX_SHIFT_MM,
    avoid_corners,
    bed_lengths_mm,
    cells_between,
    clearance_around_pin_mm,
    cut_slack_mm,
    depth_for_pin_mm,
    farthest_pair,
    hole_depth_mm,
    hole_frame,
    hole_mm,
    joints_between,
    require_height,
    rotated_onto_bed,
    thin_wall_mm2,
)
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.cad.splitting import triangles_of
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.transforms import transform


def test_thin_walls_beside_a_cut_are_measured() -> None:
    # A step at x = 20: a cut 0.5 mm to either side leaves 6 x 10 mm of a wall 0.5 mm thick on one side.
    stepped = Manifold.cube((20.0, 10.0, 10.0)) + Manifold.cube((40.0, 10.0, 4.0))
    thin = thin_wall_mm2(triangles_of(stepped), 0, np.array([10.0, 18.7, 18.9, 19.5, 20.5, 21.3, 39.5]), 1.2)
    np.testing.assert_allclose(thin, [0.0, 0.0, 60.0, 60.0, 0.0, 0.0, 40.0], atol=1e-9)
    # For the mirrored step the other side is thin.
    turned = stepped.mirror((1.0, 0.0, 0.0))
    thin = thin_wall_mm2(triangles_of(turned), 0, np.array([-20.5, -19.5, -18.9]), 1.2)
    np.testing.assert_allclose(thin, [0.0, 60.0, 60.0], atol=1e-9)
    # Along y the step is a wall of its full length.
    assert thin_wall_mm2(triangles_of(stepped), 1, np.array([0.5]), 1.2) == pytest.approx(200.0 + 80.0)


@pytest.mark.parametrize(("lean_deg", "share"), [(0.0, 1.0), (10.0, 1.2 / (10.0 * math.tan(math.radians(10.0))))])
def test_only_the_near_part_of_an_inclined_face_counts(lean_deg: float, share: float) -> None:
    # An end of 10 x 10 mm, its upper edge further out by the lean; the cut is at its lower edge.
    out = 10.0 * math.tan(math.radians(lean_deg))
    profile = CrossSection([np.array([(0.0, 0.0), (20.0, 0.0), (20.0 + out, 10.0), (0.0, 10.0)])])
    body = Manifold.extrude(profile, 10.0)
    area = 100.0 / math.cos(math.radians(lean_deg))
    cut = 20.0 - 1e-9
    assert thin_wall_mm2(triangles_of(body), 0, np.array([cut]), 1.2) == pytest.approx(share * area, rel=1e-6)
    steep = 10.0 * math.tan(math.radians(16.0))
    wedge = CrossSection([np.array([(0.0, 0.0), (20.0, 0.0), (20.0 + steep, 10.0), (0.0, 10.0)])])
    assert thin_wall_mm2(triangles_of(Manifold.extrude(wedge, 10.0)), 0, np.array([cut]), 1.2) == 0.0


def test_a_cut_moves_off_corners_to_the_side_that_leaves_less_thin_walls() -> None:
    # A step down at x = 20: a cut before it leaves a thin wall, one after it none.
    stepped = triangles_of(Manifold.cube((20.0, 10.0, 10.0)) + Manifold.cube((40.0, 10.0, 4.0)))
    assert avoid_corners(stepped, 0, (20.0,), 1.2) == pytest.approx((20.01,))
    assert avoid_corners(stepped, 0, (10.0, 30.0), 1.2) == (10.0, 30.0)
    assert avoid_corners(stepped, 0, (), 1.2) == ()


def test_adjacent_pieces_share_a_joint_with_pins_clear_of_crossing_cuts() -> None:
    low, high = np.zeros(3), np.array([300.0, 200.0, 20.0])
    cells = cells_between(((100.0, 200.0), (90.0,)), low, high)
    assert list(cells) == [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)]
    assert cells[0, 0] == ((-1.0, 100.0), (-1.0, 90.0))
    assert cells[2, 1] == ((200.0, 301.0), (90.0, 201.0))
    joints = joints_between(cells, 16.0)
    assert len(joints) == 2 * 2 + 3
    assert {joint.cells for joint in joints if joint.axis == 1} == {((i, 0), (i, 1)) for i in range(3)}
    spans = {joint.cells: (joint.cut_mm, joint.span_mm) for joint in joints}
    assert spans[(0, 0), (1, 0)] == (100.0, (-FAR_MM, 74.0))
    assert spans[(1, 1), (2, 1)] == (200.0, (106.0, FAR_MM))
    assert spans[(1, 0), (1, 1)] == (90.0, (116.0, 184.0))
    assert joints_between(cells_between(((), ()), low, high), 16.0) == []


LONG_BED = HARDWARE.replaced(printer=HARDWARE.printer.replaced(bed_mm=(200.0, 300.0, 250.0)))


def test_the_longer_side_of_a_part_lies_along_the_longer_side_of_the_bed() -> None:
    assert bed_lengths_mm((250.0, 100.0), LONG_BED) == (300.0, 200.0)
    assert bed_lengths_mm((100.0, 250.0), LONG_BED) == (200.0, 300.0)


def test_a_part_is_rotated_by_a_quarter_turn_only_if_it_fits_no_other_way(block: PartPlan) -> None:
    assert rotated_onto_bed(block, 190.0, 300.0, LONG_BED) is block
    assert rotated_onto_bed(block, 250.0, 200.0, LONG_BED) is block
    turned = rotated_onto_bed(replace(block, print_from_rig=np.eye(4)), 250.0, 300.0, LONG_BED)
    np.testing.assert_allclose(transform(turned.print_from_rig, np.array([250.0, 100.0, 5.0])), [-100.0, 250.0, 5.0])
    assert np.linalg.det(turned.print_from_rig) == pytest.approx(1.0)


@pytest.mark.parametrize(("length", "count"), [(300.0, 2), (500.0, 3), (800.0, 4)])
def test_cuts_moved_by_their_slack_leave_pieces_that_fit(length: float, count: int) -> None:
    slack = cut_slack_mm(length, count, 220.0)
    longest = length / count + (slack if count == 2 else 2.0 * slack)
    assert longest + MAX_SHIFT_MM == pytest.approx(220.0)
    # No piece may be longer than the bed, so that cuts of pieces that just fit cannot move.
    assert cut_slack_mm(440.0, 2, 220.0) == 0.0


def test_a_part_taller_than_the_printer_is_refused() -> None:
    require_height("bar", 250.0, HARDWARE)
    with pytest.raises(InputError, match=r"^bar is 250\.1 mm high, expected at most 250 mm \(printer bed\)$"):
        require_height("bar", 250.1, HARDWARE)


DIAMETER, LENGTH = HARDWARE.holder.pin_mm


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_hole_enters_its_piece_with_its_roof_up(axis: int, side: float) -> None:
    frame = hole_frame(np.array([3.0, 4.0, 5.0]), axis, side)
    np.testing.assert_array_equal(frame[:3, 3], [3.0, 4.0, 5.0])
    np.testing.assert_array_equal(frame[:3, 2], side * np.eye(3)[axis])
    np.testing.assert_array_equal(frame[:3, 1], [0.0, 0.0, 1.0])
    np.testing.assert_allclose(frame[:3, :3] @ frame[:3, :3].T, np.eye(3))
    assert np.linalg.det(frame) == pytest.approx(1.0)


def test_a_hole_is_wider_than_its_pin_deeper_than_half_of_it_and_leaves_a_wall() -> None:
    wall = HARDWARE.printer.wall_mm
    assert hole_mm(HARDWARE) > DIAMETER
    assert 2.0 * hole_depth_mm(HARDWARE) > LENGTH
    assert depth_for_pin_mm(HARDWARE) - hole_depth_mm(HARDWARE) == pytest.approx(wall)
    # The ridge of the roof is the intersection of two tangents of the hole.
    ridge = hole_mm(HARDWARE) / 2.0 / np.sin(np.radians(42.0))
    assert clearance_around_pin_mm(HARDWARE) == pytest.approx(ridge + wall)


def test_the_farthest_pair_of_points_and_of_no_points() -> None:
    pair, apart = farthest_pair(np.array([(0.0, 0.0), (3.0, 0.0), (1.0, 1.0), (3.0, 4.0)]))
    assert apart == 5.0
    assert {tuple(point) for point in pair} == {(0.0, 0.0), (3.0, 4.0)}
    assert farthest_pair(np.zeros((0, 2)))[1] == 0.0
    assert farthest_pair(np.ones((1, 2)))[1] == 0.0
