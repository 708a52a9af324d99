"""Calibration of sets that another renderer made, which the project does not ship: precise, and sure of no more."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.calibration_foreign import nees
from mirrorcam.calibration.calibration_files import calibrate_files
from mirrorcam.calibration.calibration_request import CalibrationRequest
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.calibration.diagnostics.verdict import check_solution
from mirrorcam.optics.calibration.diagnostics.view_statistics import view_figures
from mirrorcam.optics.geometry.layout import Layout


def request_of(folder: Path) -> CalibrationRequest:
    return CalibrationRequest(board=folder / "board.toml", layout=folder / "layout.json", base=(folder / "base",))


def state(calibration: Calibration) -> str:
    return check_solution(calibration, view_figures(calibration)).state


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a_ch", "a_cb"])
def test_a_clean_set_is_good_to_use_and_as_uncertain_as_it_is_wrong(foreign_sets: Path, name: str) -> None:
    found = calibrate_files([foreign_sets / name / "frames"], request_of(foreign_sets / name))
    truth = json.loads((foreign_sets / name / "truth" / "truth.json").read_text())
    assert state(found) == "good"
    assert (~found.inliers).mean() < 0.01
    assert nees(found.layout, truth, lambda _: True) < 2.0
    true = np.array(truth["C"])
    normals = found.layout.virtual_centres_in_rig_mm
    cosines = np.sum(normals * true, axis=1) / np.linalg.norm(normals, axis=1) / np.linalg.norm(true, axis=1)
    assert np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))).max() < 0.003


@pytest.mark.slow
def test_plates_are_measured_also_from_a_layout_that_knows_none(foreign_sets: Path, tmp_path: Path) -> None:
    folder = foreign_sets / "s2_ch"
    Layout.load(folder / "layout.json").with_surface("first").save(tmp_path / "layout.json")
    model = RequestedModel.parse("second_surface+auto")
    request = request_of(folder).replaced(layout=tmp_path / "layout.json", model=model)
    found = calibrate_files([folder / "frames"], request, detections=tmp_path / "corners")
    known = found.layout.uncertainty
    assert known is not None
    place = known.parameters.index("sheet_mm")
    thickness, sigma = found.layout.mirrors[0].thickness_mm, float(np.sqrt(known.covariance[place, place]))
    assert abs(thickness - 2.0) < min(3.0 * sigma, 0.02)
    assert state(found) == "good"
