"""Ground-truth maps: closed forms in front of the bare camera, the nearer of two mirrors, and obstacles."""

from __future__ import annotations

import json

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import Checkerboard
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.truth.pixel_maps import NO_MIRROR, board_maps, exr_bytes, pixel_rays

BOARD = Checkerboard(cols=6, rows=5, square_mm=24.0)
AHEAD = rigid(np.eye(3), [-72.0, -60.0, 400.0])


def test_before_the_bare_camera_maps_are_those_of_a_pinhole(small_layout: Layout) -> None:
    camera = small_layout.camera
    maps = board_maps(pixel_rays(small_layout, mirrors=False), BOARD, AHEAD)
    v, u = np.mgrid[: camera.height_px, : camera.width_px]
    x, y = (u - camera.cx_px) / camera.fx_px * 400.0, (v - camera.cy_px) / camera.fy_px * 400.0
    shown = (np.abs(x) <= 72.0 + 24.0) & (np.abs(y) <= 60.0 + 24.0)
    np.testing.assert_array_equal(np.isfinite(maps["board.x"]), shown)
    np.testing.assert_allclose(maps["board.x"][shown], x[shown] + 72.0, atol=1e-9)
    np.testing.assert_allclose(maps["board.y"][shown], y[shown] + 60.0, atol=1e-9)
    np.testing.assert_allclose(maps["path"][shown], np.sqrt(x**2 + y**2 + 400.0**2)[shown])
    assert (maps["mirror"] == NO_MIRROR).all()


def test_every_fourth_pixel_is_every_fourth_of_all(small_layout: Layout) -> None:
    every, fourth = (pixel_rays(small_layout, mirrors=True, step=step) for step in (1, 4))
    np.testing.assert_array_equal(fourth.mirror, every.mirror[::4, ::4])
    np.testing.assert_allclose(fourth.direction, every.direction[::4, ::4], atol=1e-12)


def test_a_board_behind_the_camera_or_seen_from_its_back_shows_nothing(small_layout: Layout) -> None:
    rays = pixel_rays(small_layout, mirrors=False)
    for pose in (rigid(np.eye(3), [-72.0, -60.0, -400.0]), rigid(np.diag([-1.0, 1.0, -1.0]), [72.0, -60.0, 400.0])):
        assert np.isnan(board_maps(rays, BOARD, pose)["board.x"]).all()


class Curtain:
    """Stops all rays from the pupil with x > 0 before any mirror, and none behind the mirrors."""

    def distance_to_body_mm(self, start: FloatArray, direction: FloatArray) -> FloatArray:
        return np.where(np.isfinite(start[..., 0]), np.inf, np.nan)

    def distance_from_pupil_mm(self, rays: FloatArray) -> FloatArray:
        return np.where(rays[..., 0] > 0.0, 1.0, np.inf)


def test_obstacles_before_the_mirrors_hide_them(small_layout: Layout) -> None:
    free = pixel_rays(small_layout, mirrors=True)
    hidden = pixel_rays(small_layout, mirrors=True, obstacles=Curtain())
    right = np.arange(small_layout.camera.width_px) > small_layout.camera.cx_px
    assert (hidden.mirror[:, right] == NO_MIRROR).all()
    assert np.isnan(hidden.direction[:, right]).all()
    np.testing.assert_array_equal(hidden.mirror[:, ~right], free.mirror[:, ~right])


def test_files_of_maps_say_what_they_are_told(small_layout: Layout) -> None:
    maps = board_maps(pixel_rays(small_layout, mirrors=False, step=16), BOARD, AHEAD)
    header = {"pose": json.dumps(AHEAD.tolist())}
    assert exr_bytes(maps, header) == exr_bytes(maps, header)
    assert header["pose"].encode() in exr_bytes(maps, header)
