"""Matched points agree with the rays of the rendered scene."""

from __future__ import annotations

from typing import Any

import numpy as np

from mirrorcam.optics.drift.matched_points import MatchedPoints, PointMatcher
from mirrorcam.optics.light_field.decoder import Decoder
from tests.optics.drift.calibrated_device import device, turned
from tests.optics.drift.textured_scenes import Sheet, Shot, fractal, photograph


def test_points_of_a_plane_are_found_in_all_views() -> None:
    truth, depth_mm = device().truth, 400.0
    random = np.random.default_rng(0)
    sheet = Sheet(np.array([0.0, 0.0, depth_mm]), np.eye(3), fractal(random, slope=0.8), 1.0)
    found = PointMatcher(truth).match(photograph(truth, [sheet], Shot(noise=0.5), random))
    assert len(found.frame) > 200
    assert np.bincount(found.view, minlength=9).min() > 50
    places = np.full((9, len(found.frame), 2), np.nan)
    for view, mirror in enumerate(truth.mirrors):
        rows = found.view == view
        rays = truth.camera.unproject(found.pixels[rows])
        start = mirror.virtual_centre_in_rig_mm @ truth.view_from_rig.T
        ray = (rays @ mirror.reflection) @ truth.view_from_rig.T
        at = start + ray * ((depth_mm - start[2]) / ray[:, 2:])
        places[view, found.point[rows]] = at[:, :2]
    off_mm = np.linalg.norm(places - np.nanmedian(places, axis=0), axis=2)
    px_mm = truth.camera.fx_px / depth_mm
    assert np.nanmedian(off_mm) * px_mm < 0.06
    assert np.nanquantile(off_mm, 0.99) * px_mm < 0.6


def test_points_are_unvignetted() -> None:
    layout = device().calibrated
    layout = layout.replaced(camera=layout.camera.replaced(aperture_mm=2.0, focus_mm=500.0))
    found = PointMatcher(layout)
    served = Decoder(layout, field="union").weights.reshape(found.inner.shape)
    assert served[found.inner].min() == 1.0
    assert found.inner.sum() > 0.6 * (served == 1.0).sum()


def test_a_mirror_that_moved_by_pixels_is_followed(frames: list[Any]) -> None:
    calibrated = device().calibrated
    plain = PointMatcher(calibrated).match(frames[0])
    moved = PointMatcher(turned(calibrated, 2, np.array([0.3, 0.0, 0.0]))).match(frames[0])
    assert (moved.view == 2).sum() > 0.7 * (plain.view == 2).sum()


def test_a_frame_without_texture_has_no_points() -> None:
    layout = device().calibrated
    grey = np.full((layout.camera.height_px, layout.camera.width_px, 3), 120, np.uint8)
    found = PointMatcher(layout).match(grey)
    assert len(found.point) == len(found.frame) == 0


def test_points_that_one_view_alone_sees_are_left_out_and_frames_are_numbered() -> None:
    part = MatchedPoints(
        point=np.array([0, 0, 1, 1]),
        view=np.array([0, 1, 0, 2]),
        pixels=np.zeros((4, 2)),
        frame=np.zeros(2, np.int64),
        cell=np.array([3, 4]),
    )
    both = MatchedPoints.joined([part, part])
    assert both.frame.tolist() == [0, 0, 1, 1]
    assert both.point.tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    kept = both.where(both.view != 2)
    assert kept.point.tolist() == [0, 0, 1, 1]
    assert kept.frame.tolist() == [0, 1]
    assert kept.cell.tolist() == [3, 3]
