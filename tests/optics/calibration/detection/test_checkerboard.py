"""Plain checkerboards in pictures with known corners."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import (
    Grey,
    board_limits,
    cell_px,
    complete_board,
    confirm,
    find_checkerboards,
    non_collinear,
)
from mirrorcam.optics.calibration.solver.observations import Corners
from mirrorcam.optics.geometry.boards import Checkerboard, load_board
from tests.optics.calibration.detection.one_mirror import CAMERA, one_mirror, rms, seen
from tests.optics.synthetic import posed, render

PLAIN = Checkerboard(cols=9, rows=6, square_mm=20.0)
DIRECT_POSE = posed(PLAIN, np.array([5.0, -8.0, 330.0]), np.array([12.0, -20.0, 8.0]), direct=True)
SQUARES = Checkerboard(cols=9, rows=8, square_mm=1.0)
SIDE, MARGIN = 20, 40
ALL = np.ones((2, 2), dtype=bool)
UPRIGHT = Checkerboard(cols=5, rows=7, square_mm=30.0)
FOCAL_PX, MIDDLE, SIZE = 190.0, 300.0, 601


def test_a_board_is_found_and_numbered_exactly() -> None:
    """On cells of 19 px and a soft lens, where OpenCV's finder errs by a tenth of a pixel."""
    pose = posed(PLAIN, np.array([5.0, -8.0, 700.0]), np.array([12.0, -20.0, 8.0]), direct=True)
    picture = render(CAMERA, None, PLAIN, pose, noise_grey=1.0, blur_px=1.3)
    truth = seen(PLAIN.corners_in_board_mm, pose, None)
    found, raw = cv2.findChessboardCornersSB(picture, (8, 5), flags=cv2.CALIB_CB_ACCURACY)
    assert found
    by_finder = np.asarray(raw, dtype=np.float64).reshape(-1, 2)
    if np.linalg.norm(by_finder[0] - truth[0]) > np.linalg.norm(by_finder[0] - truth[-1]):
        by_finder = by_finder[::-1]
    (grid,) = find_checkerboards(picture, PLAIN)
    (corners,) = grid.numberings(PLAIN, mirrored=False)
    assert rms(by_finder - truth) > 0.1
    assert len(corners) == 40
    assert rms(corners.pixels - truth[corners.ids]) < 0.03


def test_a_mirrored_plain_board_is_numbered_as_its_corners_are() -> None:
    layout = one_mirror()
    pose = posed(PLAIN, np.array([0.0, 330.0, 80.0]), np.array([15.0, 10.0, -7.0]), direct=False)
    picture = render(CAMERA, layout, PLAIN, pose, noise_grey=1.0)
    (grid,) = find_checkerboards(picture, PLAIN)
    truth = seen(PLAIN.corners_in_board_mm, pose, layout)
    (corners,) = grid.numberings(PLAIN, mirrored=True)
    assert rms(corners.pixels - truth[corners.ids]) < 0.05
    (unmirrored,) = grid.numberings(PLAIN, mirrored=False)
    assert rms(unmirrored.pixels - truth[unmirrored.ids]) > 10.0


def test_a_board_that_the_camera_sharpened_is_found() -> None:
    picture = render(CAMERA, None, PLAIN, DIRECT_POSE, blur_px=0.3).astype(np.float64)
    overshot = picture + 10.0 * (picture - cv2.GaussianBlur(picture, (0, 0), 2.0))
    sharpened = np.clip(np.rint(overshot), 0, 255).astype(np.uint8)
    (grid,) = find_checkerboards(sharpened, PLAIN)
    (corners,) = grid.numberings(PLAIN, mirrored=False)
    assert len(corners) == 40
    assert rms(corners.pixels - seen(PLAIN.corners_in_board_mm, DIRECT_POSE, None)[corners.ids]) < 0.1


