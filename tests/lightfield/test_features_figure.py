"""The picture of features marks each one at its pixel, coloured by nearness."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirrorcam.lightfield.features_figure import draw_features
from mirrorcam.optics.light_field.features import FeatureFinder
from tests.drawn import drawn, values_of
from tests.optics.light_field.features.scenes import of_planes, uneven_views


def test_marks_are_at_the_features_and_crosses_at_the_refracted_ones(tmp_path: Path) -> None:
    light_field = of_planes(uneven_views(), [(560.0, (0.1, -0.2), None, 1)])[0]
    features = FeatureFinder(light_field, "ORB", two_slope_sigma=1.0).find(light_field)
    plain = ~features.refracted
    assert 0 < plain.sum() < len(features)
    path = tmp_path / "features.png"
    figure = drawn(lambda: draw_features(path, light_field, features), path)
    discs, *crosses = figure.axes[0].collections
    assert np.allclose(discs.get_offsets(), features.pixels[plain])
    assert np.allclose(values_of(discs), 1.0 / features.depth_mm[plain])
    assert all(np.allclose(each.get_offsets(), features.pixels[~plain]) for each in crosses)
    assert f"{(~plain).sum()} with two slopes" in figure.axes[0].get_title()
