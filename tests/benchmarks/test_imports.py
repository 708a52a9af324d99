"""Benchmarks need the library and its extras, but no test framework."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
FILES = [path.relative_to(ROOT).with_suffix("") for path in (ROOT / "benchmarks").rglob("*.py")]
BENCHMARKS = sorted(".".join(file.parts) for file in FILES if file.name not in ("__init__", "mrcal_solver"))
BLOCKED = ("pytest", "_pytest", "hypothesis")
IMPORT_WITHOUT = """
import importlib, sys
for name in sys.argv[1].split():
    sys.modules[name] = None
for name in sys.argv[2:]:
    importlib.import_module(name)
"""


def imported_without(blocked: tuple[str, ...], modules: list[str]) -> subprocess.CompletedProcess[str]:
    """Import modules in a fresh interpreter in which the blocked ones cannot be imported."""
    command = [sys.executable, "-c", IMPORT_WITHOUT, " ".join(blocked), *modules]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def test_every_benchmark_is_imported_without_a_test_framework() -> None:
    assert len(BENCHMARKS) > 10
    done = imported_without(BLOCKED, BENCHMARKS)
    assert done.returncode == 0, done.stderr
