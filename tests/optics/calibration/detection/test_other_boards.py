"""Boards other than the stated one, and flipped pictures, are recognised and named."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.images.pictures import read_image
from mirrorcam.optics.calibration.detection import other_boards as module
from mirrorcam.optics.calibration.detection.charuco import find_any_markers, find_marked_boards, find_markers
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.marker_layout import MarkerPairs
from mirrorcam.optics.calibration.detection.other_boards import other_board, other_markers, surely_other_board
from mirrorcam.optics.geometry.boards import CalibrationBoard, Charuco, Checkerboard, load_board
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from tests.nightly import a_few
from tests.optics.calibration.detection.aprilgrid_sheet import GRID, Sheet
from tests.optics.calibration.detection.one_mirror import CAMERA, one_mirror, seen
from tests.optics.calibration.detection.one_mirror import CAMERA as LARGER
from tests.optics.layouts import faceted_parabola
from tests.optics.synthetic import posed, render

SMALL_CAMERA = Camera(name="small", width_px=640, height_px=360, fx_px=453.0, fy_px=453.0, cx_px=319.5, cy_px=179.5)
LAYOUT = faceted_parabola(SMALL_CAMERA, DesignSpec(camera=SMALL_CAMERA, rows=2, cols=2), fill=0.92)
PLAIN = Checkerboard(cols=7, rows=6, square_mm=12.0)
EVEN = Checkerboard(cols=8, rows=6, square_mm=10.5)
MARKED = Charuco(cols=10, rows=7, square_mm=19.0, marker_mm=14.0)
SELFIE = "like those of a selfie camera"
WIDE = Charuco(cols=14, rows=9, square_mm=14.0, marker_mm=10.5)
BOARD = Charuco(cols=8, rows=6, square_mm=32.0, marker_mm=24.0, dictionary="DICT_4X4_50")
TURNS = ([10.0, 12.0, 20.0], [-15.0, 20.0, 0.0])
DIRECT_OR_MIRRORED = pytest.mark.parametrize("mirrored", [False, True])


@lru_cache
def pictures(board: Checkerboard | Charuco, *, mirrored: bool) -> tuple[Grey, ...]:
    """Two pictures of a board, through mirrors or by the bare camera."""
    far = 330.0 if mirrored else 220.0 if isinstance(board, Checkerboard) else 300.0
    place = np.array([0.0, far, 85.0]) if mirrored else np.array([0.0, 0.0, far])
    turns = ([10.0, 12.0, 20.0], [-15.0, 20.0, 0.0])
    layout = LAYOUT if mirrored else None
    return tuple(
        render(SMALL_CAMERA, layout, board, posed(board, place, np.array(turn), direct=not mirrored), noise_grey=4.0)
        for turn in turns
    )


def flipped(board: Checkerboard | Charuco, *, mirrored: bool) -> list[Grey]:
    return [np.ascontiguousarray(picture[:, ::-1]) for picture in pictures(board, mirrored=mirrored)]


@pytest.mark.parametrize(("stated", "mirrored"), [((6, 6), True), ((8, 6), False), ((7, 5), False), ((8, 7), False)])
def test_a_checkerboard_of_another_size_is_named(stated: tuple[int, int], *, mirrored: bool) -> None:
    board = PLAIN.replaced(cols=stated[0], rows=stated[1])
    said = f"the pictures show a checkerboard of 7 x 6 squares, board says {stated[0]} x {stated[1]}"
    assert other_board(pictures(PLAIN, mirrored=mirrored), board, mirrored=mirrored, found=False) == said


def test_a_checkerboard_that_was_found_is_not_taken_for_a_smaller_one() -> None:
    shown = pictures(PLAIN, mirrored=False)
    higher = PLAIN.replaced(rows=7)
    assert other_board(shown, higher, mirrored=False, found=True) is None
    assert other_board(shown, higher, mirrored=False, found=True, fits=False) is None
    lower = PLAIN.replaced(rows=5)
    said = "the pictures show a checkerboard of 7 x 6 squares, board says 7 x 5"
    assert other_board(shown, lower, mirrored=False, found=True, fits=False) == said


@pytest.mark.parametrize("stated", [(9, 7), (11, 7), (8, 7), (10, 6)])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_charuco_board_of_another_size_is_named(stated: tuple[int, int], *, mirrored: bool) -> None:
    board = MARKED.replaced(cols=stated[0], rows=stated[1])
    found = other_board(pictures(MARKED, mirrored=mirrored), board, mirrored=mirrored, found=True)
    assert found is not None
    said = "10 columns of squares" if stated[0] != 10 else "more rows of squares"
    assert f"show a ChArUco board of {said}, board says {stated[0]} x {stated[1]}" in found


@pytest.mark.parametrize("mirrored", [False, True])
def test_exchanged_columns_and_rows_of_a_charuco_board_are_named(*, mirrored: bool) -> None:
    said = other_board(
        pictures(WIDE, mirrored=mirrored), WIDE.replaced(cols=9, rows=14), mirrored=mirrored, found=False
    )
    assert said == (
        "the pictures show a ChArUco board of 14 columns of squares, board says 9 x 14 squares: are cols and rows "
        "exchanged?"
    )


@lru_cache
def tags(*, mirrored: bool) -> tuple[Grey, ...]:
    """Two pictures of an AprilGrid of 6 x 4 tags, by a camera alone or before a mirror."""
    sheet = Sheet()
    place = np.array([0.0, 350.0, 80.0]) if mirrored else np.array([0.0, 0.0, 320.0])
    layout = one_mirror() if mirrored else None
    return tuple(
        render(LARGER, layout, sheet, posed(sheet, place, np.array(turn), direct=not mirrored), noise_grey=2.0)
        for turn in ([10.0, 12.0, 20.0], [-15.0, 20.0, 0.0])
    )


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ((5, 4), "6 columns of tags, board says 5 x 4 tags"),
        ((8, 3), "6 columns of tags, board says 8 x 3 tags"),
        ((12, 7), "6 columns of tags, board says 12 x 7 tags"),
        ((4, 6), "6 columns of tags, board says 4 x 6 tags: are cols and rows exchanged?"),
        ((6, 3), "more rows of tags, board says 6 x 3 tags"),
    ],
)
@pytest.mark.parametrize("mirrored", [False, True])
def test_an_aprilgrid_of_another_size_is_named(stated: tuple[int, int], said: str, *, mirrored: bool) -> None:
    board = GRID.replaced(cols=stated[0], rows=stated[1])
    assert other_board(tags(mirrored=mirrored), board, mirrored=mirrored, found=False) == (
        f"the pictures show an AprilGrid of {said}"
    )


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_stated_aprilgrid_is_taken_and_flipped_ones_are_recognised(*, mirrored: bool) -> None:
    shown = tags(mirrored=mirrored)
    for board in (GRID, GRID.replaced(rows=6)):
        assert other_board(shown, board, mirrored=mirrored, found=False) is None
    turned = [np.ascontiguousarray(picture[:, ::-1]) for picture in shown]
    said = other_board(turned, GRID, mirrored=mirrored, found=False)
    assert said is not None
    assert SELFIE in said


@pytest.mark.parametrize("mirrored", a_few(2, [False, True]))
@pytest.mark.parametrize("found", [False, True])
def test_the_stated_board_is_taken(*, mirrored: bool, found: bool) -> None:
    shown = pictures(MARKED, mirrored=mirrored)
    assert other_board(shown, MARKED, mirrored=mirrored, found=found) is None
    # Other parts may be out of view.
    assert other_board(shown, MARKED.replaced(rows=9), mirrored=mirrored, found=found) is None
    blank = [np.full_like(shown[0], 60)]
    for board in (MARKED, PLAIN):
        assert other_board(blank, board, mirrored=mirrored, found=found) is None
    assert other_board([], MARKED, mirrored=mirrored, found=found) is None


@pytest.mark.parametrize(("board", "mirrored"), [(PLAIN, False), (EVEN, True)])
def test_the_stated_checkerboard_is_kept_if_no_other_fits(board: Checkerboard, *, mirrored: bool) -> None:
    assert other_board(pictures(board, mirrored=mirrored)[:1], board, mirrored=mirrored, found=True, fits=False) is None


@pytest.mark.parametrize("mirrored", [False, True])
def test_flipped_pictures_are_recognised(*, mirrored: bool) -> None:
    said = other_board(flipped(MARKED, mirrored=mirrored), MARKED, mirrored=mirrored, found=False)
    assert said is not None
    assert f"they are mirrored, {SELFIE}" in said


@pytest.mark.parametrize("mirrored", [False, True])
def test_flipped_pictures_of_a_checkerboard_are_recognised_by_its_colours(*, mirrored: bool) -> None:
    said = other_board(flipped(EVEN, mirrored=mirrored)[:1], EVEN, mirrored=mirrored, found=False)
    assert said is not None
    assert said.startswith("the 8 x 6 checkerboard in the pictures has black where it should be white")
    assert SELFIE in said


def test_some_flipped_pictures_of_a_checkerboard_are_ambiguous() -> None:
    shown = flipped(EVEN, mirrored=False)[:1]
    # It equals the picture of the board with cols and rows exchanged.
    assert other_board(shown, EVEN.replaced(cols=6, rows=8), mirrored=False, found=False) is None
    # With boards seen directly and in mirrors, half of them are mirrored anyway.
    assert other_board(shown, EVEN, mirrored=None, found=False) is None
    # With an odd number of columns or rows, a board looks the same in a mirror.
    assert other_board(flipped(PLAIN, mirrored=False)[:1], PLAIN, mirrored=False, found=False) is None


@pytest.mark.parametrize("mirrored", a_few(1, [False, True]))
def test_another_dictionary_is_named(*, mirrored: bool) -> None:
    shown = pictures(MARKED.replaced(dictionary="DICT_5X5_100"), mirrored=mirrored)
    said = other_board(shown, MARKED, mirrored=mirrored, found=False)
    assert said == (
        "the pictures show markers of DICT_5X5_50, board says dictionary DICT_4X4_250: "
        'set dictionary = "DICT_5X5_50" there'
    )


def test_a_missing_row_of_another_renderers_board_is_named(foreign_sets: Path) -> None:
    """Its frames show so many markers that the last row, beyond the inner corners, is not searched."""
    board = load_board(foreign_sets / "a_ch" / "board.toml")
    shown = [read_image(path, grey=True) for path in sorted((foreign_sets / "a_ch" / "frames").iterdir())[:2]]
    found = other_board(shown, board.replaced(rows=board.rows - 1), mirrored=True, found=True)
    assert found is not None
    assert "a ChArUco board of more rows of squares" in found
    assert other_board(shown, board, mirrored=True, found=True) is None


@lru_cache
def marked_pictures(board: Charuco, *, mirrored: bool, aside_mm: float = 0.0) -> tuple[Grey, ...]:
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
@pytest.mark.parametrize(("cols", "rows"), a_few(2, [(6, 6), (5, 8), (8, 6), (9, 6), (11, 8)]))
def test_the_other_pattern_is_named(cols: int, rows: int, *, mirrored: bool) -> None:
    new = sized(cols, rows)
    old = new.replaced(legacy=True)
    for board, other, said in ((new, old, "4.6 and later"), (old, new, "set legacy = true in board")):
        shown = marked_pictures(board, mirrored=mirrored, aside_mm=80.0 * mirrored)
        assert other_markers(shown, board, mirrored=mirrored, found=True) is None
        assert said in (other_markers(shown, other, mirrored=mirrored, found=True) or "")


@DIRECT_OR_MIRRORED
@pytest.mark.parametrize(
    "board",
    a_few(
        4,
        [
            sized(7, 5).replaced(inverted=True),
            sized(6, 6).replaced(legacy=True),
            sized(5, 8).replaced(legacy=True, first_marker=30),
            sized(8, 6).replaced(dictionary="DICT_APRILTAG_36h11", first_marker=500),
            sized(7, 5).replaced(dictionary="DICT_ARUCO_ORIGINAL"),
            sized(7, 5).replaced(dictionary="DICT_7X7_50"),
            sized(8, 6).replaced(inverted=True, legacy=True, first_marker=10),
        ],
    ),
    ids=lambda board: f"{board.dictionary} {board.cols} x {board.rows}",
)
def test_boards_are_found_as_they_are_stated(board: Charuco, *, mirrored: bool) -> None:
    place = np.array([0.0, 350.0, 80.0]) if mirrored else np.array([0.0, 0.0, 320.0])
    pose = posed(board, place, np.array(TURNS[0]), direct=not mirrored)
    shown = marked_pictures(board, mirrored=mirrored)
    (corners,) = find_marked_boards(shown[0], board, mirrored=mirrored, max_boards=2)
    assert len(corners) > 0.8 * len(board.corners_in_board_mm)
    truth = seen(board.corners_in_board_mm, pose, one_mirror() if mirrored else None)[corners.ids]
    assert np.abs(corners.pixels - truth).max() < 0.1
    assert other_markers(shown, board, mirrored=mirrored, found=True) is None


@DIRECT_OR_MIRRORED
@pytest.mark.parametrize("first", [6, 24])
def test_other_numbers_are_named(first: int, *, mirrored: bool) -> None:
    board = BOARD.replaced(first_marker=first)
    said = other_markers(marked_pictures(board, mirrored=mirrored), BOARD, mirrored=mirrored, found=False)
    assert said is not None
    assert f"set first_marker = {first} there" in said
    back = other_markers(marked_pictures(BOARD, mirrored=mirrored), board, mirrored=mirrored, found=False)
    assert back is not None
    assert "set first_marker = 0 there" in back


def test_the_second_board_of_a_series_is_not_taken_for_the_old_pattern() -> None:
    """The numbers of 8 x 5 squares begin half a pair of rows later, as in the old pattern."""
    board = sized(8, 5)
    said = other_markers(
        marked_pictures(board.replaced(first_marker=20), mirrored=False), board, mirrored=False, found=False
    )
    assert said is not None
    assert "set first_marker = 20 there" in said


@DIRECT_OR_MIRRORED
@pytest.mark.parametrize("found", a_few(2, [False, True]))
@pytest.mark.parametrize("stated", [0.5, 0.68, 0.81, 0.9])
def test_another_side_of_the_markers_is_measured(stated: float, *, found: bool, mirrored: bool) -> None:
    shown = marked_pictures(BOARD, mirrored=mirrored)
    said = other_markers(shown, BOARD.replaced(marker_mm=32.0 * stated), mirrored=mirrored, found=found)
    assert said == (
        f"the markers in the pictures look like 24 mm on squares of 32 mm, board says marker_mm = {32.0 * stated:g}"
    )


@DIRECT_OR_MIRRORED
def test_a_print_in_white_on_black_is_named(*, mirrored: bool) -> None:
    negatives = [np.asarray(255 - shown, dtype=np.uint8) for shown in marked_pictures(BOARD, mirrored=mirrored)]
    said = other_markers(negatives, BOARD, mirrored=mirrored, found=False)
    assert said == "the ChArUco board in the pictures is printed white on black: set inverted = true in board"
    assert other_markers(negatives, BOARD.replaced(inverted=True), mirrored=mirrored, found=True) is None


@DIRECT_OR_MIRRORED
@pytest.mark.parametrize(
    ("shown", "keys"),
    [
        ({"inverted": True, "first_marker": 24}, ("inverted = true", "first_marker = 24")),
        ({"dictionary": "DICT_6X6_250", "first_marker": 100}, ('dictionary = "DICT_6X6_250"', "first_marker = 100")),
        ({"dictionary": "DICT_5X5_50", "inverted": True}, ("inverted = true", 'dictionary = "DICT_5X5_50"')),
        ({"dictionary": "DICT_7X7_50", "legacy": True}, ('dictionary = "DICT_7X7_50"', "legacy = true")),
        ({"legacy": True, "first_marker": 20}, ("legacy = true", "first_marker = 20")),
        ({"legacy": True, "first_marker": 24}, ("legacy = true", "first_marker = 24")),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, dict) else "",
)
def test_all_differences_are_named_at_once(shown: dict[str, Any], keys: tuple[str, ...], *, mirrored: bool) -> None:
    board = BOARD.replaced(**shown)
    pictures_of_board = marked_pictures(board, mirrored=mirrored)[:1]
    said = other_markers(pictures_of_board, BOARD, mirrored=mirrored, found=False)
    assert said is not None
    assert all(key in said for key in keys)
    assert other_markers(pictures_of_board, board, mirrored=mirrored, found=True) is None


@DIRECT_OR_MIRRORED
def test_a_stated_inversion_that_is_not_there_is_named(*, mirrored: bool) -> None:
    said = other_markers(
        marked_pictures(BOARD, mirrored=mirrored), BOARD.replaced(inverted=True), mirrored=mirrored, found=False
    )
    assert said is not None
    assert said.endswith("printed black on white, board says inverted = true: remove that")


@pytest.mark.parametrize(
    ("shown", "stated", "said"),
    [
        (BOARD, PLAIN, 'ChArUco board of 8 columns of squares, board says kind = "checkerboard"'),
        (BOARD, GRID, 'set kind = "charuco" there, dictionary = "DICT_4X4_50"'),
        (PLAIN, BOARD, 'plain checkerboard of 7 x 6 squares, board says kind = "charuco"'),
        (PLAIN, GRID, 'set kind = "checkerboard" there'),
        (GRID, BOARD, 'AprilGrid of 6 columns of tags, board says kind = "charuco"'),
        (GRID, PLAIN, 'set kind = "aprilgrid" there, spacing = 0.2,'),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_another_kind_of_board_is_named(shown: CalibrationBoard, stated: CalibrationBoard, said: str) -> None:
    if isinstance(shown, Checkerboard):
        seen_pictures = pictures(shown, mirrored=False)
    else:
        seen_pictures = tags(mirrored=False) if shown == GRID else marked_pictures(BOARD, mirrored=False)
    assert said in (other_board(seen_pictures[:1], stated, mirrored=False, found=False) or "")


@DIRECT_OR_MIRRORED
@pytest.mark.parametrize("stated", [0.1, 0.185, 0.3])
def test_another_spacing_of_tags_is_measured(stated: float, *, mirrored: bool) -> None:
    said = other_board(tags(mirrored=mirrored), GRID.replaced(spacing=stated), mirrored=mirrored, found=stated == 0.185)
    assert said is not None
    assert f"look like 0.2 sides of a tag, board says spacing = {stated:g} (Kalibr's tagSpacing)" in said


@DIRECT_OR_MIRRORED
@pytest.mark.parametrize("name", a_few(2, ["DICT_6X6_50", "DICT_APRILTAG_36h11"]))
def test_another_dictionary_of_any_kind_is_named(name: str, *, mirrored: bool) -> None:
    shown = marked_pictures(BOARD.replaced(dictionary=name), mirrored=mirrored)
    said = other_markers(shown, BOARD, mirrored=mirrored, found=False)
    assert said is not None
    assert said.endswith(f'board says dictionary DICT_4X4_50: set dictionary = "{name}" there')


def test_a_dictionary_with_the_same_markers_is_not_another_board(monkeypatch: pytest.MonkeyPatch) -> None:
    """A board of 24 markers is the same from DICT_4X4_50 and from DICT_4X4_250; pictures too poor once named either."""
    tried: set[str] = set()

    def counted(grey: Grey, names: list[str], *, mirrored: bool) -> np.ndarray:
        tried.update(names)
        return np.zeros(len(names), dtype=int)

    def pairs(shown: object, board: Charuco, *, mirrored: bool) -> MarkerPairs:
        tried.add(board.dictionary)
        return MarkerPairs.of([], inner=False)

    monkeypatch.setattr(module, "_pairs", pairs)
    monkeypatch.setattr(module, "count_by_family", counted)
    assert other_markers([np.zeros((9, 9), np.uint8)], BOARD, mirrored=False, found=False) is None
    assert {"DICT_4X4_50", "DICT_5X5_1000"} < tried
    assert not tried & {"DICT_4X4_100", "DICT_4X4_250", "DICT_4X4_1000"}


WRONG = [
    (PLAIN, PLAIN.replaced(cols=8)),
    (PLAIN, PLAIN.replaced(rows=5)),
    (PLAIN, MARKED),
    (PLAIN, GRID),
    (MARKED, MARKED.replaced(cols=9)),
    (MARKED, MARKED.replaced(rows=5)),
    (MARKED, MARKED.replaced(cols=7, rows=10)),
    (MARKED, MARKED.replaced(dictionary="DICT_5X5_250")),
    (MARKED, PLAIN),
    (MARKED, GRID),
]


@DIRECT_OR_MIRRORED
@pytest.mark.parametrize(("shown", "stated"), a_few(5, WRONG))
def test_a_sample_names_a_wrong_board_though_its_first_picture_is_empty(
    shown: Checkerboard | Charuco, stated: CalibrationBoard, *, mirrored: bool
) -> None:
    sample = pictures(shown, mirrored=mirrored)
    empty = np.full_like(sample[0], 60)
    assert surely_other_board([empty, *sample, empty], stated, mirrored=mirrored) is not None
    assert surely_other_board([empty, *sample, empty], shown, mirrored=mirrored) is None
    assert surely_other_board([empty, empty], stated, mirrored=mirrored) is None


def test_more_rows_are_not_taken_for_the_old_pattern_with_other_numbers() -> None:
    """Eight rows of markers among inner corners belong to ten rows or more."""
    board = Charuco(cols=14, rows=10, square_mm=19.0, marker_mm=14.0)
    said = other_markers(marked_pictures(board, mirrored=False), board.replaced(rows=8), mirrored=False, found=True)
    assert said == "the pictures show a ChArUco board of more rows of squares, board says 14 x 8 squares"


@DIRECT_OR_MIRRORED
def test_markers_of_a_family_are_read_as_by_opencv(*, mirrored: bool) -> None:
    for board in (BOARD, BOARD.replaced(dictionary="DICT_APRILTAG_36h11", first_marker=500)):
        shown = marked_pictures(board, mirrored=mirrored)[0]
        numbers, quads = find_markers(shown, board, mirrored=mirrored)
        ids, corners = find_any_markers(shown, board, mirrored=mirrored)
        assert len(ids) >= len(numbers) > 0.8 * len(board.markers)
        for number, quad in zip(numbers + board.first_marker, quads, strict=True):
            assert np.abs(corners[ids == number] - quad).max(axis=(1, 2)).min() < 1.0
