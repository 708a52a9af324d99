"""Subjects: the objects of a scene, with textures that do not change between frames.

Blur out of focus, against the circle of confusion.

What pixels of a sensor show, against the reference's rays and pictures of the same scene.

Previews of a layout: the same for the same arguments, for layouts of all kinds, and of both subjects.
"""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.boards import default_board
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import Pupil
from mirrorcam.optics.geometry.transforms import transform
from mirrorcam.render_scenes.fields_of_view import common_bounds
from mirrorcam.render_scenes.preview.mirror_views import mirror_views
from mirrorcam.render_scenes.preview.preview_frame import (
    TEXTURE_PX,
    SensorLight,
    arranged_tabletop,
    binned_sensor,
    out_of_focus,
    preview_frame,
    rays_of_pixels,
    sensor_light,
    view_from_board,
)
from mirrorcam.render_scenes.preview.traced_scene import traced_tabletop
from mirrorcam.render_scenes.preview.triangle_tree import NOTHING
from mirrorcam.render_scenes.settings import SENSORS, SensorModel
from mirrorcam.render_scenes.tabletop.tabletop import MIN_CLEARANCE, arrange_tabletop, clear_depth_mm
from mirrorcam.render_scenes.tabletop.tabletop_scene import TabletopScene
from mirrorcam.render_scenes.tabletop.tabletop_set import default_depths_mm
from mirrorcam.render_scenes.truth.pixel_maps import pixel_rays
from tests.nightly import a_few


def test_objects_are_those_of_the_scene_with_textures_of_one_size(small_layout: Layout) -> None:
    found = arranged_tabletop(small_layout, 3)
    scene = arrange_tabletop(small_layout, default_depths_mm(small_layout), 3)
    assert [item.replaced(texture_px=None) for item in found.objects] == list(scene.objects)
    assert all(item.texture_px == (TEXTURE_PX[str(item.texture)] if item.texture else None) for item in found.objects)


def test_objects_of_another_layout_move_to_the_middle_of_the_field(small_layout: Layout) -> None:
    # The same device, half as large again: its views are higher.
    mirrors = tuple(
        mirror.replaced(
            virtual_centre_in_rig_mm=1.5 * mirror.virtual_centre_in_rig_mm,
            outline_in_rig_mm=1.5 * mirror.outline_in_rig_mm,
        )
        for mirror in small_layout.mirrors
    )
    large = small_layout.replaced(mirrors=mirrors, metrics={}, verdict={})
    own, moved = arranged_tabletop(small_layout, 3), arranged_tabletop(large, 3, small_layout)
    depth = default_depths_mm(small_layout)[1]
    shift = common_bounds(large, depth).mean(axis=0) - common_bounds(small_layout, depth).mean(axis=0)
    assert shift[1] < -20.0
    for before, after in zip(own.objects, moved.objects, strict=True):
        there = before.view_from_object[:3, 3] + np.array([*shift, 0.0])
        np.testing.assert_allclose(after.view_from_object[:3, 3], there)
        np.testing.assert_allclose(after.size_mm, before.size_mm)
    np.testing.assert_allclose(moved.lamp_target_in_view_mm[:2], own.lamp_target_in_view_mm[:2] + shift)


def test_objects_have_room_in_front_of_a_layout_designed_for_nearer_ones(small_layout: Layout) -> None:
    assert small_layout.spec is not None
    near = 0.6 * clear_depth_mm(small_layout)
    close = small_layout.replaced(spec=small_layout.spec.replaced(depths_mm=(near, 1.01 * near)))
    pose = view_from_board(close, default_board())
    corners = [pose @ [x, y, 0.0, 1.0] for x in (0.0, 240.0) for y in (0.0, 168.0)]
    assert min(corner[2] for corner in corners) > clear_depth_mm(close)
    depths = [item.view_from_object[2, 3] for item in arranged_tabletop(close, 0).objects[2:]]
    assert min(depths) == pytest.approx(clear_depth_mm(close) / (1.0 - MIN_CLEARANCE) + 1.0)


