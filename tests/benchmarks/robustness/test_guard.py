"""The guard sees what a bad attempt does, and the small part of every category has no wrong outcome."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks.robustness import guard
from benchmarks.robustness.__main__ import categories
from benchmarks.robustness.guard import Category, Tally, lines, refused_well, tally, watched


def test_an_attempt_without_fault_is_right() -> None:
    seen: list[Path] = []

    def attempt(seed: int, folder: Path) -> str:
        seen.append(folder)
        (folder / "file").write_text("x")
        return ""

    assert watched(attempt, 0) == ""
    assert not seen[0].exists()


def test_errors_hangs_and_memory_are_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "LARGEST_BYTES", 50_000_000)

    def fails(seed: int, folder: Path) -> str:
        raise KeyError("no such key")

    def hangs(seed: int, folder: Path) -> str:
        time.sleep(30)
        return ""

    def grows(seed: int, folder: Path) -> str:
        np.ones(1_000_000_000 // 8).sum()
        return ""

    assert watched(fails, 0) == "traceback: KeyError: 'no such key'"
    assert watched(hangs, 0, 0.2) == "took longer than 0.2 s"
    assert "MB of memory" in watched(grows, 0)


def test_files_elsewhere_are_wrong(tmp_path: Path) -> None:
    def writes(seed: int, folder: Path) -> str:
        (tmp_path / "file").write_text("x")
        return ""

    assert watched(writes, 0) == f"writes {tmp_path / 'file'}"


def test_messages_are_one_short_line() -> None:
    assert refused_well("layout.json: no such file") == ""
    assert "2 lines" in refused_well("a\nb")
    assert "301 characters" in refused_well("a" * 301)


def test_the_table_counts_and_shows_what_is_wrong() -> None:
    table = list(lines([Tally("layouts", 10, {3: "traceback: KeyError"}, {5: 2.5}, 4.0)]))
    assert table[1].split() == ["layouts", "10", "9", "1", "1", "4"]
    assert table[2:] == ["layouts, seed 3: traceback: KeyError", "layouts, seed 5: 2.5 s of processor time"]


def faulty(seed: int, folder: Path) -> str:
    raise AttributeError(f"attempt {seed}")


def test_attempts_are_made_in_processes_and_tallied_by_seed() -> None:
    found = tally(Category("odd", 100, faulty), range(4), workers=2)
    assert (found.tried, found.right) == (4, 0)
    assert "traceback: AttributeError" in found.wrong[3]


VALID_DATA = {"videos": {6}}
"""Seeds that are known to be wrong: flipped bits that give the data of another picture, as no reader can tell."""


@pytest.mark.parametrize("name", categories())
def test_a_part_of_every_category_has_no_wrong_outcome(name: str) -> None:
    category = categories()[name]
    outcomes = {seed: watched(category.attempt, seed, category.longest_s) for seed in range(category.tested)}
    wrong = {seed: outcome for seed, outcome in outcomes.items() if outcome}
    assert {seed: each for seed, each in wrong.items() if not each.endswith("valid data")} == {}
    assert set(wrong) == VALID_DATA.get(name, set())
