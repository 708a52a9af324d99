"""The guard sees what a bad attempt does, and the small part of every category has no wrong outcome."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks.robustness import guard
from benchmarks.robustness.__main__ import categories
from benchmarks.robustness.guard import Category, run_monitored, tally


@pytest.mark.slow
def test_errors_hangs_and_memory_are_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "MAX_MEMORY_BYTES", 50_000_000)

    def fails(seed: int, folder: Path) -> str:
        raise KeyError("no such key")

    def hangs(seed: int, folder: Path) -> str:
        time.sleep(30)
        return ""

    def grows(seed: int, folder: Path) -> str:
        np.ones(1_000_000_000 // 8).sum()
        return ""

    assert run_monitored(fails, 0) == "traceback: KeyError: 'no such key'"
    assert run_monitored(hangs, 0, 0.2) == "took longer than 0.2 s"
    assert "MB of memory" in run_monitored(grows, 0)


def test_files_elsewhere_are_wrong(tmp_path: Path) -> None:
    def writes(seed: int, folder: Path) -> str:
        (tmp_path / "file").write_text("x")
        return ""

    assert run_monitored(writes, 0) == f"writes {tmp_path / 'file'}"


def faulty(seed: int, folder: Path) -> str:
    raise AttributeError(f"attempt {seed}")


@pytest.mark.slow
def test_attempts_are_made_in_processes_and_tallied_by_seed() -> None:
    found = tally(Category("odd", 100, faulty), range(4), workers=2)
    assert (found.tried, found.right) == (4, 0)
    assert "traceback: AttributeError" in found.wrong[3]


@pytest.mark.parametrize("name", categories())
def test_a_part_of_every_category_has_no_wrong_outcome(name: str) -> None:
    category = categories()[name]
    outcomes = {seed: run_monitored(category.attempt, seed, category.max_s) for seed in range(category.tested)}
    assert {seed: outcome for seed, outcome in outcomes.items() if outcome} == {}
