"""The overview of a tabletop set: frame, central view and how near things are, beside each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.disk.files import write_bytes
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import InputError
from mirrorcam.render_scenes.settings import SENSORS
from mirrorcam.render_scenes.truth.pixel_maps import exr_bytes
from mirrorcam.simulation.tabletop_figure import GAP_PX, HEIGHT_PX, overview
from tests.render_scenes.manifests import scene_of_two_depths

pytest.importorskip("OpenEXR", reason="rendering needs the extra render")
LINEAR = 60  # of 255, in the frame and in the view
MIDDLE_PX = (HEIGHT_PX - GAP_PX) // 2


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A set of uniform pictures; the left half of its central view is at 300 mm, the right one at 600 mm."""
    scene = scene_of_two_depths()
    sensor = SENSORS["ideal"].replaced(jpeg_quality=None)
    scene.replaced(width_px=96, height_px=54, sensor=sensor, central_view=(1, 0)).save(tmp_path)
    write_image(tmp_path / "frames/0000.png", np.full((54, 96, 3), LINEAR, np.uint8))
    write_image(tmp_path / "truth/views/1_0.png", np.full((30, 40, 3), LINEAR, np.uint8))
    depth_mm = np.full((30, 40), 300.0)
    depth_mm[:, 20:] = 600.0
    write_bytes(tmp_path / "truth/depth/1_0.exr", exr_bytes({"depth": depth_mm}, {}))
    return tmp_path


def test_pictures_are_brightened_and_near_is_red_far_is_blue(folder: Path) -> None:
    picture = overview(folder).astype(int)
    frame_px, view_px = round(HEIGHT_PX * 96 / 54), round(MIDDLE_PX * 40 / 30)
    assert abs(picture.shape[1] - (frame_px + GAP_PX + view_px)) <= 1
    assert picture.shape[0] == HEIGHT_PX
    bright = round(255.0 * (LINEAR / 255.0) ** (1.0 / 2.2))
    assert (picture[:, :frame_px] == bright).all()
    assert (picture[:MIDDLE_PX, frame_px + GAP_PX :] == bright).all()
    assert (picture[:, frame_px : frame_px + GAP_PX] == 255).all()
    assert (picture[MIDDLE_PX:-MIDDLE_PX, frame_px:] == 255).all()
    near, far = picture[-20, frame_px + GAP_PX + 20], picture[-20, -20]
    assert near[0] > near[2] + 40
    assert far[2] > far[0]


def test_a_view_at_one_depth_has_one_colour(folder: Path) -> None:
    write_bytes(folder / "truth/depth/1_0.exr", exr_bytes({"depth": np.full((30, 40), 400.0)}, {}))
    nearness = overview(folder)[-MIDDLE_PX:, -100:]
    assert (nearness == nearness[0, 0]).all()


def test_a_set_without_its_depth_is_refused_in_one_line(folder: Path) -> None:
    (folder / "truth/depth/1_0.exr").unlink()
    with pytest.raises(InputError, match=r"1_0\.exr: no such file$"):
        overview(folder)
