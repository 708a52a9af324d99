"""The design beside its start: what is compared, and the record of it."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from benchmarks import design_start
from benchmarks.design_start import FOLDS_DEG, figures_of, spec_of
from benchmarks.records import Records
from mirrorcam.optics.geometry.layout import Layout

LAYOUT = Layout.load(Path(__file__).parents[1] / "data" / "default_layout.json")


def test_designs_are_compared_at_the_depths_that_they_are_for() -> None:
    assert [spec_of(fold_deg).fold_deg for fold_deg in FOLDS_DEG] == [90.0, 120.0]
    assert spec_of(90.0).depths_mm == (300.0, 500.0)
    figures = figures_of(LAYOUT)
    assert figures["usable_efficiency_500mm"] == LAYOUT.metrics["usable_efficiency_500mm"].value
    assert len(figures) == 5


def test_the_record_has_the_designs_and_their_starts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(design_start, "design", lambda _: LAYOUT)
    monkeypatch.setattr(sys, "argv", ["design_start", "--json", str(tmp_path / "new.json")])
    design_start.main()
    record = Records.load(tmp_path / "new.json").records["design_start"]
    assert record.values["optimised_120.grid_error"].value == LAYOUT.metrics["grid_error"].value
    assert record.values["parabola_90.grid_error"].value > 2.0 * record.values["optimised_90.grid_error"].value
