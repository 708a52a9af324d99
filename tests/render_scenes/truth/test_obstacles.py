"""Obstacles by their two methods alone: maps and corners lose exactly what a screen of closed form hides."""

from __future__ import annotations

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Checkerboard
from mirrorcam.optics.geometry.transforms import rigid, transform
from mirrorcam.render_scenes.truth.corners import BoolArray, Oracle
from mirrorcam.render_scenes.truth.obstacles import Obstacles
from mirrorcam.render_scenes.truth.pixel_maps import board_maps, pixel_rays

DEPTH_MM = 400.0
BOARD = Checkerboard(cols=14, rows=10, square_mm=16.0)


class Screen:
    """The half with x > 0 of the plane y = `at_mm`, which stands before the mirrors and out of the camera's sight."""

    def __init__(self, at_mm: float) -> None:
        self.at_mm = at_mm

    def free_mm(self, start: FloatArray, direction: FloatArray) -> FloatArray:
        length = (self.at_mm - start[..., 1]) / direction[..., 1]
        hit = (length > 0.0) & (start[..., 0] + length * direction[..., 0] > 0.0)
        return np.where(hit | np.isnan(length), length, np.inf)

    def free_from_pupil_mm(self, rays: FloatArray) -> FloatArray:
        return np.full(rays.shape[:-1], np.inf)


def facing(layout: Layout) -> FloatArray:
    """The pose of the board upright before the device."""
    turn = layout.view_from_rig.T
    return rigid(turn, turn @ np.array([0.0, -70.0, DEPTH_MM]) - turn @ np.array([*BOARD.size_mm, 0.0]) / 2.0)


def maps_and_corners(layout: Layout, obstacles: Obstacles | None) -> tuple[BoolArray, BoolArray]:
    """Where the board shows (h, w), and which of its corners are seen via each mirror."""
    maps = board_maps(pixel_rays(layout, mirrors=True, obstacles=obstacles), BOARD, facing(layout))
    return np.isfinite(maps["board.x"]), Oracle(layout, BOARD, (), obstacles).by_mirrors(facing(layout))[1]


def test_a_screen_before_the_board_hides_one_half_from_maps_and_corners(small_layout: Layout) -> None:
    shown, seen = maps_and_corners(small_layout, None)
    still_shown, still_seen = maps_and_corners(small_layout, Screen(DEPTH_MM - 1.0))
    maps = board_maps(pixel_rays(small_layout, mirrors=True), BOARD, facing(small_layout))
    # A millimetre before the board, the shadow's edge lies where x = 0, to a small part of a square.
    x_of_board = maps["board.x"] - BOARD.size_mm[0] / 2.0
    clear = shown & (np.abs(x_of_board) > 1.0)
    assert clear.any()
    np.testing.assert_array_equal(still_shown[clear], x_of_board[clear] < 0.0)
    x_of_corners = transform(facing(small_layout), BOARD.corners_in_board_mm)[:, 0]
    apart = np.abs(x_of_corners) > BOARD.square_mm / 2.0
    np.testing.assert_array_equal(still_seen[:, apart], (seen & (x_of_corners < 0.0))[:, apart])
    assert still_seen.any()


def test_a_screen_behind_the_board_hides_nothing(small_layout: Layout) -> None:
    free, behind = maps_and_corners(small_layout, None), maps_and_corners(small_layout, Screen(DEPTH_MM + 1.0))
    for expected, found in zip(free, behind, strict=True):
        np.testing.assert_array_equal(found, expected)
