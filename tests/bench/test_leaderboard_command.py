"""`mirrorcam leaderboard` from the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam import cli
from tests.bench.test_leaderboard_files import written
from tests.command_line import assert_refused_here, results


def test_a_page_and_tables_of_two_calibrators(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ours, theirs = (
        written(tmp_path / f"{name}.json", errors)
        for name, errors in (("ours", {"a": 0.2, "b": 0.1}), ("theirs", {"a": 0.1, "b": None}))
    )
    out = tmp_path / "out"
    line = ["leaderboard", f"ours={ours}", f"theirs={theirs}", "--not-run", "other=no wheel"]
    files = ["--out", f"{out}/page.html", "--markdown", f"{out}/board.md", "--json", f"{out}/board.json"]
    assert cli.main([*line, *files]) == 0
    assert results(out) == ["board.json", "board.md", "page.html"]
    printed = capsys.readouterr().out
    assert printed.index("theirs") < printed.index("ours")  # better on the common set
    assert "theirs failed on b: no corners" in printed


def test_bad_input_is_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = written(tmp_path / "1.json", {"a": 0.1})
    assert_refused_here(["leaderboard", str(file)], capsys, "expected NAME=FILE")
    twice = ["leaderboard", f"one={file}", f"one={file}", "--out", f"{tmp_path}/page.html"]
    assert_refused_here(twice, capsys, "one: the set a appears twice")
    assert not (tmp_path / "page.html").exists()
