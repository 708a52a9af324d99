"""What is engraved: as high as asked or as fits, inside, upright and unlike its mirror image."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import LineString, Polygon, union_all

from mirrorcam.cad.mirrors.engraving import LINE_GAP_MM, mark

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


def test_a_narrow_mirror_is_marked_down_a_column() -> None:
    tall = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 30.0], [0.0, 30.0]])
    across, up = np.ptp(np.vstack(mark("2-0", tall, 5.0)), axis=0)
    assert across == pytest.approx(3.0 - 2.0 * LINE_GAP_MM)
    assert up > 3.0 * across


def test_signs_of_a_small_mirror_stay_apart() -> None:
    # Room for 3.5 x 1 mm within the line gap: what arrow, two digits and a dash take half a millimetre apart.
    small = np.array([[0.0, 0.0], [4.6, 0.0], [4.6, 2.2], [0.0, 2.2]])
    arrow, head, *signs = (LineString(stroke) for stroke in mark("5-0", small, 5.0))
    figures = [union_all([arrow, head]), *signs]
    gaps = [figure.distance(other) for i, figure in enumerate(figures) for other in figures[i + 1 :]]
    assert min(gaps) >= LINE_GAP_MM - 1e-9
