"""What is engraved: as high as asked or as there is room for, inside, upright and unlike its mirror image."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from shapely import LineString, Polygon

from cad.mirrors.marks import LINE_GAP_MM, STROKES, mark

WIDE = np.array([[0.0, 0.0], [60.0, 0.0], [60.0, 40.0], [0.0, 40.0]])


def test_a_mark_has_its_height_and_points_up_from_the_middle() -> None:
    strokes = mark("0-1", WIDE, 5.0)
    np.testing.assert_allclose(strokes[0][1] - strokes[0][0], [0.0, 5.0])
    corners = np.vstack(strokes)
    np.testing.assert_allclose((corners.min(axis=0) + corners.max(axis=0)) / 2.0, [30.0, 20.0])
    # One arrow of two strokes, and one stroke for each of 0, -, 1.
    assert len(strokes) == 5


@pytest.mark.parametrize("outline", [WIDE / 8.0, WIDE[::-1] / 8.0, np.array([[0.0, 0.0], [9.0, 1.0], [2.0, 12.0]])])
def test_a_mark_shrinks_until_it_keeps_the_line_gap(outline: np.ndarray) -> None:
    strokes = mark("10-11", outline, 5.0)
    assert np.ptp(np.vstack(strokes)[:, 1]) < 3.0
    gaps = [Polygon(outline).exterior.distance(LineString(stroke)) for stroke in strokes]
    assert all(Polygon(outline).contains(LineString(stroke)) for stroke in strokes)
    assert min(gaps) == pytest.approx(LINE_GAP_MM, abs=1e-9)


def test_no_sign_looks_like_another() -> None:
    drawn = {
        sign: frozenset(frozenset(pair) for stroke in strokes for pair in pairwise(stroke))
        for sign, strokes in STROKES.items()
    }
    assert len(set(drawn.values())) == len(STROKES)
