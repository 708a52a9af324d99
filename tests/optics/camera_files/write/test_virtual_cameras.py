"""A mirror as a camera: rigid, upright, exact for first-surface mirrors, with an error for second-surface ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from shapely import Polygon, box

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric
from mirrorcam.optics.camera_files.write import virtual_cameras
from mirrorcam.optics.camera_files.write.virtual_cameras import Flip, flipped_camera, flipped_pixels
from mirrorcam.optics.camera_files.write.write_exports import readme
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from tests.optics.camera_files.write.conftest import TOLERANCE_PX, Case, seen_through, sideways_layout


def test_the_flipped_frame_is_a_cameras(case: Case) -> None:
    for view, points_in_rig, pixels in zip(case.views, case.points_in_rig, case.flipped_px, strict=True):
        np.testing.assert_allclose(view.project(points_in_rig), pixels, rtol=0, atol=TOLERANCE_PX)


def test_without_the_flip_no_rigid_camera_sees_it(case: Case) -> None:
    """The check above would detect an unflipped frame by many pixels."""
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
        assert (view.mask[inside[:, 1], inside[:, 0]] > 0).mean() > 0.9  # rounding may leave the rim
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
    with pytest.raises(InputError, match="view_0_0 reaches beyond the range of the lens model"):
        virtual_cameras(parabola_layout.replaced(camera=folding))


def acrylic(layout: Layout) -> Layout:
    plates = tuple(
        Mirror.second_surface(
            mirror.virtual_centre_in_rig_mm, mirror.outline_in_rig_mm, thickness_mm=2.0, refractive_index=1.49
        )
        for mirror in layout.mirrors
    )
    return layout.replaced(mirrors=plates)


def bent(layout: Layout) -> Layout:
    """A sag of some 0.01 mm, and saddles."""
    return layout.replaced(
        mirrors=tuple(mirror.replaced(curvature_per_m=[0.08, -0.05, 0.04]) for mirror in layout.mirrors)
    )


def test_flat_first_surface_mirrors_are_pinholes(case: Case) -> None:
    for view in case.views:
        assert view.pinhole_error_px < 1e-9
        np.testing.assert_array_equal(view.camera.intrinsics[[0, 1]], case.layout.camera.intrinsics[[0, 1]])


def walking(layout: Layout) -> Layout:
    return layout.replaced(camera=layout.camera.replaced(pupil_walk_mm=2.0))


@pytest.mark.parametrize("not_a_pinhole", [acrylic, bent, walking])
def test_other_mirrors_are_nearly_pinholes_and_their_error_is_stated(
    parabola_layout: Layout, not_a_pinhole: Callable[[Layout], Layout]
) -> None:
    layout = not_a_pinhole(parabola_layout)
    assert layout.spec is not None
    low, high = min(layout.spec.depths_mm), max(layout.spec.depths_mm)
    for number, view in enumerate(virtual_cameras(layout)):
        apparent = layout.mirrors[number].apparent
        points = seen_through(layout, number, count=2000)
        away = np.linalg.norm(points - apparent.virtual_centre_in_rig_mm, axis=1)
        points = points[(away > low) & (away < high)]
        exact = flipped_pixels(layout.project(points, number), layout.camera, view.flip)
        off = np.linalg.norm(view.project(points) - exact, axis=1)
        assert 0.001 < off.max() <= 1.02 * view.pinhole_error_px
        pinhole = layout.camera.replaced(pupil_walk_mm=None)
        plain = flipped_pixels(pinhole.project(apparent.reflect(points)), layout.camera, view.flip)
        assert off.max() < 0.5 * np.linalg.norm(plain - exact, axis=1).max()
        turn = view.camera_from_rig[:3, :3]
        assert np.linalg.det(turn) == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)


def test_a_layout_without_a_design_is_fitted_where_its_board_was() -> None:
    """Small mirrors, and a board much nearer than 300 mm."""
    working = {"working_distance_mm": Metric(value=120.0, unit="mm")}
    large = sideways_layout()
    small = (
        Mirror(
            virtual_centre_in_rig_mm=0.2 * mirror.virtual_centre_in_rig_mm,
            outline_in_rig_mm=0.2 * mirror.outline_in_rig_mm,
        )
        for mirror in large.mirrors
    )
    layout = acrylic(large.replaced(mirrors=tuple(small), kind="calibrated", metrics=working))
    views, elsewhere = virtual_cameras(layout), virtual_cameras(layout.replaced(metrics={}))
    for number, (view, other) in enumerate(zip(views, elsewhere, strict=True)):
        apparent = layout.mirrors[number].apparent
        points = seen_through(layout, number, count=300) - apparent.virtual_centre_in_rig_mm
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        points = apparent.virtual_centre_in_rig_mm + points * np.linspace(0.7 * 120.0, 1.4 * 120.0, 300)[:, None]
        exact = flipped_pixels(layout.project(points, number), layout.camera, view.flip)
        off = np.linalg.norm(view.project(points) - exact, axis=1).max()
        assert off <= 1.02 * view.pinhole_error_px
        assert off < 0.5 * np.linalg.norm(other.project(points) - exact, axis=1).max()
    assert "at 84 to 168 mm from its virtual centre" in readme(layout, views)
