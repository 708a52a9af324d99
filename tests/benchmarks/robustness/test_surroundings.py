"""Some of the surroundings, of the quickest command, and what the table looks for is found."""

from __future__ import annotations

from pathlib import Path
from subprocess import CompletedProcess

import pytest

from benchmarks.robustness.guard import watched
from benchmarks.robustness.surroundings import CASES, attempt, fault


@pytest.mark.parametrize("case", [("full disk at 100 bytes", ""), ("in a read-only folder", ""), ("output", "-dash")])
def test_a_command_ends_well_in_odd_surroundings(case: tuple[str, str], tmp_path: Path) -> None:
    seed = CASES.index(("cameras", *case))
    assert watched(attempt, seed, 300.0) == ""


def ended(code: int, said: str, found: dict[str, str], *, named: bool = False) -> str:
    return fault(CompletedProcess((), code, b"", said.encode()), found, {"a": "1", "b": "2"}, named=named)


def test_faults_are_found() -> None:
    assert ended(0, "", {"a": "1", "b": "2"}) == ""
    assert ended(2, "mirrorcam: no\n", {"a": "1"}) == ""
    assert ended(0, "", {"a": "1"}) == "done without all of its files"
    assert ended(2, "mirrorcam: no\n", {"a": "0"}) == "left a"
    assert ended(2, "mirrorcam: no\n", {"c": "1"}, named=True) == ""
    assert ended(2, "mirrorcam: no\nno\n", {}) == "message of 2 lines: 'mirrorcam: no\\nno'"
    assert ended(1, "Traceback\nOSError: no\n", {}) == "traceback: OSError: no"
    assert ended(-9, "", {}) == "exit code -9: ''"
    assert ended(0, "a warning", {"a": "1", "b": "2"}) == "says 'a warning'"
