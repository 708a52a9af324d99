"""Videos filtered in time: static and moving scenes, slow drift, and changes of lighting."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.temporal import TemporalFilter
from mirrorcam.optics.light_field.temporal.filter import neighbours, specific_fraction
from mirrorcam.optics.light_field.temporal.recursive_mean import MEMORY
from tests.optics.light_field.depth.surfaces import grid_views
from tests.optics.light_field.temporal.videos import HEIGHT_PX, SIGMA, WIDTH_PX, error_grey, picture, shot

GAINS = np.ones((9, HEIGHT_PX, 3), np.float32)


def filtered(scenes: Any, count: int, sigma: float = SIGMA) -> tuple[LightField, LightField]:
    """Return the last of some frames, unfiltered and filtered."""
    random, video = np.random.default_rng(9), TemporalFilter(1)
    for number in range(count):
        frame = shot(scenes(number), random, sigma)
        found = video.filtered(frame)
    return frame, found


def rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_noise_of_a_static_scene_falls_as_in_a_mean() -> None:
    for count in (2, 5, 12):
        _, found = filtered(lambda number: picture(), count)
        assert rms(error_grey(found, picture())) == pytest.approx(SIGMA / np.sqrt(count), rel=0.12)
    _, found = filtered(lambda number: picture(), 3 * MEMORY)
    # A recursive mean with the weight w of a new frame has the variance w / (2 - w).
    assert rms(error_grey(found, picture())) == pytest.approx(SIGMA / np.sqrt(2 * MEMORY - 1), rel=0.2)


def test_the_first_frame_and_unrelated_frames_are_unchanged() -> None:
    random, video = np.random.default_rng(10), TemporalFilter(1)
    for seed in range(6):
        frame = shot(picture(seed, contrast=40.0), random)
        found = video.filtered(frame)
        if seed == 0:
            assert found is frame
        else:
            # Each of 256 grey levels is recovered from 0 to 1.
            assert np.array_equal(found.samples * np.float32(255.0), frame.samples)


def test_moving_objects_leave_no_trace() -> None:
    def scene(number: int) -> Any:
        whole = picture(contrast=10.0)
        whole[30:60, 5 + 3 * number : 35 + 3 * number] = picture(1, contrast=30.0)[:30, :30] + 40.0
        return whole

    count = 20
    last, found = filtered(scene, count)
    error, single = error_grey(found, scene(count - 1)), error_grey(last, scene(count - 1))
    left = 5 + 3 * (count - 1)
    assert rms(error[:, :, 32:58, left + 2 : left + 28]) <= 1.05 * rms(single[:, :, 32:58, left + 2 : left + 28])
    assert rms(error[:, :, 32:58, left - 6 : left]) <= 1.1 * rms(single[:, :, 32:58, left - 6 : left])
    assert rms(error[:, :, :20]) < 0.35 * SIGMA


@pytest.mark.parametrize("speed_px", [0.05, 0.1, 0.3, 1.0])
def test_a_slow_drift_of_the_picture_is_not_smeared(speed_px: float) -> None:
    wide = cv2.resize(picture(contrast=30.0), (4 * WIDTH_PX, 4 * HEIGHT_PX), interpolation=cv2.INTER_CUBIC)

    def scene(number: int) -> Any:
        place = np.array([[1.0, 0.0, -60.0 - speed_px * number], [0.0, 1.0, -60.0]])
        return cv2.warpAffine(wide, place, (WIDTH_PX, HEIGHT_PX), flags=cv2.INTER_CUBIC)

    count = 30
    last, found = filtered(scene, count)
    truth = np.clip(scene(count - 1), 0, 255)
    assert rms(error_grey(found, truth)) < 1.02 * rms(error_grey(last, truth))
    # The error along the picture's gradient: lag contributes less than half of a frame's noise.
    slope = cv2.Sobel(truth, cv2.CV_64F, 1, 0, ksize=1, scale=0.5)
    inner = (slice(None), slice(None), slice(8, -8), slice(8, -8))
    wide_slope = np.broadcast_to(slope, found.samples.shape)[inner]
    lag_px = abs(float((error_grey(found, truth)[inner] * wide_slope).sum() / np.square(wide_slope).sum()))
    assert lag_px * rms(wide_slope) < 0.5 * SIGMA


def test_slowly_approaching_objects_do_not_lag() -> None:
    """A weak texture with growing disparity: no block differs by more than noise, but depth would lag."""
    wide = cv2.resize(picture(contrast=8.0), (4 * WIDTH_PX, 4 * HEIGHT_PX), interpolation=cv2.INTER_CUBIC)
    rate_px, count = 0.03, 40

    def scene(number: int) -> Any:
        def view(t: int, s: int) -> Any:
            place = np.array([[1.0, 0.0, -60.0 - rate_px * number * s], [0.0, 1.0, -60.0 - rate_px * number * t]])
            return cv2.warpAffine(wide, place, (WIDTH_PX, HEIGHT_PX), flags=cv2.INTER_CUBIC)

        return np.stack([np.stack([view(t, s) for s in (-1, 0, 1)]) for t in (-1, 0, 1)])

    _, found = filtered(scene, count)
    truth = scene(count - 1)
    error = error_grey(found, truth)
    assert rms(error) < 0.8 * SIGMA
    slope = np.stack(
        [np.stack([cv2.Sobel(view, cv2.CV_64F, 1, 0, ksize=1, scale=0.5) for view in row]) for row in truth]
    )
    lag_px = (error * slope).sum(axis=(0, 2, 3, 4)) / np.square(slope).sum(axis=(0, 2, 3, 4))
    # Views at the left and right lag in opposite directions: a mean of MEMORY frames would lag by 0.7 px.
    assert abs(lag_px[2] - lag_px[0]) / 2 < 0.2


def test_a_moving_texture_as_fine_as_noise_is_not_averaged() -> None:
    scenes = [picture(grain_px=0.7, contrast=8.0)]
    last, found = filtered(lambda number: np.roll(scenes[0], 5 * number, axis=1), 12)
    assert np.abs(found.samples * np.float32(255.0) - last.samples).mean() < 0.05


@pytest.mark.parametrize("light", [lambda n: 1.0 + 0.03 * np.sin(2.4 * n), lambda n: 0.8 * 1.01**n])
def test_lighting_that_changes_is_followed(light: Any) -> None:
    count = 24
    _, found = filtered(lambda number: picture() * light(number), count)
    assert rms(error_grey(found, picture() * light(count - 1))) < 0.33 * SIGMA


def test_a_repeated_frame_changes_nothing() -> None:
    random, video = np.random.default_rng(11), TemporalFilter(1)
    for _ in range(6):
        frame = shot(picture(), random)
        for _ in range(3):
            found = video.filtered(frame)
    assert rms(error_grey(found, picture())) < 0.6 * SIGMA
    later = [shot(picture(), random) for _ in range(12)]
    for frame in later:
        found = video.filtered(frame)
    assert rms(error_grey(found, picture())) < 0.33 * SIGMA


def test_threads_and_other_videos_make_no_difference() -> None:
    random = np.random.default_rng(12)
    frames = [shot(picture(number // 3), random) for number in range(6)]
    alone, beside = TemporalFilter(1), TemporalFilter(3)
    for frame in frames:
        TemporalFilter(1).filtered(frame)
        assert np.array_equal(alone.filtered(frame).samples, beside.filtered(frame).samples)


def test_other_views_and_other_samples_start_anew() -> None:
    random, video = np.random.default_rng(13), TemporalFilter(1)
    frame = shot(picture(), random)
    moved = shot(picture(), random, step_mm=21.0)
    grey = shot(picture()[..., :1], random)
    for each in (frame, moved, grey, frame):
        assert video.filtered(each) is each


@pytest.mark.slow
def test_grey_and_floating_point_videos_are_filtered_too() -> None:
    random, video, floating = np.random.default_rng(14), TemporalFilter(1), TemporalFilter(1)
    for _ in range(10):
        frame = shot(picture()[..., :1], random)
        found = video.filtered(frame)
        samples: Any = frame.samples / np.float32(255.0)
        again = floating.filtered(LightField.of(frame, samples, frame.weights))
    assert rms(error_grey(found, picture()[..., :1])) < 0.4 * SIGMA
    assert np.abs(again.samples - found.samples).max() * 255.0 < 0.6 * SIGMA


def test_extreme_samples_do_not_affect_later_frames() -> None:
    random, video = np.random.default_rng(16), TemporalFilter(1)
    for number in range(10):
        frame = shot(picture(), random)
        samples: Any = frame.samples / np.float32(255.0)
        if number == 2:
            samples[:, :, 20:30, 20:30] = 3e38
            samples[:, :, 40:50, 20:30] = -3e38
        found = video.filtered(LightField.of(frame, samples, frame.weights))
    assert np.isfinite(found.samples).all()
    assert rms(error_grey(found, picture())) < 0.5 * SIGMA


def test_light_fields_that_would_take_gigabytes_are_not_filtered(monkeypatch: pytest.MonkeyPatch) -> None:
    random, video = np.random.default_rng(17), TemporalFilter(1)
    monkeypatch.setattr("mirrorcam.optics.light_field.temporal.filter.MAX_SAMPLES", 9 * WIDTH_PX * HEIGHT_PX)
    for _ in range(3):
        frame = shot(picture(), random)
        assert video.filtered(frame) is frame
        grey = shot(picture()[..., :1], random)
        video.filtered(grey)
    assert video.filtered(shot(picture()[..., :1], random)).samples.dtype == np.float32


@pytest.mark.slow
def test_small_views_are_filtered_too() -> None:
    random, video = np.random.default_rng(15), TemporalFilter(1)
    for size in (4, 7, 8, 17):
        views = grid_views(uneven=False, width_px=size, height_px=size)
        for _ in range(4):
            frame = shot(picture(), random)
            samples, weights = frame.samples[:, :, :size, :size], frame.weights[:, :, :size, :size]
            given = LightField.of(views, samples, weights)
            found = video.filtered(given)
        assert found.samples.shape == samples.shape
        assert (found is given) == (size < 8)


def at_disparity(scene: Any, disparity_px: int) -> Any:
    """Return the views (t, s, v, u, c) of a periodic picture at a disparity."""
    return np.stack(
        [
            np.stack([np.roll(scene, (-disparity_px * t, -disparity_px * s), (0, 1)) for s in (-1, 0, 1)])
            for t in (-1, 0, 1)
        ]
    )


def test_shifts_follow_the_views() -> None:
    views = grid_views(uneven=False)
    reference, near, shifts = neighbours(views)
    assert (reference, sorted(near)) == (4, [1, 3, 5, 7])
    one = shifts[len(shifts) // 2 + 1]
    assert {(int(view), *map(int, shift)) for view, shift in zip(near, one, strict=True)} == {
        (1, 0, -1),
        (3, -1, 0),
        (5, 1, 0),
        (7, 0, 1),
    }


@pytest.mark.parametrize("disparity_px", [-6, 0, 5])
def test_motion_is_common_to_views_at_any_disparity_and_noise_is_not(disparity_px: int) -> None:
    random = np.random.default_rng(7)
    scene = picture(grain_px=1.0)
    still = [shot(at_disparity(scene, disparity_px), random) for _ in range(2)]
    assert specific_fraction(still[1], still[0], GAINS) > 0.9
    moved = shot(at_disparity(np.roll(scene, 3, axis=1), disparity_px), random)
    assert specific_fraction(moved, still[0], GAINS) < 0.3


def test_without_neighbours_or_in_small_views_no_motion_is_reported() -> None:
    random = np.random.default_rng(8)
    frames = [shot(picture(seed), random) for seed in (0, 1)]
    small = []
    for frame in frames:
        given = {"width_px": 16, "height_px": 16}
        views = grid_views(uneven=False, **given)
        small.append(type(frame).of(views, frame.samples[:, :, :16, :16], frame.weights[:, :, :16, :16]))
    assert specific_fraction(small[1], small[0], GAINS[:, :16]) == 1.0
    assert specific_fraction(frames[0], frames[0], GAINS) == 1.0
    assert WIDTH_PX > 16