@pytest.mark.parametrize("square_mm", [30.0, 40.0])
@pytest.mark.parametrize("amount, limit_px", [(0.0, 0.005), (3.0, 0.01), (8.0, 0.04)])
def test_large_squares_are_found_exactly_however_sharp_their_edges_are(
    amount: float, limit_px: float, square_mm: float
) -> None:
    """Cells of 40 to 60 px: the samples of the first refinement are farther apart than the edges are wide."""
    board = Checkerboard(cols=7, rows=6, square_mm=square_mm)
    pose = posed(board, np.array([5.0, -8.0, 420.0]), np.array([25.0, -30.0, 8.0]), direct=True)
    soft = render(CAMERA, None, board, pose, blur_px=0.3, noise_grey=1.0).astype(np.float64)
    overshot = soft + amount * (soft - cv2.GaussianBlur(soft, (0, 0), 2.0))
    (grid,) = find_checkerboards(np.clip(np.rint(overshot), 0, 255).astype(np.uint8), board)
    (corners,) = grid.numberings(board, mirrored=False)
    assert len(corners) == 30
    assert rms(corners.pixels - seen(board.corners_in_board_mm, pose, None)[corners.ids]) < limit_px


@pytest.mark.parametrize("name", ["sharp_checkerboard_missed", "fisheye_checkerboard"])
def test_photographed_boards_are_found_where_opencv_finds_them(name: str) -> None:
    folder = Path(__file__).parents[5] / "shared" / "data" / "tried" / name
    if not folder.is_dir():
        pytest.skip(f"the photographs of {folder} are not here")
    board = load_board(folder / "board.toml")
    assert isinstance(board, Checkerboard)
    for picture, corners in json.loads((folder / "corners_of_opencv.json").read_text()).items():
        (grid,) = find_checkerboards(read_image(folder / picture, grey=True), board)
        apart = np.linalg.norm(grid.corners.pixels[:, None] - np.array(corners).reshape(-1, 2), axis=2)
        assert len(grid) == len(board.corners_in_board_mm)
        assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1.0


def test_several_boards_are_found_in_one_picture_also_if_they_touch() -> None:
    small = Checkerboard(cols=8, rows=7, square_mm=9.0)
    views = [
        posed(small, np.array([x, 0.0, 300.0]), np.array([5.0, 10.0, roll]), direct=True)
        for x, roll in ((-60.0, 20.0), (60.0, -30.0))
    ]
    pictures = [render(CAMERA, None, small, pose) for pose in views]
    for seam in (395, 480):  # next to the second board, and across it
        together = np.where(np.arange(800) < seam, pictures[0], pictures[1])
        boards = find_checkerboards(together, small)
        assert len(boards) == 2
        for pose in views:
            truth = seen(small.corners_in_board_mm, pose, None)
            off = [cKDTree(truth).query(board.corners.pixels)[0].max() for board in boards]
            assert min(off) < 0.3


@pytest.mark.parametrize("turn_deg", [0.0, 33.0, 90.0, 200.0])
def test_a_board_cut_by_an_edge_is_numbered_if_two_of_its_ends_are_seen(turn_deg: float) -> None:
    pose = posed(PLAIN, np.array([0.0, 0.0, 330.0]), np.array([12.0, -20.0, turn_deg]), direct=True)
    picture = render(CAMERA, None, PLAIN, pose, noise_grey=1.0)
    truth = seen(PLAIN.corners_in_board_mm, pose, None)
    cut = picture.copy()
    # A straight slanting edge at the board's first corner, with something else beyond it.
    y, x = np.mgrid[: cut.shape[0], : cut.shape[1]]
    along = truth[10] - truth[-1]
    cut[(x - truth[10, 0]) * along[0] + (y - truth[10, 1]) * along[1] > 0] = 150
    (grid,) = find_checkerboards(cut, PLAIN)
    assert len(grid) >= 20
    options = grid.numberings(PLAIN, mirrored=False)
    assert min(rms(corners.pixels - truth[corners.ids]) for corners in options) < 0.1
    assert len(options) == 1


def test_a_hand_hides_corners_and_gives_no_false_ones() -> None:
    picture = render(CAMERA, None, PLAIN, DIRECT_POSE)
    truth = seen(PLAIN.corners_in_board_mm, DIRECT_POSE, None)
    covered = picture.copy()
    cv2.ellipse(covered, tuple(int(v) for v in truth[3]), (60, 100), 20.0, 0.0, 360.0, (140,), -1)
    (grid,) = find_checkerboards(covered, PLAIN)
    (corners,) = grid.numberings(PLAIN, mirrored=False)
    assert 15 < len(corners) < 40
    assert rms(corners.pixels - truth[corners.ids]) < 0.1


