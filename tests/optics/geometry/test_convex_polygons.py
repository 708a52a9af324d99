"""Clipping of convex polygons."""

from __future__ import annotations

import numpy as np
from shapely import Polygon

from mirrorcam.optics.geometry.convex_polygons import clipped

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])


def test_what_is_left_lies_beyond_the_line() -> None:
    heights = SQUARE @ [1.0, 1.0] - 1.0
    part = clipped(SQUARE, heights)
    expected = Polygon(SQUARE).difference(Polygon([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    assert Polygon(part).symmetric_difference(expected).area < 1e-12


def test_all_or_nothing_may_be_left() -> None:
    np.testing.assert_array_equal(clipped(SQUARE, np.ones(4)), SQUARE)
    assert clipped(SQUARE, -np.ones(4)).shape == (0, 2)
    assert clipped(np.zeros((0, 2)), np.zeros(0)).shape == (0, 2)
