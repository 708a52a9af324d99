"""Tolerances: zero, of a hobby printer, a selection, and scaled."""

from __future__ import annotations

import pytest

from mirrorcam.core.values import InvalidValue
from mirrorcam.optics.geometry.tolerances import WORKMANSHIP, Tolerances

CAMERA = ("focal_percent", "centre_px", "distortion_mean", "distortion_sigma")


def test_none_is_a_camera_as_designed() -> None:
    none = Tolerances.none()
    assert {*WORKMANSHIP, *CAMERA} == set(Tolerances.model_fields)
    for name in (*WORKMANSHIP, "focal_percent", "centre_px"):
        assert getattr(none, name) == 0.0
    assert none.distortion_mean == none.distortion_sigma == (0.0,) * 5


def test_a_hobby_printer_leaves_nothing_exact_but_the_camera() -> None:
    hobby = Tolerances.hobby()
    assert all(getattr(hobby, name) > 0 for name in WORKMANSHIP)
    assert hobby.only(*CAMERA) == Tolerances.none()


def test_precision_scales_what_is_printed_and_assembled_and_not_the_camera() -> None:
    tolerances = Tolerances(sheet_thickness_mm=0.1, camera_offset_mm=0.4, camera_turn_deg=0.6)
    twice = tolerances.times(2.0)
    for name in WORKMANSHIP:
        assert getattr(twice, name) == 2.0 * getattr(tolerances, name) > 0
    for name in CAMERA:
        assert getattr(twice, name) == getattr(tolerances, name)


def test_only_keeps_what_it_names() -> None:
    only = Tolerances().only("tilt_deg", "distortion_mean")
    assert (only.tilt_deg, only.distortion_mean) == (0.3, Tolerances().distortion_mean)
    assert only.replaced(tilt_deg=0.0, distortion_mean=(0.0,) * 5) == Tolerances.none()


@pytest.mark.parametrize("changes", [{"tilt_deg": -0.1}, {"centre_px": float("nan")}, {"distortion_mean": (0.1,)}])
def test_what_is_no_tolerance_is_refused(changes: dict[str, object]) -> None:
    with pytest.raises(InvalidValue, match=next(iter(changes))):
        Tolerances(**changes)