def test_no_board_is_found_in_a_picture_without_one() -> None:
    random = np.random.default_rng(0)
    blocks = np.kron(random.integers(0, 255, (27, 48)), np.ones((10, 10))).astype(np.uint8)
    for picture in (np.full((270, 480), 90, np.uint8), random.integers(0, 255, (270, 480)).astype(np.uint8)):
        assert find_checkerboards(picture, PLAIN) == []
    # Some random squares resemble a small part of a board, which determines no numbering.
    for grid in find_checkerboards(blocks, PLAIN):
        assert len(grid) < 12
        assert len(grid.numberings(PLAIN, mirrored=False)) > 4


def test_corners_behind_a_hand_are_not_confirmed() -> None:
    picture = render(CAMERA, None, PLAIN, DIRECT_POSE)
    truth = seen(PLAIN.corners_in_board_mm, DIRECT_POSE, None)
    near = truth + np.random.default_rng(0).normal(0.0, 1.0, truth.shape)
    complete = confirm(picture, near, PLAIN)
    assert len(complete) == 40
    assert rms(complete.pixels - truth) < 0.05
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


def test_corners_on_one_line_are_rejected() -> None:
    x = np.arange(10.0) * 20
    row = Corners(np.arange(10), np.column_stack([x, 0.1 * x]))
    assert len(non_collinear(row)) == 0
    two_rows = Corners(np.arange(20), np.concatenate([row.pixels, row.pixels + np.array([-2.0, 20.0])]))
    assert len(non_collinear(two_rows)) == 20
    assert len(non_collinear(Corners(np.arange(4), two_rows.pixels[[0, 5, 10, 15]]))) == 0


def test_cell_is_the_distance_to_the_nearest_neighbour() -> None:
    np.testing.assert_allclose(cell_px(np.array([[0.0, 0.0], [3.0, 4.0], [30.0, 4.0]])), [5.0, 5.0, 27.0])


def drawn(*, beyond: int) -> NDArray[np.float32]:
    """Draw the board with a margin of one white square, and the surroundings."""
    paper = np.full((10 * SIDE, 11 * SIDE), 220, np.uint8)
    paper[SIDE:-SIDE, SIDE:-SIDE] = 30 + 190 * (SQUARES.image(SIDE) > 0)
    picture = np.pad(paper, MARGIN, constant_values=beyond)
    return np.asarray(cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 1.0), dtype=np.float32)


def ends(picture: NDArray[np.float32], cols: slice, rows: slice) -> NDArray[np.bool_]:
    """Find the ends of the board from the corners of some columns and rows."""
    x, y = np.meshgrid(np.arange(8)[cols], np.arange(7)[rows])
    corners = np.stack([x.ravel(), y.ravel()], axis=1)
    pixels = np.asarray(MARGIN + SIDE * (corners + 2.0) - 0.5, dtype=np.float64)
    # The first corner has black right of and below it, so that its sum is odd.
    return np.isfinite(board_limits(picture, corners + np.array([1, 0]), pixels))


@pytest.mark.parametrize("beyond", [20, 120, 250])
def test_a_complete_board_ends_on_all_sides(beyond: int) -> None:
    np.testing.assert_array_equal(ends(drawn(beyond=beyond), np.s_[:], np.s_[:]), ALL)


def test_a_board_that_goes_on_does_not_end() -> None:
    found = ends(drawn(beyond=20), np.s_[2:], np.s_[:5])
    np.testing.assert_array_equal(found, [[False, True], [True, False]])


@pytest.mark.parametrize("grey", [20, 120, 220])
@pytest.mark.parametrize("squares", [0.3, 0.6, 0.9, 1.1, 1.4])
def test_an_occluder_is_not_taken_for_an_end(grey: int, squares: float) -> None:
    """Even one of the paper's colour along the grid, unless it begins where the board might end."""
    picture = drawn(beyond=20)
    last = 4
    picture[:, int(MARGIN + SIDE * (last + 2 + squares)) :] = grey
    if not (grey == 220 and 0.85 < squares < 1.15):
        assert not ends(picture, np.s_[: last + 1], np.s_[:])[1, 0]


def test_few_squares_determine_no_end() -> None:
    assert not ends(drawn(beyond=20), np.s_[:3], np.s_[:2]).any()


