"""Motions of mirrors and their effect on virtual centres."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.drift.mirror_motions import (
    calibration_covariance,
    centre_changes,
    centre_rows,
    common_covariance,
    covariance_of_centres,
    hinged_covariance,
    motion_covariance,
    rotation_jacobian,
)
from mirrorcam.optics.drift.scene_fit import parameter_names
from tests.optics.drift.calibrated_device import device, turned


def test_the_derivative_of_the_rotation_agrees_with_differences() -> None:
    layout = device().truth
    names = parameter_names(layout)
    mirror = layout.mirrors[3]
    turn = np.cross(mirror.normal_in_rig, [0.3, -0.5, 0.8]) * 0.001
    centre = turned(layout, 3, np.degrees(turn)).mirrors[3].virtual_centre_in_rig_mm
    change = np.zeros(len(names))
    change[[names.index(f"mirror 3 {axis}_mm") for axis in "xyz"]] = centre - mirror.virtual_centre_in_rig_mm
    assert rotation_jacobian(layout, names, 3) @ change == pytest.approx(turn, abs=2e-3 * float(np.linalg.norm(turn)))


def test_rotations_about_the_centre_agree_with_differences() -> None:
    layout = device().truth
    mirror, turn = layout.mirrors[3], np.array([0.0003, -0.0005, 0.0008])
    moved = turned(layout, 3, np.degrees(turn)).mirrors[3].virtual_centre_in_rig_mm - mirror.virtual_centre_in_rig_mm
    assert turn @ centre_changes(mirror) == pytest.approx(moved, abs=2e-3 * float(np.linalg.norm(moved)))


def test_a_shift_and_a_rotation_have_their_variances() -> None:
    mirror = device().truth.mirrors[3]
    n = mirror.normal_in_rig
    assert n @ motion_covariance(mirror, 0.0, 0.3) @ n == pytest.approx(0.6**2)
    across = np.linalg.svd(n[None])[2][1]
    size = 2.0 * mirror.distance_mm * np.radians(0.02)
    assert across @ motion_covariance(mirror, 0.02, 0.0) @ across == pytest.approx(size**2)
    assert n @ hinged_covariance(mirror, 0.02) @ n > n @ motion_covariance(mirror, 0.02, 0.0) @ n


def test_covariances_are_placed_by_the_names_of_the_parameters() -> None:
    layout = device().calibrated
    names = parameter_names(layout)
    assert centre_rows(names, 1).tolist() == [names.index(f"mirror 1 {axis}_mm") for axis in "xyz"]
    covariance = covariance_of_centres({2: np.eye(3)}, names)
    assert np.trace(covariance) == 3.0
    assert covariance[np.ix_(centre_rows(names, 2), centre_rows(names, 2))] == pytest.approx(np.eye(3))
    known = layout.uncertainty
    assert known is not None
    place, row = known.parameters.index("fx_px"), names.index("fx_px")
    assert calibration_covariance(layout, names)[row, row] == known.covariance[place, place]
    assert not calibration_covariance(device().truth, names).any()
    assert np.linalg.matrix_rank(common_covariance(layout, names)) == 7
