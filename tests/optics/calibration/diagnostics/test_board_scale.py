"""A board whose size was stated in another unit is named as such, with the size that fits the mirrors."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.calibration.calibration import calibrate
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.diagnostics.board_scale import other_size, size_ratio
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.targets import Checkerboard
from tests.optics.layouts import faceted_parabola
from tests.optics.synthetic import posed, render

CAMERA = Camera(name="small", width_px=640, height_px=360, fx_px=453.0, fy_px=453.0, cx_px=319.5, cy_px=179.5)
LAYOUT = faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.92)
BOARD = Checkerboard(cols=8, rows=5, square_mm=11.0)


@pytest.fixture(scope="module")
def pictures() -> list[Grey]:
    turns = ([10.0, 12.0, 20.0], [-15.0, 20.0, 0.0])
    poses = [posed(BOARD, np.array([0.0, 300.0, 85.0]), np.array(turn), direct=False) for turn in turns]
    return [render(CAMERA, LAYOUT, BOARD, pose, noise_grey=3.0) for pose in poses]


@pytest.mark.parametrize("factor", [0.001, 1 / 25.4, 0.1, 1.0, 10.0])
def test_the_size_that_fits_is_found_from_any_stated_one(pictures: list[Grey], factor: float) -> None:
    ratio = size_ratio(pictures, LAYOUT, BOARD.replaced(square_mm=11.0 * factor))
    assert ratio is not None
    assert ratio * factor == pytest.approx(1.0, rel=0.06)


def test_another_unit_is_named(pictures: list[Grey]) -> None:
    for factor, unit in ((0.1, "cm"), (1 / 25.4, "inches")):
        target = BOARD.replaced(square_mm=11.0 * factor)
        said = other_size(pictures, LAYOUT, target)
        assert said == (
            f"board.toml says squares of {11.0 * factor:g} mm, the pictures fit about 11 mm: "
            f"were they measured in {unit}?"
        )
    with pytest.raises(InputError, match="were they measured in inches"):
        calibrate(pictures, [], LAYOUT, target)
    other = other_size(pictures, LAYOUT, BOARD.replaced(square_mm=30.0))
    assert other is not None
    assert "is either of them of another device?" in other


def test_the_right_size_and_pictures_without_a_board_are_not_doubted(pictures: list[Grey]) -> None:
    assert other_size(pictures, LAYOUT, BOARD) is None
    upside_down = [np.ascontiguousarray(picture[::-1, ::-1]) for picture in pictures]
    assert other_size(upside_down, LAYOUT, BOARD) is None
    assert other_size([np.full((360, 640), 60, np.uint8)], LAYOUT, BOARD) is None
