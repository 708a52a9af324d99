"""Violations: values with checked fields."""

from __future__ import annotations

import pytest

from mirrorcam.core.values import InvalidValue
from mirrorcam.optics.geometry.violation import LeastViolation, Violation

SEGMENT = [[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]]


def test_a_violation_is_written_and_read() -> None:
    violation = Violation(mirrors=(0, 1), missing_mm=1.5, place_in_rig_mm=SEGMENT)
    whole = LeastViolation(constraint="spacing", mirrors=(), violations=(violation,))
    assert LeastViolation.model_validate_json(whole.model_dump_json()) == whole


def test_a_place_must_be_a_segment() -> None:
    with pytest.raises(InvalidValue, match=r"expected \(2, 3\)"):
        Violation(mirrors=(0,), missing_mm=1.0, place_in_rig_mm=SEGMENT[:1])