def test_the_board_is_in_the_middle_of_the_field_and_before_the_mirrors(fold_90_layout: Layout) -> None:
    board = default_board()
    pose = view_from_board(fold_90_layout, board)
    middle = (pose @ [*np.array(board.size_mm) / 2.0, 0.0, 1.0])[:3]
    np.testing.assert_allclose(middle[:2], common_bounds(fold_90_layout, middle[2]).mean(axis=0))
    corners = pose @ np.array([[x, y, 0.0, 1.0] for x in (0.0, board.size_mm[0]) for y in (0.0, board.size_mm[1])]).T
    assert corners[2].min() > clear_depth_mm(fold_90_layout)
    # The printed side is visible: z of the board points into the paper.
    assert pose[2, 2] > 0.9


CAMERA = Camera.c920().binned(0.25).replaced(aperture_mm=8.0, focus_mm=500.0)


def test_a_picture_in_focus_or_of_a_pinhole_is_not_blurred() -> None:
    picture = np.random.default_rng(0).random((40, 50, 3)).astype(np.float32)
    assert out_of_focus(picture, np.full((40, 50), 500.0), CAMERA) is picture
    assert out_of_focus(picture, np.full((40, 50), 200.0), CAMERA.replaced(aperture_mm=0.0)) is picture


@pytest.mark.parametrize("distance", [250.0, 350.0, np.inf])
def test_a_point_gets_the_variance_of_its_circle_of_confusion(distance: float) -> None:
    picture = np.zeros((81, 81, 3), np.float32)
    picture[40, 40] = 1.0, 2.0, 3.0
    blurred = out_of_focus(picture, np.full((81, 81), distance), CAMERA)
    np.testing.assert_allclose(blurred.sum(axis=(0, 1)), [1.0, 2.0, 3.0], rtol=1e-3)
    places = np.arange(81) - 40.0
    variance = (blurred[..., 0].sum(axis=0) * places**2).sum()
    diameter = CAMERA.fx_px * 8.0 * abs(1.0 / 500.0 - 1.0 / distance)
    assert variance == pytest.approx(diameter**2 / 16.0, rel=0.03)


PUPIL = Pupil(1.8, 500.0)


def light_of(layout: Layout) -> SensorLight:
    return sensor_light(layout.camera, mirror_views(layout, PUPIL, 0.92), traced_tabletop(arranged_tabletop(layout, 0)))


@pytest.fixture(params=a_few(1, ["distorted_layout", "plates"]))
def small(request: pytest.FixtureRequest) -> Layout:
    """A layout with a lens that distorts, and with plates, at 480 x 270 pixels."""
    layout: Layout = request.getfixturevalue(request.param)
    return layout.replaced(camera=layout.camera.binned(0.25))


@pytest.mark.slow
def test_pixels_agree_with_the_reference_in_depth_and_roughly_in_colour(small: Layout) -> None:
    found = light_of(small)
    reference = TabletopScene(small, arranged_tabletop(small, 0), 0.92)
    rays = pixel_rays(small, mirrors=True)
    hits = reference.hits(rays.start, rays.direction)
    shown = (hits.object_index != NOTHING) & (rays.mirror == found.mirror)
    # Borders of mirrors are bands in which both are visible.
    assert shown.mean() > 0.85
    assert (hits.object_index == found.object_number)[shown].mean() > 0.9999
    same = shown & (hits.object_index == found.object_number)
    depth = hits.points[same] @ small.view_from_rig[2]
    error = np.abs(depth - found.depth_mm[same])
    assert np.median(error) < 1e-3
    assert np.percentile(error, 99.0) < 0.01
    seen = rays.path_before_mm[same] + hits.path_mm[same]
    pixels = rays_of_pixels(small.camera.model_dump_json())[same]
    if not small.mirrors[0].is_second_surface:
        along = found.along_axis_mm[same] * np.sqrt(1.0 + np.square(pixels).sum(axis=1))
        np.testing.assert_allclose(along, seen, rtol=1e-4)
    radiance = reference.photograph(PUPIL, spp=16, subpixels=1, seed=0)
    grey = [np.clip(light, 0.0, 1.0).mean(axis=2) for light in (radiance, found.radiance)]
    assert np.corrcoef(grey[0].ravel(), grey[1].ravel())[0, 1] > 0.965
    assert grey[1][shown].mean() == pytest.approx(grey[0][shown].mean(), rel=0.05)
    for number in np.unique(found.object_number[same]):
        of_one = same & (found.object_number == number)
        assert grey[1][of_one].mean() == pytest.approx(grey[0][of_one].mean(), rel=0.2)


