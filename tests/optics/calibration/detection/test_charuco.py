"""ChArUco boards and AprilGrids in one image: named corners, and markers grouped into boards."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.calibration.detection import charuco
from mirrorcam.optics.calibration.detection.charuco import (
    find_marked_boards,
    find_markers,
    groups,
    linked_tags,
    marker_corners,
)
from mirrorcam.optics.calibration.detection.checkerboard import linked_grids
from mirrorcam.optics.geometry.boards import Charuco, Checkerboard
from tests.optics.calibration.detection.aprilgrid_sheet import GRID, Sheet
from tests.optics.calibration.detection.one_mirror import CAMERA, one_mirror, rms, seen
from tests.optics.synthetic import posed, render

CHARUCO = Charuco(cols=11, rows=7, square_mm=18.0, marker_mm=11.25)


@pytest.mark.parametrize("mirrored", [False, True])
def test_charuco_corners_are_named_and_exact(mirrored: bool) -> None:
    layout = one_mirror() if mirrored else None
    middle = np.array([20.0, 300.0, 80.0]) if mirrored else np.array([20.0, 0.0, 300.0])
    pose = posed(CHARUCO, middle, np.array([10.0, -12.0, 6.0]), direct=not mirrored)
    picture = render(CAMERA, layout, CHARUCO, pose, noise_grey=1.0)
    (corners,) = find_marked_boards(picture, CHARUCO, mirrored=mirrored, max_boards=4)
    assert len(corners) > 40
    truth = seen(CHARUCO.corners_in_board_mm, pose, layout)[corners.ids]
    assert rms(corners.pixels - truth) < 0.01
    assert find_marked_boards(picture, CHARUCO, mirrored=not mirrored, max_boards=4) == []


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("turn_deg", [6.0, 97.0, -170.0])
def test_aprilgrid_corners_are_named_and_exact(turn_deg: float, mirrored: bool) -> None:
    layout = one_mirror() if mirrored else None
    middle = np.array([10.0, 300.0, 80.0]) if mirrored else np.array([10.0, 0.0, 300.0])
    pose = posed(Sheet(), middle, np.array([10.0, -12.0, turn_deg]), direct=not mirrored)
    picture = render(CAMERA, layout, Sheet(), pose, noise_grey=1.0)
    (corners,) = find_marked_boards(picture, GRID, mirrored=mirrored, max_boards=4)
    assert len(corners) > 80
    truth = seen(GRID.corners_in_board_mm, pose, layout)[corners.ids]
    assert rms(corners.pixels - truth) < 0.01
    assert find_marked_boards(picture, GRID, mirrored=not mirrored, max_boards=4) == []


def test_a_board_without_a_grid_is_found_by_its_markers_next_to_one_with_a_grid(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pose = posed(CHARUCO, np.array([20.0, 0.0, 300.0]), np.array([10.0, -12.0, 6.0]), direct=True)
    picture = render(CAMERA, None, CHARUCO, pose, noise_grey=1.0)
    twice = np.hstack([picture, picture])
    first, second = find_marked_boards(twice, CHARUCO, mirrored=False, max_boards=4)
    original = linked_grids
    monkeypatch.setattr(
        charuco, "linked_grids", lambda grey: [grid for grid in original(grey) if grid[1][:, 0].max() < CAMERA.width_px]
    )
    found = find_marked_boards(twice, CHARUCO, mirrored=False, max_boards=4)
    assert {len(board) for board in found} == {len(first), len(second)}
    assert sorted(board.pixels[:, 0].min() > CAMERA.width_px for board in found) == [False, True]
    # If grids show at least half of the possible boards, markers are not searched one by one.
    assert len(find_marked_boards(twice, CHARUCO, mirrored=False, max_boards=2)) == 1


def test_corners_of_tags_are_not_drawn_to_either_side() -> None:
    pose = posed(Sheet(), np.array([10.0, 0.0, 300.0]), np.array([10.0, -12.0, 6.0]), direct=True)
    (corners,) = find_marked_boards(render(CAMERA, None, Sheet(), pose), GRID, mirrored=False, max_boards=1)
    off = corners.pixels - seen(GRID.corners_in_board_mm, pose, None)[corners.ids]
    row, col = np.divmod(corners.ids, 2 * GRID.cols)
    for kind in range(4):
        assert np.abs(off[(row % 2 == kind // 2) & (col % 2 == kind % 2)].mean(axis=0)).max() < 3e-3


def test_tags_have_their_places_and_rotation() -> None:
    pose = posed(Sheet(), np.array([10.0, 0.0, 300.0]), np.array([10.0, -12.0, 6.0]), direct=True)
    picture = render(CAMERA, None, Sheet(), pose)
    ids, quads = find_markers(picture, GRID, mirrored=False)
    assert len(ids) >= 2, "most tags are joined by the squares between them"
    at = marker_corners(GRID)[ids].reshape(-1, 2) * GRID.pitch_mm
    points = np.column_stack([at, np.zeros(len(at))])
    assert rms(quads.reshape(-1, 2) - seen(points, pose, None)) < 1.5


def test_markers_lie_in_the_middle_of_white_squares() -> None:
    places = marker_corners(CHARUCO)
    assert len(places) == 11 * 7 // 2
    middles = places.mean(axis=1)
    np.testing.assert_allclose(middles % 1.0, 0.5, atol=1e-6)
    assert (np.floor(middles).sum(axis=1) % 2 == 1).all(), "the top-left square is black"
    np.testing.assert_allclose(np.ptp(places, axis=1), 11.25 / 18.0, atol=1e-6)


def test_markers_of_two_boards_fall_into_two_groups_and_misread_ones_into_none() -> None:
    places = marker_corners(CHARUCO)
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    near, far = 30.0 * places + [100.0, 50.0], 22.0 * places @ turn.T + [600.0, 80.0]
    misread = np.roll(near[:4], 17, axis=0) + 300.0 * np.arange(4)[:, None, None]
    found = groups(np.concatenate([places, places, places[10:14]]), np.concatenate([near, far, misread]))
    count = len(places)
    assert sorted(map(sorted, (part.tolist() for part in found))) == [
        list(range(count)),
        list(range(count, 2 * count)),
    ]
    assert groups(places[:0], near[:0]) == []


@pytest.mark.parametrize("turn_deg", [0.0, 40.0, 90.0, 200.0])
def test_corners_are_linked_and_tags_distinguished_from_gaps(turn_deg: float) -> None:
    pose = posed(Sheet(), np.array([0.0, 0.0, 320.0]), np.array([15.0, -20.0, turn_deg]), direct=True)
    picture = render(CAMERA, None, Sheet(), pose, noise_grey=1.0)
    (places, pixels), *others = linked_tags(picture, GRID)
    assert others == []
    assert len(places) > 80
    truth = seen(GRID.corners_in_board_mm, pose, None)
    apart = np.linalg.norm(pixels[:, None] - truth, axis=2)
    assert apart.min(axis=1).max() < 1.0
    row, col = np.divmod(apart.argmin(axis=1), 2 * GRID.cols)
    true = {(int(c), int(r)): number for number, (c, r) in enumerate(zip(col, row, strict=True))}
    for number, (x, y) in enumerate(zip(col, row, strict=True)):
        # The corner across a tag, along the grid's own axes.
        x, y = int(x), int(y)
        other = true.get((x + 1 if x % 2 == 0 else x - 1, y))
        if other is None:
            continue
        low = np.minimum(places[number], places[other])
        axis = int(np.flatnonzero(places[number] != places[other])[0])
        assert np.abs(places[number] - places[other]).sum() == 1
        assert low[axis] % 2 == (1, 0)[axis], "tags begin at odd x and even y"


def test_a_checkerboard_is_not_taken_for_a_charuco_board() -> None:
    board = Checkerboard(cols=9, rows=7, square_mm=16.0)
    pose = posed(board, np.array([0.0, 0.0, 320.0]), np.array([15.0, -20.0, 10.0]), direct=True)
    assert linked_tags(render(CAMERA, None, board, pose), GRID) == []
