"""docs/library.md and the library example of README.md: what they name exists, and their code runs."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
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
def test_the_programs_of_the_page_and_of_the_readme_run(tmp_path: Path) -> None:
    sure = run("".join(programs(PAGE)), tmp_path)
    assert float(sure.partition("%")[0]) > 30.0
    out = tmp_path / "output" / "library"
    assert (out / "points.ply").stat().st_size > 100_000
    (tmp_path / "calibrated").mkdir()
    shutil.copy(out / "set" / "truth" / "layout.json", tmp_path / "calibrated")
    (frame,) = (out / "set" / "frames").iterdir()
    shutil.copy(frame, tmp_path / "frame.png")  # pictures are read by what they hold, not by their names
    (program,) = programs((ROOT / "README.md").read_text(encoding="utf-8"))
    printed = run(program, tmp_path)
    assert printed.startswith("(1, 3, ")
    poses = json.loads((out / "set" / "truth" / "poses.json").read_text())
    # The middle of the board, along the views; the camera does not see all of it.
    board = mirrorcam.SetRequest.model_fields["target"].get_default(call_default_factory=True)
    middle = np.array(poses["frames"][0]) @ [board.size_mm[0] / 2, board.size_mm[1] / 2, 0.0, 1.0]
    views = np.array(json.loads((out / "set" / "truth" / "layout.json").read_text())["view_from_rig"])
    depth_mm = views[2] @ middle[:3]
    assert abs(float(printed.split()[-1]) - depth_mm) < 0.1 * depth_mm
