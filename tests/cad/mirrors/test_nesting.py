"""Packing of convex pieces: complete, apart, rotated but never flipped, and dense in known cases."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import MultiPoint, Polygon

from mirrorcam.cad.mirrors.nesting import fits, nest
from mirrorcam.core.values import FloatArray

GAP = 3.0


def rectangle(width: float, height: float) -> FloatArray:
    return np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])


@st.composite
def convex(draw: st.DrawFn) -> FloatArray:
    """Three to six corners on an ellipse: convex, at any rotation."""
    angles = np.array(sorted(draw(st.lists(st.integers(0, 71), min_size=3, max_size=6, unique=True)))) * np.pi / 36.0
    size = np.array([draw(st.floats(4.0, 60.0)), draw(st.floats(4.0, 60.0))])
    turn = draw(st.floats(0.0, 6.28))
    corners = np.column_stack([np.cos(angles), np.sin(angles)]) * size
    return corners @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])


@settings(max_examples=40, deadline=None)
@given(st.lists(convex().filter(lambda piece: MultiPoint(piece).convex_hull.area > 20.0), min_size=1, max_size=10))
def test_pieces_lie_entirely_on_their_sheets_with_gaps(pieces: list[FloatArray]) -> None:
    places = nest(pieces, (140.0, 130.0), GAP)
    assert len(places) == len(pieces)
    sheets: dict[int, list[Polygon]] = {}
    for piece, place in zip(pieces, places, strict=True):
        np.testing.assert_allclose(place.rotation @ place.rotation.T, np.eye(2), atol=1e-12)
        assert np.linalg.det(place.rotation) == pytest.approx(1.0)
        sheets.setdefault(place.sheet, []).append(Polygon(place.apply(piece)))
    assert sorted(sheets) == list(range(len(sheets)))
    for polygons in sheets.values():
        for index, polygon in enumerate(polygons):
            left, bottom, right, top = polygon.bounds
            assert min(left, bottom, 140.0 - right, 130.0 - top) >= GAP - 1e-5
            assert all(polygon.distance(other) >= GAP - 1e-6 for other in polygons[index + 1 :])


def test_equal_rectangles_fill_a_sheet_without_waste() -> None:
    # Four columns of five pieces of 20 x 30 mm, long side across, with 3 mm around each, fill it exactly.
    sheet = (4 * 30.0 + 5 * GAP, 5 * 20.0 + 6 * GAP)
    places = nest([rectangle(20.0, 30.0)] * 20, sheet, GAP)
    assert {place.sheet for place in places} == {0}
    more = nest([rectangle(20.0, 30.0)] * 21, sheet, GAP)
    assert max(place.sheet for place in more) == 1


def test_two_right_triangles_share_the_box_of_one() -> None:
    triangle = np.array([[0.0, 0.0], [60.0, 0.0], [0.0, 60.0]])
    # Two halves of a square, half a gap apart along both axes, need sqrt(2) gaps more than the square.
    side = 60.0 + 2.0 * GAP + np.sqrt(2.0) * GAP + 1.0
    places = nest([triangle, triangle], (side, side), GAP)
    assert {place.sheet for place in places} == {0}


def test_a_piece_is_rotated_to_fit_and_refused_if_it_cannot() -> None:
    places = nest([rectangle(10.0, 90.0)], (96.0, 20.0), GAP)
    assert np.ptp(places[0].apply(rectangle(10.0, 90.0)), axis=0) == pytest.approx([90.0, 10.0])
    assert not fits(rectangle(10.0, 91.0), (96.0, 20.0), GAP)
    with pytest.raises(ValueError, match="larger than a sheet"):
        nest([rectangle(5.0, 5.0), rectangle(10.0, 91.0)], (96.0, 20.0), GAP)


def test_no_pieces_need_no_sheet() -> None:
    assert nest([], (100.0, 100.0), GAP) == []
