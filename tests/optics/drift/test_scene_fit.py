"""The fit of projected points finds the turned mirror; a rolling shutter is not mistaken for a turn."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.drift.matched_points import MatchedPoints
from mirrorcam.optics.drift.mirror_motions import calibration_covariance, centre_rows, common_covariance
from mirrorcam.optics.drift.scene_fit import SceneFit, parameter_names
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.drift.calibrated_device import device, turned

INDEX = 5


def seen(layout: Layout, noise_px: float, twist: FloatArray | None = None) -> MatchedPoints:
    """Exact projections of points in front of the mirrors; a twist moves them during the readout."""
    random = np.random.default_rng(0)
    in_view = np.column_stack([random.uniform(-90, 90, (400, 2)), random.uniform(250, 600, 400)])
    points = in_view @ layout.view_from_rig
    point, view, pixels = [], [], []
    for k in range(len(layout.mirrors)):
        at = layout.project(points, k)
        for _ in range(3):
            if twist is not None:
                when = (at[:, 1:] / layout.camera.height_px) - 0.5
                at = layout.project(points + when * (np.cross(twist[:3], points) + twist[3:]), k)
        low, high = (getattr(layout.outline_px(k), end)(axis=0) for end in ("min", "max"))
        shown = np.flatnonzero(((at > low) & (at < high)).all(axis=1))
        point.append(shown)
        view.append(np.full(len(shown), k))
        pixels.append(at[shown] + noise_px * random.standard_normal((len(shown), 2)))
    order = np.argsort(np.concatenate(point), kind="stable")
    every = MatchedPoints(
        point=np.concatenate(point)[order],
        view=np.concatenate(view)[order],
        pixels=np.concatenate(pixels)[order],
        frame=np.zeros(400, np.int64),
        cell=np.arange(400) % 25,
    )
    return every.where(np.ones(len(every.point), bool))


def told_change(layout: Layout, matches: MatchedPoints) -> FloatArray:
    """Change (3,) of one mirror's virtual centre if only that mirror may have moved."""
    names = parameter_names(layout)
    rows = centre_rows(names, INDEX)
    prior = calibration_covariance(layout, names)
    prior[rows, rows] += 1.0
    fit = SceneFit(layout, matches, prior).solve()
    inside = np.eye(len(names)) + fit.information @ prior
    return np.asarray((prior @ np.linalg.solve(inside, fit.gradient))[rows])


def test_a_turned_mirror_is_found_where_it_is() -> None:
    truth = device().truth
    moved = turned(truth, INDEX, np.array([0.03, -0.04, 0.02]), shift_mm=0.05)
    change = told_change(truth, seen(moved, 0.0))
    expected = moved.mirrors[INDEX].virtual_centre_in_rig_mm - truth.mirrors[INDEX].virtual_centre_in_rig_mm
    assert change == pytest.approx(expected, abs=1e-3 * float(np.linalg.norm(expected)))


def test_a_scene_that_moves_during_readout_is_not_a_rotation_of_a_mirror() -> None:
    truth = device().truth
    twist = np.array([0.01, -0.008, 0.004, 3.0, -2.0, 1.0])
    moved = turned(truth, INDEX, np.array([0.02, 0.0, 0.0]))
    change = told_change(truth, seen(moved, 0.0, twist))
    expected = moved.mirrors[INDEX].virtual_centre_in_rig_mm - truth.mirrors[INDEX].virtual_centre_in_rig_mm
    assert change == pytest.approx(expected, abs=0.05 * float(np.linalg.norm(expected)))


def test_contributions_of_cells_scatter_no_more_than_independent_noise() -> None:
    truth = device().truth
    names = parameter_names(truth)
    prior = common_covariance(truth, names)
    fit = SceneFit(truth, seen(truth, 0.2), prior).solve()
    assert fit.sigma_px == pytest.approx(0.2, rel=0.1)
    # Whitened contributions of cells have variance 1, less because large residuals have less weight.
    values, vectors = np.linalg.eigh(fit.information)
    kept = values > 1e-6 * values[-1]
    white = vectors[:, kept] / np.sqrt(values[kept])
    assert 0.4 < np.trace(white.T @ fit.scatter @ white) / kept.sum() < 1.1


def test_wrong_matches_hardly_count() -> None:
    truth = device().truth
    moved = turned(truth, INDEX, np.array([0.03, 0.0, 0.02]))
    matches = seen(moved, 0.05)
    random = np.random.default_rng(1)
    wrong = random.random(len(matches.pixels)) < 0.1
    matches.pixels[wrong] += random.normal(0.0, 8.0, (int(wrong.sum()), 2)) + 3.0
    change = told_change(truth, matches)
    expected = moved.mirrors[INDEX].virtual_centre_in_rig_mm - truth.mirrors[INDEX].virtual_centre_in_rig_mm
    assert change == pytest.approx(expected, abs=0.2 * float(np.linalg.norm(expected)))
