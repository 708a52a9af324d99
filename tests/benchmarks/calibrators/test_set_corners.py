"""What OpenCV's calibrators read of a set: pictures, nominal layout and board, and nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.calibrators.set_corners import corners_of_set
from mirrorcam.core.disk.files import write_text
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.targets import load_board
from tests.optics.layouts import faceted_parabola

CAMERA = Camera(width_px=640, height_px=360, fx_px=454.0, fy_px=456.0, cx_px=316.0, cy_px=181.0)
CHECKERBOARD = 'kind = "checkerboard"\ncols = 9\nrows = 7\nsquare_mm = 8.0\n'
APRILGRID = 'kind = "aprilgrid"\ncols = 6\nrows = 6\ntag_mm = 28.0\nspacing = 0.3\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A set with a grey frame."""
    faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.92).save(tmp_path / "layout.json")
    (tmp_path / "frames").mkdir()
    write_image(tmp_path / "frames" / "0000.png", np.full((360, 640), 127, np.uint8))
    write_text(tmp_path / "board.toml", CHECKERBOARD)
    return tmp_path


def test_a_frame_without_a_board_shows_none(folder: Path) -> None:
    found = corners_of_set(folder)
    assert found.seen == {}
    assert found.names == ("view_0_0", "view_0_1", "view_1_0", "view_1_1")
    assert found.size_px == (640, 360)
    assert found.points_in_board == pytest.approx(load_board(folder / "board.toml").corners_in_board_mm)


def test_a_set_without_frames_and_a_board_without_a_detector_are_refused(folder: Path) -> None:
    write_text(folder / "board.toml", APRILGRID)
    with pytest.raises(InputError, match="an AprilGrid, expected a ChArUco board or a checkerboard"):
        corners_of_set(folder)
    (folder / "frames" / "0000.png").unlink()
    with pytest.raises(InputError, match="no frames"):
        corners_of_set(folder)
