"""The table of parts from the figures of a run, and the record that its benchmark writes."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from benchmarks import default_run
from benchmarks.default_run import parts_table
from benchmarks.records import Records
from mirrorcam.optics.base.files import write_metrics
from mirrorcam.optics.base.values import Metric

METRICS = {
    "validation.held_out_rms_x_px": Metric(value=0.013, unit="px", limit=0.06),
    "cad.fit_coupon.volume_cm3": Metric(value=9.97, unit="cm3"),
    "cad.fit_coupon.wall_mm": Metric(value=1.2, unit="mm"),
    "cad.fit_coupon.overhang_mm2": Metric(value=0.0, unit="mm2", limit=0.0),
    "cad.mirror_holder.volume_cm3": Metric(value=85.36, unit="cm3"),
    "cad.mirror_holder.wall_mm": Metric(value=1.6, unit="mm"),
    "cad.mirror_holder.overhang_mm2": Metric(value=0.0, unit="mm2", limit=0.0),
    "cad.mirror_holder.print_minutes": Metric(value=255.2, unit="min"),
    "cad.mirror_holder.print_g": Metric(value=53.1, unit="g"),
    "cad.mirror_holder.support_filament_mm": Metric(value=0.0, unit="mm", limit=0.0),
}


def test_parts_from_the_largest_with_dashes_without_a_slicer() -> None:
    assert parts_table(METRICS).rows == (
        ("mirror holder", "85.4 cm³", "53 g", "4:15 h", "1.60 mm", "0 mm², 0 mm of filament"),
        ("fit coupon", "10.0 cm³", "-", "-", "1.20 mm", "0 mm², -"),
    )


def test_the_record_holds_every_figure_of_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def run(arguments: list[str]) -> int:
        write_metrics(Path(arguments[-1]) / "metrics.json", METRICS)
        return 0

    monkeypatch.setattr(default_run, "mirrorcam", run)
    monkeypatch.setattr(sys, "argv", ["default_run", str(tmp_path / "run"), "--json", str(tmp_path / "new.json")])
    assert default_run.main() == 0
    found = Records.load(tmp_path / "new.json").records
    assert found["default_run"].command == "mirrorcam run"
    assert {name: each.value for name, each in found["default_run"].values.items()} == {
        name: each.value for name, each in METRICS.items()
    }
    assert found["default_parts"].table == parts_table(METRICS)


def test_a_run_that_fails_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(default_run, "mirrorcam", lambda _: 1)
    monkeypatch.setattr(sys, "argv", ["default_run", str(tmp_path / "run"), "--json", str(tmp_path / "new.json")])
    assert default_run.main() == 1
    assert not (tmp_path / "new.json").exists()
