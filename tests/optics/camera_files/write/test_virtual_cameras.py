"""A mirror as a camera: rigid, upright, exact for first-surface mirrors, with an error for second-surface ones."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import Polygon, box

from mirrorcam.core.values import InputError
from mirrorcam.optics.camera_files.write import virtual_cameras
from mirrorcam.optics.camera_files.write.virtual_cameras import Flip, flipped_camera, flipped_pixels
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.camera_files.write.conftest import TOLERANCE_PX, Case, sideways_layout


def test_the_flipped_frame_is_a_cameras(case: Case) -> None:
    for view, points_in_rig, pixels in zip(case.views, case.points_in_rig, case.flipped_px, strict=True):
        np.testing.assert_allclose(view.project(points_in_rig), pixels, rtol=0, atol=TOLERANCE_PX)


def test_without_the_flip_no_rigid_camera_sees_it(case: Case) -> None:
    """The check above would notice a frame that is left as it is: here by many pixels."""
    view, number = case.views[0], 0
    unflipped = case.layout.project(case.points_in_rig[number], number)
    assert np.abs(view.project(case.points_in_rig[number]) - unflipped).max() > 10.0


def test_poses_are_rigid_and_stand_at_the_virtual_centres(case: Case) -> None:
    for view, centre in zip(case.views, case.layout.virtual_centres_in_rig_mm, strict=True):
        turn = view.camera_from_rig[:3, :3]
        assert np.linalg.det(turn) == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        np.testing.assert_allclose(-turn.T @ view.camera_from_rig[:3, 3], centre, atol=1e-9)


def test_views_are_upright(case: Case) -> None:
    """Less than 45 degrees from the views' own axes, on average."""
    up = [view.camera_from_rig[1, :3] @ case.layout.view_from_rig[1] for view in case.views]
    right = [view.camera_from_rig[0, :3] @ case.layout.view_from_rig[0] for view in case.views]
    assert np.mean(up) > 0.7
    assert np.mean(right) > 0.7


@pytest.mark.parametrize("flip", ["left-right", "top-bottom"])
def test_flipping_twice_changes_nothing(crooked_layout: Layout, flip: Flip) -> None:
    camera = crooked_layout.camera
    twice = flipped_camera(flipped_camera(camera, flip), flip)
    np.testing.assert_allclose(twice.intrinsics, camera.intrinsics, rtol=0, atol=1e-12)
    pixels = np.array([[0.0, 0.0], [12.25, 500.5]])
    again = flipped_pixels(flipped_pixels(pixels, camera, flip), camera, flip)
    np.testing.assert_array_equal(again, pixels)


def test_a_lit_pixel_is_where_the_camera_puts_it(case: Case) -> None:
    camera = case.layout.camera
    for view, points_in_rig in zip(case.views, case.points_in_rig, strict=True):
        number = view.row * case.layout.cols + view.column
        column, row = np.rint(case.layout.project(points_in_rig[0], number)).astype(int)
        frame = np.zeros((camera.height_px, camera.width_px, 3), dtype=np.uint8)
        frame[row, column] = 255
        flipped = view.flipped(frame)
        (found,) = np.argwhere(flipped[..., 0])
        assert np.abs(found[::-1] - view.project(points_in_rig[0])).max() <= 0.5 + TOLERANCE_PX
        assert view.mask[tuple(found)] == 255
        cut = view.sub_image
        (in_cut,) = np.argwhere(flipped[cut.slices][..., 0])
        at = view.cropped.project(view.camera_from_rig[:3, :3] @ points_in_rig[0] + view.camera_from_rig[:3, 3])
        assert np.abs(in_cut[::-1] - at).max() <= 0.5 + TOLERANCE_PX


def test_masks_lie_apart_and_hold_what_the_mirrors_show(case: Case) -> None:
    total = np.sum([view.mask > 0 for view in case.views], axis=0)
    assert total.max() == 1
    for view, pixels in zip(case.views, case.flipped_px, strict=True):
        inside = np.rint(pixels).astype(int)
        assert (view.mask[inside[:, 1], inside[:, 0]] > 0).mean() > 0.9  # rounding leaves the rim now and then
        rows, columns = view.sub_image.slices
        outside = view.mask.copy()
        outside[rows, columns] = 0
        assert not outside.any()
        sensor = box(-0.5, -0.5, view.camera.width_px - 0.5, view.camera.height_px - 0.5)
        assert (view.mask > 0).sum() == pytest.approx(Polygon(view.outline_px).intersection(sensor).area, rel=0.005)


def test_a_mirror_outside_the_sensor_is_refused() -> None:
    layout = sideways_layout()
    narrow = layout.camera.replaced(width_px=200, cx_px=100.0)
    with pytest.raises(InputError, match="view_0_0 shows no pixel of the sensor"):
        _ = [view.sub_image for view in virtual_cameras(layout.replaced(camera=narrow))]


def test_a_mirror_beyond_the_lens_model_is_refused(parabola_layout: Layout) -> None:
    folding = parabola_layout.camera.replaced(distortion=[-0.9, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="view_0_0 reaches beyond where the lens model is defined"):
        virtual_cameras(parabola_layout.replaced(camera=folding))