def through_fisheye(*, flipped: bool) -> tuple[Grey, FloatArray]:
    """Return a picture of the board close to an equidistant lens, and the pixels (24, 2) of its corners."""
    print_ = np.pad(UPRIGHT.image(40), 40, constant_values=255)
    v, u = (np.indices((SIZE, SIZE)) - MIDDLE) / FOCAL_PX
    angle = np.hypot(u, v)
    out = np.tan(np.minimum(angle, 1.5)) / np.maximum(angle, 1e-9)
    middle = np.array([20.0, -30.0])
    x, y = (
        60.0 * axis * out + move + size / 2.0 for axis, move, size in zip((u, v), middle, UPRIGHT.size_mm, strict=True)
    )
    on_print = np.stack([x, y], axis=2) / UPRIGHT.square_mm
    at = ((on_print + 1.0) * 40.0 - 0.5).astype(np.float32)
    seen = cv2.GaussianBlur(cv2.remap(print_, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=120.0), (0, 0), 0.8)
    corners = (UPRIGHT.corners_in_board_mm[:, :2] - np.array(UPRIGHT.size_mm) / 2.0 - middle) / 60.0
    radius = np.linalg.norm(corners, axis=1, keepdims=True)
    pixels = MIDDLE + FOCAL_PX * np.arctan(radius) / np.maximum(radius, 1e-9) * corners
    if flipped:
        return np.ascontiguousarray(seen[:, ::-1]), pixels * [-1.0, 1.0] + [SIZE - 1.0, 0.0]
    return np.asarray(seen, dtype=np.uint8), pixels


@pytest.mark.parametrize("flipped", [False, True])
def test_all_corners_are_found_under_strong_distortion(*, flipped: bool) -> None:
    picture, truth = through_fisheye(flipped=flipped)
    (grid,) = find_checkerboards(picture, UPRIGHT)
    numberings = grid.numberings(UPRIGHT, mirrored=flipped)
    assert 0 < len(numberings) <= 2
    off = min(float(np.abs(one.pixels - truth[one.ids]).max()) for one in numberings)
    assert off < 0.5
    assert len(grid) == 24


def test_two_boards_are_found_under_strong_distortion() -> None:
    shown = [through_fisheye(flipped=flipped)[0] for flipped in (False, True)]
    together = np.concatenate(shown, axis=1)
    grids = find_checkerboards(together, UPRIGHT)
    assert [len(grid) for grid in grids] == [24, 24]
    assert sorted(float(grid.corners.pixels[:, 0].mean()) > SIZE for grid in grids) == [False, True]


@pytest.mark.parametrize("mirrored", [False, True])
def test_an_inverted_board_is_numbered_as_its_corners_are(*, mirrored: bool) -> None:
    """With an odd number of columns and rows, no turn of the other print looks the same."""
    board = Checkerboard(cols=9, rows=7, square_mm=18.0, inverted=True)
    layout = one_mirror() if mirrored else None
    place = np.array([0.0, 330.0, 80.0]) if mirrored else np.array([5.0, -8.0, 330.0])
    pose = posed(board, place, np.array([12.0, -10.0, 8.0]), direct=not mirrored)
    picture = render(CAMERA, layout, board, pose, noise_grey=1.0)
    (grid,) = find_checkerboards(picture, board)
    truth = seen(board.corners_in_board_mm, pose, layout)
    numberings = grid.numberings(board, mirrored=mirrored)
    assert min(rms(corners.pixels - truth[corners.ids]) for corners in numberings) < 0.05
    assert not grid.numberings(board.replaced(inverted=False), mirrored=mirrored)
    assert len(confirm(picture, truth, board)) == 48
    assert not len(confirm(picture, truth, board.replaced(inverted=False)))


def test_a_board_that_is_partly_hidden_or_of_another_size_is_not_complete() -> None:
    picture, _ = through_fisheye(flipped=False)
    assert complete_board(picture, UPRIGHT) is not None
    assert complete_board(picture, UPRIGHT.replaced(rows=9)) is None
    hidden = picture.copy()
    hidden[:, :270] = 128
    assert complete_board(hidden, UPRIGHT) is None
    assert find_checkerboards(np.full((300, 400), 90, np.uint8), UPRIGHT) == []
