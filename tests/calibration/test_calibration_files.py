"""A calibration becomes five files, and corners in files calibrate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mirrorcam.calibration.calibration_files import calibrate_files, write_calibration
from mirrorcam.calibration.calibration_request import CalibrationRequest
from mirrorcam.core.values import InputError
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import save_board
from mirrorcam.run.run_page import read_metrics
from tests.optics.calibration.sound_calibration import BOARD, nominal_layout, sound_calibration


def test_files_hold_the_calibration(tmp_path: Path) -> None:
    calibration = sound_calibration()
    write_calibration(calibration, tmp_path, command="mirrorcam test")
    names = ["corners.csv", "layout.json", "metrics.json", "report.html", "residuals.png"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert Layout.load(tmp_path / "layout.json") == calibration.layout
    assert read_metrics(tmp_path / "metrics.json") == calibration.metrics
    assert "mirrorcam test" in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.fixture
def corner_request(tmp_path: Path) -> CalibrationRequest:
    """A request with the corners of the sound calibration as two tables, of frames with and without mirrors."""
    write_calibration(sound_calibration(), tmp_path, command="mirrorcam test")
    nominal_layout().save(tmp_path / "nominal.json")
    save_board(tmp_path / "board.toml", BOARD)
    heads, *lines = [line for line in (tmp_path / "corners.csv").read_text().splitlines() if line[0] != "#"]
    for name, wanted in (("mirrors.csv", False), ("bare.csv", True)):
        kept = [heads, *(line for line in lines if (",direct," in line) == wanted)]
        (tmp_path / name).write_text("\n".join(kept) + "\n")
    tables = (tmp_path / "mirrors.csv", tmp_path / "bare.csv")
    return CalibrationRequest(board=tmp_path / "board.toml", layout=tmp_path / "nominal.json", corners=tables)


def test_tables_of_corners_calibrate_as_their_pictures_did(corner_request: CalibrationRequest) -> None:
    found, first = calibrate_files((), corner_request), sound_calibration()
    assert found.pictures == first.pictures
    assert found.metrics["corners"] == first.metrics["corners"]
    for mirror, same in zip(found.layout.mirrors, first.layout.mirrors, strict=True):
        assert mirror.virtual_centre_in_rig_mm == pytest.approx(same.virtual_centre_in_rig_mm, abs=0.01)


def test_corners_without_mirrors_are_refused(corner_request: CalibrationRequest) -> None:
    with pytest.raises(InputError, match=r"bare\.csv: all corners are seen directly, expected pictures through"):
        calibrate_files((), corner_request.replaced(corners=corner_request.corners[1:]))


def test_mirrors_of_another_surface_are_fitted_from_the_thickness_found_first(
    corner_request: CalibrationRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first fit is of the layout as it is, the second of plates whose thickness is free."""
    fits: list[tuple[Layout, RequestedModel]] = []

    def fit(
        seen: object, base: object, layout: Layout, corners: object, *, model: RequestedModel, names: object
    ) -> Any:
        fits.append((layout, model))
        return sound_calibration()

    monkeypatch.setattr("mirrorcam.calibration.calibration_files.calibrate_corners", fit)
    calibrate_files((), corner_request.replaced(model=RequestedModel.parse("fisheye+bend+auto+second_surface")))
    (plain, first), (plates, second) = fits
    assert first == RequestedModel(lens="fisheye")
    assert second == RequestedModel(lens="fisheye", additions=("sheet", "bend"), auto=True)
    assert [layout.mirrors[0].is_second_surface for layout in (plain, plates)] == [False, True]
    calibrate_files((), corner_request.replaced(model=RequestedModel.parse("joint+first_surface")))
    assert fits[2:] == [(plain, RequestedModel())]
