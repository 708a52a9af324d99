"""Another board than the stated one, or a flipped picture, is recognised and named with its cause."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.images.pictures import read_image
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.other_boards import other_board
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.targets import Charuco, Checkerboard, load_board
from tests.optics.calibration.detection.aprilgrid_sheet import GRID, Sheet
from tests.optics.calibration.detection.one_mirror import CAMERA as LARGER
from tests.optics.calibration.detection.one_mirror import one_mirror
from tests.optics.layouts import faceted_parabola
from tests.optics.synthetic import posed, render

CAMERA = Camera(name="small", width_px=640, height_px=360, fx_px=453.0, fy_px=453.0, cx_px=319.5, cy_px=179.5)
LAYOUT = faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.92)
PLAIN = Checkerboard(cols=7, rows=6, square_mm=12.0)
EVEN = Checkerboard(cols=8, rows=6, square_mm=10.5)
MARKED = Charuco(cols=10, rows=7, square_mm=19.0, marker_mm=14.0)
SELFIE = "as those of a selfie camera"


@lru_cache
def pictures(target: Checkerboard | Charuco, *, mirrored: bool) -> tuple[Grey, ...]:
    """Two pictures of a board, through mirrors or by the bare camera."""
    far = 330.0 if mirrored else 220.0 if isinstance(target, Checkerboard) else 300.0
    place = np.array([0.0, far, 85.0]) if mirrored else np.array([0.0, 0.0, far])
    turns = ([10.0, 12.0, 20.0], [-15.0, 20.0, 0.0])
    layout = LAYOUT if mirrored else None
    return tuple(
        render(CAMERA, layout, target, posed(target, place, np.array(turn), direct=not mirrored), noise_grey=4.0)
        for turn in turns
    )


def flipped(target: Checkerboard | Charuco, *, mirrored: bool) -> list[Grey]:
    return [np.ascontiguousarray(picture[:, ::-1]) for picture in pictures(target, mirrored=mirrored)]


@pytest.mark.parametrize(("stated", "mirrored"), [((6, 6), True), ((8, 6), False), ((7, 5), False), ((8, 7), False)])
def test_a_checkerboard_of_another_size_is_named(stated: tuple[int, int], *, mirrored: bool) -> None:
    target = PLAIN.replaced(cols=stated[0], rows=stated[1])
    said = f"the pictures show a checkerboard of 7 x 6 squares, board.toml says {stated[0]} x {stated[1]}"
    assert other_board(pictures(PLAIN, mirrored=mirrored), target, mirrored=mirrored, found=False) == said


def test_a_checkerboard_that_was_found_is_none_smaller() -> None:
    shown = pictures(PLAIN, mirrored=False)
    higher = PLAIN.replaced(rows=7)
    assert other_board(shown, higher, mirrored=False, found=True) is None
    assert other_board(shown, higher, mirrored=False, found=True, fits=False) is None
    lower = PLAIN.replaced(rows=5)
    said = "the pictures show a checkerboard of 7 x 6 squares, board.toml says 7 x 5"
    assert other_board(shown, lower, mirrored=False, found=True, fits=False) == said


@pytest.mark.parametrize("stated", [(9, 7), (11, 7), (8, 7), (10, 6)])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_charuco_board_of_another_size_is_named(stated: tuple[int, int], *, mirrored: bool) -> None:
    target = MARKED.replaced(cols=stated[0], rows=stated[1])
    found = other_board(pictures(MARKED, mirrored=mirrored), target, mirrored=mirrored, found=True)
    assert found is not None
    said = "10 columns of squares" if stated[0] != 10 else "more rows of squares"
    assert f"show a ChArUco board of {said}, board.toml says {stated[0]} x {stated[1]}" in found


WIDE = Charuco(cols=14, rows=9, square_mm=14.0, marker_mm=10.5)


@pytest.mark.parametrize("mirrored", [False, True])
def test_exchanged_columns_and_rows_of_a_charuco_board_are_named(*, mirrored: bool) -> None:
    said = other_board(
        pictures(WIDE, mirrored=mirrored), WIDE.replaced(cols=9, rows=14), mirrored=mirrored, found=False
    )
    assert said == (
        "the pictures show a ChArUco board of 14 columns of squares, board.toml says 9 x 14 squares: are cols and rows "
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
        ((5, 4), "6 columns of tags, board.toml says 5 x 4 tags"),
        ((8, 3), "6 columns of tags, board.toml says 8 x 3 tags"),
        ((12, 7), "6 columns of tags, board.toml says 12 x 7 tags"),
        ((4, 6), "6 columns of tags, board.toml says 4 x 6 tags: are cols and rows exchanged?"),
        ((6, 3), "more rows of tags, board.toml says 6 x 3 tags"),
    ],
)
@pytest.mark.parametrize("mirrored", [False, True])
def test_an_aprilgrid_of_another_size_is_named(stated: tuple[int, int], said: str, *, mirrored: bool) -> None:
    target = GRID.replaced(cols=stated[0], rows=stated[1])
    assert other_board(tags(mirrored=mirrored), target, mirrored=mirrored, found=False) == (
        f"the pictures show an AprilGrid of {said}"
    )


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_stated_aprilgrid_is_taken_and_flipped_ones_are_recognised(*, mirrored: bool) -> None:
    shown = tags(mirrored=mirrored)
    for target in (GRID, GRID.replaced(rows=6)):
        assert other_board(shown, target, mirrored=mirrored, found=False) is None
    turned = [np.ascontiguousarray(picture[:, ::-1]) for picture in shown]
    said = other_board(turned, GRID, mirrored=mirrored, found=False)
    assert said is not None
    assert SELFIE in said


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("found", [False, True])
def test_the_stated_board_is_taken(*, mirrored: bool, found: bool) -> None:
    shown = pictures(MARKED, mirrored=mirrored)
    assert other_board(shown, MARKED, mirrored=mirrored, found=found) is None
    # The rest may be out of view.
    assert other_board(shown, MARKED.replaced(rows=9), mirrored=mirrored, found=found) is None
    blank = [np.full_like(shown[0], 60)]
    for target in (MARKED, PLAIN):
        assert other_board(blank, target, mirrored=mirrored, found=found) is None
    assert other_board([], MARKED, mirrored=mirrored, found=found) is None


@pytest.mark.parametrize(("target", "mirrored"), [(PLAIN, False), (EVEN, True)])
def test_the_stated_checkerboard_is_taken_where_it_does_not_fit(target: Checkerboard, *, mirrored: bool) -> None:
    assert (
        other_board(pictures(target, mirrored=mirrored)[:1], target, mirrored=mirrored, found=True, fits=False) is None
    )


@pytest.mark.parametrize("mirrored", [False, True])
def test_flipped_pictures_are_recognised(*, mirrored: bool) -> None:
    said = other_board(flipped(MARKED, mirrored=mirrored), MARKED, mirrored=mirrored, found=False)
    assert said is not None
    assert f"they are mirrored, {SELFIE}" in said


@pytest.mark.parametrize("mirrored", [False, True])
def test_flipped_pictures_of_a_checkerboard_are_recognised_where_its_colours_tell(*, mirrored: bool) -> None:
    said = other_board(flipped(EVEN, mirrored=mirrored)[:1], EVEN, mirrored=mirrored, found=False)
    assert said is not None
    assert said.startswith("the 8 x 6 checkerboard in the pictures has black where it should be white")
    assert SELFIE in said


def test_what_a_flipped_picture_of_a_checkerboard_does_not_tell() -> None:
    shown = flipped(EVEN, mirrored=False)[:1]
    # It is that of the board with cols and rows exchanged.
    assert other_board(shown, EVEN.replaced(cols=6, rows=8), mirrored=False, found=False) is None
    # Directly and in mirrors at once, half of the boards are mirrored anyway.
    assert other_board(shown, EVEN, mirrored=None, found=False) is None
    # With an odd number of columns or rows, a board looks the same in a mirror.
    assert other_board(flipped(PLAIN, mirrored=False)[:1], PLAIN, mirrored=False, found=False) is None


@pytest.mark.parametrize("mirrored", [False, True])
def test_another_dictionary_is_named(*, mirrored: bool) -> None:
    shown = pictures(MARKED.replaced(dictionary="DICT_5X5_100"), mirrored=mirrored)
    said = other_board(shown, MARKED, mirrored=mirrored, found=False)
    assert said == "the pictures show markers of DICT_5X5_50, board.toml says dictionary DICT_4X4_250"


def test_one_row_less_than_another_renderer_printed_is_told(foreign_sets: Path) -> None:
    """Its frames show so many markers that those of the last row, beside the inner corners, are not sought."""
    target = load_board(foreign_sets / "a_ch" / "board.toml")
    shown = [read_image(path, grey=True) for path in sorted((foreign_sets / "a_ch" / "frames").iterdir())[:2]]
    found = other_board(shown, target.replaced(rows=target.rows - 1), mirrored=True, found=True)
    assert found is not None
    assert "a ChArUco board of more rows of squares" in found
    assert other_board(shown, target, mirrored=True, found=True) is None
