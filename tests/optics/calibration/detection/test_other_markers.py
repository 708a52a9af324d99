"""What a ChArUco board in pictures has otherwise than stated is named: its pattern, numbers, markers or colours."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from mirrorcam.optics.calibration.detection import other_markers as module
from mirrorcam.optics.calibration.detection.charuco import find_boards
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.marker_steps import MarkerPairs
from mirrorcam.optics.calibration.detection.other_markers import other_markers
from mirrorcam.optics.geometry.targets import Charuco
from tests.optics.calibration.detection.one_mirror import CAMERA, one_mirror, seen
from tests.optics.synthetic import posed, render

BOARD = Charuco(cols=8, rows=6, square_mm=32.0, marker_mm=24.0, dictionary="DICT_4X4_50")
TURNS = ([10.0, 12.0, 20.0], [-15.0, 20.0, 0.0])
DIRECT_OR_MIRRORED = pytest.mark.parametrize("mirrored", [False, True])


@lru_cache
def pictures(board: Charuco, *, mirrored: bool, aside_mm: float = 0.0) -> tuple[Grey, ...]:
    """Two pictures of a board, by a bare camera or before a mirror; some of it may be out of view."""
    place = np.array([aside_mm, 350.0, 80.0]) if mirrored else np.array([aside_mm, 0.0, 320.0])
    layout = one_mirror() if mirrored else None
    return tuple(
        render(CAMERA, layout, board, posed(board, place, np.array(turn), direct=not mirrored), noise_grey=2.0)
        for turn in TURNS
    )


def sized(cols: int, rows: int) -> Charuco:
    square_mm = min(300.0 / cols, 190.0 / rows)
    return BOARD.replaced(cols=cols, rows=rows, square_mm=square_mm, marker_mm=0.75 * square_mm)


@DIRECT_OR_MIRRORED
@pytest.mark.parametrize(("cols", "rows"), [(6, 6), (5, 8), (8, 6), (9, 6), (11, 8)])
def test_the_pattern_is_named_where_it_is_the_other_one(cols: int, rows: int, *, mirrored: bool) -> None:
    new = sized(cols, rows)
    old = new.replaced(legacy=True)
    for board, other, said in ((new, old, "4.6 and later"), (old, new, "add legacy = true to board.toml")):
        shown = pictures(board, mirrored=mirrored, aside_mm=80.0 * mirrored)
        assert other_markers(shown, board, mirrored=mirrored, found=True) is None
        assert said in (other_markers(shown, other, mirrored=mirrored, found=True) or "")


@DIRECT_OR_MIRRORED
@pytest.mark.parametrize(
    "board",
    [
        sized(6, 6).replaced(legacy=True),
        sized(5, 8).replaced(legacy=True, first_marker=30),
        sized(8, 6).replaced(dictionary="DICT_APRILTAG_36h11", first_marker=500),
        sized(7, 5).replaced(dictionary="DICT_ARUCO_ORIGINAL"),
        sized(7, 5).replaced(dictionary="DICT_7X7_50"),
    ],
    ids=lambda board: f"{board.dictionary} {board.cols} x {board.rows}",
)
def test_boards_are_found_as_they_are_stated(board: Charuco, *, mirrored: bool) -> None:
    place = np.array([0.0, 350.0, 80.0]) if mirrored else np.array([0.0, 0.0, 320.0])
    pose = posed(board, place, np.array(TURNS[0]), direct=not mirrored)
    shown = pictures(board, mirrored=mirrored)
    (corners,) = find_boards(shown[0], board, mirrored=mirrored, most=2)
    assert len(corners) > 0.8 * len(board.corners_in_board_mm)
    truth = seen(board.corners_in_board_mm, pose, one_mirror() if mirrored else None)[corners.ids]
    assert np.abs(corners.pixels - truth).max() < 0.1
    assert other_markers(shown, board, mirrored=mirrored, found=True) is None


@DIRECT_OR_MIRRORED
@pytest.mark.parametrize("first", [6, 24])
def test_other_numbers_are_named(first: int, *, mirrored: bool) -> None:
    board = BOARD.replaced(first_marker=first)
    said = other_markers(pictures(board, mirrored=mirrored), BOARD, mirrored=mirrored, found=False)
    assert said is not None
    assert f"set first_marker = {first} there" in said
    back = other_markers(pictures(BOARD, mirrored=mirrored), board, mirrored=mirrored, found=False)
    assert back is not None
    assert "set first_marker = 0 there" in back


def test_the_numbers_of_the_second_board_of_a_series_are_not_taken_for_the_old_pattern() -> None:
    """Those of 8 x 5 squares begin half a pair of rows later, as those of the old pattern would."""
    board = sized(8, 5)
    said = other_markers(pictures(board.replaced(first_marker=20), mirrored=False), board, mirrored=False, found=False)
    assert said is not None
    assert "set first_marker = 20 there" in said


@DIRECT_OR_MIRRORED
@pytest.mark.parametrize("found", [False, True])
@pytest.mark.parametrize("stated", [0.5, 0.68, 0.81, 0.9])
def test_another_side_of_the_markers_is_measured(stated: float, *, found: bool, mirrored: bool) -> None:
    shown = pictures(BOARD, mirrored=mirrored)
    said = other_markers(shown, BOARD.replaced(marker_mm=32.0 * stated), mirrored=mirrored, found=found)
    assert said == (
        "the markers in the pictures look like 24 mm on squares of 32 mm, "
        f"board.toml says marker_mm = {32.0 * stated:g}"
    )


@DIRECT_OR_MIRRORED
def test_a_print_in_white_on_black_is_named(*, mirrored: bool) -> None:
    negatives = [np.asarray(255 - shown, dtype=np.uint8) for shown in pictures(BOARD, mirrored=mirrored)]
    said = other_markers(negatives, BOARD, mirrored=mirrored, found=False)
    assert said is not None
    assert "is printed white on black" in said


@DIRECT_OR_MIRRORED
@pytest.mark.parametrize("name", ["DICT_6X6_50", "DICT_APRILTAG_36h11"])
def test_another_dictionary_of_any_kind_is_named(name: str, *, mirrored: bool) -> None:
    shown = pictures(BOARD.replaced(dictionary=name), mirrored=mirrored)
    said = other_markers(shown, BOARD, mirrored=mirrored, found=False)
    assert said == f"the pictures show markers of {name}, board.toml says dictionary DICT_4X4_50"


def test_a_dictionary_with_the_same_markers_is_none_of_another_board(monkeypatch: pytest.MonkeyPatch) -> None:
    """A board of 24 markers is the same from DICT_4X4_50 and from DICT_4X4_250; pictures too poor once named either."""
    tried: set[str] = set()

    def counted(grey: Grey, names: list[str], first: int, *, mirrored: bool) -> np.ndarray:
        tried.update(names)
        return np.zeros(len(names), dtype=int)

    def pairs(shown: object, target: Charuco, *, mirrored: bool) -> MarkerPairs:
        tried.add(target.dictionary)
        return MarkerPairs.of([], inner=False)

    monkeypatch.setattr(module, "_pairs", pairs)
    monkeypatch.setattr(module, "families_seen", counted)
    assert other_markers([np.zeros((9, 9), np.uint8)], BOARD, mirrored=False, found=False) is None
    assert {"DICT_4X4_50", "DICT_5X5_1000"} < tried
    assert not tried & {"DICT_4X4_100", "DICT_4X4_250", "DICT_4X4_1000"}
