"""Numberings of a part of a board: the right one, and no other that colours or ends exclude."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.detections import DetectedFrame, DetectedGrid
from mirrorcam.optics.calibration.solver.observations import Corners, Observations
from mirrorcam.optics.geometry.boards import Checkerboard

ODD = Checkerboard(cols=7, rows=6, square_mm=10.0)
EVEN = Checkerboard(cols=8, rows=6, square_mm=10.0)
SQUARE = Checkerboard(cols=6, rows=6, square_mm=10.0)
BOARDS = [ODD, EVEN, SQUARE]


def part(
    board: Checkerboard, rows: slice, cols: slice, turn: int, *, mirrored: bool, ends: bool = False
) -> tuple[DetectedGrid, NDArray[np.int64]]:
    """Return a part of a board as a picture shows it, rotated by quarter turns, with its true ids."""
    ids = np.arange((board.rows - 1) * (board.cols - 1)).reshape(board.rows - 1, -1)[rows, cols].ravel()
    row, col = np.divmod(ids, board.cols - 1)
    seen = np.stack([-col if mirrored else col, row], axis=1)
    pixels = 20.0 * (seen @ np.linalg.matrix_power(np.array([[0, 1], [-1, 0]]), turn))
    places = (pixels / 20.0).astype(np.int64)
    # By the print: black right of and below corner (0, 0), which is white in a mirror, and after a quarter turn.
    white = ((row + col) % 2 == 1) ^ mirrored ^ (turn % 2 == 1)
    places[:, 0] += (places[0].sum() % 2 == 0) != white[0]
    limits = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
    if ends:
        complete = np.stack(np.meshgrid([0, board.cols - 2], [0, board.rows - 2]), axis=-1).reshape(-1, 2)
        box = (complete * [-1 if mirrored else 1, 1]) @ np.linalg.matrix_power(np.array([[0, 1], [-1, 0]]), turn)
        at = (pixels / 20.0).astype(np.int64)
        limits[0][at.min(axis=0) == box.min(axis=0)] = places.min(axis=0)[at.min(axis=0) == box.min(axis=0)]
        limits[1][at.max(axis=0) == box.max(axis=0)] = places.max(axis=0)[at.max(axis=0) == box.max(axis=0)]
    return DetectedGrid(places, Corners(np.arange(len(ids)), pixels), limits), ids


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("turn", range(4))
def test_a_complete_board_has_one_numbering_or_two(board: Checkerboard, *, mirrored: bool, turn: int) -> None:
    grid, ids = part(board, np.s_[:], np.s_[:], turn, mirrored=mirrored)
    found = [corners.ids.tolist() for corners in grid.numberings(board, mirrored=mirrored)]
    assert ids.tolist() in found
    assert len(found) == 1 + board.looks_same_upside_down
    if board.looks_same_upside_down:
        assert ids[::-1].tolist() in found


@pytest.mark.parametrize("mirrored", [False, True])
def test_colours_identify_a_mirrored_board_of_even_sides(*, mirrored: bool) -> None:
    grid, _ = part(EVEN, np.s_[:], np.s_[:], 1, mirrored=mirrored)
    assert grid.numberings(EVEN, mirrored=not mirrored) == []
    grid, _ = part(ODD, np.s_[:], np.s_[:], 1, mirrored=mirrored)
    assert len(grid.numberings(ODD, mirrored=not mirrored)) == 1


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_part_has_the_right_numbering_among_others(board: Checkerboard, turn: int, *, mirrored: bool) -> None:
    grid, ids = part(board, np.s_[1:5], np.s_[2:6], turn, mirrored=mirrored)
    found = grid.numberings(board, mirrored=mirrored)
    assert ids.tolist() in [corners.ids.tolist() for corners in found]
    assert len({tuple(corners.ids.tolist()) for corners in found}) == len(found) > 1
    for corners in found:
        row, col = np.divmod(corners.ids, board.cols - 1)
        near = np.abs(np.diff(np.stack([row, col]), axis=1)).sum(axis=0)
        assert (near[:2] == 1).all()


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("mirrored", [False, True])
def test_ends_number_a_part(turn: int, *, mirrored: bool) -> None:
    grid, ids = part(ODD, np.s_[:3], np.s_[:], turn, mirrored=mirrored, ends=True)
    (corners,) = grid.numberings(ODD, mirrored=mirrored)
    assert corners.ids.tolist() == ids.tolist()
    # The board has black squares at two corners, on the same side, a quarter turn apart.
    grid, ids = part(ODD, np.s_[:4], np.s_[2:], turn, mirrored=mirrored, ends=True)
    found = [corners.ids.tolist() for corners in grid.numberings(ODD, mirrored=mirrored)]
    assert len(found) == 2
    assert ids.tolist() in found


def test_a_larger_board_has_no_numbering() -> None:
    grid, _ = part(EVEN, np.s_[:], np.s_[:], 0, mirrored=False)
    assert grid.numberings(ODD, mirrored=False) == []
    assert grid.extent == (7, 5)
    assert len(grid) == 35


@pytest.mark.parametrize("turn", range(4))
def test_a_grid_in_a_mirror_is_unmirrored(turn: int) -> None:
    grid, ids = part(ODD, np.s_[:3], np.s_[2:], turn, mirrored=True, ends=True)
    found = {tuple(corners.ids.tolist()) for corners in grid.as_printed.numberings(ODD, mirrored=False)}
    assert tuple(ids.tolist()) in found
    assert found == {tuple(corners.ids.tolist()) for corners in grid.numberings(ODD, mirrored=True)}
    moved = grid.as_printed.transformed(1, np.array([4, 1]))
    assert found == {tuple(corners.ids.tolist()) for corners in moved.numberings(ODD, mirrored=False)}


def test_parts_are_numbered_jointly_but_not_alone() -> None:
    left, _ = part(ODD, np.s_[:], np.s_[:4], 0, mirrored=False, ends=True)
    right, ids = part(ODD, np.s_[:], np.s_[2:], 0, mirrored=False)
    complete = DetectedGrid.join([left.where(left.grid_xy[:, 1] < left.grid_xy[:, 1].max()), right])
    numbered = [corners.ids[-len(ids) :].tolist() for corners in complete.numberings(ODD, mirrored=False)]
    assert numbered == [ids.tolist()]


def test_an_end_contradicted_by_another_view_is_dropped() -> None:
    left, _ = part(ODD, np.s_[:], np.s_[:3], 0, mirrored=False)
    false_end = DetectedGrid(left.grid_xy, left.corners, np.array([[-np.inf, -np.inf], left.grid_xy.max(axis=0)]))
    right, _ = part(ODD, np.s_[:], np.s_[1:], 0, mirrored=False)
    assert np.isinf(DetectedGrid.join([false_end, right]).limits[1, 0])
    assert np.isfinite(DetectedGrid.join([false_end]).limits[1, 0])


@pytest.mark.parametrize("middles", [np.zeros(2), np.zeros((1, 3)), np.array([[0.0, np.nan]])])
def test_places_that_are_not_finite_are_refused(middles: FloatArray) -> None:
    with pytest.raises(ValueError, match=r"expected \(k, 2\) of finite numbers"):
        DetectedFrame(Observations.empty(), middles)


def test_places_are_kept_read_only() -> None:
    middles = np.zeros((1, 2))
    frame = DetectedFrame(Observations.empty(), middles)
    middles[0] = 1.0
    assert frame.unassigned_px.tolist() == [[0.0, 0.0]]
    with pytest.raises(ValueError, match="read-only"):
        frame.unassigned_px[0, 0] = 1.0
    assert DetectedFrame(Observations.empty()).unassigned_px.shape == (0, 2)
