"""Depth of scenes in closed form: accuracy, confidence, and refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.depth import DepthEstimator, DepthMap, VideoDepth, estimate_depth
from mirrorcam.optics.light_field.depth.confidence import FAR_CORRELATION_PX
from mirrorcam.optics.light_field.light_field import LightField, Views
from tests.optics.light_field.depth.conftest import CARD, WALL, inner
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

SIGMA = 3.0
SETTLED, COUNT = 16, 28


def test_surfaces_are_found_to_a_small_part_of_their_depth(scene: Any, found: DepthMap) -> None:
    _, depth, number = scene
    for surface in (0, 1):
        error = np.abs(found.depth_mm - depth)[inner(number, surface)] / depth[inner(number, surface)]
        assert np.median(error) < 0.0015
        assert np.quantile(error, 0.9) < 0.006
    assert (np.abs(found.depth_mm - depth) / depth < 0.02).mean() > 0.9


def test_points_hidden_from_views_on_one_side_are_seen_by_the_other(scene: Any, found: DepthMap) -> None:
    _, depth, number = scene
    near_edge = inner(number, 0, 3) & ~inner(number, 0, 8)
    near_edge[:8] = near_edge[-8:] = False
    near_edge[:, :8] = near_edge[:, -8:] = False
    assert near_edge.sum() > 300
    assert (np.abs(found.depth_mm - depth)[near_edge] / depth[near_edge] < 0.02).mean() > 0.85


def test_sigma_predicts_the_errors_of_depths(scene: Any, found: DepthMap) -> None:
    _, depth, number = scene
    sure = (inner(number, 0) | inner(number, 1)) & (found.confidence > 0.5)
    part = np.abs(found.depth_mm - depth)[sure] / found.sigma_mm[sure]
    # Half of a normal distribution lies within 0.67 sigma; smoothing may only reduce errors.
    assert 0.1 < np.median(part) < 1.0
    assert np.mean(part < 3.0) > 0.9


def test_confidence_is_high_where_depth_is_right_and_low_where_it_is_wrong(scene: Any, found: DepthMap) -> None:
    _, depth, _ = scene
    wrong = np.abs(found.depth_mm - depth) / depth > 0.03
    assert wrong.sum() > 50
    assert np.median(found.confidence[~wrong]) > 0.8
    assert np.median(found.confidence[wrong]) < np.median(found.confidence[~wrong]) - 0.3
    # Hardly any wrong depth is more probable than a right one.
    order = np.argsort(found.confidence, axis=None)
    ranks = np.empty(order.size)
    ranks[order] = np.arange(order.size)
    above = (ranks[wrong.ravel()].mean() - (wrong.sum() - 1) / 2.0) / (~wrong).sum()
    assert above < 0.03, above


def test_a_blank_wall_is_not_trusted_and_its_sigma_is_as_wide_as_the_search() -> None:
    light_field, _, _ = photograph(grid_views(), [Surface(500.0, contrast=0.0)])
    estimator = DepthEstimator(light_field)
    blank = estimator.estimate(light_field)
    assert np.median(blank.confidence) < 0.25
    near, far = estimator.near_mm, estimator.far_mm
    distance, nearest, farthest = (each - light_field.reference_view_depth_mm for each in (blank.depth_mm, near, far))
    uniform = (1.0 / nearest - 1.0 / farthest) / np.sqrt(12.0)
    assert np.nanmedian(blank.sigma_mm / np.square(distance)) > 0.7 * uniform
    assert np.isfinite(blank.sigma_mm[blank.valid]).all()


@pytest.mark.parametrize("level", [0, 128, 255])
@pytest.mark.parametrize("quality", ["best", "fast"])
def test_views_without_any_texture_have_no_confidence(level: int, quality: Any) -> None:
    views = grid_views()
    weights = np.ones((views.rows, views.cols, views.height_px, views.width_px), np.float32)
    weights[:, :, :, -9:] = weights[:, :, 40:60, 40:60] = 0.0  # the border of the samples is no texture
    samples = np.where(weights[..., None] > 0, np.uint8(level), np.uint8(0))
    light_field = LightField.of(views, samples, weights)
    found = DepthEstimator(light_field, quality=quality).estimate(light_field)
    assert found.valid.any()
    assert found.confidence.max() < 1e-4


@pytest.mark.parametrize("quality", ["best", "fast"])
def test_brightened_rims_of_a_grey_frame_are_no_texture(quality: Any) -> None:
    views = grid_views()
    x = np.abs(np.linspace(-1.0, 1.0, views.width_px))
    rim = np.clip(1.0 - 6.0 * (x - 0.8), 0.4, 1.0).astype(np.float32)
    weights = np.broadcast_to(rim, (views.rows, views.cols, views.height_px, views.width_px)).copy()
    samples = np.rint(100.0 / weights)[..., None].astype(np.uint8)  # as decoding brightens them
    light_field = LightField.of(views, samples, weights)
    assert DepthEstimator(light_field, quality=quality).estimate(light_field).confidence.max() < 1e-2


def test_saturated_pixels_have_no_confidence_beyond_the_reach_of_texture() -> None:
    light_field, _, _ = photograph(grid_views(), [Surface(500.0)])
    samples: Any = light_field.samples.copy()
    samples[:, :, :, 80:] = 255
    found = estimate_depth(LightField.of(light_field, samples, light_field.weights))
    beyond = 80 + FAR_CORRELATION_PX // 2 + 2
    assert found.confidence[:, beyond:].max() == 0.0
    assert np.median(found.confidence[:, :70]) > 0.8


def test_depths_are_refused_exactly_where_two_views_share_no_point() -> None:
    """Views 20 mm apart, 120 px wide, with a focal length of 400 px and the reference plane at infinity."""
    light_field = LightField.from_views(np.zeros((1, 2, 90, 120), np.uint8), step_mm=20.0, focal_px=400.0)
    nearest_mm = 400.0 * 20.0 / 119.5  # pixels of the outermost column coincide
    DepthEstimator(light_field, near_mm=0.9 * nearest_mm, far_mm=1.01 * nearest_mm)
    for far_mm in (0.8, 0.99 * nearest_mm):
        with pytest.raises(InputError, match=r"^near_mm .*: the views share no point at these depths, .* in mm"):
            DepthEstimator(light_field, near_mm=0.9 * far_mm, far_mm=far_mm)


def test_mirrors_of_different_brightness_do_not_matter(scene: Any) -> None:
    gains = np.random.default_rng(4).uniform(0.75, 1.15, (3, 3))
    light_field, depth, number = photograph(grid_views(), [WALL, CARD], gains=gains)
    found = DepthEstimator(light_field).estimate(light_field)
    sure = inner(number, 0) | inner(number, 1)
    assert np.median(np.abs(found.depth_mm - depth)[sure] / depth[sure]) < 0.002


def test_uneven_positions_are_used_as_they_are(scene: Any, found: DepthMap) -> None:
    light_field, depth, number = scene
    even = LightField.of(grid_views(uneven=False), light_field.samples, light_field.weights)
    assumed = DepthEstimator(even).estimate(even)
    sure = inner(number, 0)

    def error(depth_map: DepthMap) -> float:
        return float(np.median(np.abs(depth_map.depth_mm - depth)[sure] / depth[sure]))

    assert error(found) < 0.25 * error(assumed)


def test_points_seen_by_fewer_than_two_other_views_have_no_depth(scene: Any) -> None:
    light_field = scene[0]
    weights = light_field.weights.copy()
    weights[:, :, :, 60:] = 0.0
    weights[1, 1:, :, 60:] = 1.0
    weights[1, 1, :, :10] = 0.0
    samples = light_field.samples * (weights > 0)[..., None]
    found = DepthEstimator(cut := LightField.of(light_field, samples.astype(np.uint8), weights)).estimate(cut)
    assert not found.valid[:, :10].any()
    assert not found.valid[:, 85:].any()
    assert found.valid[5:-5, 25:45].all()
    for array in (found.sigma_mm, found.depth_mm):
        assert (np.isnan(array) == ~found.valid).all()
    assert (found.confidence[~found.valid] == 0).all()


@pytest.mark.parametrize("kind", ["float", "grey"])
def test_floats_and_grey_give_the_same_depth(scene: Any, found: DepthMap, kind: str) -> None:
    light_field = scene[0]
    samples = light_field.samples
    if kind == "float":
        other = LightField.of(light_field, (samples / 255.0).astype(np.float32), light_field.weights)
    else:
        other = LightField.of(light_field, samples.mean(axis=-1, keepdims=True).astype(np.uint8), light_field.weights)
    depth = DepthEstimator(other).estimate(other).depth_mm
    assert np.nanmedian(np.abs(depth - found.depth_mm)) < 1.0


def test_other_grids_work() -> None:
    for rows, cols in ((1, 2), (2, 2), (1, 5), (4, 3)):
        light_field, depth, number = photograph(grid_views(rows, cols, step_mm=15.0), [WALL, CARD])
        found = DepthEstimator(light_field).estimate(light_field)
        sure = inner(number, 0) & found.valid
        sure[:, :20] = sure[:, -20:] = False
        assert found.view == (rows // 2, cols // 2)
        assert np.median(np.abs(found.depth_mm - depth)[sure] / depth[sure]) < 0.01


def test_the_number_of_threads_changes_no_bit(scene: Any, found: DepthMap) -> None:
    alone = DepthEstimator(scene[0], workers=1).estimate(scene[0])
    for name in ("depth_mm", "sigma_mm", "confidence"):
        assert np.array_equal(getattr(alone, name), getattr(found, name), equal_nan=True)


def test_small_ranges_are_searched_at_full_size_and_large_ones_at_half(scene: Any) -> None:
    near = DepthEstimator(scene[0], near_mm=300.0, far_mm=420.0)
    wide = DepthEstimator(scene[0], near_mm=100.0, far_mm=np.inf)
    assert near.plane_count < wide.plane_count
    depth = scene[1]
    found = wide.estimate(scene[0]).depth_mm
    assert np.nanmedian(np.abs(found - depth) / depth) < 0.003


def test_light_fields_that_determine_no_depth_are_refused(scene: Any) -> None:
    light_field = scene[0]

    def part(rows: slice, cols: slice, **changes: Any) -> LightField:
        given = {name: getattr(light_field, name) for name in Views.__dataclass_fields__}
        views = Views(**(given | {"positions_mm": light_field.positions_mm[rows, cols]} | changes))
        height, width = views.height_px, views.width_px
        return LightField.of(
            views,
            light_field.samples[rows, cols, :height, :width],
            light_field.weights[rows, cols, :height, :width],
        )

    everything = slice(None)
    with pytest.raises(InputError, match="one view, expected two or more"):
        DepthEstimator(part(slice(1, 2), slice(1, 2)))
    with pytest.raises(InputError, match="all views coincide"):
        DepthEstimator(part(everything, everything, positions_mm=np.zeros((3, 3, 3))))
    with pytest.raises(InputError, match="views are 12x90 px, expected 16 px or more"):
        DepthEstimator(part(everything, everything, width_px=12))
    for near, far in ((500.0, 300.0), (-79.0, 300.0), (np.nan, 400.0)):
        with pytest.raises(InputError, match=r"near_mm below far_mm, and both beyond the foremost view, at -?\d+ mm"):
            DepthEstimator(light_field, near_mm=near, far_mm=far)
    with pytest.raises(InputError, match=r"need \d+ planes at 1 px .*, expected at most 2048"):
        DepthEstimator(light_field, near_mm=-76.0)


def test_a_light_field_of_other_views_or_weights_is_refused(scene: Any) -> None:
    light_field = scene[0]
    estimator = DepthEstimator(light_field)
    weights = light_field.weights.copy()
    weights[0, 0, 0, 0] = 0.0
    for other in (
        LightField.of(grid_views(step_mm=21.0), light_field.samples, light_field.weights),
        LightField.of(light_field, light_field.samples, weights),
    ):
        assert not estimator.fits(other)
        with pytest.raises(
            InputError, match="differs in views or weights from the one that the estimator was built for"
        ):
            estimator.estimate(other)


def test_one_call_is_the_estimator_of_that_light_field(scene: Any) -> None:
    light_field = scene[0]
    near, far = 0.7 * light_field.reference_depth_mm, 1.8 * light_field.reference_depth_mm
    wanted = DepthEstimator(light_field, near_mm=near, far_mm=far).estimate(light_field)
    np.testing.assert_array_equal(estimate_depth(light_field, near_mm=near, far_mm=far).depth_mm, wanted.depth_mm)


def test_a_search_that_is_too_large_uses_a_smaller_picture(scene: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    light_field, depth, *_ = scene
    monkeypatch.setattr("mirrorcam.optics.light_field.depth.estimate.MIN_SEARCHED_PX", 24)
    usual = DepthEstimator(light_field, workers=1).estimate(light_field)
    monkeypatch.setattr("mirrorcam.optics.light_field.depth.estimate.MAX_NEAR_COSTS", 1000)
    found = DepthEstimator(light_field, workers=1).estimate(light_field)
    assert not np.array_equal(found.depth_mm, usual.depth_mm, equal_nan=True)
    assert np.nanmedian(np.abs(found.depth_mm - depth) / depth) < 0.01
    assert np.nanmedian(found.sigma_mm) > 1.3 * np.nanmedian(usual.sigma_mm)


def test_depths_without_a_surface_are_not_trusted(scene: Any) -> None:
    found = DepthEstimator(scene[0], near_mm=2500.0, far_mm=9000.0, workers=1).estimate(scene[0])
    assert np.mean(found.confidence > 0.5) < 0.1


def noisy(light_field: LightField, random: np.random.Generator) -> LightField:
    samples = light_field.samples + SIGMA * random.normal(size=light_field.samples.shape)
    return LightField.of(light_field, np.clip(np.rint(samples), 0, 255).astype(np.uint8), light_field.weights)


@pytest.mark.slow
def test_static_scenes_keep_their_depth(scene: Any) -> None:
    random = np.random.default_rng(1)
    estimator = DepthEstimator(scene[0], quality="fast", workers=1)
    video = VideoDepth(estimator)
    found: tuple[list[Any], list[Any]] = ([], [])
    for number in range(COUNT):
        frame = noisy(scene[0], random)
        depth = video.estimate(frame)
        if number == 0:
            assert np.array_equal(depth.depth_mm, estimator.estimate(frame).depth_mm, equal_nan=True)
        if number >= SETTLED:
            found[0].append(estimator.estimate(frame).disparity_px())
            found[1].append(depth.disparity_px())
    inner = (slice(None), slice(8, -8), slice(8, -8))
    single, filtered = (np.nanstd(np.array(each)[inner], axis=0) for each in found)
    # With so few pixels, those at depth edges dominate the root mean square. Single frames are smoothed as their noise
    # requires, averaged ones are not: .43 of .11 px remain.
    assert np.sqrt(np.nanmean(filtered**2)) < min(0.5 * np.sqrt(np.nanmean(single**2)), 0.06)
    assert np.nanmedian(filtered) < np.nanmedian(single) / 5


@pytest.mark.slow
def test_unrelated_frames_have_the_depth_of_single_ones() -> None:
    random = np.random.default_rng(2)
    walls = [
        photograph(grid_views(), [Surface(depth, seed=seed)])[0] for seed, depth in enumerate((480.0, 520.0, 600.0))
    ]
    estimator = DepthEstimator(walls[0], quality="fast", workers=1)
    video = VideoDepth(estimator)
    for wall in walls:
        frame = noisy(wall, random)
        found, alone = video.estimate(frame), estimator.estimate(frame)
        for name in ("depth_mm", "sigma_mm", "confidence"):
            same = np.isclose(getattr(found, name), getattr(alone, name), rtol=1e-5, equal_nan=True)
            assert same.mean() > 0.99, name


@pytest.mark.slow
def test_sigma_keeps_matching_the_error(scene: Any) -> None:
    random = np.random.default_rng(3)
    video = VideoDepth(DepthEstimator(scene[0], quality="fast", workers=1))
    ratios = []
    for _ in range(12):
        depth = video.estimate(noisy(scene[0], random))
        ratios.append(np.nanmedian(np.abs(depth.depth_mm - scene[1]) / depth.sigma_mm))
    # Sigma is too large for this scene in all frames; it falls as much as the error does.
    assert ratios[-1] == pytest.approx(ratios[0], rel=0.25)
    assert 0.2 < ratios[-1] < 1.05


def test_what_moves_in_a_video_is_searched_over_all_planes() -> None:
    random = np.random.default_rng(4)
    wall = Surface(600.0, grain_mm=2.0)
    cards = [Surface(420.0, bounds=(left, -12.0, left + 22.0, 12.0), grain_mm=2.0) for left in (-25.0, -19.0)]
    still, before, after = (photograph(grid_views(), [wall, *card]) for card in ([], cards[:1], cards[1:]))
    estimator = DepthEstimator(still[0], quality="fast", workers=1)
    video = VideoDepth(estimator)
    for frame in (still, still, before, before, after):
        found = video.estimate(noisy(frame[0], random))
    alone = estimator.estimate(noisy(after[0], random))

    def wrong(depth: DepthMap) -> float:
        inner = (slice(8, -8), slice(8, -8))
        return float(np.mean(np.abs(depth.depth_mm - after[1])[inner] > 0.05 * after[1][inner]))

    assert wrong(found) < wrong(alone) + 0.01
