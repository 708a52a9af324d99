"""Runs the command in a process, and checks that what it refuses takes one line and leaves no file."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from mirrorcam import cli
from mirrorcam.core.disk.output_folder import HIDDEN


def mirrorcam(folder: Path, arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mirrorcam", *arguments.split()]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)


def results(folder: Path) -> list[str]:
    """Names of everything that a command has put into a folder, without its own record of it."""
    return sorted(path.name for path in folder.iterdir() if path.name != HIDDEN)


def assert_refused(folder: Path, arguments: str, *expected: str) -> None:
    """Exit 2, one line on standard error that holds the expected words, and not one new file."""
    before = sorted(folder.rglob("*"))
    result = mirrorcam(folder, arguments)
    assert_one_line(result.stderr, *expected)
    assert result.returncode == 2
    assert sorted(folder.rglob("*")) == before


def assert_refused_here(arguments: Sequence[str], capture: pytest.CaptureFixture[str], *expected: str) -> None:
    """In this process: exit 2 and one line on standard error that holds the expected words."""
    capture.readouterr()
    assert cli.main(arguments) == 2
    assert_one_line(capture.readouterr().err, *expected)


def assert_one_line(said: str, *expected: str) -> None:
    assert said.count("\n") == 1, said
    assert said.startswith("mirrorcam: ")
    for words in expected:
        assert words in said
