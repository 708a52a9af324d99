"""Dimension lines: consecutive ones share a tier, and text keeps clear of extension lines."""

from __future__ import annotations

import numpy as np
from shapely import LineString, Polygon

from mirrorcam.cad.guide.dimension_lines import LinearDimension, draw_tiers
from mirrorcam.cad.guide.drawing_sheet import DrawingSheet

BOX = np.array([[60.0, 60.0], [140.0, 140.0]])


def drawn(*spans: tuple[float, float, str]) -> DrawingSheet:
    """Upright dimensions left of a square view, with ends in mm from its lower edge."""
    sheet = DrawingSheet(200.0, 200.0)
    dimensions = [LinearDimension(60.0 + np.array([a, b]), np.full(2, 60.0), words) for a, b, words in spans]
    draw_tiers(sheet, BOX, dimensions, 40.0, vertical=True)
    return sheet


def across(sheet: DrawingSheet, words: str) -> float:
    """The x of a text's base line."""
    return float(next(text.corners[:, 0].max() for text in sheet.text_boxes if text.text == words))


def test_dimensions_that_follow_each_other_share_a_line_and_others_do_not() -> None:
    sheet = drawn((0.0, 25.0, "chain a"), (25.0, 60.0, "chain b"), (5.0, 70.0, "beyond"))
    assert across(sheet, "chain a") == across(sheet, "chain b")
    assert across(sheet, "beyond") < across(sheet, "chain a")


def test_text_without_room_keeps_clear_of_extension_lines() -> None:
    """The end of another dimension is over a short one, so that its text is below."""
    for other, side in ((8.0, -1.0), (40.0, 1.0)):
        sheet = drawn((0.0, 4.0, "3.7"), (0.0, other, "8"), (0.0, 80.0, "80"))
        lines = [LineString(line) for line, _ in sheet.drawn_lines]
        (text,) = (Polygon(box.corners).buffer(-0.2) for box in sheet.text_boxes if box.text == "3.7")
        assert not any(text.intersects(line) for line in lines)
        assert np.sign(text.centroid.y - 60.0) == side


def test_no_text_is_beyond_the_room_however_many_lines_there_are() -> None:
    for vertical in (True, False):
        sheet = DrawingSheet(200.0, 200.0)
        dimensions = [
            LinearDimension(60.0 + np.array([0.0, 10.0 + 9.0 * k]), np.full(2, 60.0), f"{k}") for k in range(8)
        ]
        draw_tiers(sheet, BOX, dimensions, 40.0, vertical=vertical)
        axis = 0 if vertical else 1
        assert min(float(box.corners[:, axis].min()) for box in sheet.text_boxes) > 60.0 - 40.0
        assert min(float(line[:, axis].min()) for line, _ in sheet.drawn_lines) > 60.0 - 40.0
