"""Clipping of convex polygons."""

from __future__ import annotations

import numpy as np
from shapely import Polygon

from mirrorcam.optics.geometry.convex_polygons import clipped, each_clipped

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


def test_polygons_at_once_are_clipped_as_each_alone() -> None:
    """Twice in a row, a triangle that repeats its last corner among quadrangles."""
    random = np.random.default_rng(1)
    polygons = SQUARE + random.uniform(-0.4, 0.4, (40, 4, 2))
    polygons[::3, 3] = polygons[::3, 2]
    together, alone = polygons, [polygon[:3] if k % 3 == 0 else polygon for k, polygon in enumerate(polygons)]
    for _ in range(2):
        slopes, reach = random.normal(size=(40, 2)), random.normal(0.5, 0.5, 40)
        together = each_clipped(together, (together @ slopes[..., None])[..., 0] + reach[:, None])
        alone = [clipped(part, part @ slope + far) for part, slope, far in zip(alone, slopes, reach, strict=True)]
    assert together.shape[1] <= 6
    assert {len(part) for part in alone} == {0, 3, 4, 5}
    for part, expected in zip(together, alone, strict=True):
        np.testing.assert_array_equal(part[: len(expected)], expected)
        np.testing.assert_array_equal(part[len(expected) :] - (part[len(expected) - 1] if len(expected) else 0.0), 0.0)
