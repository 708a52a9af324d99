"""Sections: the planes of the cuts, the cut faces, their hatching, and the trace."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from shapely import LineString, box

from mirrorcam.cad.guide.drawing_sheet import DrawingSheet
from mirrorcam.cad.guide.part_views import FRONT, RIGHT, TOP, PlacedView, project
from mirrorcam.cad.guide.sections import (
    HATCH_LINE_MM,
    cut,
    cutting_plane_line,
    draw_cutting_plane_line,
    hatch,
    section_plane,
)
from mirrorcam.cad.plan.dimension import Hole
from mirrorcam.cad.plan.part_plan import PartPlan

BED = np.eye(3)
UP, ALONG_X = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])


def test_a_block_is_cut_through_its_holes_and_hatched_between_them(block: Callable[..., PartPlan]) -> None:
    part = block()
    solid = part.make(part.plan)
    section = cut(solid, 1, 0.0, BED)
    assert section is not None
    # 60 x 10 minus two holes of 6 through the full height: three rectangles.
    assert sorted(round(face.area, 3) for face in section.faces) == [70.0, 70.0, 340.0]
    np.testing.assert_allclose(section.view.box, [[-30.0, -5.0], [30.0, 5.0]], atol=1e-6)
    sheet = DrawingSheet(100.0, 100.0)
    hatch(sheet, section.faces, 1.0, np.array([50.0, 50.0]))
    holes = [box(x - 2.9, 45.0, x + 2.9, 55.0) for x in (30.0, 70.0)]
    lines = [LineString(line) for line, width in sheet.drawn_lines if width == HATCH_LINE_MM]
    assert len(lines) > 20
    for line in lines:
        assert not any(line.intersects(hole) for hole in holes)
        (x, y), (x1, y1) = line.coords
        assert y1 - y == pytest.approx(x1 - x)
    assert cut(solid, 1, 99.0, BED) is None


def test_only_what_is_behind_the_plane_is_seen(block: Callable[..., PartPlan]) -> None:
    part = block()
    for normal, axes in enumerate((RIGHT, FRONT, TOP)):
        section = cut(part.make(part.plan), normal, 2.0, BED)
        assert section is not None
        np.testing.assert_allclose(section.view.axes_in_rig, axes)
        assert sum(face.area for face in section.faces) > 0.0


def test_a_part_is_cut_where_most_of_its_blind_holes_are() -> None:
    def hole(x: float, y: float, axis: np.ndarray, text: str) -> Hole:
        return Hole(np.array([x, y, 0.0]), axis, 4.0, text, 5.0)

    through = [hole(x, 0.0, UP, "through") for x in (0.0, 10.0, 20.0)]
    assert section_plane("a plan", through, BED) == (1, 0.0)
    blind = [hole(7.0, y, UP, "↧5") for y in (3.0, 9.0)]
    assert section_plane("a plan", [*through, *blind], BED) == (0, 7.0)
    # A wider hole on the same axis counts once.
    twice = [hole(7.0, 3.0, UP, "↧5"), hole(7.0, 3.0, -UP, "↧2"), *(hole(x, 5.0, ALONG_X, "↧5") for x in (0.0, 1.0))]
    assert section_plane("a plan", twice, BED) == (0, 7.0)
    assert section_plane("a plan", [], BED) is None


def test_the_cutting_plane_line_is_drawn_clear_of_text(block: Callable[..., PartPlan]) -> None:
    part = block()
    solid = part.make(part.plan)
    section = cut(solid, 0, 20.0, BED)
    assert section is not None
    views = [
        PlacedView(project(solid, axes), 1.0, np.array(shift))
        for axes, shift in ((TOP, (50.0, 150.0)), (FRONT, (50.0, 50.0)), (RIGHT, (150.0, 50.0)))
    ]
    traces = [cutting_plane_line(view, section, BED) for view in views]
    assert traces[2] is None
    seen = [trace for trace in traces if trace]
    for trace in seen:
        np.testing.assert_allclose(trace.ends[:, 0], 70.0)
        np.testing.assert_allclose(trace.arrow, [-1.0, 0.0])
    sheet = DrawingSheet(200.0, 200.0)
    sheet.text((68.0, 170.0), "in the way", 3.0)
    draw_cutting_plane_line(sheet, seen, "A")
    letters = [box for box in sheet.text_boxes if box.text == "A"]
    assert len(letters) == 2
    assert all(box.corners[:, 1].max() < 70.0 for box in letters)
