"""Assignment of boards to mirrors: exact corners in any order, and boards that belong to no mirror."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.assignment import assign, unassigned_px
from mirrorcam.optics.calibration.solver.observations import Corners
from mirrorcam.optics.geometry.boards import Charuco, Checkerboard
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.synthetic_corners import mirrored_corners, mirrored_poses

BOARD = Charuco(cols=10, rows=7, square_mm=20.0, marker_mm=14.0)
WIDE = Charuco(cols=24, rows=10, square_mm=20.0, marker_mm=14.0)
PLAIN = Checkerboard(cols=9, rows=7, square_mm=6.0)


def boards_of(layout: Layout, board: Checkerboard | Charuco, pose: FloatArray) -> dict[int, Corners]:
    """Return the corners that each mirror shows of a board at a pose."""
    seen = mirrored_corners(layout, board, pose, 0.0, np.random.default_rng(0))
    views = np.unique(seen.view).tolist()
    return {view: Corners(seen.corner[seen.view == view], seen.pixels[seen.view == view]) for view in views}


@pytest.fixture(scope="module")
def pose() -> FloatArray:
    return mirrored_poses(BOARD, 1, tilt_deg=10.0, seed=3)[0]


def test_boards_are_assigned_to_their_mirrors_in_any_order(fold_90_layout: Layout, pose: FloatArray) -> None:
    shown = boards_of(fold_90_layout, BOARD, pose)
    assert len(shown) >= 6
    shuffled = np.random.default_rng(1).permutation(list(shown))
    found = assign([(shown[view],) for view in shuffled], fold_90_layout, BOARD)
    assert [view for view, _ in found] == sorted(shown)
    for view, corners in found:
        assert corners is shown[view]


def test_a_board_that_stands_elsewhere_is_left_out(fold_90_layout: Layout) -> None:
    """One mirror shows a second board, 200 mm from the first, with no corner at the place of the first one's."""
    pose = mirrored_poses(WIDE, 1, tilt_deg=5.0, seed=3)[0]
    displaced = pose.copy()
    displaced[0, 3] += 200.0
    shown, other = boards_of(fold_90_layout, WIDE, pose), boards_of(fold_90_layout, WIDE, displaced)
    mirror = max(other, key=lambda view: len(other[view]) * (view in shown))
    boards = [(corners,) for view, corners in shown.items() if view != mirror]
    found = dict(assign([*boards, (other[mirror],)], fold_90_layout, WIDE))
    assert set(found) == set(shown) - {mirror}
    again = dict(assign([*boards, (shown[mirror],)], fold_90_layout, WIDE))
    assert set(again) == set(shown)


def test_boards_of_no_mirror_are_reported_complete_and_once(fold_90_layout: Layout, pose: FloatArray) -> None:
    shown = boards_of(fold_90_layout, BOARD, pose)
    boards = [(corners,) for corners in shown.values()]
    mirrors = fold_90_layout.mirrors
    without = fold_90_layout.replaced(rows=3, cols=2, mirrors=tuple(m for n, m in enumerate(mirrors) if n % 3 < 2))
    assert not len(unassigned_px(boards, assign(boards, fold_90_layout, BOARD), fold_90_layout))
    unknown = [corners.pixels.mean(axis=0) for view, corners in shown.items() if view % 3 == 2]
    assert len(unknown) >= 2
    assert unassigned_px(boards, assign(boards, without, BOARD), without).tolist() == np.array(unknown).tolist()
    # The remaining part of a board is not the board of another mirror.
    rests = [(Corners(board.ids[:6], board.pixels[:6]),) for view, board in shown.items() if view % 3 == 2]
    known = [(board,) for view, board in shown.items() if view % 3 < 2]
    assert not len(unassigned_px([*known, *rests], assign([*known, *rests], without, BOARD), without))


def test_parts_and_repetitions_of_the_board_of_a_mirror_are_not_left_over(
    fold_90_layout: Layout, pose: FloatArray
) -> None:
    shown = list(boards_of(fold_90_layout, BOARD, pose).values())
    largest = max(shown, key=len)
    others = [(board,) for board in shown if board is not largest]
    half = len(largest) // 2 + 1
    parts = [Corners(largest.ids[rows], largest.pixels[rows]) for rows in (np.s_[:half], np.s_[half:])]
    again = Corners(largest.ids, largest.pixels + 0.5)
    displaced = Corners(largest.ids, largest.pixels + np.array([120.0, 0.0]))
    for boards, count in (
        ([*others, *((part,) for part in parts)], 0),
        ([*others, (largest,), (again,)], 0),
        ([*others, (largest,), (displaced,)], 1),
    ):
        assert len(unassigned_px(boards, assign(boards, fold_90_layout, BOARD), fold_90_layout)) == count


def test_a_plain_board_is_numbered_as_in_the_largest_view(fold_90_layout: Layout) -> None:
    pose = mirrored_poses(PLAIN, 1, tilt_deg=10.0, seed=3)[0]
    shown = boards_of(fold_90_layout, PLAIN, pose)
    complete = {view: corners for view, corners in shown.items() if len(corners) == len(PLAIN.corners_in_board_mm)}
    assert len(complete) >= 2
    boards = []
    for number, corners in enumerate(complete.values()):
        turned = Corners(corners.ids, corners.pixels[::-1])
        boards.append((corners, turned) if number == 0 else (turned, corners))
    found = assign(boards, fold_90_layout, PLAIN)
    rightly = [np.array_equal(corners.pixels, complete[view].pixels) for view, corners in found]
    assert len(found) == len(complete)
    assert all(rightly) or not any(rightly), "alike in all views"


def test_without_boards_nothing_is_assigned(fold_90_layout: Layout) -> None:
    assert assign([], fold_90_layout, BOARD) == []
    outside = Corners(np.arange(54), 5000.0 + 30.0 * np.random.default_rng(0).random((54, 2)))
    assert assign([(outside,)], fold_90_layout, BOARD) == []
