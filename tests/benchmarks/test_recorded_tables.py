"""Tables that benchmarks record, from figures as they find them."""

from __future__ import annotations

import importlib
from typing import Any

import pytest

from benchmarks import calibration_foreign, calibration_hard, calibration_mrcal, light_field_motion
from benchmarks.calibration_foreign import LENS, Report
from benchmarks.calibration_mrcal import OWN, Compared
from benchmarks.drift import TURNS_DEG, Outcome, column, recorded
from benchmarks.drift import Report as Column
from benchmarks.light_field_motion import Sums
from benchmarks.records import table
from mirrorcam.optics.base.values import Metric


def test_sets_of_another_renderer_stand_beside_each_other_with_what_was_found_before() -> None:
    found = Report("0.18 % of 7,224", "0.0008°, 0.0034 mm", "1.32", "", "Good to use")
    made = calibration_foreign.tabled({"a_ch": found, "mine": found})
    assert made.columns == ("", "ChArUco", "mine")
    assert made.rows[0] == ("corners dropped", "0.18 % of 7,224 (was 4.7 %)", "0.18 % of 7,224")


def test_hard_pictures_of_two_sets_stand_beside_each_other() -> None:
    rows = [("no base", "6,061, 0.2 %", "0.0011°", "1.3", "Good to use"), ("two sizes", "", "", "", "refused: so")]
    one = table(("", *calibration_hard.HEAD), rows)
    made = calibration_hard.beside({"a_cb": one, "s2_ch": one})
    assert made.columns[1] == "checkerboard: corners, dropped"
    assert made.columns[5] == "acrylic: corners, dropped"
    assert made.rows[0] == ("no base", *rows[0][1:], *rows[0][1:])
    assert made.rows[1] == ("two sizes", "refused", "", "", "", "refused", "", "", "")


def compared(board: str, truth: dict[str, Any]) -> Compared:
    numbers = {"lens": [900.0, 901.0, 640.0, 352.0, 0, 0, 0, 0, 0], "sigma": [0.01] * 9, "rms_px": [0.01, 0.02]}
    found = {name: numbers | {"corners": corners, "seconds": 2.0} for name, corners in ((OWN, 99), ("mrcal", 90))}
    off_px = {OWN: (0.0005, 0.0006), "mrcal": (0.0008, 0.0009)}
    return Compared(board, 100, found, LENS, {"truth": truth}, off_px)


def test_mrcal_has_columns_of_its_own_and_of_acrylic_only_how_far_lenses_are_off() -> None:
    truth = {"lens": [900.0, 901.0, 640.0, 352.8, 0, 0, 0, 0, 0]}
    figures, made = calibration_mrcal.recorded(
        [compared("ChArUco", truth | {"cameras": []}), compared("ChArUco", truth)]
    )
    assert figures["left_out_charuco_percent"] == pytest.approx(10.0)
    assert (figures["acrylic_lens_own_px"], figures["acrylic_lens_mrcal_px"]) == (0.0005, 0.0008)
    rows = {row[0]: row[1:] for row in made.rows}
    assert made.columns == ("", f"ChArUco: {OWN}", "mrcal")
    assert rows["cy, px (truth 352.8)"] == ("352.000 ± 0.010",) * 2
    assert rows["seconds"] == ("2.0, with model selection", "2.0")


def outcome(turn_deg: float, error_deg: float, *, alarm: bool, only_right: bool = True) -> Outcome:
    return Outcome(turn_deg, 0.1, alarm, only_right, error_deg, 100.0 * turn_deg, True, 0.1)


def test_recordings_of_moved_mirrors_have_alarms_and_the_largest_error_where_there_was_one() -> None:
    found = [outcome(size, size / 10.0, alarm=size > 0.01) for size in TURNS_DEG]
    found += [outcome(0.05, 0.001, alarm=True, only_right=False), outcome(0.0, 0.5, alarm=False)]
    cells = column(found)
    assert cells == ("0", "0", "0", "1; 0.002°", "2; 0.005°; 1 of a wrong mirror", "0.5 to 5.0")
    figures, made = recorded({"simulated, of 2": Column(cells, 0.2, 0.8, 1), "`a`, of 2": Column(cells, -0.2, 0.1, 2)})
    assert figures == {"largest_simulated": 0.2, "largest_of_sets": -0.2, "exponential_tail": 0.8, "told_scenes": 1}
    assert made.rows[0] == ("none", "0", "0")


def test_scenes_of_a_kind_of_sequence_share_a_row_and_what_they_have_alike() -> None:
    one = Sums(536.2, 0.003, 0.021, 0.54, 1, 3.9, 12.0)
    other = Sums(536.2, 0.005, 0.022, 0.50, 1, 2.1, 6.0)
    row = light_field_motion.by_kind({"loop": [one, other]}).rows[0]
    assert row == ("loop", "536 mm", "0.003, 0.005 %", "0.02 mm", "0.54, 0.50", "1", "3.9, 2.1 %; 12, 6 mm")


def test_times_of_the_studio_past_their_limit_are_bold() -> None:
    pytest.importorskip("playwright")
    studio = importlib.import_module("benchmarks.studio")
    figures = {
        f"preview_{which}_{count}x{count}": Metric(value=90.0, unit="ms")
        for which in ("p50", "p95")
        for count in (3, 5)
    }
    made = studio.tabled(figures, {3: [1.0, 2.2, 1.3, 1.1], 5: [3.5, 3.7, 3.6, 3.5]})
    assert made.rows[0][1:] == ("90 / 90 ms", "90 / 90 ms", "150 ms")
    assert made.rows[1][1:] == ("**2.2 s**", "3.7 s", "1.5, 5 s")
    assert "the others: 1.0 to 1.3 s, 3.5 to 3.6 s" in made.rows[1][0]
