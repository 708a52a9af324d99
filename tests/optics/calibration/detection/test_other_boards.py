"""Another board than the stated one, or a flipped picture, is recognised and refused with its cause."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.other_boards import refuse_other_board
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Charuco, Checkerboard, Target
from tests.optics.layouts import faceted_parabola
from tests.optics.synthetic import posed, render

CAMERA = Camera(name="small", width_px=960, height_px=540, fx_px=680.0, fy_px=680.0, cx_px=479.5, cy_px=269.5)
PLAIN = Checkerboard(cols=9, rows=6, square_mm=9.0)
MARKED = Charuco(cols=14, rows=10, square_mm=14.0, marker_mm=9.8)


@pytest.fixture(scope="module")
def layout() -> Layout:
    return faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.92)


def pictures(target: Target, layout: Layout | None) -> list[Grey]:
    """Two pictures of a board, through mirrors or by the bare camera."""
    far = 330.0 if layout else 220.0 if isinstance(target, Checkerboard) else 300.0
    place = np.array([0.0, far, 85.0]) if layout else np.array([0.0, 0.0, far])
    turns = ([10.0, 12.0, 20.0], [-15.0, 20.0, 0.0])
    return [
        render(CAMERA, layout, target, posed(target, place, np.array(turn), direct=layout is None), noise_grey=4.0)
        for turn in turns
    ]


@pytest.mark.parametrize("stated", [(8, 6), (10, 6), (9, 5)])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_checkerboard_of_another_size_is_named(layout: Layout, stated: tuple[int, int], *, mirrored: bool) -> None:
    shown = pictures(PLAIN, layout if mirrored else None)
    target = Checkerboard(cols=stated[0], rows=stated[1], square_mm=9.0)
    with pytest.raises(
        InputError, match=f"show a checkerboard of 9 x 6 squares, board.toml says {stated[0]} x {stated[1]}"
    ):
        refuse_other_board(shown, target, mirrored=mirrored, found=False)


@pytest.mark.parametrize("stated", [(13, 10), (15, 10), (12, 10), (14, 9)])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_charuco_board_of_another_size_is_named(layout: Layout, stated: tuple[int, int], *, mirrored: bool) -> None:
    target = MARKED.replaced(cols=stated[0], rows=stated[1])
    said = "14 columns of squares" if stated[0] != 14 else "more rows of squares"
    with pytest.raises(InputError, match=f"show a ChArUco board of {said}, board.toml says {stated[0]} x {stated[1]}"):
        refuse_other_board(pictures(MARKED, layout if mirrored else None), target, mirrored=mirrored, found=True)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("found", [False, True])
def test_the_stated_board_is_taken(layout: Layout, *, mirrored: bool, found: bool) -> None:
    marked, plain = (pictures(target, layout if mirrored else None) for target in (MARKED, PLAIN))
    grey = [np.full_like(marked[0], 60)]

    def refused(shown: list[Grey], target: Target) -> str:
        try:
            refuse_other_board(shown, target, mirrored=mirrored, found=found)
        except InputError as error:
            return str(error)
        return ""

    assert refused(marked, MARKED) == ""
    assert refused(marked, MARKED.replaced(rows=12)) == ""  # the other rows may be out of view
    assert refused(grey, MARKED) == ""
    assert refused(grey, PLAIN) == ""
    assert refused(plain, PLAIN) == ""


@pytest.mark.parametrize("mirrored", [False, True])
def test_flipped_pictures_are_recognised(layout: Layout, *, mirrored: bool) -> None:
    shown = [np.ascontiguousarray(picture[:, ::-1]) for picture in pictures(MARKED, layout if mirrored else None)]
    with pytest.raises(InputError, match="they are mirrored, as those of a selfie camera"):
        refuse_other_board(shown, MARKED, mirrored=mirrored, found=False)


@pytest.mark.parametrize("mirrored", [False, True])
def test_another_dictionary_is_named(layout: Layout, *, mirrored: bool) -> None:
    shown = pictures(MARKED.replaced(dictionary="DICT_5X5_100"), layout if mirrored else None)
    with pytest.raises(InputError, match=r"show markers of DICT_5X5_100, board\.toml says dictionary DICT_4X4"):
        refuse_other_board(shown, MARKED, mirrored=mirrored, found=False)
