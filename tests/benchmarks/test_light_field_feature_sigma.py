"""Features of a rough matte relief are as sure as they say, seen by few views and by many, and none is refracted."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.light_field_feature_sigma import at_edges, errors_px
from benchmarks.relief_scene import Card, Relief, even_views, light_field_of
from mirrorcam.optics.light_field.features import FeatureFinder

ROUGH = Relief(heights_mm=((4.0, 4.0), (12.0, 8.0), (32.0, 30.0)), contrast=10.0)


@pytest.mark.parametrize("count", [3, 5])
def test_errors_are_as_large_as_told_and_nothing_is_refracted(count: int) -> None:
    views = even_views(count, 20.0 / (count - 1), width_px=240, height_px=180, centre_px=np.array([119.5, 89.5]))
    light_field, true_mm = light_field_of(ROUGH, views, noise_grey=0.8)
    true_px = views.disparity_px_from_depth(true_mm)
    features = FeatureFinder(light_field, "ORB").find(light_field)
    clear = ~at_edges(features, true_px, count - 1)
    assert clear.sum() > 300
    ratio = np.abs(errors_px(features, true_px) / features.disparity_sigma_px)[clear]
    assert 0.5 < np.median(ratio) < 0.8
    assert np.mean(ratio > 3) < 0.04
    assert np.mean(features.refracted[clear]) < 0.01


def test_the_outline_of_a_card_is_an_edge() -> None:
    views = even_views(3, 10.0, width_px=160, height_px=120, centre_px=np.array([79.5, 59.5]))
    scene = Relief(heights_mm=((32.0, 5.0),), cards=(Card(350.0, (-25.0, -25.0, 25.0, 25.0)),))
    light_field, true_mm = light_field_of(scene, views, subsamples=1)
    features = FeatureFinder(light_field, "ORB").find(light_field)
    edge = at_edges(features, views.disparity_px_from_depth(true_mm), 2)
    from_outline = np.abs(
        np.abs(features.pixels - 79.5 * np.array([1.0, 59.5 / 79.5])).max(axis=1) - 25.0 * 500.0 / 350.0
    )
    assert edge[from_outline < 4].mean() > 0.95
    fine = features.scale_px < 2
    assert not edge[fine & (from_outline > 12)].any()
