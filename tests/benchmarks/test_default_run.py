"""The record that the benchmark of the default run writes."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from benchmarks import default_run
from benchmarks.records import Records
from mirrorcam.core.disk.files import write_metrics
from mirrorcam.core.values import Metric

METRICS = {
    "validation.held_out_rms_x_px": Metric(value=0.013, unit="px", limit=0.06),
    "cad.mirror_holder.print_g": Metric(value=53.1, unit="g"),
}


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


def test_a_run_that_fails_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(default_run, "mirrorcam", lambda _: 1)
    monkeypatch.setattr(sys, "argv", ["default_run", str(tmp_path / "run"), "--json", str(tmp_path / "new.json")])
    assert default_run.main() == 1
    assert not (tmp_path / "new.json").exists()
