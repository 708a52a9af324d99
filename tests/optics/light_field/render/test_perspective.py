"""Pictures by depth: sharp everywhere, from between the views, and without occluders."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.render.perspective import all_in_focus, insert_views, orbit, render_view
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, refocus
from mirrorcam.optics.light_field.render.view_depths import ViewDepths, remove_nearer
from tests.optics.light_field.depth.surfaces import Surface, grid_views, met, photograph
from tests.optics.light_field.render.scenes import CARD, POST, SCENE, WALL, behind_mm, inside, seen_at, true_depths
from tests.optics.light_field.render.test_refocusing import psnr, truth

COUNT = 3


def test_everything_is_sharp_with_less_noise() -> None:
    views = grid_views()
    light_field = photograph(views, SCENE, noise=0.04)[0]
    true = truth(views, SCENE)
    picture = all_in_focus(light_field, true_depths(views, SCENE))
    where = inside(true.shape[:2])
    assert picture.valid.all()
    central = psnr(light_field.samples[1, 1] / 255.0, true, where)
    assert psnr(picture.image, true, where) > central + 6.0
    # No single plane shows everything sharp.
    for depth in (CARD.distance_mm, WALL.distance_mm):
        assert psnr(refocus(light_field, FocalPlane((0, 0, 1 / depth))).image, true, where) < central


def test_the_picture_by_measured_depth_is_nearly_as_sharp() -> None:
    views = grid_views()
    light_field = photograph(views, SCENE, noise=0.02)[0]
    depths = ViewDepths.estimate(light_field)
    true = truth(views, SCENE)
    where = inside(true.shape[:2])
    picture = all_in_focus(light_field, depths)
    assert psnr(picture.image, true, where) > psnr(light_field.samples[1, 1] / 255.0, true, where) + 3.0
    known = depths.measured & inside(true.shape[:2])
    assert known.mean() > 0.6
    expected = true_depths(views, SCENE)
    off = np.abs(depths.depth_mm(views) / expected.depth_mm(views) - 1.0)[known]
    assert np.median(off) < 0.01
    assert np.mean(off > 0.05) < 0.03


@pytest.mark.parametrize("place", [(12.0, -7.0, 0.0), (-8.0, 14.0, 0.0)])
def test_a_picture_between_the_views_matches_a_pinhole_there(place: tuple[float, float, float]) -> None:
    views = grid_views()
    light_field = photograph(views, SCENE)[0]
    true = seen_at(views, np.array(place), SCENE)
    where = inside(true.shape[:2])
    picture = render_view(light_field, true_depths(views, SCENE), np.array(place))
    assert picture.valid.all()
    assert psnr(picture.image, true, where) > 33.0
    by_measured = render_view(light_field, ViewDepths.estimate(light_field), np.array(place))
    assert psnr(by_measured.image, true, where) > 26.0
    nearest = psnr(light_field.samples[1, 1] / 255.0, true, where)
    assert nearest < 20.0


def test_a_picture_from_a_views_position_matches_that_view() -> None:
    views = grid_views()
    light_field = photograph(views, SCENE, noise=0.0)[0]
    picture = render_view(light_field, true_depths(views, SCENE), views.positions_mm[1, 2])
    assert psnr(picture.image, light_field.samples[1, 2] / 255.0, picture.valid) > 45.0


def test_occluders_are_left_out() -> None:
    views = grid_views(step_mm=32.0)
    light_field = photograph(views, [WALL, POST])[0]
    true = truth(views, [WALL])
    hidden = met(views, (1, 1), views.pixel_grid(), [WALL, POST])[2] == 1
    assert 0.05 < hidden.mean() < 0.2
    cut = 460.0 + behind_mm(views)
    plane = FocalPlane((-0.2 / 560.0, 0.3 / 560.0, 1.0 / 560.0))
    for depths, least_db in ((true_depths(views, [WALL, POST]), 34.0), (ViewDepths.estimate(light_field), 28.0)):
        without = remove_nearer(light_field, depths, cut)
        assert (without.weights[1, 1][hidden] == 0).mean() > 0.97
        picture = all_in_focus(without, depths)
        assert (picture.valid & hidden).sum() > 0.9 * hidden.sum()
        assert psnr(picture.image, true, picture.valid & hidden) > least_db
        # So does a plane behind the post, where the picture with the post shows its blur.
        past = refocus(without, plane)
        assert psnr(past.image, true, past.valid & hidden) > least_db
        assert psnr(refocus(light_field, plane).image, true, hidden) < 25.0


@pytest.mark.filterwarnings("error")
def test_dissimilar_views_still_fill_gaps_of_the_central_one() -> None:
    views = grid_views()
    light_field = photograph(views, SCENE)[0]
    samples, weights = light_field.samples.copy(), light_field.weights.copy()
    samples[1, 1] = 255
    weights[1, 1, 30:50, 40:70], samples[1, 1, 30:50, 40:70] = 0.0, 0
    picture = all_in_focus(LightField.of(views, samples, weights), true_depths(views, SCENE))
    assert picture.valid.all()
    assert np.isfinite(picture.image).all()
    lacking = np.zeros((90, 120), dtype=bool)
    lacking[31:49, 41:69] = True
    assert psnr(picture.image, truth(views, SCENE), lacking) > 30.0


def test_pixels_seen_by_no_view_stay_empty() -> None:
    views = grid_views()
    wide = Surface(400.0, bounds=(-60.0, -22.0, 60.0, 14.0), seed=2, mean=0.65)
    light_field = photograph(views, [WALL, wide])[0]
    depths = true_depths(views, [WALL, wide])
    without = remove_nearer(light_field, depths, 460.0 + behind_mm(views))
    picture = all_in_focus(without, depths)
    assert 0.02 < (~picture.valid).mean() < 0.4
    assert (picture.image[~picture.valid] == 0).all()


def test_the_path_around_stays_between_the_views() -> None:
    views = grid_views()
    light_field, places = photograph(views, SCENE)[0], np.array(list(orbit(views, 12)))
    assert places.shape == (12, 3)
    low, high = (edge(views.positions_mm.reshape(-1, 3), axis=0) for edge in (np.min, np.max))
    assert ((places >= low - 1e-9) & (places <= high + 1e-9))[:, :2].all()
    assert np.ptp(places[:, 0]) > 30.0
    assert np.ptp(places[:, 1]) > 30.0
    with pytest.raises(InputError, match=r"position \(90, 0\) mm lies outside the views"):
        render_view(light_field, true_depths(views, SCENE), np.array([90.0, 0.0, 0.0]))


def test_at_its_own_position_a_view_overrides_wrong_depth() -> None:
    views = grid_views()
    light_field = photograph(views, SCENE, noise=0.0)[0]
    depths = true_depths(views, SCENE)
    wrong = ViewDepths(depths.inverse_distance.copy(), depths.measured.copy())
    wrong.inverse_distance[1, 1, 20:60, 30:90] *= np.float32(0.7)
    wrong.measured[1, 1, 20:60, 30:90] = False
    picture = all_in_focus(light_field, wrong)
    patch = np.zeros((90, 120), dtype=bool)
    patch[20:60, 30:90] = True
    assert psnr(picture.image, light_field.samples[1, 1] / 255.0, patch) > 35.0
    stray = light_field.samples.copy()
    stray[1, 1, 20:60, 30:90] = 128
    picture = all_in_focus(LightField.of(views, stray, light_field.weights), wrong)
    assert np.abs(picture.image[patch] - 128.0 / 255.0).mean() < 0.02


def test_blur_matches_that_of_as_many_real_views() -> None:
    few = grid_views(uneven=False)
    light_field = photograph(few, SCENE)[0]
    many = grid_views(2 * (COUNT + 1) + 1, 2 * (COUNT + 1) + 1, step_mm=20.0 / (COUNT + 1), uneven=False)
    dense = insert_views(light_field, true_depths(few, SCENE), COUNT)
    np.testing.assert_allclose(dense.positions_mm, many.positions_mm, atol=1e-9)
    np.testing.assert_array_equal(dense.samples[:: COUNT + 1, :: COUNT + 1], light_field.samples)
    plane = FocalPlane.at_depth(few, 560.0 + few.reference_view_depth_mm)
    true = refocus(photograph(many, SCENE)[0], plane).image
    where = inside(true.shape[:2], 16)
    reached, sparse = (psnr(refocus(each, plane).image, true, where) for each in (dense, light_field))
    assert reached > 38.0
    assert reached > sparse + 8.0


def test_pixels_without_samples_stay_empty() -> None:
    views = grid_views()
    light_field = photograph(views, SCENE)[0]
    weights, samples = light_field.weights.copy(), light_field.samples.copy()
    weights[..., :50], samples[..., :50, :] = 0.0, 0
    part = LightField.of(views, samples, weights)
    dense = insert_views(part, true_depths(views, SCENE), 1)
    assert (dense.weights[1, 1, :, :25] == 0).all()
    assert (dense.samples[1, 1, :, :25] == 0).all()
    assert (dense.weights[1, 1, :, -25:] == 1).all()


def test_too_many_views_are_refused() -> None:
    views = grid_views()
    light_field = photograph(views, SCENE)[0]
    with pytest.raises(InputError, match="401x401 views of 120x90 px, expected at most 200 million px"):
        insert_views(light_field, true_depths(views, SCENE), 199)
