"""Dimensions in the rig frame: the span of a length, in full and along a direction; which plans offer any.

Dimensions of holes among the cuts of a part.
"""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.plan.dimension import Dimensioned, Length, holes
from mirrorcam.cad.plan.fasteners import Bore, Hexagon
from mirrorcam.cad.plan.hardware import HARDWARE


def test_a_length_along_a_direction_is_the_projection_of_its_span() -> None:
    ends = np.array([(1.0, 2.0, 3.0), (4.0, 6.0, 3.0)])
    np.testing.assert_array_equal(Length(ends).span_in_rig, [3.0, 4.0, 0.0])
    np.testing.assert_array_equal(Length(ends, way_in_rig=np.array([0.0, 1.0, 0.0])).span_in_rig, [0.0, 4.0, 0.0])
    across = Length(ends, way_in_rig=np.array([0.8, -0.6, 0.0])).span_in_rig
    np.testing.assert_allclose(across, np.zeros(3), atol=1e-12)


def test_plans_with_dimensions_satisfy_the_protocol() -> None:
    assert isinstance(plan_clip(HARDWARE), Dimensioned)
    assert not isinstance(HARDWARE, Dimensioned)


def test_every_hole_is_read_from_the_cuts_with_its_tools_length() -> None:
    down, at, up = np.array([0.0, 0.0, -1.0]), np.array([5.0, 0.0, 3.0]), np.array([1.0, 0.0, 0.0])
    screw, driver = Bore(at, down, 1.7, 4.0), Bore(at + 4.0 * down, -down, 3.2, 99.0)
    slot, nut = Bore(np.zeros(3), down, 1.7, 4.0, up, 8.0), Hexagon(at, down, up, 5.7, 2.6)
    found = holes((screw, driver, slot, nut, "another cut"))
    assert [(hole.diameter_mm, hole.travel_mm) for hole in found] == [(3.4, 0.0), (6.4, 0.0), (3.4, 8.0), (5.7, 0.0)]
    assert [hole.text for hole in found] == [""] * 4
    assert [hole.form for hole in found] == ["round", "round", "round", "hexagon"]
    # A bore starts slightly outside the material; the cut is measured from the face.
    cuts: tuple[Bore | Hexagon, ...] = (screw, driver, slot, nut)
    for hole, cut in zip(found, cuts, strict=True):
        assert hole.cut_mm is not None
        end = hole.centre_in_rig + hole.cut_mm * hole.axis_in_rig
        np.testing.assert_allclose(end, cut.mouth + cut.depth_mm * cut.axis, atol=1e-12)
