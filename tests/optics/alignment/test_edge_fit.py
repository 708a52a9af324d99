"""Errors of building, from the light across edges."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.alignment.build_errors import CAMERA, BuildErrors, BuiltDevice
from mirrorcam.optics.alignment.edge_fit import EdgeFitter
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.alignment.built_devices import built, sheet


@pytest.fixture(scope="module")
def pinhole(default_layout: Layout) -> Layout:
    return default_layout.replaced(camera=default_layout.camera.replaced(aperture_mm=0.0))


@pytest.fixture(scope="module")
def fitter(pinhole: Layout) -> EdgeFitter:
    return EdgeFitter(BuiltDevice(pinhole, BuildErrors()))


def drawn(fitter: EdgeFitter, seed: int) -> FloatArray:
    return np.random.default_rng(seed).normal(0.0, 0.6, fitter.device.count)


def test_edges_of_a_white_sheet_are_found_where_they_are(pinhole: Layout, fitter: EdgeFitter) -> None:
    units = drawn(fitter, 0)
    found = fitter.fit(sheet(built(pinhole, BuildErrors(), units)))
    for place, points in enumerate((found.seen.own, found.seen.other)):
        truth = fitter.device.pixels(points, units)
        designed = fitter.device.pixels(points, np.zeros(fitter.device.count))
        off = ((truth - designed) * found.seen.out).sum(axis=1) - found.offset_px[:, place]
        kept = found.seen.paired if place else np.ones(len(off), bool)
        assert np.sqrt(np.mean(off[kept] ** 2)) < 0.6
        assert np.abs(truth - designed).max() > 8.0


def test_the_turn_of_the_camera_is_found(pinhole: Layout, fitter: EdgeFitter) -> None:
    units = np.zeros(fitter.device.count)
    units[3:6] = 1.2, -1.0, 0.8
    found = fitter.fit(sheet(built(pinhole, BuildErrors(), units)))
    sigma = np.sqrt(np.diag(found.covariance))[3:6]
    assert (np.abs(found.errors[3:6] - units[3:6]) < 3.0 * sigma).all()
    assert sigma[2] < 0.3  # roll is told best


def test_the_dark_tells_nothing(fitter: EdgeFitter) -> None:
    random = np.random.default_rng(0)
    found = fitter.fit(random.normal(3.0, 1.0, (1080, 1920)).clip(0.0).astype(np.float32))
    assert np.isnan(found.own_px).mean() > 0.9
    mirrors = np.sqrt(np.diag(found.covariance))[CAMERA:]
    assert mirrors.min() > 0.5
    designed, seen = found.seen_points
    assert len(designed) == len(seen) < 0.1 * found.own_px.size


def test_seen_points_are_as_far_from_the_design_as_edges_are(pinhole: Layout, fitter: EdgeFitter) -> None:
    found = fitter.fit(sheet(pinhole))
    designed, seen = found.seen_points
    assert len(designed) > 60
    assert np.median(np.linalg.norm(seen - designed, axis=1)) < 0.6


def test_a_fit_from_the_one_before_is_the_same(pinhole: Layout, fitter: EdgeFitter) -> None:
    picture = sheet(built(pinhole, BuildErrors(), drawn(fitter, 2)))
    first = fitter.fit(picture)
    again = fitter.fit(picture, first.errors)
    assert np.abs(again.offset_px - first.offset_px).max() < 0.3
