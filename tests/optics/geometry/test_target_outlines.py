"""The outlines of a board's ink, held against OpenCV's picture of the same board."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from mirrorcam.optics.geometry.marker_dictionaries import NAMES, modules
from mirrorcam.optics.geometry.target_outlines import ink_in_board_mm
from mirrorcam.optics.geometry.targets import AprilGrid, Charuco, Checkerboard

# Sizes at which OpenCV's raster is exact: a module of a marker is a whole number of pixels.
BOARDS = [
    Checkerboard(cols=5, rows=4, square_mm=7.5),
    *(
        Charuco(cols=5, rows=4, square_mm=modules(name) + 2.0, marker_mm=modules(name), dictionary=name)
        for name in NAMES
    ),
    *(
        Charuco(cols=cols, rows=rows, square_mm=8.0, marker_mm=6.0, legacy=True, first_marker=7)
        for cols, rows in ((5, 4), (4, 5), (6, 4))
    ),
]


@pytest.mark.parametrize("board", BOARDS, ids=lambda board: getattr(board, "dictionary", board.kind))
def test_ink_is_where_the_picture_is_black(board: Checkerboard | Charuco) -> None:
    picture = board.image(round(4 * board.square_mm))
    y, x = (np.mgrid[: picture.shape[0], : picture.shape[1]] + 0.5) / 4.0
    inked = shapely.contains_xy(ink_in_board_mm(board), x, y)
    np.testing.assert_array_equal(inked, picture == 0)


@pytest.mark.parametrize("board", BOARDS[:2], ids=["checkerboard", "charuco"])
def test_no_polygon_overlaps_or_touches_another_along_an_edge(board: Checkerboard | Charuco) -> None:
    ink = ink_in_board_mm(board)
    assert ink.area == pytest.approx(shapely.union_all(ink).area, rel=1e-12)
    polygons = shapely.get_parts(ink)
    tree = shapely.STRtree(polygons)
    one, other = tree.query(polygons, predicate="intersects")
    assert shapely.length(shapely.intersection(polygons[one], polygons[other]))[one != other].max(initial=0.0) == 0.0
    assert shapely.is_ccw(shapely.get_exterior_ring(polygons)).all()


def test_sizes_that_are_no_whole_numbers_of_pixels_are_exact() -> None:
    board = Charuco(cols=4, rows=3, square_mm=12.3, marker_mm=7.77)
    ink = ink_in_board_mm(board)
    assert ink.bounds == pytest.approx((0.0, 0.0, 49.2, 36.9), abs=1e-12)
    # The first marker, in the second square of the first row.
    markers = [polygon for polygon in ink.geoms if shapely.contains_xy(polygon.envelope, 12.3 + 12.3 / 2, 12.3 / 2)]
    low = 12.3 / 2 - 7.77 / 2
    assert shapely.MultiPolygon(markers[:1]).bounds == pytest.approx(
        (12.3 + low, low, 24.6 - low, 12.3 - low), abs=1e-12
    )


def test_ink_of_an_aprilgrid_is_where_its_picture_is_black() -> None:
    board = AprilGrid(cols=3, rows=2, tag_mm=10.0, spacing=0.25)
    picture = board.image(40)
    y, x = (np.mgrid[: picture.shape[0], : picture.shape[1]] + 0.5) / 4.0
    np.testing.assert_array_equal(shapely.contains_xy(ink_in_board_mm(board), x, y), picture == 0)
