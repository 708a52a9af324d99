"""Alarms if a mirror turned by 0.02 degrees, none without motion, and no answer without texture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.drift.drift import TARGET_DEG, Drift, drift_corrected_layout, find_drift
from mirrorcam.optics.drift.matched_points import MatchedPoints, PointMatcher
from mirrorcam.optics.geometry.layout import Layout
from tests.nightly import a_few
from tests.optics.drift.calibrated_device import across, device, turn_error_deg, turned

INDEX = 5


def drift_in(layout: Layout, frames: list[Any]) -> Drift:
    matcher = PointMatcher(layout)
    return find_drift(layout, MatchedPoints.joined([matcher.match(frame) for frame in frames]))


def test_nothing_moved(frames: list[Any]) -> None:
    drift = drift_in(device().calibrated, frames)
    assert not drift.moved
    assert not drift.undetermined
    assert drift.frames == 2
    assert max(mirror.statistic for mirror in drift.mirrors) < 0.3
    assert not drift.change.any()


@pytest.mark.parametrize("index", a_few(1, [0, 4, 7]))
def test_a_rotation_of_two_hundredths_of_a_degree_is_detected_and_solved(frames: list[Any], index: int) -> None:
    calibrated = device().calibrated
    turn = across(calibrated, index, 0.02, np.random.default_rng(index))
    drift = drift_in(turned(calibrated, index, turn), frames)
    assert [mirror.index for mirror in drift.moved] == [index]
    move = drift.moved[0]
    assert np.linalg.norm(move.rotation_deg + turn) < 0.01
    assert np.linalg.norm(move.rotation_deg + turn) < 3.0 * move.rotation_sigma_deg


@pytest.mark.slow
def test_two_moved_mirrors_are_both_detected(frames: list[Any]) -> None:
    layout = turned(device().calibrated, 1, np.array([0.1, 0.0, 0.0]))
    layout = turned(layout, 8, np.array([0.0, 0.06, 0.06]), shift_mm=0.1)
    assert sorted(mirror.index for mirror in drift_in(layout, frames).moved) == [1, 8]


def test_without_texture_mirrors_are_undetermined(frames: list[Any]) -> None:
    layout = device().calibrated
    drift = drift_in(layout, [np.full_like(frames[0], 120)])
    assert not drift.moved
    assert len(drift.undetermined) == len(layout.mirrors)
    assert all(mirror.detectable_deg > TARGET_DEG for mirror in drift.mirrors)
    assert not any(mirror.tested for mirror in drift.mirrors)
    noise = np.random.default_rng(0).normal(120.0, 3.0, frames[0].shape).astype(np.uint8)
    assert not drift.mismatched
    assert not drift_in(layout, [noise]).mismatched


def test_detail_that_other_views_do_not_show_is_of_another_device(frames: list[Any]) -> None:
    layout = device().calibrated
    assert not drift_in(layout, frames[:1]).mismatched
    drift = drift_in(layout, [np.roll(frames[0], 150, axis=1)])
    assert drift.mismatched
    assert not drift.moved
    assert drift.undetermined


def test_a_mirror_that_sees_nothing_is_undetermined(frames: list[Any]) -> None:
    layout = device().calibrated
    low, high = (getattr(layout.outline_px(6), end)(axis=0).astype(int) for end in ("min", "max"))
    hidden = [frame.copy() for frame in frames]
    for frame in hidden:
        frame[low[1] : high[1], low[0] : high[0]] = 90
    drift = drift_in(layout, hidden)
    assert not drift.moved
    assert 6 in [mirror.index for mirror in drift.undetermined]


def resolved(layout: Layout, frames: list[Any]) -> Layout:
    matcher = PointMatcher(layout)
    drift = find_drift(layout, MatchedPoints.joined([matcher.match(frame) for frame in frames]))
    return drift_corrected_layout(layout, drift, "a test")


def test_the_moved_mirror_is_where_it_is(frames: list[Any], tmp_path: Path) -> None:
    calibrated = device().calibrated
    moved = turned(calibrated, INDEX, np.array([0.03, 0.0, 0.04]))
    found = resolved(moved, frames)
    assert turn_error_deg(found, calibrated, INDEX) < 0.01
    for k, (mirror, other) in enumerate(zip(found.mirrors, moved.mirrors, strict=True)):
        assert (mirror == other) == (k != INDEX)
    assert found.camera == moved.camera
    assert found.provenance["resolved_from"] == moved.identity
    assert found.provenance["resolved_mirrors"] == "1-2"
    found.save(tmp_path / "layout.json")
    assert Layout.load(tmp_path / "layout.json").identity == found.identity


def test_the_covariance_grows_for_the_moved_mirror_alone_and_covers_the_error(frames: list[Any]) -> None:
    calibrated = device().calibrated
    moved = turned(calibrated, INDEX, np.array([0.03, 0.0, 0.04]))
    found = resolved(moved, frames)
    before, after = moved.uncertainty, found.uncertainty
    assert before is not None
    assert after is not None
    rows = [k for k, name in enumerate(after.parameters) if name.startswith(f"mirror {INDEX} ")]
    others = np.setdiff1d(np.arange(len(after.parameters)), rows)
    assert np.allclose(before.covariance[np.ix_(others, others)], after.covariance[np.ix_(others, others)])
    assert (np.diag(after.covariance)[rows] > np.diag(before.covariance)[rows]).all()
    assert np.linalg.eigvalsh(after.covariance)[0] > -1e-9 * np.trace(after.covariance)
    off = found.mirrors[INDEX].virtual_centre_in_rig_mm - device().truth.mirrors[INDEX].virtual_centre_in_rig_mm
    assert off @ np.linalg.solve(after.covariance[np.ix_(rows, rows)], off) < 16.0


def test_a_layout_without_covariance_gets_none(frames: list[Any]) -> None:
    moved = turned(device().truth, INDEX, np.array([0.03, 0.0, 0.04]))
    found = resolved(moved, frames)
    assert found.uncertainty is None
    assert turn_error_deg(found, device().truth, INDEX) < 0.01
