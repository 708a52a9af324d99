"""Marks of parts: glyphs of printable width, in a free face, with material behind them."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from build123d import Box, GeomType, Location, Part, Plane, Pos
from shapely import Polygon

from mirrorcam.cad.parts.part_mark import (
    DEPTH_MM,
    EDGE_MM,
    SIDE_DEG,
    STROKE_MM,
    engraved,
    glyph_outlines,
    plan_mark,
)
from mirrorcam.cad.plan.part_plan import NamedFace
from mirrorcam.cad.plan.stroke_font import STROKES
from mirrorcam.optics.geometry.transforms import transform

# Two lines of a nozzle of 0.4 mm.
RIDGE_MM = 0.9
UP = np.array([0.0, 0.0, 1.0])
LINES = ("MC-07", "0f9ab2cd", "2026-11-23")


def block(width: float, depth: float, height: float) -> Part:
    part = Part() + Box(width, depth, height)
    part.label = "block"
    return part


@pytest.mark.parametrize("letter", sorted(STROKES))
def test_strokes_are_as_wide_and_ridges_between_them_as_wide_as_they_print(letter: str) -> None:
    outlines = shapely.union_all(list(glyph_outlines([letter + "8" + letter, "8" + letter])))
    ridge = 0.49 * RIDGE_MM
    closed = outlines.buffer(ridge, join_style="mitre").buffer(-ridge, join_style="mitre")
    assert closed.area == pytest.approx(outlines.area, rel=1e-6)
    assert outlines.buffer(-0.49 * STROKE_MM).area > 0.0
    # Wider only where strokes meet.
    assert outlines.buffer(-0.7 * STROKE_MM).area == 0.0


def test_a_mark_is_cut_as_deep_as_stated_and_no_wider_than_its_glyphs() -> None:
    part = block(60.0, 40.0, 5.0)
    mark = plan_mark(part, LINES, UP)
    assert mark is not None
    cut = engraved(part, mark)
    assert cut.label == "block"
    assert cut.is_valid
    assert len(cut.solids()) == 1
    narrower = DEPTH_MM * np.tan(np.deg2rad(SIDE_DEG))
    areas = [
        sum(outline.buffer(-share * narrower, join_style="mitre", mitre_limit=9.0).area for outline in mark.outlines)
        for share in (0.0, 0.5, 1.0)
    ]
    # Simpson's rule, exact since the area is quadratic in the depth.
    assert part.volume - cut.volume == pytest.approx(DEPTH_MM / 6.0 * (areas[0] + 4.0 * areas[1] + areas[2]), rel=1e-6)
    assert {face.geom_type for face in cut.faces()} == {GeomType.PLANE}
    np.testing.assert_allclose(mark.rig_from_face[:3, 2], UP, atol=1e-9)


def test_it_avoids_slots_behind_the_face() -> None:
    """A slot 0.1 mm wide and 0.9 mm behind the face, as makes slicers add walls, would leave a wall of 0.5 mm."""

    def backed(part: Part) -> Polygon:
        mark = plan_mark(part, LINES, UP)
        assert mark is not None
        corners = shapely.get_coordinates(list(mark.outlines))
        in_rig = transform(mark.rig_from_face, np.insert(corners, 2, 0.0, axis=1))
        np.testing.assert_allclose(in_rig[:, 2], 2.5)
        return shapely.box(*(in_rig[:, :2].min(axis=0) - EDGE_MM), *(in_rig[:, :2].max(axis=0) + EDGE_MM))

    solid = block(60.0, 60.0, 5.0)
    _, low, right, high = backed(solid).bounds
    x, y = right - 0.3, (low + high) / 2.0 + 2.0
    slotted = solid - Pos(x, y, -0.45) * Box(0.1, 2.0, 4.1)
    assert not backed(slotted).intersects(shapely.box(x - 0.05, y - 1.0, x + 0.05, y + 1.0))


@pytest.mark.parametrize("turned", [(0.0, 0.0, 0.0), (20.0, 35.0, 70.0)])
def test_it_avoids_named_faces_and_the_bed(turned: tuple[float, float, float]) -> None:
    place = Location((5.0, 6.0, 7.0), turned)
    part = Part() + place * Box(60.0, 40.0, 30.0)
    frame = Plane(place)
    up = np.array(tuple(frame.z_dir))
    top = NamedFace("top", np.array(tuple(frame.origin)) + 15.0 * up, up)
    mark = plan_mark(part, LINES, up, [top])
    assert mark is not None
    # Not on top, which is a named face, nor below: on a side, upright.
    assert abs(mark.rig_from_face[:3, 2] @ up) < 1e-9
    np.testing.assert_allclose(mark.rig_from_face[:3, 1], up, atol=1e-9)


def test_it_leaves_out_lines_or_all_where_there_is_no_space() -> None:
    small = plan_mark(block(30.0, 8.0, 4.0), LINES, UP)
    assert small is not None
    height = np.ptp(np.vstack([shapely.get_coordinates(each) for each in small.outlines])[:, 1])
    assert height < 8.0 - 2.0 * EDGE_MM + 1e-6
    assert plan_mark(block(12.0, 6.0, 4.0), LINES, UP) is None


def test_it_is_neither_cut_through_a_thin_wall_nor_hidden() -> None:
    assert plan_mark(block(60.0, 40.0, 1.5), LINES, UP) is None
    # A tray: its floor is open, its walls are too thin.
    tray = Part() + Box(60.0, 60.0, 5.0) + [Pos(side * 29.0, 0.0, 8.0) * Box(2.0, 60.0, 16.0) for side in (-1, 1)]
    inside = plan_mark(tray, LINES, UP)
    assert inside is not None
    lid = tray + Pos(0.0, 0.0, 16.0) * Box(60.0, 60.0, 1.0)
    under = plan_mark(lid, LINES, UP)
    assert under is None or abs(under.rig_from_face[2, 3] - 2.5) > 1e-6