def test_gaps_between_mirrors_are_black_and_nothing_is_at_infinity(small: Layout) -> None:
    found = light_of(small)
    gap = found.mirror == NOTHING
    assert gap.any()
    assert not found.radiance[gap].any()
    assert (found.object_number[gap] == NOTHING).all()
    assert np.isinf(found.depth_mm[found.object_number == NOTHING]).all()
    assert np.isfinite(found.depth_mm[found.object_number != NOTHING]).all()
    # Where two mirrors share the pupil, each is darker than alone, and their sum is no brighter.
    assert np.isfinite(found.radiance).all()


def test_edges_are_smooth(small_layout: Layout) -> None:
    found = light_of(small_layout)
    board = found.object_number == 5
    grey = found.radiance.mean(axis=2)
    levels = np.unique(np.round(grey[board], 3))
    assert len(levels) > 100


def test_a_preview_has_the_requested_width_and_is_reproducible(fold_90_layout: Layout) -> None:
    first, again, other = (preview_frame(fold_90_layout, width_px=320, seed=seed) for seed in (0, 0, 1))
    assert first.picture.shape == (180, 320, 3)
    assert first.picture.dtype == np.uint8
    assert first.layout.camera == fold_90_layout.camera.binned(320 / 1920)
    np.testing.assert_array_equal(first.picture, again.picture)
    assert (first.picture != other.picture).mean() > 0.5
    assert first.picture.mean() > 20
    # No larger than the sensor.
    assert preview_frame(first.layout, width_px=4000).picture.shape == (180, 320, 3)


def test_the_print_of_a_board_is_where_the_layout_projects_it(fold_90_layout: Layout) -> None:
    board = default_board()
    frame = preview_frame(fold_90_layout, "board", width_px=960, sensor=SENSORS["ideal"])
    pose = view_from_board(frame.layout, board)
    # Centres of squares: the top left one is black, and colours alternate; markers lie within the white ones.
    columns, rows = np.meshgrid(np.arange(board.cols), np.arange(board.rows))
    black = (columns + rows) % 2 == 0
    middles = np.stack([(columns + 0.5) * board.square_mm, (rows + 0.5) * board.square_mm, 0.0 * rows], axis=-1)
    seen = 0
    for mirror in range(9):
        px = frame.layout.project(transform(pose, middles) @ frame.layout.view_from_rig, mirror)
        place = np.nan_to_num(np.rint(px), nan=-1).astype(int)
        height, width = frame.picture.shape[:2]
        on = (place >= 0).all(axis=-1) & (place[..., 0] < width) & (place[..., 1] < height) & black
        at = place[on]
        shown = frame.light.mirror[at[:, 1], at[:, 0]] == mirror
        grey = frame.light.radiance[at[shown, 1], at[shown, 0], 0]
        seen += len(grey)
        assert len(grey) == 0 or np.median(grey) < 0.06
    assert seen > 300


def test_objects_may_be_those_of_another_layout(fold_90_layout: Layout) -> None:
    few = fold_90_layout.replaced(
        rows=1, cols=3, mirrors=fold_90_layout.mirrors[3:6], spec=None, metrics={}, verdict={}
    )
    full = preview_frame(fold_90_layout, width_px=320).light
    own = preview_frame(few, width_px=320).light
    same = preview_frame(few, width_px=320, arranged_for=fold_90_layout).light
    # Pixels of the glossy ball in the middle row of mirrors.
    ball = ((full.object_number == 4) & (full.mirror >= 3) & (full.mirror < 6)).sum()
    assert (same.object_number == 4).sum() == pytest.approx(ball, rel=0.05)
    assert (own.object_number == 4).sum() != pytest.approx(ball, rel=0.05)


def test_invalid_arguments_are_refused(fold_90_layout: Layout) -> None:
    with pytest.raises(InputError, match=r"^subject is 'cat', expected tabletop or board$"):
        preview_frame(fold_90_layout, "cat")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"^width of 8 px, expected 64 to 4096$"):
        preview_frame(fold_90_layout, width_px=8)


def test_a_binned_sensor_has_the_noise_of_the_mean_of_its_pixels() -> None:
    model = SensorModel(full_well_electrons=1000.0, read_noise_grey=2.0, prnu_percent=1.0, lens_blur_px=1.2)
    small = binned_sensor(model, 0.5)
    assert (small.full_well_electrons, small.read_noise_grey) == (4000.0, 1.0)
    assert (small.prnu_percent, small.lens_blur_px) == (0.5, 0.6)
    assert binned_sensor(SENSORS["webcam"], 1.0).bayer is False
