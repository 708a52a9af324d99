"""Targets: corners where OpenCV finds them in the printed picture, and invalid boards."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import InvalidValue
from mirrorcam.optics.geometry.boards import (
    TAG_FAMILY,
    AprilGrid,
    CalibrationBoard,
    Charuco,
    Checkerboard,
    default_board,
    load_board,
    save_board,
)

CHARUCO = Charuco(cols=7, rows=5, square_mm=12.5, marker_mm=9.0)
PLAIN = Checkerboard(cols=8, rows=7, square_mm=3.0)
TAGS = AprilGrid(cols=6, rows=4, tag_mm=88.0, spacing=0.3)
# Family 36h11 of the AprilTags C++ library, ids 0 to 2: a set bit is white, the highest bit is the upper left module
# of a tag as Kalibr prints it.
CODES = (0xD5D628584, 0xD97F18B49, 0xDD280910E)


@pytest.mark.parametrize("board", [CHARUCO, PLAIN, default_board()])
def test_corners_run_row_by_row_from_the_top_left(board: Checkerboard | Charuco) -> None:
    corners = board.corners_in_board_mm
    assert corners.shape == ((board.rows - 1) * (board.cols - 1), 3)
    assert corners[0].tolist() == [board.square_mm, board.square_mm, 0]
    assert corners[1].tolist() == [2 * board.square_mm, board.square_mm, 0]
    assert corners[board.cols - 1].tolist() == [board.square_mm, 2 * board.square_mm, 0]
    width, height = board.size_mm
    assert corners[-1].tolist() == [width - board.square_mm, height - board.square_mm, 0]


def test_opencv_agrees_on_the_charuco_corners() -> None:
    assert np.allclose(CHARUCO.opencv_board.getChessboardCorners(), CHARUCO.corners_in_board_mm)
    assert CHARUCO.opencv_board.getChessboardSize() == (7, 5)


@pytest.mark.parametrize("board", [CHARUCO, default_board()])
def test_charuco_corners_are_found_where_they_were_printed(board: Charuco) -> None:
    px, border = 40, 20
    image = np.pad(board.image(px), border, constant_values=255)
    assert board.image(px).shape == (board.rows * px, board.cols * px)
    found, ids, _, _ = cv2.aruco.CharucoDetector(board.opencv_board).detectBoard(image)
    assert sorted(np.ravel(ids)) == list(range(len(board.corners_in_board_mm)))
    # The printed edge between pixels 39 and 40 lies at 39.5 where pixel centres are whole numbers.
    expected = board.corners_in_board_mm[np.ravel(ids), :2] / board.square_mm * px - 0.5 + border
    assert np.abs(np.asarray(found).reshape(-1, 2) - expected).max() < 0.25


def test_the_checkerboard_is_found_where_it_was_printed() -> None:
    px, border = 20, 20
    image = np.pad(PLAIN.image(px), border, constant_values=255)
    found, corners = cv2.findChessboardCornersSB(image, (7, 6))
    assert found
    expected = PLAIN.corners_in_board_mm[:, :2] / PLAIN.square_mm * px - 0.5 + border
    points = np.asarray(corners).reshape(-1, 2)
    assert min(np.abs(points - expected).max(), np.abs(points[::-1] - expected).max()) < 0.1


@pytest.mark.parametrize("board", [CHARUCO, PLAIN])
def test_the_top_left_square_is_black_and_squares_alternate(board: Checkerboard | Charuco) -> None:
    image = board.image(40)
    # A square's border ring shows its colour: a marker leaves it free.
    ring = image.reshape(board.rows, 40, board.cols, 40)[:, 2, :, 20]
    row, col = np.indices(ring.shape)
    assert np.array_equal(ring, np.where((row + col) % 2 == 0, 0, 255))


@pytest.mark.parametrize(("cols", "rows"), [(8, 7), (7, 8), (8, 6), (7, 5)])
def test_which_boards_look_the_same_upside_down(cols: int, rows: int) -> None:
    board = Checkerboard(cols=cols, rows=rows, square_mm=1.0)
    image = board.image(3)
    assert board.looks_same_upside_down is np.array_equal(image, image[::-1, ::-1])


@pytest.mark.parametrize(("cols", "rows"), [(6, 6), (5, 8), (8, 5), (7, 7)])
@pytest.mark.parametrize("legacy", [False, True])
def test_opencv_finds_boards_of_both_patterns_with_ids_from_any_number(cols: int, rows: int, *, legacy: bool) -> None:
    board = CHARUCO.replaced(cols=cols, rows=rows, legacy=legacy, first_marker=20, dictionary="dict_6x6_250")
    old_or_new = cv2.aruco.CharucoBoard(
        (cols, rows),
        board.square_mm,
        board.marker_mm,
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_250),
        20 + np.arange(rows * cols // 2, dtype=np.int32),
    )
    old_or_new.setLegacyPattern(legacy)
    image = np.pad(board.image(40), 20, constant_values=255)
    found, ids, _, _ = cv2.aruco.CharucoDetector(old_or_new).detectBoard(image)
    assert sorted(np.ravel(ids)) == list(range(len(board.corners_in_board_mm)))
    expected = board.corners_in_board_mm[np.ravel(ids), :2] / board.square_mm * 40 - 0.5 + 20
    assert np.abs(np.asarray(found).reshape(-1, 2) - expected).max() < 0.25
    np.testing.assert_array_equal(board.black, image[22:-20:40, 22:-20:40] == 0)
    new = board.replaced(legacy=False)
    assert np.array_equal(board.image(40), new.image(40)) == (rows % 2 == 1 or not legacy)


def test_keys_that_a_board_does_not_need_are_not_written(tmp_path: Path) -> None:
    save_board(tmp_path / "board.toml", CHARUCO)
    assert set(CHARUCO.model_dump()) == {"kind", "cols", "rows", "square_mm", "marker_mm", "dictionary"}
    assert "legacy" not in (tmp_path / "board.toml").read_text()
    save_board(tmp_path / "old.toml", CHARUCO.replaced(legacy=True, first_marker=3))
    assert "legacy = true\nfirst_marker = 3\n" in (tmp_path / "old.toml").read_text()


@pytest.mark.parametrize(
    "board",
    [
        CHARUCO,
        CHARUCO.replaced(legacy=True, first_marker=3, inverted=True),
        PLAIN.replaced(inverted=True),
        PLAIN,
        TAGS,
        default_board(),
        Checkerboard(cols=3, rows=3, square_mm=1 / 3),
    ],
)
def test_a_board_survives_its_file(board: CalibrationBoard, tmp_path: Path) -> None:
    save_board(tmp_path / "board.toml", board)
    back = load_board(tmp_path / "board.toml")
    assert type(back) is type(board)
    assert back == board


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("cols = 8\nrows = 7\nsquare_mm = 3.0\n", "'kind'"),
        (
            'kind = "dots"\ncols = 8\nrows = 7\nsquare_mm = 3.0\n',
            "'dots', expected one of 'checkerboard', 'charuco', 'aprilgrid'",
        ),
        ('kind = "checkerboard"\ncols = 8\nrows = 7\n', "checkerboard.square_mm: Field required"),
        ('kind = "checkerboard"\ncols = 8\nrows = 7\nsquare_mm = nan\n', "square_mm: Input should be a finite number"),
        ('kind = "checkerboard"\ncols = 8\nrows = 7\nsquare_mm = 3\nmarker_mm = 2\n', "marker_mm: not known"),
        (
            'kind = "checkerboard"\ncols = 2\nrows = 7\nsquare_mm = 3\n',
            "cols: Input should be greater than or equal to 3",
        ),
        ('kind = "charuco"\ncols = 8\nrows = 7\nsquare_mm = 3\nmarker_mm = 3\n', "marker_mm 3.0 is not smaller than"),
        (
            'kind = "charuco"\ncols = 8\nrows = 7\nsquare_mm = 3\nmarker_mm = 2\ndictionary = "DICT_9X9"\n',
            "dictionary 'DICT_9X9' is unknown, expected one of DICT_4X4_50,",
        ),
        (
            'kind = "charuco"\ncols = 12\nrows = 10\nsquare_mm = 3\nmarker_mm = 2\ndictionary = "DICT_4X4_50"\n',
            "60 markers are needed, but DICT_4X4_50 has 50",
        ),
        (
            'kind = "charuco"\ncols = 8\nrows = 6\nsquare_mm = 3\nmarker_mm = 2\nfirst_marker = 230\n',
            "24 markers are needed, starting at id 230, but DICT_4X4_250 has 250",
        ),
        ('kind = "charuco"\ncols = 8\nrows = 6\nsquare_mm = 3\nmarker_mm = 2\nlegacy = 1\n', "legacy: Input should"),
        ('kind = "aprilgrid"\ncols = 6\nrows = 6\ntag_mm = 88\n', "aprilgrid.spacing: Field required"),
        ('kind = "aprilgrid"\ncols = 6\nrows = 6\ntag_mm = 88\nspacing = 1.5\n', "spacing: Input should be less than"),
        (
            'kind = "aprilgrid"\ncols = 30\nrows = 20\ntag_mm = 8\nspacing = 0.3\n',
            "600 tags are needed but 36h11 has only 587",
        ),
        ("cols == 8", "not valid TOML"),
        ("cols = 8\n", "'kind' is missing"),
    ],
)
def test_board_files_are_refused_in_one_line(content: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "board.toml"
    path.write_text(content)
    with pytest.raises(InputError) as caught:
        load_board(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_board_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"board\.toml: no such file$"):
        load_board(tmp_path / "board.toml")


@pytest.mark.parametrize("changes", [{"square_mm": 0.0}, {"rows": 2}, {"cols": 3.5}, {"colour": "red"}])
def test_invalid_boards_are_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(InvalidValue):
        PLAIN.replaced(**changes)


def test_aprilgrid_corners_are_where_kalibr_has_them() -> None:
    # GridCalibrationTargetAprilgrid::createGridPoints: from the lower left corner of tag 0, y up, row by row.
    size, spacing, cols, rows = 0.088, 0.3, 6, 4
    kalibr = np.array(
        [
            [(c // 2) * (1 + spacing) * size + (c % 2) * size, (r // 2) * (1 + spacing) * size + (r % 2) * size]
            for r in range(2 * rows)
            for c in range(2 * cols)
        ]
    )
    r, c = np.divmod(np.arange(len(kalibr)), 2 * cols)
    ours = TAGS.corners_in_board_mm[(2 * rows - 1 - r) * 2 * cols + c]
    _, height = TAGS.size_mm
    np.testing.assert_allclose(ours[:, 0], 1000 * kalibr[:, 0] + TAGS.gap_mm, atol=1e-9)
    np.testing.assert_allclose(ours[:, 1], height - TAGS.gap_mm - 1000 * kalibr[:, 1], atol=1e-9)


@pytest.mark.parametrize("number", range(3))
def test_tags_are_printed_as_kalibr_prints_them(number: int) -> None:
    code = np.array([[CODES[number] >> (35 - 6 * row - col) & 1 for col in range(6)] for row in range(6)], dtype=bool)
    black = TAGS.tag(number)
    np.testing.assert_array_equal(black[2:-2, 2:-2], ~code)
    assert black.sum() == 100 - code.sum(), "two modules of black border"
    # The lower row holds the first tags, from the left; gaps cross in black squares.
    image = TAGS.image(100)
    assert image.shape == (4 * 130 + 30, 6 * 130 + 30)
    left, low = 30 + 130 * number, 30 + 3 * 130
    np.testing.assert_array_equal(image[low : low + 100 : 10, left : left + 100 : 10] == 0, black)
    assert (image[low - 30 : low, left - 30 : left] == 0).all()
    assert (image[low - 30 : low, left : left + 100] == 255).all()


def test_opencv_reads_the_tags_rotated_by_180_degrees() -> None:
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = 2
    # Remove the squares, which connect the outlines of tags.
    image = np.pad(TAGS.image(100), 30, constant_values=255)
    for row in range(5):
        for col in range(7):
            image[30 + 130 * row : 60 + 130 * row, 30 + 130 * col : 60 + 130 * col] = 255
    quads, ids, _ = cv2.aruco.ArucoDetector(TAG_FAMILY, parameters).detectMarkers(image)
    assert ids is not None
    assert sorted(np.ravel(ids)) == list(range(24))
    first = np.asarray(quads[int(np.flatnonzero(np.ravel(ids) == 0)[0])]).reshape(4, 2)
    low = 30 + 30 + 3 * 130
    np.testing.assert_allclose(first[0], [60 + 100, low + 100], atol=1.5)
    np.testing.assert_allclose(first[2], [60, low], atol=1.5)


KALIBR = "target_type: 'aprilgrid' #gridtype\ntagCols: 6 #tags\ntagRows: 4\ntagSize: 0.088 # m\ntagSpacing: 0.3\n"


@pytest.mark.parametrize("name", ["april_6x4.yaml", "grid.yml"])
def test_kalibrs_own_file_is_read(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(KALIBR)
    assert load_board(tmp_path / name) == TAGS


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("'aprilgrid'", "'circlegrid'", "target_type is 'circlegrid', expected 'aprilgrid' or 'checkerboard'"),
        ("'aprilgrid'", "'checkerboard'", "colSpacingMeters: 'None', expected a number above 0"),
        ("tagSize: 0.088", "tagSize: wide", "tagSize: 'wide', expected a number"),
        ("tagSize: 0.088", "tagSize: 1e", "tagSize: '1e', expected a number"),
        ("tagSize: 0.088", "tagSize: .inf", "tagSize: 'inf', expected a number"),
        ("tagRows: 4", "", "tagRows: 'None', expected a whole number"),
        ("tagRows: 4", "tagRows: 4.5", "tagRows: '4.5', expected a whole number"),
        ("tagSpacing: 0.3", "tagSpacing: 3", "tagSpacing is 3, expected the gap divided by tagSize, 0.05 to 0.8"),
        ("tagSpacing: 0.3", "tagSpacing: 0.0264", "if that is in metres, it is 0.3"),
        ("tagSpacing: 0.3", f"tagSpacing: {'[' * 40}", "nested deeper than 32"),
        ("tagSpacing: 0.3", "tagSpacing: 0.3\n---\na: 1", "2 documents, expected one"),
    ],
)
def test_files_of_kalibr_are_refused_in_one_line(old: str, new: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "target.yaml"
    path.write_text(KALIBR.replace(old, new))
    with pytest.raises(InputError) as caught:
        load_board(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("board", [CHARUCO, CHARUCO.replaced(rows=6, legacy=True, first_marker=5), PLAIN])
def test_an_inverted_board_is_the_negative_of_its_print(board: Checkerboard | Charuco) -> None:
    inverted = board.replaced(inverted=True)
    np.testing.assert_array_equal(inverted.image(40), 255 - board.image(40))
    np.testing.assert_array_equal(inverted.corners_in_board_mm, board.corners_in_board_mm)
    if isinstance(board, Charuco) and isinstance(inverted, Charuco):
        np.testing.assert_array_equal(inverted.black, ~board.black)
        np.testing.assert_array_equal(inverted.marker_squares, board.marker_squares)
        np.testing.assert_array_equal(inverted.markers, ~board.markers)
