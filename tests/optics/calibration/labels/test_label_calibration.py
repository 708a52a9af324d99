"""Mirrors from labels of which some are wrong: errors, covariances, outliers, and refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.calibration.labels.known_scale import KnownLength
from mirrorcam.optics.calibration.labels.label_calibration import label_observations, unknown_camera
from mirrorcam.optics.calibration.labels.label_result import calibrate_labels
from mirrorcam.optics.calibration.labels.label_start import first_centres
from mirrorcam.optics.calibration.labels.label_table import LabelTable
from mirrorcam.optics.calibration.labels.label_verdict import label_verdict
from mirrorcam.optics.calibration.labels.point_adjustment import (
    CameraPrior,
    adjust,
    linearized_rows,
    points_estimate,
)
from mirrorcam.optics.calibration.solver.observations import DIRECT
from tests.optics.calibration.labels.label_errors import calibrated, errors, pooled, squares
from tests.optics.calibration.labels.simulated_labels import CAMERA, SHEET, Simulated, sheet_camera, simulated


def test_wrong_and_swapped_labels_do_little_harm() -> None:
    nees, to_bound = pooled([(simulated(seed, mirrors=3), CameraPrior.known(CAMERA)) for seed in range(3)])
    assert 0.3 < nees < 2.0
    assert to_bound < 2.0


@pytest.mark.slow
@pytest.mark.parametrize("prior", [None, SHEET], ids=["known camera", "data sheet"])
def test_errors_are_within_twice_the_bound_and_covariances_true(prior: CameraPrior | None) -> None:
    sets = []
    for mirrors in (2, 3, 4):
        for seed in range(20):
            camera = CAMERA if prior is None else sheet_camera(seed)
            sets.append((simulated(seed, mirrors=mirrors, camera=camera), prior or CameraPrior.known(camera)))
    nees, to_bound = pooled(sets)
    assert 0.7 < nees < 1.4
    assert to_bound < 2.0


def test_points_have_true_covariances() -> None:
    labels = simulated(3, mirrors=3, wrong=0.0, swapped=0.0)
    points = calibrated(labels).points
    error = points.positions - labels.points[points.frame, points.label]
    nees = np.einsum("pi,pij,pj->p", error, np.linalg.inv(points.covariances), error) / 3.0
    assert 0.6 < nees.mean() < 1.6


def test_a_length_between_labels_gives_the_scale() -> None:
    labels = simulated(1, mirrors=2, wrong=0.0, swapped=0.0)
    true = labels.points[:, 0] - labels.points[:, 4]
    stretched = labels.points.copy()
    stretched[:, 0] = labels.points[:, 4] + 100.0 * true / np.linalg.norm(true, axis=1)[:, None]
    rigid = simulated(1, mirrors=2, wrong=0.0, swapped=0.0, points=stretched)
    result = calibrate_labels(rigid.table, CameraPrior.known(CAMERA), KnownLength("nose", "tail", 100.0))
    assert result.spread < 1.3
    square, count = squares(errors(rigid, result), result.layout.uncertainty.covariance)  # type: ignore[union-attr]
    assert count == 6
    assert square < 25.0
    assert np.abs(errors(rigid, result)).max() < 8.0
    varying = calibrate_labels(labels.table, CameraPrior.known(CAMERA), KnownLength("nose", "tail", 100.0))
    assert varying.spread > 3.0
    assert "known length varies" in "".join(label_verdict(varying).reasons)


def test_a_focal_length_is_found_among_others() -> None:
    labels = simulated(2, mirrors=4)
    result = calibrated(labels, unknown_camera(CAMERA.width_px, CAMERA.height_px))
    uncertainty = result.layout.uncertainty
    assert uncertainty is not None
    sigma = np.sqrt(uncertainty.covariance[0, 0])
    assert abs(result.layout.camera.fx_px - CAMERA.fx_px) < 3.0 * sigma
    assert sigma < 0.1 * CAMERA.fx_px


def test_wrong_labels_are_named() -> None:
    labels = simulated(4, mirrors=3, wrong=0.03, swapped=0.05, seen=1.0)
    result = calibrated(labels)
    table = labels.table
    rejected = {(item.frame, item.view, item.label): item.remark for item in result.rejected}
    wrong = [
        (int(f), int(v), int(k))
        for f, v, k, fine in zip(table.frame, table.view, table.label, labels.correct, strict=True)
        if not fine
    ]
    assert np.mean([key in rejected for key in wrong]) > 0.9  # some swaps move a label by less than the noise
    assert len(rejected) < 1.2 * len(wrong)
    assert any(remark.startswith("is at 'paw") for remark in rejected.values())
    assert any(remark.startswith("is where the view") for remark in rejected.values())


def test_labels_exchanged_with_a_mirror_lie_behind_it() -> None:
    labels = simulated(5, mirrors=1, wrong=0.0, swapped=0.0, seen=1.0)
    table = labels.table
    pixels = table.pixels.copy()
    rows = np.flatnonzero((table.frame == 3) & (table.label == 4))
    pixels[rows] = pixels[rows[::-1]]
    result = calibrated(replace(labels, table=replace(table, pixels=pixels)))
    remarks = {(item.frame, item.view, item.label): item.remark for item in result.rejected}
    assert {remarks[3, DIRECT, 4], remarks[3, 0, 4]} == {"exchanged between its views"}


def test_derivatives() -> None:
    labels = simulated(0, mirrors=2, wrong=0.0, swapped=0.0, frames=3)
    observations, frame, label = label_observations(labels.table)
    estimate = points_estimate(labels.camera, labels.centres, labels.points[frame, label])
    rows = linearized_rows(estimate, observations, SHEET.free)
    step = 1e-4
    for column in range(len(SHEET.free), rows.d_global.shape[2]):
        centres = labels.centres.copy()
        centres.ravel()[column - len(SHEET.free)] += step
        moved = points_estimate(labels.camera, centres, labels.points[frame, label])
        difference = (linearized_rows(moved, observations, SHEET.free).r - rows.r) / step
        np.testing.assert_allclose(rows.d_global[:, :, column], difference, atol=1e-4)


def test_the_start_is_exact_without_noise() -> None:
    labels = simulated(0, mirrors=3, wrong=0.0, swapped=0.0, noise_px=0.0)
    observations, frame, _ = label_observations(labels.table)
    centres, sigma_px = first_centres(CAMERA, observations, len(frame), labels.table.views)
    centres *= np.linalg.norm(labels.centres) / np.linalg.norm(centres)
    np.testing.assert_allclose(centres, labels.centres, atol=1e-6)
    assert sigma_px < 1e-6


def shifted(labels: Simulated, rows: np.ndarray, shift_px: tuple[float, float]) -> Simulated:
    """Shift the labels of a mask."""
    pixels = labels.table.pixels.copy()
    pixels[rows] += shift_px
    return replace(labels, table=replace(labels.table, pixels=pixels))


def test_a_cropped_view_is_no_plane_mirror() -> None:
    labels = simulated(6, mirrors=3, wrong=0.0, swapped=0.0)
    good = label_verdict(calibrated(labels))
    assert good.state == "good", good.reasons
    cropped = shifted(labels, labels.table.view == 1, (-12.0, 9.0))
    verdict = label_verdict(calibrated(cropped))
    assert verdict.state == "stop"
    assert "'mirror 1'" in verdict.reasons[0]


def test_a_mirror_that_moved_is_seen_in_halves_of_the_frames() -> None:
    labels = simulated(7, mirrors=2, wrong=0.0, swapped=0.0)
    moved = shifted(labels, (labels.table.view == 0) & (labels.table.frame % 2 == 0), (0.0, 5.0))
    result = calibrated(moved)
    by_frame = next(split for split in result.splits if split.division == "by frame")
    assert by_frame.ratio > by_frame.limit
    assert label_verdict(result).state != "good"
    assert result.calibration.metrics["covariance_inflation"].value > 1.0


def of_rows(table: LabelTable, mask: np.ndarray) -> LabelTable:
    return replace(
        table, frame=table.frame[mask], view=table.view[mask], label=table.label[mask], pixels=table.pixels[mask]
    )


def test_labels_that_determine_nothing_are_refused() -> None:
    table, known = simulated(0, mirrors=2).table, CameraPrior.known(CAMERA)
    with pytest.raises(InputError, match="no point is labelled in two views"):
        calibrate_labels(of_rows(table, table.view == 0), known)
    with pytest.raises(InputError, match=r"'mirror 1': 0 points .* expected at least 5"):
        calibrate_labels(of_rows(table, table.view != 1), known)
    apart = of_rows(table, np.where(table.frame % 2 == 0, table.view != 1, table.view != 0))
    with pytest.raises(InputError, match="shares no point with another mirror"):
        calibrate_labels(apart, known)
    with pytest.raises(InputError, match="expected camera or one of nose"):
        calibrate_labels(table, known, KnownLength("snout", "tail", 10.0))
    random = np.random.default_rng(0)
    nonsense = replace(table, pixels=random.uniform(0.0, 1000.0, table.pixels.shape))
    with pytest.raises(InputError, match="of the labels contradict flat mirrors"):
        calibrate_labels(nonsense, known)


def test_adjustment_lowers_the_cost_to_the_bound() -> None:
    labels = simulated(8, mirrors=2, wrong=0.0, swapped=0.0, frames=20)
    observations, frame, label = label_observations(labels.table)
    truth = points_estimate(labels.camera, labels.centres, labels.points[frame, label])
    estimate, _ = adjust(truth, observations, CameraPrior.known(CAMERA))
    r = linearized_rows(estimate, observations, np.zeros(0, dtype=np.int64)).r
    freedom = r.size - 3 * len(frame) - 5
    assert np.sum(r**2) == pytest.approx(freedom, rel=0.25)


@pytest.mark.slow
def test_a_hundred_thousand_labels() -> None:
    labels = simulated(0, mirrors=4, frames=2700)
    assert len(labels.table.frame) > 100_000
    result = calibrated(labels)
    assert result.calibration.metrics["mirror_0_normal_sigma_deg"].value < 0.01
