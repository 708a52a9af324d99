"""The assembly drawing: a balloon for every line of the parts list, at a component of that item, without overlaps."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cad.guide.assembly_drawing import (
    BALLOON_MM,
    draw_assembly,
    listed_items,
    write_assembly_drawing,
)
from mirrorcam.cad.guide.drawing_sheet import PARTS_TOLERANCE, DrawingSheet
from tests.cad.guide.conftest import Made
from tests.cad.guide.test_drawing import crossed, outside, overlaps


@pytest.fixture(scope="module")
def sheet(made: Made) -> DrawingSheet:
    return draw_assembly(made.device.level_from_rig, made.components, "0123456789ab")


def test_the_parts_list_counts_every_piece_once(made: Made) -> None:
    listed = listed_items(made.components)
    assert [item.number for item in listed] == list(range(1, len(listed) + 1))
    assert Counter(component.name for item in listed for component in item.components) == Counter(
        p.name for p in made.components
    )
    assert {
        len({component.title for component in item.components})
        for item in listed
        if item.components[0].kind != "mirror"
    } == {1}
    (mirrors,) = (item for item in listed if item.components[0].kind == "mirror")
    assert len(mirrors.components) == len(made.device.layout.mirrors)
    assert all(item.reference for item in listed if item.components[0].kind in ("part", "screw", "insert", "nut"))


@pytest.mark.slow
def test_every_line_of_the_list_has_a_balloon(made: Made, sheet: DrawingSheet) -> None:
    texts = Counter(box.text for box in sheet.text_boxes)
    circles = [
        line.mean(axis=0) for line, _ in sheet.drawn_lines if len(line) == 49 and np.isclose(line[0], line[-1]).all()
    ]
    listed = listed_items(made.components)
    assert len(circles) == len(listed)
    for item in listed:
        assert texts[item.description] == 1
        inside = [
            box
            for box in sheet.text_boxes
            if box.text == str(item.number)
            and min(np.linalg.norm(box.corners.mean(axis=0) - middle) for middle in circles) < BALLOON_MM / 2.0
        ]
        assert len(inside) == 1


@pytest.mark.slow
def test_nothing_lies_over_anything(sheet: DrawingSheet) -> None:
    assert overlaps(sheet) == []
    assert outside(sheet) == []
    assert crossed(sheet) == []


@pytest.mark.slow
def test_the_files_are_the_same_each_time(made: Made, tmp_path: Path) -> None:
    first, second = (
        write_assembly_drawing(tmp_path / name, made.device.level_from_rig, made.components, "0123456789ab")
        for name in "ab"
    )
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()


def test_the_general_tolerance_is_that_of_the_parts_drawings(sheet: DrawingSheet) -> None:
    texts = [box.text for box in sheet.text_boxes]
    assert PARTS_TOLERANCE in texts
    assert [text for text in texts if "±" in text] == []
