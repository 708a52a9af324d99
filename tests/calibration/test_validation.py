"""Errors of calibrated mirrors against the truth, for known turns and shifts."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.calibration.error_bounds import LIMITED, bounded, mirror_bounds
from mirrorcam.calibration.validation import Validation, decoded_metrics, mirror_errors
from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_labels import LABELS
from mirrorcam.core.values import Metric
from mirrorcam.optics.calibration.diagnostics.calibration_result import tilted_to
from mirrorcam.optics.calibration.diagnostics.mirror_uncertainty import mirror_covariance
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.sound_calibration import sound_calibration


def test_a_layout_has_no_error_against_itself(small_layout: Layout) -> None:
    found = mirror_errors(small_layout, small_layout)
    assert {name: metric.value for name, metric in found.items()} == dict.fromkeys(found, pytest.approx(0.0, abs=1e-9))


def test_a_mirror_moved_along_its_normal_is_off_by_that_much(small_layout: Layout) -> None:
    first, second = small_layout.mirrors
    centre = second.virtual_centre_in_rig_mm
    away = centre / np.linalg.norm(centre)
    farther = second.replaced(
        virtual_centre_in_rig_mm=centre + 0.1 * away, outline_in_rig_mm=second.outline_in_rig_mm + 0.05 * away
    )
    found = mirror_errors(small_layout.replaced(mirrors=(first, farther)), small_layout)
    assert found["distance_error_max_mm"].value == pytest.approx(0.05, rel=1e-6)
    assert found["distance_error_rms_mm"].value == pytest.approx(0.05 / np.sqrt(2.0), rel=1e-6)
    assert found["normal_error_max_deg"].value == pytest.approx(0.0, abs=1e-6)


def test_another_number_of_mirrors_is_refused(small_layout: Layout, default_layout: Layout) -> None:
    with pytest.raises(InputError, match="9 mirrors calibrated, truth has 2"):
        mirror_errors(default_layout, small_layout)


def test_one_figure_past_its_limit_fails_a_validation() -> None:
    good, bad = Metric(value=1.0, unit="mm", limit=1.0), Metric(value=1.1, unit="mm", limit=1.0)
    assert Validation(sound_calibration(), {"a": good, "b": Metric(value=9.0, unit="mm")}).passed
    assert not Validation(sound_calibration(), {"a": good, "b": bad}).passed


@pytest.mark.filterwarnings("error")
def test_a_validation_without_decoded_corners_fails_with_the_reason() -> None:
    found = decoded_metrics(np.zeros(0))
    assert found["decoded_corners"].value == 0
    for name in ("decoded_corner_rms_px", "decoded_corner_p95_px"):
        assert not found[name].known
        assert "no corner was found" in found[name].reason
    limited = {name: metric.replaced(limit=1.0) for name, metric in found.items() if not metric.known}
    assert not Validation(sound_calibration(), limited).passed


def test_every_check_has_a_label() -> None:
    assert set(LIMITED) - set(LABELS) == set()


def test_limits_follow_from_the_stated_covariance() -> None:
    layout = sound_calibration().layout
    bounds, known = mirror_bounds(layout), layout.uncertainty
    assert known is not None
    narrow = layout.replaced(uncertainty=known.replaced(covariance=0.25 * known.covariance))
    for name, (sigma, factor) in mirror_bounds(narrow).items():
        assert (sigma, factor) == pytest.approx((0.5 * bounds[name][0], bounds[name][1]), rel=1e-9)
    metrics = {name: Metric(value=2.0 * sigma, unit="1") for name, (sigma, _) in bounds.items()}
    assert all(metric.passed for metric in bounded(metrics, bounds).values())
    assert not bounded(metrics, {name: (sigma / 4.0, factor) for name, (sigma, factor) in bounds.items()})[
        "distance_error_max_mm"
    ].passed


def test_errors_within_the_covariance_are_within_the_limits_as_often_as_stated() -> None:
    layout = sound_calibration().layout
    assert layout.uncertainty is not None
    covariance = mirror_covariance(layout.uncertainty)
    random = np.random.default_rng(3)
    root = np.linalg.cholesky(covariance + 1e-12 * np.trace(covariance) * np.eye(len(covariance)))
    limits = {name: sigma * factor for name, (sigma, factor) in mirror_bounds(layout).items()}
    worst = dict.fromkeys(limits, 0.0)
    for _ in range(200):
        moved = layout.virtual_centres_in_rig_mm.reshape(-1, 3) + (root @ random.standard_normal(len(root))).reshape(
            -1, 3
        )
        mirrors = [tilted_to(mirror, centre) for mirror, centre in zip(layout.mirrors, moved, strict=True)]
        found = mirror_errors(layout.replaced(mirrors=tuple(mirrors)), layout)
        worst = {name: max(worst[name], found[name].value) for name in limits}
    for name, limit in limits.items():
        assert 0.5 * limit < worst[name] < 1.2 * limit, name
