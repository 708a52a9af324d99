"""Plain checkerboards in pictures whose truth is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.optics.calibration.detection.checkerboard import (
    cell_px,
    confirm,
    find_checkerboards,
    orderings,
    spread_out,
)
from mirrorcam.optics.calibration.solver.observations import Corners
from mirrorcam.optics.geometry.targets import Checkerboard
from tests.optics.calibration.detection.one_mirror import CAMERA, one_mirror, rms, seen
from tests.optics.synthetic import posed, render

PLAIN = Checkerboard(cols=9, rows=6, square_mm=20.0)
DIRECT_POSE = posed(PLAIN, np.array([5.0, -8.0, 330.0]), np.array([12.0, -20.0, 8.0]), direct=True)


def test_the_finder_alone_errs_and_refinement_does_not() -> None:
    """On cells of 19 px and a soft lens, where the finder's own refinement fails by an order of magnitude."""
    pose = posed(PLAIN, np.array([5.0, -8.0, 700.0]), np.array([12.0, -20.0, 8.0]), direct=True)
    picture = render(CAMERA, None, PLAIN, pose, noise_grey=1.0, blur_px=1.3)
    truth = seen(PLAIN.corners_in_board_mm, pose, None)
    found, raw = cv2.findChessboardCornersSB(picture, (8, 5), flags=cv2.CALIB_CB_ACCURACY)
    assert found
    by_finder = np.asarray(raw, dtype=np.float64).reshape(-1, 2)
    if np.linalg.norm(by_finder[0] - truth[0]) > np.linalg.norm(by_finder[0] - truth[-1]):
        by_finder = by_finder[::-1]
    (board,) = find_checkerboards(picture, PLAIN, most=1)
    (refined,) = orderings(picture, board, PLAIN, mirrored=False)
    assert rms(by_finder - truth) > 0.1
    assert rms(refined - truth) < 0.03


def test_a_board_that_the_finder_completes_beyond_the_picture_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """The finder extrapolates, and refinement by gradients fails outside the picture."""
    at = np.array([[20.0 * col - 15.0, 20.0 * row + 15.0] for row in range(5) for col in range(8)], dtype=np.float32)
    answers = iter([(True, at[:, None]), (False, None)])
    monkeypatch.setattr(cv2, "findChessboardCornersSB", lambda *_, **__: next(answers, (False, None)))
    assert find_checkerboards(np.full((270, 480), 90, np.uint8), PLAIN, most=2) == []


def test_a_mirrored_plain_board_is_numbered_as_its_corners_are() -> None:
    layout = one_mirror()
    pose = posed(PLAIN, np.array([0.0, 330.0, 80.0]), np.array([15.0, 10.0, -7.0]), direct=False)
    picture = render(CAMERA, layout, PLAIN, pose, noise_grey=1.0)
    (board,) = find_checkerboards(picture, PLAIN, most=1)
    (ordering,) = orderings(picture, board, PLAIN, mirrored=True)
    assert rms(ordering - seen(PLAIN.corners_in_board_mm, pose, layout)) < 0.05
    (unmirrored,) = orderings(picture, board, PLAIN, mirrored=False)
    assert rms(unmirrored - seen(PLAIN.corners_in_board_mm, pose, layout)) > 10.0


def test_a_board_that_looks_the_same_upside_down_has_two_numberings() -> None:
    even = Checkerboard(cols=8, rows=6, square_mm=20.0)
    assert even.looks_same_upside_down
    picture = render(CAMERA, None, even, DIRECT_POSE)
    (board,) = find_checkerboards(picture, even, most=1)
    both = orderings(picture, board, even, mirrored=False)
    assert len(both) == 2
    np.testing.assert_array_equal(both[0], both[1][::-1])


def test_several_boards_are_found_in_one_picture() -> None:
    small = Checkerboard(cols=8, rows=7, square_mm=9.0)
    views = [
        posed(small, np.array([x, 0.0, 300.0]), np.array([5.0, 10.0, roll]), direct=True)
        for x, roll in ((-60.0, 20.0), (60.0, -30.0))
    ]
    pictures = [render(CAMERA, None, small, pose) for pose in views]
    together = np.where(np.arange(800) < 395, pictures[0], pictures[1])
    boards = find_checkerboards(together, small, most=4)
    assert len(boards) == 2
    for pose in views:
        truth = seen(small.corners_in_board_mm, pose, None).mean(axis=0)
        assert min(np.linalg.norm(board.mean(axis=(0, 1)) - truth) for board in boards) < 0.5


def test_corners_behind_a_hand_are_not_confirmed() -> None:
    picture = render(CAMERA, None, PLAIN, DIRECT_POSE)
    truth = seen(PLAIN.corners_in_board_mm, DIRECT_POSE, None)
    near = truth + np.random.default_rng(0).normal(0.0, 1.0, truth.shape)
    whole = confirm(picture, near, PLAIN)
    assert len(whole) == 40
    assert rms(whole.pixels - truth) < 0.05
    hand = tuple(int(v) for v in truth[11])
    covered = picture.copy()
    cv2.circle(covered, hand, 45, (120,), -1)
    partly = confirm(covered, near, PLAIN)
    hidden = np.linalg.norm(truth - truth[11], axis=1) < 45
    assert not set(partly.ids) & set(np.flatnonzero(hidden))
    assert len(partly) >= 40 - hidden.sum() - 16
    assert rms(partly.pixels - truth[partly.ids]) < 0.3
    flat = np.full_like(picture, 128)
    assert len(confirm(flat, near, PLAIN)) == 0


def test_corners_on_one_line_count_for_nothing() -> None:
    x = np.arange(10.0) * 20
    row = Corners(np.arange(10), np.column_stack([x, 0.1 * x]))
    assert len(spread_out(row)) == 0
    two_rows = Corners(np.arange(20), np.concatenate([row.pixels, row.pixels + np.array([-2.0, 20.0])]))
    assert len(spread_out(two_rows)) == 20
    assert len(spread_out(Corners(np.arange(4), two_rows.pixels[[0, 5, 10, 15]]))) == 0


def test_cell_is_the_distance_to_the_nearest_neighbour() -> None:
    np.testing.assert_allclose(cell_px(np.array([[0.0, 0.0], [3.0, 4.0], [30.0, 4.0]])), [5.0, 5.0, 27.0])
