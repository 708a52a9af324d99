"""The gallery: a tile shows a camera in its clip, and all tiles make full rows."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import camera_gallery
from benchmarks.camera_gallery import COLUMNS, TILE_PX, TITLE_PX, gallery, tile


def test_a_tile_shows_the_clip_the_camera_and_its_name() -> None:
    shown = tile("d435")
    assert shown.shape == (TILE_PX[1] + TITLE_PX, TILE_PX[0], 3)
    red, green, blue = (shown[: TILE_PX[1], :, channel].astype(int) for channel in range(3))
    assert ((red > 120) & (red - blue > 60)).sum() > 2000
    assert ((red < 60) & (green < 60) & (blue < 70)).sum() > 5000
    assert (shown[TILE_PX[1] :] < 128).any()


def test_rows_are_filled_with_white(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_gallery, "tile", lambda name: np.full((3, 2, 3), int(name), np.uint8))
    picture = gallery(tuple(str(number) for number in range(COLUMNS + 1)))
    assert picture.shape == (6, 2 * COLUMNS, 3)
    assert (picture[3:, 2:] == 255).all()
