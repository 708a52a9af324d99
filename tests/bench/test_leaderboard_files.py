"""A leaderboard from files of evaluations, which may be anyone's, and its command."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from mirrorcam import cli
from mirrorcam.bench.evaluation import Evaluation
from mirrorcam.bench.leaderboard_files import (
    EDGE,
    FILES,
    WIDTH,
    leaderboard_page,
    read_leaderboard,
    rms_chart,
    write_leaderboard,
)
from mirrorcam.bench.scores.leaderboard import Leaderboard, TriedSet, leaderboard
from mirrorcam.bench.scores.score_report import ScoredSet, ScoreReport
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric
from tests.bench.scores.test_leaderboard import attempt
from tests.command_line import assert_refused_here, results


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


def test_a_board_is_a_page_and_tables(tmp_path: Path) -> None:
    board = read_leaderboard([f"one={written(tmp_path / '1.json', {'a': 0.1})}"])
    write_leaderboard(board, tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(FILES)
    read = json.loads((tmp_path / "out" / "leaderboard.json").read_text(encoding="utf-8"))
    assert read["schema"] == "mirrorcam.leaderboard/1"
    text = (tmp_path / "out" / "leaderboard.md").read_text(encoding="utf-8")
    assert text.startswith("# Leaderboard: 1 calibrator on 1 set")


def test_a_page_and_tables_of_two_calibrators(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ours, theirs = (
        written(tmp_path / f"{name}.json", errors)
        for name, errors in (("ours", {"a": 0.2, "b": 0.1}), ("theirs", {"a": 0.1, "b": None}))
    )
    out = tmp_path / "out"
    line = ["score", "leaderboard", f"ours={ours}", f"theirs={theirs}", "--not-run", "other=no wheel"]
    assert cli.main([*line, "--out", str(out)]) == 0
    assert results(out) == ["leaderboard.html", "leaderboard.json", "leaderboard.md"]
    printed = capsys.readouterr().out
    assert printed.index("theirs") < printed.index("ours")  # better on the common set
    assert "theirs failed on b: no corners" in printed


def test_bad_input_is_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = written(tmp_path / "1.json", {"a": 0.1})
    assert_refused_here(["score", "leaderboard", str(file)], capsys, "expected NAME=FILE")
    twice = ["score", "leaderboard", f"one={file}", f"one={file}", "--out", f"{tmp_path}/out"]
    assert_refused_here(twice, capsys, "one: the set a appears twice")
    assert not (tmp_path / "out").exists()


def test_a_file_of_the_user_is_not_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = ["score", "leaderboard", f"one={written(tmp_path / '1.json', {'a': 0.1})}", "--out", f"{tmp_path}/out"]
    assert cli.main(line) == 0
    before = (tmp_path / "out" / "leaderboard.html").read_bytes()
    assert cli.main(line) == 0  # its own files, again with the same bytes
    assert (tmp_path / "out" / "leaderboard.html").read_bytes() == before
    (tmp_path / "out" / "leaderboard.md").write_text("mine", encoding="utf-8")
    assert_refused_here(line, capsys, "leaderboard.md")
    assert (tmp_path / "out" / "leaderboard.md").read_text(encoding="utf-8") == "mine"


HOSTILE = "<script>alert('x')</script>"


def board() -> Leaderboard:
    return leaderboard(
        {
            "good": [attempt("a", 0.01), attempt("b", 0.1)],
            HOSTILE: [attempt("a", 0.1), attempt("b").replaced(failure=f'"{HOSTILE}"')],
        },
        {"good": "run", HOSTILE: HOSTILE},
        {"other": HOSTILE},
    )


def test_names_from_files_are_escaped_and_nothing_is_loaded() -> None:
    page = leaderboard_page(board())
    assert "<script" not in page
    assert page.count("&lt;script&gt;") >= 6
    assert not re.search(r'(src|href)="', page)


def test_the_best_of_a_set_is_bold_and_a_failure_says_why() -> None:
    page = leaderboard_page(board())
    assert "<td><b>0.01</b></td><td>0.1</td>" in page
    assert '<td>0.1</td><td><b class="fail" title="&#34;&lt;script&gt;' in page  # one score alone is not the best
    assert "<b>other</b>" in page


def test_dots_are_where_the_logarithm_of_the_error_is() -> None:
    drawn = rms_chart(board())
    places = sorted(float(x) for x in re.findall(r'<circle cx="([0-9.]+)"', drawn))
    left, right = EDGE, WIDTH - EDGE
    assert places == [left, right, right]  # 0.01 and 0.1 px are the ends of one decade
    bars = [float(width) for width in re.findall(r'<rect [^>]*width="([0-9.]+)"', drawn)]
    assert sorted(bars) == [0.0, right - left]


def test_without_a_score_there_is_no_drawing() -> None:
    empty = leaderboard({"one": [attempt("a")]}, {"one": "run"}, {})
    assert not rms_chart(empty)
    assert "<svg" not in leaderboard_page(empty)


def test_an_exact_calibration_has_a_place_on_the_logarithmic_axis() -> None:
    exact = leaderboard({"one": [attempt("a", 0.0)]}, {"one": "run"}, {})
    assert "nan" not in rms_chart(exact)
    assert "inf" not in rms_chart(exact)
