"""Footprints of subpixels: against traced rays and closed forms, each covered once."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import Pupil
from mirrorcam.render_scenes.boards import board_from_texels
from mirrorcam.render_scenes.fast.pixel_footprints import pixel_footprints
from mirrorcam.render_scenes.fast.print_map import map_to_print, virtual_views
from mirrorcam.render_scenes.sets.poses import plan_frames
from mirrorcam.render_scenes.truth.pixel_maps import board_maps, pixel_rays
from tests.nightly import a_few


def test_plates_agree_with_rays_traced_surface_by_surface(plates: Layout, small_board: Charuco) -> None:
    """Points of the board that every pixel shows, by formula and by `truth.pixel_maps`."""
    camera = plates.camera.replaced(width_px=480, height_px=270).with_intrinsics(
        plates.camera.intrinsics * [0.25, 0.25, 0.25, 0.25, 1, 1, 1, 1, 1]
    )
    small = plates.replaced(camera=camera)
    pose = plan_frames(small, small_board, 1, np.random.default_rng(1)).poses[0]
    truth = board_maps(pixel_rays(small, mirrors=True), small_board, pose)
    views, board = virtual_views(small.mirrors), board_from_texels(small_board)
    shown = [footprints for (footprints,) in pixel_footprints(camera, small.mirrors, 1, np.full(9, 0.92), Pupil())]
    ghost, picture, twice, thrice = (shown[start : start + 9] for start in range(0, len(shown), 9))
    for footprints in picture:
        to_print = map_to_print(views[footprints.view], pose, np.asarray(np.linalg.inv(board)), Pupil())
        rays = np.column_stack([footprints.x, footprints.y, np.ones(len(footprints.x))]).astype(np.float64).T
        texels = (to_print.print @ rays - footprints.centre_shift_mm * (to_print.shift @ rays)) / (
            to_print.depth @ rays
        )
        at = board[:2] @ np.vstack([texels, np.ones(texels.shape[1])])
        same = truth["mirror"].ravel()[footprints.subpixel] == footprints.view
        same &= np.isfinite(truth["board.x"].ravel()[footprints.subpixel])
        assert same.sum() > 0.5 * len(footprints.subpixel)
        for name, found in zip(("board.x", "board.y"), at, strict=True):
            np.testing.assert_allclose(found[same], truth[name].ravel()[footprints.subpixel][same], atol=2e-4)
    # The front reflects about 5 % and transmits the rest, and reflects the same share again from within.
    for passed, low, high in ((ghost, 0.03, 0.08), (picture, 0.75, 0.9), (twice, 0.02, 0.07), (thrice, 0.001, 0.005)):
        weights = np.concatenate([footprints.weight for footprints in passed])
        assert low < np.median(weights) < high


@pytest.mark.parametrize("pupil", a_few(1, [Pupil(), Pupil(aperture_mm=2.0)]))
def test_no_subpixel_of_a_view_is_shown_twice(distorted_layout: Layout, pupil: Pupil) -> None:
    """Where one mirror hides a part of another, both together cover a subpixel at most once."""
    first, *others = distorted_layout.mirrors
    nearer = first.moved(np.eye(3), 0.35 * first.virtual_centre_in_rig_mm * [-0.05, 0.0, 0.0])
    built = distorted_layout.replaced(mirrors=(nearer, *others), kind="as-built")
    views = pixel_footprints(built.camera, built.mirrors, 1, np.ones(9), pupil)
    assert len(views) == 9
    filled = np.zeros(built.camera.width_px * built.camera.height_px)
    for parts in views:
        indices = np.concatenate([footprints.subpixel for footprints in parts])
        assert len(np.unique(indices)) == len(indices)
        np.add.at(filled, indices, np.concatenate([footprints.weight for footprints in parts]))
    assert filled.max() <= 1.0 + 1e-6


def test_the_bare_camera_covers_every_subpixel_once(small_layout: Layout) -> None:
    camera = small_layout.camera
    ((footprints,),) = pixel_footprints(camera, (), 2, np.zeros(0), Pupil())
    np.testing.assert_array_equal(footprints.subpixel, np.arange(4 * camera.width_px * camera.height_px))
    assert (footprints.weight == 1.0).all()
    assert not footprints.centre_shift_mm.any()
    # The centre of the first subpixel is a quarter of a pixel to the left of the first pixel's.
    assert footprints.x[0] == pytest.approx((-0.25 - camera.cx_px) / camera.fx_px, rel=1e-5)
    assert footprints.y[0] == pytest.approx((-0.25 - camera.cy_px) / camera.fy_px, rel=1e-5)
    np.testing.assert_allclose(footprints.steps, np.diag([0.5 / camera.fx_px, 0.5 / camera.fy_px]), atol=1e-8)
