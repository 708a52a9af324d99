"""Strip plans: every mirror once, on strips of its own width, within the sheet."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mirrorcam.cad.mirrors.strips import Strip, strip_plan

SHEET_MM = (300.0, 200.0)
SIDES = st.tuples(st.integers(5, 60), st.integers(5, 60)).map(lambda pair: (float(max(pair)), float(min(pair))))


def test_mirrors_of_one_width_share_a_strip() -> None:
    sizes = {"a": (30.0, 20.0), "b": (25.0, 15.0), "c": (40.0, 20.0)}
    assert strip_plan(sizes, (200.0, 300.0)) == (
        Strip(1, 20.0, (("c", 40.0), ("a", 30.0))),
        Strip(1, 15.0, (("b", 25.0),)),
    )


def test_a_full_strip_or_sheet_is_followed_by_another() -> None:
    strips = strip_plan({str(k): (30.0, 20.0) for k in range(5)}, (60.0, 40.0))
    assert [(strip.sheet, len(strip.pieces)) for strip in strips] == [(1, 2), (1, 2), (2, 1)]


@given(st.lists(SIDES, min_size=1, max_size=40))
def test_any_rectangles_are_cut_within_their_sheets(sides: list[tuple[float, float]]) -> None:
    sizes = {str(k): size for k, size in enumerate(sides)}
    strips = strip_plan(sizes, SHEET_MM)
    pieces = {name: (length, strip.width_mm) for strip in strips for name, length in strip.pieces}
    assert pieces == sizes
    assert sum(len(strip.pieces) for strip in strips) == len(sizes)
    assert all(strip.length_mm <= SHEET_MM[0] for strip in strips)
    for sheet in {strip.sheet for strip in strips}:
        assert sum(strip.width_mm for strip in strips if strip.sheet == sheet) <= SHEET_MM[1]


def test_a_mirror_larger_than_the_sheet_is_refused() -> None:
    with pytest.raises(ValueError, match="mirror a of 310 x 20 mm is larger than a sheet"):
        strip_plan({"a": (310.0, 20.0)}, SHEET_MM)
