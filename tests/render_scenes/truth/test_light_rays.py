"""Obstacles: maps and corners lose exactly what a screen of closed form hides.

Traced rays: against the laws of reflection and refraction in closed form.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import Checkerboard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.pupil import Pupil
from mirrorcam.optics.geometry.transforms import rigid, transform
from mirrorcam.render_scenes.mirror_finish import MirrorFinish
from mirrorcam.render_scenes.truth.corners import BoolArray, CornerProjector
from mirrorcam.render_scenes.truth.light_rays import Obstacles, chief_rays, image_px, trace_via_mirror
from mirrorcam.render_scenes.truth.pixel_maps import board_maps, pixel_rays

DEPTH_MM = 400.0
BOARD = Checkerboard(cols=14, rows=10, square_mm=16.0)


class Screen:
    """The half with x > 0 of the plane y = `at_mm`, in front of the mirrors and outside the field of the camera."""

    def __init__(self, at_mm: float) -> None:
        self.at_mm = at_mm

    def distance_to_body_mm(self, start: FloatArray, direction: FloatArray) -> FloatArray:
        length = (self.at_mm - start[..., 1]) / direction[..., 1]
        hit = (length > 0.0) & (start[..., 0] + length * direction[..., 0] > 0.0)
        return np.where(hit | np.isnan(length), length, np.inf)

    def distance_from_pupil_mm(self, rays: FloatArray) -> FloatArray:
        return np.full(rays.shape[:-1], np.inf)


def facing(layout: Layout) -> FloatArray:
    """The pose of the board upright in front of the device."""
    turn = layout.view_from_rig.T
    return rigid(turn, turn @ np.array([0.0, -70.0, DEPTH_MM]) - turn @ np.array([*BOARD.size_mm, 0.0]) / 2.0)


def maps_and_corners(layout: Layout, obstacles: Obstacles | None) -> tuple[BoolArray, BoolArray]:
    """Mask (h, w) of the board, and which of its corners are visible via each mirror."""
    maps = board_maps(pixel_rays(layout, mirrors=True, obstacles=obstacles), BOARD, facing(layout))
    return np.isfinite(maps["board.x"]), CornerProjector(layout, BOARD, (), obstacles).via_mirrors(facing(layout))[1]


def test_a_screen_before_the_board_hides_one_half_from_maps_and_corners(small_layout: Layout) -> None:
    shown, seen = maps_and_corners(small_layout, None)
    still_shown, still_seen = maps_and_corners(small_layout, Screen(DEPTH_MM - 1.0))
    maps = board_maps(pixel_rays(small_layout, mirrors=True), BOARD, facing(small_layout))
    # A millimetre in front of the board, the edge of the shadow is at x = 0 to a small part of a square.
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


CENTRE = np.array([4.0, -78.0, 82.0])
BENT = MirrorFinish(reflectance=(0.9, 0.9, 0.9), sag_mm=0.02, ripple_mm=2e-4)


def square_mirror(**kind: object) -> Mirror:
    """A mirror of 30 mm squared about its chief ray."""
    normal = -CENTRE / np.linalg.norm(CENTRE)
    right = np.cross(normal, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    middle = np.array([0.0, 0.0, 0.5 * (CENTRE @ CENTRE) / CENTRE[2]])
    up = np.cross(right, normal)
    outline = [middle + 15.0 * (a * right + b * up) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return Mirror(virtual_centre_in_rig_mm=CENTRE, outline_in_rig_mm=np.array(outline), **kind)


def unit_rays() -> FloatArray:
    x, y = np.meshgrid(np.linspace(-0.05, 0.05, 5), np.linspace(-0.05, 0.05, 5))
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def test_a_plane_reflects_as_if_light_came_from_the_virtual_centre() -> None:
    mirror = square_mirror()
    entry, start, direction, path = trace_via_mirror(mirror, unit_rays())
    np.testing.assert_allclose(entry, path)
    np.testing.assert_allclose(start, CENTRE + path[..., None] * direction, atol=1e-9)
    np.testing.assert_allclose(direction, unit_rays() @ mirror.reflection.T, atol=1e-12)


def test_a_ray_beside_the_outline_misses() -> None:
    aside = np.array([0.6, 0.0, 0.8])
    entry, start, direction, path = trace_via_mirror(square_mirror(), aside)
    assert entry == np.inf
    assert np.isnan(start).all()
    assert np.isnan(direction).all()
    assert np.isnan(path)


def test_a_plate_shifts_rays_along_its_front_by_snells_law() -> None:
    plate, thick, index = square_mirror(surface="second", thickness_mm=2.0, refractive_index=1.5), 2.0, 1.5
    rays = unit_rays()
    entry, start, direction, path = trace_via_mirror(plate, rays)
    cosine = -(rays @ plate.normal_in_rig)
    inner_sine = np.sqrt(1.0 - cosine**2) / index
    inner_cosine = np.sqrt(1.0 - inner_sine**2)
    met = entry[..., None] * rays
    np.testing.assert_allclose(met @ plate.normal_in_rig, -(plate.distance_mm - thick), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(start - met, axis=-1), 2.0 * thick * inner_sine / inner_cosine)
    np.testing.assert_allclose(path - entry, 2.0 * thick / inner_cosine)
    np.testing.assert_allclose(direction, rays @ plate.reflection.T, atol=1e-12)


@pytest.mark.parametrize("kind", [{}, {"surface": "second", "thickness_mm": 2.0, "refractive_index": 1.5}])
def test_points_along_a_traced_ray_are_imaged_where_it_came_from(kind: dict[str, object]) -> None:
    camera, mirror = Camera.c920(), square_mirror(**kind)
    px = np.array([[camera.cx_px + 30.0 * a, camera.cy_px + 20.0 * b] for a in (-1.0, 0.0, 2.0) for b in (-2.0, 1.0)])
    rays = camera.unproject(px)
    _, start, direction, _ = trace_via_mirror(mirror, rays / np.linalg.norm(rays, axis=-1, keepdims=True), BENT)
    np.testing.assert_allclose(image_px(camera, mirror, start + 350.0 * direction, BENT), px, atol=1e-6)


WALKING = Pupil(focus_mm=500.0, walk_mm=0.6)
LENS = Camera.c920().replaced(distortion=[0.05, -0.1, 0.001, 0.0, 0.0], focus_mm=500.0, pupil_walk_mm=0.6)
PLACES_PX = np.array([[960.0, 540.0], [200.0, 900.0], [1850.0, 60.0]])


def test_chief_rays_start_on_the_axis_and_meet_the_point_in_focus() -> None:
    start, unit = chief_rays(LENS, PLACES_PX)
    x, y = LENS.normalized_from_pixels(PLACES_PX).T
    np.testing.assert_allclose(start, np.column_stack([0.0 * x, 0.0 * y, 0.6 * (x**2 + y**2)]), atol=1e-12)
    along = (500.0 - start[:, 2]) / unit[:, 2]
    np.testing.assert_allclose(start + along[:, None] * unit, 500.0 * np.column_stack([x, y, 1.0 + 0.0 * x]), atol=1e-9)
    # The thin lens of `Pupil` lies in z = 0: there it is the same ray.
    at_zero = start - (start[:, 2] / unit[:, 2])[:, None] * unit
    np.testing.assert_allclose(at_zero[:, :2], WALKING.centre_mm(np.column_stack([x, y])), atol=1e-12)


def test_points_on_the_ray_of_a_walking_pupil_have_their_image_in_its_pixel() -> None:
    start, unit = chief_rays(LENS, PLACES_PX)
    for length in (90.0, 400.0, 2000.0):
        np.testing.assert_allclose(image_px(LENS, None, start + length * unit), PLACES_PX, atol=1e-6)


@pytest.mark.parametrize("kind", [{}, {"surface": "second", "thickness_mm": 2.0, "refractive_index": 1.5}])
def test_a_mirror_reflects_the_rays_of_a_walking_pupil(kind: dict[str, object]) -> None:
    mirror = square_mirror(**kind)
    px = LENS.project(unit_rays().reshape(-1, 3))
    origin, unit = chief_rays(LENS, px)
    _, start, direction, _ = trace_via_mirror(mirror, unit, origin=origin)
    found = image_px(LENS, mirror, start + 350.0 * direction)
    np.testing.assert_allclose(found, px, atol=1e-6)


def test_a_pupil_that_walks_far_moves_images_by_the_parallax() -> None:
    """Seen from 0.5 mm nearer, a point at 100 mm is 0.5 % farther from the axis; a point in focus stays."""
    camera = Camera.c920().replaced(focus_mm=500.0, pupil_walk_mm=2.0)
    for depth, moved in ((500.0, 0.0), (100.0, 0.5 * (1 / 100.0 - 1 / 500.0))):
        px = image_px(camera, None, np.array([[0.5 * depth, 0.0, depth]]))
        assert px[0, 0] - camera.cx_px == pytest.approx(0.5 * camera.fx_px * (1.0 + moved), rel=1e-4)


@pytest.mark.parametrize("bend", ["sphere", "cylinder"])
@pytest.mark.parametrize("surface", ["first", "second"])
def test_a_bent_mirror_of_a_layout_shows_what_its_finish_shows(
    bend: Literal["sphere", "cylinder"], surface: Literal["first", "second"]
) -> None:
    """The model of a bent mirror, which scores use as the truth, fits; without the bend it is off by pixels."""
    camera, mirror = Camera.c920(), square_mirror(surface=surface, thickness_mm=2.0)
    finish = MirrorFinish(reflectance=(0.9,) * 3, bend=bend, sag_mm=0.02, sag_direction_deg=35.0)
    _, start, direction, _ = trace_via_mirror(mirror, unit_rays())
    points = (start + 400.0 * direction).reshape(-1, 3)
    traced = image_px(camera, mirror, points, finish)
    assert np.isfinite(traced).all()
    np.testing.assert_allclose(camera.project(finish.bent(mirror).image_of(points)), traced, atol=2e-3)
    assert np.abs(camera.project(mirror.image_of(points)) - traced).max() > 0.1
