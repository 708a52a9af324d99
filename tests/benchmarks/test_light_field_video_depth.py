"""The videos that depth is judged on: their object, their noise, and the scores."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.light_field_video_depth import (
    BEHIND_PX,
    OBJECT_PX,
    Camera,
    Passing,
    photographed,
    rendered_noise,
    scores,
    shifted,
    with_object,
)
from mirrorcam.optics.light_field.depth import DepthMap
from mirrorcam.render_scenes.settings import SENSORS

SIZE = (100, 140)


def test_an_object_is_where_its_disparity_says_and_has_uncovered_what_is_left_of_it() -> None:
    samples = np.zeros((3, 3, *SIZE, 3), np.float32)
    shot = with_object(samples, np.zeros(SIZE, np.float32), 50.0, 4.0, 1.0)
    columns = [np.flatnonzero(shot.samples[1, s, 50].sum(axis=-1)) for s in range(3)]
    assert [int(each[0]) for each in columns] == [54, 50, 46]
    assert shot.truth[50, 60] == 4.0
    assert shot.truth[50, 45] == 0.0
    assert np.flatnonzero(shot.behind[50]).tolist() == list(range(50 - BEHIND_PX, 50))
    assert 0 < shot.moving.sum() < OBJECT_PX**2
    half = with_object(samples, np.zeros(SIZE, np.float32), 50.5, 4.0, 1.0).samples[1, 1]
    inner = (slice(30, 70), slice(60, 100))
    assert np.abs(half[inner] - shifted(shot.samples, 0.5)[1, 1][inner]).mean() < 2.0


@pytest.mark.parametrize(("passing", "part"), [("raw", 1.0), ("interpolated", 0.5)])
def test_noise_is_that_of_the_sensor(passing: Passing, part: float) -> None:
    sensor, random = SENSORS["c920"], np.random.default_rng(0)
    grey = np.full((3, 3, 60, 80, 3), 120.0, np.float32)
    camera = Camera(sensor, passing, "fast")
    noise = photographed(grey, camera, random) - grey
    variance = part**2 * (sensor.read_noise_grey**2 + 120.0 * 255.0 / sensor.full_well_electrons) + 1.0 / 12.0
    assert noise.var() == pytest.approx(variance, rel=0.03)


def test_flicker_and_jumps_are_those_of_the_depth_maps() -> None:
    light_field = rendered_noise(np.random.default_rng(1))
    shape = light_field.height_px, light_field.width_px
    truth = np.zeros(shape, np.float32)
    shot = with_object(np.zeros((3, 3, *shape, 3), np.float32), truth, 300.0, 0.0, 1.0)

    def depth(disparity_px: float) -> DepthMap:
        mm = light_field.depth_mm_from_disparity(np.full(shape, disparity_px)).astype(np.float32)
        sure = np.ones(shape, np.float32)
        return DepthMap(views=light_field, view=(1, 1), depth_mm=mm, sigma_mm=sure, confidence=sure)

    found = scores([depth(0.4), depth(-0.4), depth(-0.4), depth(0.4)], [shot] * 4, 1)
    assert found.flicker == pytest.approx(0.4, rel=1e-3)
    assert found.jumps == pytest.approx(100.0 * 2 / 3, rel=1e-3)
    assert found.bad == 100.0
    assert found.mse == pytest.approx(16.0, rel=1e-3)
    exact = scores([depth(0.0)] * 2, [shot] * 2, 1)
    assert (exact.bad, exact.behind_bad) == (0.0, 0.0)
    assert exact.flicker == exact.jumps == 0.0
