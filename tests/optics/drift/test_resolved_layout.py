"""The re-solved layout: the moved mirror where it is, the others as they were, a covariance that covers the error."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam.optics.drift.drift import find_drift
from mirrorcam.optics.drift.matched_points import MatchedPoints, PointMatcher
from mirrorcam.optics.drift.resolved_layout import resolved_layout
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.drift.calibrated_device import device, turn_error_deg, turned

INDEX = 5


def resolved(layout: Layout, frames: list[Any]) -> Layout:
    matcher = PointMatcher(layout)
    drift = find_drift(layout, MatchedPoints.joined([matcher.match(frame) for frame in frames]))
    return resolved_layout(layout, drift, "a test")


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
