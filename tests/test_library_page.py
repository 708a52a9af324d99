"""docs/library.md: what it names exists, and its code runs."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import mirrorcam

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "library.md").read_text(encoding="utf-8")


def programs(page: str) -> list[str]:
    """The Python code of a page."""
    return re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)


def run(program: str, folder: Path) -> str:
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=folder, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


def test_the_tables_name_the_public_names() -> None:
    section = PAGE[PAGE.index("## Public names") : PAGE.index("## Everything else")]
    cells = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    named = {name for cell in cells for name in re.findall(r"`([A-Za-z_]+)", cell)}
    assert sorted(named) == mirrorcam.__all__


def test_the_examples_are_listed() -> None:
    listed = set(re.findall(r"\(\.\./examples/(\w+\.py)\)", PAGE))
    assert listed == {path.name for path in (ROOT / "examples").glob("*.py")}


@pytest.mark.slow
@pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")
def test_the_programs_of_the_page_run(tmp_path: Path) -> None:
    sure = run("".join(programs(PAGE)), tmp_path)
    assert float(sure.partition("%")[0]) > 30.0
    out = tmp_path / "output" / "library"
    assert (out / "points.ply").stat().st_size > 100_000
