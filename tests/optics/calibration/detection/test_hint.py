"""What the next picture should show, asked for after one picture after the other."""

from __future__ import annotations

import numpy as np
import shapely

from optics.calibration.detection.hint import ENOUGH, Hint, next_picture
from optics.calibration.observations import Observations
from optics.camera import Camera
from optics.layout import Layout
from optics.spec import DesignSpec
from optics.targets import Charuco
from optics.transforms import transform
from optics.values import FloatArray
from tests.optics.conftest import faceted_parabola

CAMERA = Camera(width_px=960, height_px=540, fx_px=680.0, fy_px=680.0, cx_px=479.5, cy_px=269.5)
LAYOUT = faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.92)
BOARD = Charuco(cols=16, rows=11, square_mm=10.0, marker_mm=6.25)


def shown(layout: Layout, pose: FloatArray, *, but: int | None = None) -> Observations:
    """The corners of a pose, as every mirror (but one) shows them."""
    parts = []
    points = transform(pose, BOARD.corners_in_board_mm)
    for index in range(len(layout.mirrors)):
        pixels = layout.project(points, index)
        region = shapely.Polygon(layout.outline_px(index))
        seen = np.flatnonzero(shapely.contains_xy(region, *np.nan_to_num(pixels, nan=-1e9).T))
        if index != but:
            parts.append(Observations.of_view(0, index, seen, pixels[seen]))
    return Observations.join(parts)


def follow(pictures: int) -> list[Hint]:
    seen: list[Observations] = []
    hints = [next_picture(seen, LAYOUT, BOARD)]
    for _ in range(pictures):
        seen.append(shown(LAYOUT, hints[-1].rig_from_board))
        hints.append(next_picture(seen, LAYOUT, BOARD))
    return hints


def test_who_follows_the_hints_fills_every_mirror_at_several_depths_and_tilts() -> None:
    hints = follow(10)
    assert not hints[0].enough
    assert hints[0].covered.max() == 0.0
    assert hints[-1].enough
    assert hints[-1].covered.min() >= ENOUGH
    assert len({hint.tilt_deg for hint in hints}) >= 4
    assert len({hint.depth_mm for hint in hints}) >= 2
    assert hints == sorted(hints, key=lambda hint: float(hint.covered.sum()))


def test_a_mirror_that_shows_nothing_is_asked_for() -> None:
    seen = [shown(LAYOUT, hint.rig_from_board, but=2) for hint in follow(8)]
    hint = next_picture(seen, LAYOUT, BOARD)
    assert hint.mirror == 2
    assert hint.covered[2] == 0.0
    assert hint.sentence.startswith("next: the board at about ")
    assert "so that mirror 2 (upper left of the picture, 0% filled)" in hint.sentence
    assert shown(LAYOUT, hint.rig_from_board).where(shown(LAYOUT, hint.rig_from_board).view == 2).view.size > 20


def test_words_say_which_edge_is_nearer() -> None:
    for hint in follow(8):
        depth = transform(hint.rig_from_board, BOARD.corners_in_board_mm) @ LAYOUT.view_from_rig[2]
        grid = depth.reshape(BOARD.rows - 1, BOARD.cols - 1)
        nearer = {
            "upper": grid[0].mean() < grid[-1].mean() - 1.0,
            "lower": grid[-1].mean() < grid[0].mean() - 1.0,
            "left": grid[:, 0].mean() < grid[:, -1].mean() - 1.0,
            "right": grid[:, -1].mean() < grid[:, 0].mean() - 1.0,
        }
        assert {edge for edge in nearer if f"its {edge} edge" in hint.sentence} == {e for e, n in nearer.items() if n}
