"""Boards as anipose, caliscope and Kalibr describe them."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.boards import (
    AprilGrid,
    CalibrationBoard,
    Charuco,
    Checkerboard,
    is_own_board,
    load_board,
)

ANIPOSE = """
project = "flypose"
nesting = 1

[calibration]
board_type = "charuco"
board_size = [7, 6]
board_marker_bits = 5
board_marker_dict_number = 100
board_marker_length = 3.75 # mm
board_square_side_length = 5 # mm
animal_calibration = false

[filter]
enabled = true
"""
CALISCOPE = """
columns = 4
rows = 5
board_height = 11.0
board_width = 8.5
dictionary = "DICT_4X4_1000"
units = "inch"
aruco_scale = 0.75
square_size_override_cm = 5.4
inverted = true
legacy_pattern = false
thickness_cm = 0.0
"""
CALISCOPES = Charuco(cols=4, rows=5, square_mm=54.0, marker_mm=40.5, dictionary="DICT_4X4_1000", inverted=True)
KALIBR = "target_type: 'checkerboard' #gridtype\ntargetCols: 6  #number of internal chessboard corners\ntargetRows: 7\n"
KALIBR += "rowSpacingMeters: 0.06\ncolSpacingMeters: 0.06\n"
GRID = "tagCols: 6\ntagRows: 4\ntagSize: 0.088\ntagSpacing: 0.3\n"


@pytest.mark.parametrize(
    ("name", "content", "board"),
    [
        ("config.toml", ANIPOSE, Charuco(cols=7, rows=6, square_mm=5, marker_mm=3.75, dictionary="DICT_5X5_100")),
        (
            "config.toml",
            ANIPOSE.replace('"charuco"', '"checkerboard"'),
            Checkerboard(cols=8, rows=7, square_mm=5.0),
        ),
        ("charuco.toml", CALISCOPE, CALISCOPES),
        ("config.toml", f"CreationDate = 2023-06-29T09:12:25\n[charuco]{CALISCOPE}", CALISCOPES),
        (
            "extrinsic_charuco.toml",
            CALISCOPE.replace("square_size_override_cm = 5.4", "").replace("inverted = true", "inverted = false"),
            CALISCOPES.replaced(square_mm=8.5 * 25.4 / 4, marker_mm=0.75 * 8.5 * 25.4 / 4, inverted=False),
        ),
        (
            "charuco.toml",
            CALISCOPE.replace("columns = 4", "columns = 12").replace("rows = 5", "rows = 9").replace("_1000", "_50"),
            CALISCOPES.replaced(cols=12, rows=9, dictionary="DICT_4X4_100"),
        ),
        (
            "chessboard.toml",
            "rows = 6\ncolumns = 9\nsquare_size_cm = 2.5\n",
            Checkerboard(cols=10, rows=7, square_mm=25),
        ),
        ("target.yaml", KALIBR, Checkerboard(cols=7, rows=8, square_mm=60.0)),
        ("target.yaml", KALIBR.partition("\n")[2], Checkerboard(cols=7, rows=8, square_mm=60.0)),
        ("april.yml", GRID, AprilGrid(cols=6, rows=4, tag_mm=88.0, spacing=0.3)),
        (
            "april.yaml",
            "{tagCols: 6, tagRows: 4, tagSize: 8.8e-2, tagSpacing: 0.3}",
            AprilGrid(cols=6, rows=4, tag_mm=88.0, spacing=0.3),
        ),
    ],
)
def test_boards_of_others_are_read(name: str, content: str, board: CalibrationBoard, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(content)
    assert load_board(path) == board
    assert not is_own_board(path)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        (
            "a.toml",
            ANIPOSE.replace('"charuco"', '"aruco"'),
            "board_type is 'aruco', expected 'charuco' or 'checkerboard'",
        ),
        ("a.toml", ANIPOSE.replace("[7, 6]", "[7, 6, 5]"), "board_size: expected two numbers: columns and rows"),
        ("a.toml", ANIPOSE.replace("[7, 6]", '["7", 6]'), "board_size: '7', expected a whole number"),
        ("a.toml", ANIPOSE.replace("_bits = 5", "_bits = 9"), "dictionary 'DICT_9X9_100' is unknown"),
        ("a.toml", ANIPOSE.replace("= 3.75", "= 5.75"), "marker_mm 5.75 is not smaller than square_mm 5.0"),
        ("a.toml", CALISCOPE.replace("rows = 5", ""), "rows: 'None', expected a whole number"),
        ("a.toml", CALISCOPE.replace("= 5.4", "= nan"), "square_size_override_cm: 'nan', expected a number above 0"),
        (
            "a.toml",
            CALISCOPE.replace("inverted = true", 'inverted = "yes"'),
            "inverted: Input should be a valid",
        ),
        (
            "a.toml",
            CALISCOPE.replace("= 5.4", "= 0").replace('"inch"', '"ell"'),
            "units is 'ell', expected 'cm' or",
        ),
        ("a.toml", "rows = 6\ncolumns = 9\n", "square_size_cm: 'None', expected a number above 0"),
        ("a.toml", "dictionary = 0\n[[markers]]\nid = 1\nsize_m = 0.1\n", "a set of single markers"),
        (
            "a.yaml",
            KALIBR.replace("colSpacingMeters: 0.06", "colSpacingMeters: 0.05"),
            "50 and 60 mm, expected",
        ),
        ("a.yaml", GRID.replace("tagCols: 6", "tagCols: !!int 6"), "expected none"),
        ("a.yaml", f"{GRID}{'a' * 1_100_000}: 1\n", "is larger than 1 MB"),
        ("a.yaml", "", "Input should be an object"),
    ],
)
def test_boards_that_cannot_be_read_are_refused_in_one_line(
    name: str, content: str, message: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(InputError) as caught:
        load_board(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
