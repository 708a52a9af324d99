"""`mirrorcam score suite`: exit codes, what it prints, and what it refuses."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

from mirrorcam import cli
from mirrorcam.bench.evaluation import read_evaluation
from mirrorcam.bench.score_request import EvaluationRequest
from tests.command_line import assert_refused_here

needs_renderer = pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")
NOMINAL = 'cp "$MIRRORCAM_SET/layout.json" "$MIRRORCAM_RESULT"'


@pytest.mark.slow
@needs_renderer
def test_it_exits_by_what_it_found_and_keeps_files_of_others(
    finished_suite: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    command = ["score", "suite", str(finished_suite), "--out", str(out), "--command"]
    assert cli.main([*command, NOMINAL]) == 0
    assert "RMS px" in capfd.readouterr().out
    assert read_evaluation(out / "evaluation.json").passed
    again = ["--baseline", str(out / "evaluation.json"), "--worse-by", "1.01"]
    assert cli.main([*command, f"{NOMINAL} && true", *again]) == 0
    assert "1.00 \N{MULTIPLICATION SIGN}" in capfd.readouterr().out
    assert cli.main([*command, "exit 1"]) == 1
    assert "one has no score: the command ended with exit code 1" in capfd.readouterr().out
    assert not (out / "pictures").exists()
    (out / "summary.md").write_text("mine", encoding="utf-8")
    assert cli.main([*command, NOMINAL]) == 2
    assert (out / "summary.md").read_text(encoding="utf-8") == "mine"


def test_it_refuses_what_it_cannot_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused_here(["score", "suite", ".", "--command", "true"], capfd, "expected the manifest of one suite")
    assert_refused_here(
        ["score", "suite", ".", "--command", "true", "--worse-by", "2"], capfd, "--worse-by: expected --baseline"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_command_is_needed() -> None:
    with pytest.raises(ValueError, match="command"):
        EvaluationRequest(command="")
