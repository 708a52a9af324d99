"""A leaderboard from files of evaluations, which may be anyone's."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from mirrorcam.bench.evaluation import Evaluation
from mirrorcam.bench.leaderboard_files import read_leaderboard, texts, write_leaderboard
from mirrorcam.bench.scores.leaderboard import TriedSet
from mirrorcam.bench.scores.score_report import ScoredSet, ScoreReport
from mirrorcam.core.values import InputError, Metric


def scored(name: str, rms_px: float) -> ScoredSet:
    return ScoredSet(
        name=name,
        calibration="cameras.yaml",
        format="opencv",
        layout="0",
        distance_mm=400.0,
        alignment="rigid",
        mirrored=False,
        views={"view_0_0": "left"},
        missing=(),
        figures={"rms_px": Metric(value=rms_px, unit="px")},
        not_given={},
        notes=(),
        checks=(),
    )


def evaluation(errors: Mapping[str, float | None], command: str = "run") -> Evaluation:
    """One whose sets have these errors; None: failed."""
    given = {name: value for name, value in errors.items() if value is not None}
    scores = ScoreReport(
        sets=tuple(scored(name, value) for name, value in given.items()),
        over_sets={},
        checks_over_sets=(),
        passed=True,
    )
    return Evaluation(
        suite="small",
        version=1,
        command=command,
        tried=tuple(
            TriedSet(
                name=name, why="", dataset_sha256=name * 8, seconds=1.0, failure="" if name in given else "no corners"
            )
            for name in errors
        ),
        scores=scores if given else None,
        changes=(),
        passed=len(given) == len(errors),
    )


def written(path: Path, errors: Mapping[str, float | None], command: str = "run", **changed: Any) -> Path:
    content = json.loads(evaluation(errors, command).text()) | changed
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def test_files_of_one_name_are_put_together(tmp_path: Path) -> None:
    first = written(tmp_path / "1.json", {"a": 0.1, "b": None})
    second = written(tmp_path / "2.json", {"c": 0.3}, command="run --again")
    other = written(tmp_path / "3.json", {"a": 0.2, "c": 0.1})
    board = read_leaderboard([f"one={first}", f"one={second}", f"two={other}"], ["three=why not = so"])
    one = next(row for row in board.rows if row.calibrator == "one")
    assert one.rms_px == {"a": 0.1, "c": 0.3}
    assert one.failures == {"b": "no corners"}
    assert one.command == "run; run --again"
    assert board.common == ("a", "c")
    assert board.not_run == {"three": "why not = so"}


def test_an_evaluation_in_which_all_failed_has_its_row(tmp_path: Path) -> None:
    board = read_leaderboard([f"one={written(tmp_path / '1.json', {'a': None})}"])
    assert board.rows[0].failures == {"a": "no corners"}


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("here.json", "'here.json': expected NAME=FILE"),
        ("=here.json", "expected NAME=FILE"),
        ("one=", "expected NAME=FILE"),
        (f"{'n' * 101}=here.json", "1 to 100 printable characters"),
        ("one\n=here.json", "expected NAME=FILE"),
        ("one=none.json", "none.json: no such file"),
    ],
)
def test_what_names_no_file_is_refused(given: str, expected: str) -> None:
    with pytest.raises(InputError, match=expected) as caught:
        read_leaderboard([given])
    assert "\n" not in str(caught.value)


def test_a_file_that_is_no_evaluation_is_refused(tmp_path: Path) -> None:
    score = tmp_path / "score.json"
    score.write_text('{"schema": "mirrorcam.score/1", "sets": []}', encoding="utf-8")
    with pytest.raises(InputError, match=r"score.json: "):
        read_leaderboard([f"one={score}"])
    named = written(tmp_path / "named.json", {"a": 0.1}, tried=[{"name": "a\u001b[31m", "why": "", "seconds": 1.0}])
    with pytest.raises(InputError, match=r"named.json: "):
        read_leaderboard([f"one={named}"])


def test_a_set_with_neither_a_score_nor_a_failure_is_refused(tmp_path: Path) -> None:
    bare = written(tmp_path / "bare.json", {"a": 0.1}, scores=None)
    with pytest.raises(InputError, match="a: expected either a score or a failure"):
        read_leaderboard([f"one={bare}"])


def test_a_calibrator_is_not_both_run_and_not_run(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--not-run: one has an evaluation"):
        read_leaderboard([f"one={written(tmp_path / '1.json', {'a': 0.1})}"], ["one=why"])


def test_files_are_written_and_none_of_the_users_is_replaced(tmp_path: Path) -> None:
    board = read_leaderboard([f"one={written(tmp_path / '1.json', {'a': 0.1})}"])
    out = tmp_path / "out"
    files = texts(board, out / "page.html", out / "board.md", out / "board.json")
    write_leaderboard(files, force=False)
    assert json.loads((out / "board.json").read_text(encoding="utf-8"))["schema"] == "mirrorcam.leaderboard/1"
    assert (out / "board.md").read_text(encoding="utf-8").startswith("# Leaderboard: 1 calibrator on 1 set")
    before = (out / "page.html").read_bytes()
    write_leaderboard(files, force=False)  # its own files, again with the same bytes
    assert (out / "page.html").read_bytes() == before
    (out / "board.md").write_text("mine", encoding="utf-8")
    (out / "page.html").unlink()
    with pytest.raises(InputError, match=r"board\.md"):
        write_leaderboard(files, force=False)
    assert not (out / "page.html").exists()  # refused before anything is written
    assert (out / "board.md").read_text(encoding="utf-8") == "mine"


def test_one_path_for_two_files_is_refused(tmp_path: Path) -> None:
    board = read_leaderboard([f"one={written(tmp_path / '1.json', {'a': 0.1})}"])
    with pytest.raises(InputError, match="is to be written twice"):
        texts(board, tmp_path / "x", tmp_path / "x", None)
