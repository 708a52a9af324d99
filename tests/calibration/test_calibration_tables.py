"""Tables of a calibration's report: each figure in its row, with its sigma where it has one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.calibration.calibration_page import (
    camera_table,
    chance_text,
    common_table,
    mirror_table,
    model_table,
    split_table,
    view_table,
    weak_table,
)
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration, mirror_sigmas
from mirrorcam.optics.calibration.diagnostics.diagnostics import Diagnostics
from mirrorcam.optics.calibration.diagnostics.view_statistics import view_figures
from tests.optics.calibration.sound_calibration import sound_calibration


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return sound_calibration()


@pytest.fixture(scope="module")
def diagnostics(calibration: Calibration) -> Diagnostics:
    assert calibration.diagnostics is not None
    return calibration.diagnostics


def test_every_cell_has_its_head(calibration: Calibration, diagnostics: Diagnostics) -> None:
    assert diagnostics.mirrors is not None
    tables = (
        view_table(view_figures(calibration)),
        mirror_table(calibration),
        camera_table(calibration),
        common_table(diagnostics.mirrors),
        *(make(diagnostics) for make in (weak_table, model_table, split_table)),
    )
    for table in tables:
        assert table.rows
        assert {len(row) for row in table.rows} == {len(table.heads)}


def test_views_are_counted_and_one_without_inliers_has_no_residual(calibration: Calibration) -> None:
    seen = calibration.observations
    blind = replace(calibration, inliers=calibration.inliers & (seen.view != 2))
    rows = {row[0]: row for row in view_table(view_figures(blind)).rows}
    assert rows["mirror 1-0"][1:3] == ("0", "0")
    assert rows["mirror 1-0"][3] == str((seen.view == 2).sum())
    assert rows["mirror 1-0"][4:] == ("none", "none")
    used = blind.inliers & (seen.view == 1)
    assert rows["mirror 0-1"][2] == f"{used.sum():,}"
    rms = np.sqrt(np.mean(calibration.residuals_px[used] ** 2, axis=0))
    np.testing.assert_allclose([float(text) for text in rows["mirror 0-1"][4:]], rms, atol=1e-4)


def test_sigmas_of_mirrors_do_not_need_diagnostics(calibration: Calibration) -> None:
    table = mirror_table(replace(calibration, diagnostics=None))
    assert len(table.heads) == 4
    for row, (tilt, distance) in zip(table.rows, mirror_sigmas(calibration.layout), strict=True):
        assert float(row[2]) == pytest.approx(distance, rel=0.06)
        assert float(row[3]) == pytest.approx(np.degrees(tilt), rel=0.06)


def test_intrinsics_without_a_sigma_are_held(calibration: Calibration) -> None:
    held = replace(calibration, layout=calibration.layout.replaced(uncertainty=None))
    assert {row[2] for row in camera_table(held).rows} == {"held"}
    rows = {row[0]: row for row in camera_table(calibration).rows}
    assert rows["fx px"][1] == f"{calibration.layout.camera.fx_px:.3f}"
    assert float(rows["fx px"][2]) > 0.0


def test_one_model_is_selected_and_those_nested_in_it_are_named(diagnostics: Diagnostics) -> None:
    first = replace(diagnostics.comparisons[0], name="paper", against=None)
    names = {"joint": "paper", "joint+bend": "joint", "joint+sheet": "joint"}
    others = tuple(
        replace(first, name=name, against=against, chance=1e-9, information_gain=9.0, supported=name != "joint+sheet")
        for name, against in names.items()
    )
    table = model_table(replace(diagnostics, model_name="joint+bend", comparisons=(first, *others)))
    assert [str(row[-1]) for row in table.rows] == ["nested", "nested", '<b class="pass">selected</b>', "no"]
    assert table.rows[0][3:7] == ("", "", "", "")
    assert [str(row[0]) for row in table.rows][2] == "<b>joint+bend</b>"
    rejected = model_table(replace(diagnostics, model_name="paper", comparisons=(first, *others)))
    assert [str(row[-1]) for row in rejected.rows].count('<b class="fail">supported</b>') == 2


def test_held_out_frames_are_open_where_the_likelihood_leaves_it_to_them(diagnostics: Diagnostics) -> None:
    supported = replace(
        diagnostics.comparisons[0],
        name="joint",
        against="paper",
        chance=1e-9,
        information_gain=9.0,
        held_out_rms_px=float("nan"),
        held_out_gain=float("nan"),
    )
    unneeded = replace(supported, chance=0.4)
    known = replace(supported, held_out_rms_px=0.05, held_out_gain=3.21)
    rows = model_table(replace(diagnostics, comparisons=(supported, unneeded, known))).rows
    assert [row[6] for row in rows] == ["open", "not needed", "0.05"]
    assert [row[7][:3] for row in rows] == ["", "", "3.2"]


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "< 0.001"), (0.00099, "< 0.001"), (0.001, "0.001"), (0.4567, "0.457"), (1.0, "1.000")]
)
def test_chances_are_told_in_thousandths(value: float, text: str) -> None:
    assert chance_text(value) == text
