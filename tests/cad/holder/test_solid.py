"""The solid itself, against closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from build123d import GeomType

from cad.hardware import HARDWARE
from cad.holder.plan import plan_holder
from cad.holder.rims import STEP_MM
from cad.holder.solid import check_gaps, make_holder, solid_of
from cad.seats import Frustum
from optics.layout import Layout
from optics.values import InputError


def test_a_frustums_solid_has_its_volume() -> None:
    base = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 2.0, 0.0], [0.0, 2.0, 0.0]])
    top = base + np.array([0.5, 0.25, 4.0])
    assert solid_of(Frustum(base, top)).volume == pytest.approx(24.0)
    pyramid = solid_of(Frustum(base, np.array([[7.0, 7.0, 4.0]])))
    assert pyramid.volume == pytest.approx(8.0)
    assert pyramid.is_valid


def test_two_mirrors_in_one_plane_give_a_plate_with_rims_and_holes(make_flat_pair: Callable[..., Layout]) -> None:
    """All seats coplanar: a bevelled plate as thick as an insert needs, eight rims, four blind holes, nothing else."""
    width, height, gap, thickness = 40.0, 30.0, 8.0, 2.0
    part = make_holder(
        plan_holder(make_flat_pair(gap_mm=gap, width_mm=width, height_mm=height, thickness_mm=thickness), HARDWARE)
    )
    margin = HARDWARE.fit.free_mm + HARDWARE.holder.rim_mm
    depth = HARDWARE.screw.insert_depth_mm + HARDWARE.printer.wall_mm
    plate = (2 * width + gap + 2 * margin) * (height + 2 * margin) - 4 * margin**2 / 2
    # The bevels that face the gap lie inside the slab's hull, whose front is level with the fillers.
    rims = sum(2 * (2 * (edge - 2 * STEP_MM)) for edge in (width, height)) * HARDWARE.holder.rim_mm
    holes = 4 * math.pi * (HARDWARE.screw.insert_hole_mm / 2) ** 2 * HARDWARE.screw.insert_depth_mm
    expected = plate * depth + rims * HARDWARE.holder.rim_height_of_sheet * thickness - holes
    assert part.volume == pytest.approx(expected, rel=1e-9)
    assert len(part.solids()) == 1
    assert part.is_valid


def test_the_back_is_one_flat_face_with_four_holes(default_layout: Layout) -> None:
    body = plan_holder(default_layout, HARDWARE)
    part = make_holder(body)
    away = body.rig_from_mount[:3, 2]
    flat = part.faces().filter_by(GeomType.PLANE)
    backs = [face for face in flat if np.array(tuple(face.normal_at())) @ away > 1.0 - 1e-12]
    outermost = max(backs, key=lambda face: float(np.array(tuple(face.center())) @ away))
    assert len(outermost.inner_wires()) == 4
    drilled = part.faces().filter_by(GeomType.CYLINDER)
    assert len(drilled) == 4
    assert all(face.radius == pytest.approx(HARDWARE.screw.insert_hole_mm / 2) for face in drilled)
    # Nothing stands out of it: the part lies flat on the bed.
    corners = np.array([tuple(vertex) for vertex in part.vertices()]) @ away
    assert corners.max() == pytest.approx(float(np.array(tuple(outermost.center())) @ away))


def test_sheets_that_nearly_touch_are_refused(make_flat_pair: Callable[..., Layout]) -> None:
    check_gaps(make_flat_pair(gap_mm=0.31), HARDWARE)
    with pytest.raises(
        InputError, match=r"mirrors 0 and 1 are 0\.25 mm apart as cut from sheet, expected at least 0\.30"
    ):
        check_gaps(make_flat_pair(gap_mm=0.25), HARDWARE)


def test_a_holder_that_the_light_cuts_apart_is_refused(make_flat_pair: Callable[..., Layout]) -> None:
    body = plan_holder(make_flat_pair(gap_mm=30.0), HARDWARE)
    origin, turn = body.rig_from_mount[:3, 3], body.rig_from_mount[:3, :3]
    square = np.array([[-5.0, -60.0, 1.0], [5.0, -60.0, 1.0], [5.0, 60.0, 1.0], [-5.0, 60.0, 1.0]])
    slot = Frustum(square @ turn.T + origin, (square - [0.0, 0.0, 60.0]) @ turn.T + origin)
    parted = type(body)(**{**vars(body), "keep_outs": (*body.keep_outs, (slot,))})
    with pytest.raises(InputError, match="falls apart into 2 pieces where the light passes"):
        make_holder(parted)
