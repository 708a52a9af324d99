"""Weak directions: a covariance that is weak along a known motion must be given that motion's name."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.calibration.diagnostics.weak_directions import motions_of, weak_directions
from mirrorcam.optics.geometry.layout import Layout, Uncertainty

RANGE_MM = 400.0
NAMED = (
    "all mirrors together about x",
    "all mirrors together about y",
    "all mirrors away from the camera",
    "focal length",
    "principal point in x",
    "lens distortion k1",
    "mirror 1-0 about its y",
    "mirror 1-1 along its normal",
)


def weak_along(layout: Layout, names: tuple[str, ...], amounts: tuple[float, ...]) -> Layout:
    """The layout with a covariance that is large along a sum of named motions and small elsewhere."""
    assert layout.uncertainty is not None
    motions = {motion.name: motion.change for motion in motions_of(layout)}
    change = np.sum([amount * motions[name] for name, amount in zip(names, amounts, strict=True)], axis=0)
    covariance = 1e-6 * layout.uncertainty.covariance + np.outer(change, change)
    return layout.replaced(uncertainty=Uncertainty(parameters=layout.uncertainty.parameters, covariance=covariance))


@pytest.mark.parametrize("name", NAMED)
def test_a_weak_motion_is_named_with_its_sigma(calibrated: Layout, name: str) -> None:
    weakest = weak_directions(weak_along(calibrated, (name,), (0.01,)), range_mm=RANGE_MM)[0]
    assert weakest.words == name
    assert weakest.share == pytest.approx(1.0, abs=1e-3)
    ((found, sigma, _),) = weakest.sigmas
    assert found == name
    assert sigma == pytest.approx(0.01, rel=1e-3)


def test_two_motions_that_hide_each_other_are_named_against_each_other(calibrated: Layout) -> None:
    names = ("principal point in y", "all mirrors together about x")
    weakest = weak_directions(weak_along(calibrated, names, (1.0, 0.02)), range_mm=RANGE_MM)[0]
    assert set(weakest.words.split(" against ")) == set(names)
    sigmas = {name: sigma for name, sigma, _ in weakest.sigmas}
    assert sigmas == pytest.approx({names[0]: 1.0, names[1]: 0.02}, rel=1e-2)


def test_the_directions_of_a_calibration_are_named(calibrated: Layout) -> None:
    found = weak_directions(calibrated, range_mm=RANGE_MM, count=4)
    assert [w.apart_px for w in found] == sorted((w.apart_px for w in found), reverse=True)
    assert found[0].words.startswith("all mirrors ")
    assert found[0].share > 0.8
    assert found[0].together_px < 0.8 * found[0].apart_px
