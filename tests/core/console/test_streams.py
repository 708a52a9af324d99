"""Help and errors can be read where the terminal or the locale knows ASCII alone."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

PLAIN = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "mirrorcam", *arguments]
    return subprocess.run(command, cwd=folder, env=os.environ | PLAIN, capture_output=True, timeout=120, check=False)


@pytest.mark.parametrize("arguments", [("--help",), ("design", "--help")])
def test_help_is_ascii(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    result = run(tmp_path, *arguments)
    assert (result.returncode, result.stderr) == (0, b"")
    assert b"mirrorcam" in result.stdout
    result.stdout.decode("ascii")


def test_a_refusal_is_ascii_and_one_line(tmp_path: Path) -> None:
    result = run(tmp_path, "cad", "f\N{LATIN SMALL LETTER U WITH DIAERESIS}r \N{SNOWMAN}.json")
    assert result.returncode == 2
    said = result.stderr.decode("ascii")
    assert said.count("\n") == 1
    assert said.endswith(".json: no such file\n")


@pytest.mark.slow
def test_matplotlib_makes_no_remarks_on_its_folders(tmp_path: Path) -> None:
    (tmp_path / "home").write_text("no folder")
    program = (
        "from mirrorcam.core.console.streams import quieten_libraries; quieten_libraries(); import matplotlib.pyplot"
    )
    others = {name: value for name, value in os.environ.items() if not name.startswith(("XDG", "MPL"))}
    command = [sys.executable, "-c", program]
    done = subprocess.run(
        command, env=others | {"HOME": str(tmp_path / "home")}, capture_output=True, timeout=120, check=False
    )
    assert (done.returncode, done.stderr) == (0, b"")


def test_characters_are_spelled_where_the_stream_lacks_them(tmp_path: Path) -> None:
    program = (
        "from mirrorcam.core.console.streams import make_readable; make_readable()\n"
        "from mirrorcam.core.console.progress import say, print_metrics\n"
        "from mirrorcam.core.values import Metric\n"
        "say('a', '3 \\u00d7 3, 5\\u00b0 \\u2603')\n"
        "print_metrics({'x': {'area': Metric(value=1.0, unit='mm2', limit=2.0)}})\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", program], env=os.environ | PLAIN, cwd=tmp_path, capture_output=True, check=True
    )
    said = result.stdout.decode("ascii")
    assert "3 x 3, 5deg \\u2603" in said
    assert "<=" in said or "pass" in said
