"""Callouts of holes: depths are those of the material, not of the tools that cut it."""

from __future__ import annotations

import numpy as np
import pytest
from build123d import Box, Cylinder, Part, Pos

from mirrorcam.cad.guide.hole_callouts import Material, called_out
from mirrorcam.cad.plan.dimension import holes
from mirrorcam.cad.plan.fasteners import NUT_FIT_MM, Bore, Hexagon
from mirrorcam.cad.plan.hardware import HARDWARE

UP, DOWN = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])
SCREW = HARDWARE.screw
TOP = np.array([0.0, 0.0, 10.01])
"""A hundredth above the top face of a plate from z = 0 to 10."""


def plate(*tools: tuple[float, float, float]) -> Part:
    """The plate less cylinders about z: their radii, from and to which z."""
    solid = Pos(0.0, 0.0, 5.0) * Box(40.0, 40.0, 10.0)
    for radius, low, high in tools:
        solid -= Pos(0.0, 0.0, (low + high) / 2.0) * Cylinder(radius, high - low)
    return Part(solid.wrapped)


def test_material_along_a_line_and_at_a_point() -> None:
    material = Material(plate((5.0, 4.0, 6.0)))
    assert material.holds(np.array([0.0, 0.0, 3.0]))
    assert not material.holds(np.array([0.0, 0.0, 5.0]))
    np.testing.assert_allclose(material.along(np.array([0.1, 0.2, -1.0]), UP, 20.0), [(1.0, 5.0), (7.0, 11.0)])


def test_a_blind_hole_for_an_insert_has_its_depth() -> None:
    radius = SCREW.insert_hole_mm / 2.0
    (hole,) = called_out(holes([Bore(TOP, DOWN, radius, 6.71)]), plate((radius, 3.3, 11.0)), SCREW)
    assert hole.text == "±0.1 ↧6.7 for M3 insert"
    np.testing.assert_allclose(hole.centre_in_rig, [0.0, 0.0, 10.0], atol=1e-6)
    (gauge,) = called_out(holes([Bore(TOP, DOWN, radius, 6.71)]), plate((radius, 3.3, 11.0)), SCREW, "")
    assert gauge.text == "↧6.7 for M3 insert"


def test_a_hole_with_nothing_behind_it_goes_through_however_far_its_tool_cuts() -> None:
    radius = SCREW.clearance_hole_mm / 2.0
    for depth in (10.02, 99.0):
        (hole,) = called_out(holes([Bore(TOP, DOWN, radius, depth)]), plate((radius, -1.0, 11.0)), SCREW)
        assert hole.text == "through for M3"


def test_a_hole_cut_from_its_shoulder_is_seen_from_its_open_end() -> None:
    solid = plate((1.7, -1.0, 11.0), (3.2, -1.0, 8.0))
    screw, driver = called_out(
        holes([Bore(TOP, DOWN, 1.7, 10.02), Bore(np.array([0.0, 0.0, 8.0]), DOWN, 3.2, 99.0)]), solid, SCREW
    )
    assert screw.text == "through for M3"
    assert driver.text == "↧8"
    np.testing.assert_allclose(driver.axis_in_rig, UP)


@pytest.mark.parametrize("turned_deg", [0.0, 10.0, 45.0, 90.0])
def test_a_slot_is_as_deep_as_the_walls_along_it(turned_deg: float) -> None:
    """A tool that cuts far beyond the material does not make it deeper, whichever way the slot lies."""
    turned = np.radians(turned_deg)
    along = np.array([np.cos(turned), np.sin(turned), 0.0])
    solid = plate((1.7, -1.0, 11.0))
    for at in np.linspace(-6.0, 6.0, 9):
        solid = Part((solid - Pos(*(at * along + 15.0 * UP).tolist()) * Cylinder(3.8, 14.0)).wrapped)
    slot = Bore(np.array([0.0, 0.0, 8.0]), UP, 3.8, 99.0, along, 12.0)
    (hole,) = called_out(holes([slot]), solid, SCREW)
    assert hole.text == "↧2"


def test_a_pocket_for_a_nut_says_so() -> None:
    flats = SCREW.nut_flats_mm + NUT_FIT_MM
    pocket = Hexagon(np.array([0.0, 0.0, 10.0]), DOWN, np.array([1.0, 0.0, 0.0]), flats, 2.6)
    (hole,) = called_out(holes([pocket]), plate((flats / 2.0, 7.4, 11.0)), SCREW)
    assert hole.text == "±0.1 ↧2.6 for M3 nut"
    assert hole.diameter_mm == pytest.approx(flats)
