"""The benchmark of backs: figures from the checks of devices, lines that are read back, and what is not built again."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from benchmarks import backs
from benchmarks.backs import BackResult, read_results, result_of
from mirrorcam.cad.plan.back_table import BACKS
from mirrorcam.core.values import Metric

CHECKS = {
    "device.mass_g": Metric(value=391.6, unit="g"),
    "device.price": Metric(value=117.6, unit="EUR"),
    "device.back_stress_mpa": Metric(value=1.24, unit="MPa", limit=5.0),
    "adapter_hook.wall_mm": Metric(value=1.91, unit="mm", limit=1.2, lower_is_better=False),
    "adapter_jaw.wall_mm": Metric(value=1.1, unit="mm", limit=1.2, lower_is_better=False),
    "mount.wall_mm": Metric(value=0.5, unit="mm", limit=0.4, lower_is_better=False),
}


def test_a_result_has_the_thinnest_wall_of_the_back_and_what_failed() -> None:
    result = result_of("monitor", CHECKS)
    assert (result.wall_mm, result.failed, result.checks) == (1.1, ("adapter_jaw.wall_mm",), 4)
    assert (result.print_minutes, result.tips_at_deg, result.stress_mpa) == (None, None, 1.24)


def test_backs_that_are_there_are_not_built_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    built: list[str] = []

    def build(layout: object, folder: Path, hardware: object, *, workers: int) -> dict[str, Metric]:
        built.append(folder.name)
        return CHECKS

    monkeypatch.setattr(backs, "build_parts", build)
    monkeypatch.setattr(sys, "argv", ["backs", str(tmp_path)])
    backs.main()
    assert built == list(BACKS)
    first = capsys.readouterr().out
    backs.main()
    assert built == list(BACKS)
    assert capsys.readouterr().out == first
    assert read_results(tmp_path / "backs.jsonl")["arca"] == result_of("arca", CHECKS)


def test_a_result_survives_its_line() -> None:
    result = result_of("vesa", CHECKS)
    assert BackResult.model_validate_json(result.model_dump_json()) == result
