"""The benchmark of filters: rain falls where pinholes see it, and a filter beats averaging on its own terms."""

from __future__ import annotations

import numpy as np

from benchmarks.light_field_filters import dB, every, peers, warped, with_noise, with_rain
from mirrorcam.optics.light_field.filters import Passband, filter_light_field
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

PHOTOGRAPHED, DEPTH_MM = photograph(grid_views(), [Surface(480.0, slope=(0.2, -0.3), seed=1)])[:2]
CLEAN = every(PHOTOGRAPHED, 1, 90)
TRUE_MM = np.asarray(DEPTH_MM, dtype=np.float64)[:90, :90]
ENDS_MM = float(TRUE_MM.min()), float(TRUE_MM.max())


def test_every_second_view_is_about_the_central_one() -> None:
    nine = photograph(grid_views(5, 5), [Surface(480.0)])[0]
    few = every(nine, 2, 60)
    assert few.samples.shape == (3, 3, 60, 60, 3)
    np.testing.assert_array_equal(few.positions_mm, nine.positions_mm[::2, ::2])


def test_views_warped_by_the_truth_agree() -> None:
    straight = warped(CLEAN, TRUE_MM)[:, 20:70, 20:70]
    assert np.abs(straight - straight[4]).mean() < 4.0 / 255.0


def test_rain_differs_from_view_to_view_and_brightens() -> None:
    rainy = with_rain(CLEAN, ENDS_MM, 6)
    wet = (rainy.samples - CLEAN.samples).max(axis=-1) > 0.05
    shares = wet.mean(axis=(2, 3))
    assert 0.001 < shares.mean() < 0.2
    assert (wet.all(axis=(0, 1))).mean() < 0.2 * shares.mean()


def test_a_filter_tells_more_than_the_mean_of_views() -> None:
    given = with_noise(CLEAN, 20.0)
    filtered = filter_light_field(given, Passband.of(given, "hyperfan", *ENDS_MM)).light_field
    truth = CLEAN.samples[1, 1]
    others = {name: dB(found, truth) for name, found in peers(given, TRUE_MM)}
    assert dB(filtered.samples[1, 1], truth) > others["mean"] + 3.0
    assert dB(filtered.samples[1, 1], truth) > others["as it is"] + 6.0
