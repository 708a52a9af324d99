"""Callouts of holes: depths in the material, not of the tools that cut it.

Positions of holes: in a table if they are many, in true length if they are oblique, and sizes of slots.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from build123d import Box, Cylinder, Part, Pos
from shapely import Polygon

from mirrorcam.cad.assembly.catalogue import parts_of
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.guide.dimension_lines import number
from mirrorcam.cad.guide.drawing import draw
from mirrorcam.cad.guide.drawing_sheet import DrawingSheet
from mirrorcam.cad.guide.hole_callouts import (
    MAX_COORDINATES,
    Material,
    callout,
    draw_oblique,
    hole_groups,
    hole_tables,
    numbered,
    oblique_holes,
    oblique_lengths,
    with_callouts,
)
from mirrorcam.cad.guide.part_views import FRONT, RIGHT, TOP, PartView, PlacedView
from mirrorcam.cad.plan.dimension import Datum, Hole, Length, holes
from mirrorcam.cad.plan.fasteners import NUT_FIT_MM, Bore, Hexagon
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.values import FloatArray

UPWARDS, DOWNWARDS = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])
SCREW = HARDWARE.screw
MOUTH = np.array([0.0, 0.0, 10.01])
"""A hundredth above the top face of a plate from z = 0 to 10."""


def plate(*tools: tuple[float, float, float]) -> Part:
    """The plate minus cylinders about z, given by radius and z range."""
    solid = Pos(0.0, 0.0, 5.0) * Box(40.0, 40.0, 10.0)
    for radius, low, high in tools:
        solid -= Pos(0.0, 0.0, (low + high) / 2.0) * Cylinder(radius, high - low)
    return Part(solid.wrapped)


def test_material_along_a_line_and_at_a_point() -> None:
    material = Material(plate((5.0, 4.0, 6.0)))
    assert material.contains(np.array([0.0, 0.0, 3.0]))
    assert not material.contains(np.array([0.0, 0.0, 5.0]))
    np.testing.assert_allclose(material.intervals(np.array([0.1, 0.2, -1.0]), UPWARDS, 20.0), [(1.0, 5.0), (7.0, 11.0)])


def test_a_blind_hole_for_an_insert_has_its_depth() -> None:
    radius = SCREW.insert_hole_mm / 2.0
    (hole,) = with_callouts(holes([Bore(MOUTH, DOWNWARDS, radius, 6.71)]), plate((radius, 3.3, 11.0)), SCREW)
    assert hole.text == "±0.1 ↧6.7 for M3 insert"
    np.testing.assert_allclose(hole.centre_in_rig, [0.0, 0.0, 10.0], atol=1e-6)
    (gauge,) = with_callouts(holes([Bore(MOUTH, DOWNWARDS, radius, 6.71)]), plate((radius, 3.3, 11.0)), SCREW, "")
    assert gauge.text == "↧6.7 for M3 insert"


def test_a_hole_with_nothing_behind_it_goes_through_however_far_its_tool_cuts() -> None:
    radius = SCREW.clearance_hole_mm / 2.0
    for depth in (10.02, 99.0):
        (hole,) = with_callouts(holes([Bore(MOUTH, DOWNWARDS, radius, depth)]), plate((radius, -1.0, 11.0)), SCREW)
        assert hole.text == "through for M3"


def test_a_hole_cut_from_its_shoulder_is_seen_from_its_open_end() -> None:
    solid = plate((1.7, -1.0, 11.0), (3.2, -1.0, 8.0))
    screw, driver = with_callouts(
        holes([Bore(MOUTH, DOWNWARDS, 1.7, 10.02), Bore(np.array([0.0, 0.0, 8.0]), DOWNWARDS, 3.2, 99.0)]), solid, SCREW
    )
    assert screw.text == "through for M3"
    assert driver.text == "↧8"
    np.testing.assert_allclose(driver.axis_in_rig, UPWARDS)


@pytest.mark.parametrize("turned_deg", [0.0, 10.0, 45.0, 90.0])
def test_a_slot_is_as_deep_as_the_walls_along_it(turned_deg: float) -> None:
    """A tool that cuts far past the material does not increase the depth, for any direction of the slot."""
    turned = np.radians(turned_deg)
    along = np.array([np.cos(turned), np.sin(turned), 0.0])
    solid = plate((1.7, -1.0, 11.0))
    for at in np.linspace(-6.0, 6.0, 9):
        solid = Part((solid - Pos(*(at * along + 15.0 * UPWARDS).tolist()) * Cylinder(3.8, 14.0)).wrapped)
    slot = Bore(np.array([0.0, 0.0, 8.0]), UPWARDS, 3.8, 99.0, along, 12.0)
    (hole,) = with_callouts(holes([slot]), solid, SCREW)
    assert hole.text == "↧2"


def test_a_pocket_for_a_nut_says_so() -> None:
    flats = SCREW.nut_flats_mm + NUT_FIT_MM
    pocket = Hexagon(np.array([0.0, 0.0, 10.0]), DOWNWARDS, np.array([1.0, 0.0, 0.0]), flats, 2.6)
    (hole,) = with_callouts(holes([pocket]), plate((flats / 2.0, 7.4, 11.0)), SCREW)
    assert hole.text == "±0.1 ↧2.6 for M3 nut"
    assert hole.diameter_mm == pytest.approx(flats)


UP = np.array([0.0, 0.0, 1.0])
SQUARE = np.array([(0.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0), (0.0, 0.0)])
VIEWS = tuple(PartView(axes, (SQUARE,), ()) for axes in (TOP, FRONT, RIGHT))


def row_of(count: int) -> list[Hole]:
    return [Hole(np.array([5.0 + 7.0 * place, 3.0 + place, 0.0]), UP, 3.4, "through") for place in range(count)]


def test_more_holes_than_dimensions_have_room_for_are_in_a_table() -> None:
    assert hole_tables(hole_groups(VIEWS, row_of(MAX_COORDINATES)), VIEWS) == ()
    holes = row_of(MAX_COORDINATES + 1)
    (table,) = hole_tables(hole_groups(VIEWS, holes), VIEWS)
    # From top to bottom, so that the last is the highest.
    assert table.rows[0] == ("1", "33.00", "7.00")
    assert table.rows[-1] == ("5", "5.00", "3.00")
    assert table.notes == ("view from above, mm from", "the lower left corner of that view")
    datum = Datum(np.array([5.0, 3.0, 9.0]), "the first of them")
    (table,) = hole_tables(hole_groups(VIEWS, [replace(hole, datum=datum) for hole in holes]), VIEWS)
    assert table.rows[-1] == ("5", "0.00", "0.00")
    assert table.notes[1] == "the first of them"


def test_numbers_do_not_depend_on_the_order_of_the_plan() -> None:
    holes = row_of(6)
    assert numbered(holes, VIEWS[0]) == numbered(holes[::-1], VIEWS[0]) == holes[::-1]


def test_a_slot_has_its_width_and_its_length() -> None:
    slot = Hole(np.zeros(3), UP, 3.4, "through for M3", 5.0, travel_mm=8.0)
    assert callout(slot, 1.0) == "slot 3.4 x 11.4 through for M3"
    groove = Hole(np.zeros(3), UP, 9.0, "x 84°", 5.0, "countersink", 8.0)
    assert callout(groove, 1.0) == "countersink slot 9 x 17 x 84° (far side)"


def oblique(turned_deg: float) -> Hole:
    """A hole at (20, 10, 30) with its axis parallel to the front view, from above at an angle to the horizontal."""
    turned = np.radians(turned_deg)
    return Hole(np.array([20.0, 10.0, 30.0]), -np.array([np.cos(turned), 0.0, np.sin(turned)]), 4.0, "↧6")


def test_an_oblique_hole_is_placed_where_its_axis_is_seen_in_true_length() -> None:
    hole = oblique(30.0)
    groups = hole_groups(VIEWS, [hole])
    assert oblique_holes(groups, VIEWS, []) == [(1, hole)]
    placed = PlacedView(VIEWS[1], 2.0, np.array([100.0, 50.0]))
    across, up = oblique_lengths(placed, hole)
    assert (across.text, up.text) == ("20", "30")
    # Two lengths of the plan that end on its axis replace it; others do not.
    on_axis = hole.centre_in_rig + 5.0 * hole.axis_in_rig
    for away, left in ((0.0, 0), (1.0, 1)):
        to_axis = Length(np.array([np.zeros(3), on_axis + away * UP]))
        assert len(oblique_holes(groups, VIEWS, [to_axis])) == 1
        assert len(oblique_holes(groups, VIEWS, [to_axis, to_axis])) == left
    # Holes along a view's direction are dimensioned in that view.
    assert oblique_holes(hole_groups(VIEWS, row_of(3)), VIEWS, []) == []


@pytest.mark.parametrize(
    ("turned_deg", "expected"),
    [(30.0, "30"), (45.0, "45"), (60.0, "30"), (120.0, "30"), (150.0, "30"), (-20.0, "20"), (200.0, "20")],
)
def test_its_angle_is_to_the_nearer_axis_of_the_view(turned_deg: float, expected: str) -> None:
    sheet = DrawingSheet(200.0, 200.0)
    hole = oblique(turned_deg)
    draw_oblique(sheet, PlacedView(VIEWS[1], 1.0, np.array([60.0, 60.0])), [hole])
    assert [box.text for box in sheet.text_boxes] == [f"{expected}°"]
    at = np.array([80.0, 90.0])
    arc = max((line for line, _ in sheet.drawn_lines), key=len)
    ways = (arc - at) / np.linalg.norm(arc - at, axis=1)[:, None]
    ends = np.degrees(np.arccos(np.clip(ways[0] @ ways[-1], -1.0, 1.0)))
    assert ends == pytest.approx(float(expected), abs=0.01)
    # It starts on an axis of the view, and ends on the hole's axis.
    assert np.abs(ways[0]).max() == pytest.approx(1.0)
    out: FloatArray = -hole.axis_in_rig[[0, 2]]
    np.testing.assert_allclose(ways[-1], out, atol=1e-9)


def test_parallel_oblique_holes_share_an_angle_whose_text_keeps_clear() -> None:
    placed, hole = PlacedView(VIEWS[1], 1.0, np.array([60.0, 60.0])), oblique(30.0)
    opposite = replace(hole, centre_in_rig=hole.centre_in_rig + 40.0 * UP, axis_in_rig=-hole.axis_in_rig)
    other = replace(oblique(70.0), centre_in_rig=hole.centre_in_rig - 30.0 * UP)
    sheet = DrawingSheet(200.0, 200.0)
    draw_oblique(sheet, placed, [hole, opposite, other])
    texts = [box.text for box in sheet.text_boxes]
    assert texts == ["2x 30°", "20°"]
    # The same place, with a text in it.
    taken = sheet.text_boxes[0].corners
    sheet = DrawingSheet(200.0, 200.0)
    sheet.text(taken[0], "a text", 2.5)
    draw_oblique(sheet, placed, [hole, opposite, other])
    first, second, _ = (Polygon(box.corners) for box in sheet.text_boxes)
    assert not first.intersects(second)


def test_the_screw_at_the_corner_of_a_clip_is_placed(device: Device) -> None:
    part = next(part for part in parts_of(device) if part.name == "camera_clip")
    texts = [box.text for box in draw(part.make(part.plan), part, HARDWARE.printer).text_boxes]
    clip = device.clip
    assert clip.nest is not None
    screw = clip.nest.screws[1]
    mouth = screw.tip - screw.mouth_mm * screw.axis
    corners = np.vstack([np.vstack([piece.base, piece.top]) for piece in clip.pieces])
    reach = min(abs(float(mouth[0] - side)) for side in (corners[:, 0].min(), corners[:, 0].max()))
    far = max(abs(float(mouth[0] - side)) for side in (corners[:, 0].min(), corners[:, 0].max()))
    assert {number(reach), number(far)} & set(texts)
    assert number(float(mouth[1]) - clip.slide_y_mm) in texts
    assert "45°" in texts
