"""The scene on which speed is measured: depth is found in it."""

from __future__ import annotations

import numpy as np

from benchmarks.light_field_depth_speed import cards, times, views_of
from mirrorcam.optics.light_field.depth import DepthEstimator


def test_depth_of_the_cards_is_found_and_every_job_timed() -> None:
    light_field, truth = cards(views_of(3, 200, 120))
    found = DepthEstimator(light_field).estimate(light_field)
    assert np.mean(np.abs(found.depth_mm - truth) < 0.02 * truth) > 0.95
    took = times(light_field, 1)
    assert set(took) == {"best", "fast", "one StereoSGBM pair", "bare remap"}
    assert all(len(each) == 1 and each[0] > 0.0 for each in took.values())
