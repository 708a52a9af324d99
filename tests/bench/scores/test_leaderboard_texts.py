"""Tables of a leaderboard: cells, reasons told once, and Markdown that names from files cannot break."""

from __future__ import annotations

from mirrorcam.bench.scores.leaderboard import board_rows, common_text, leaderboard, markdown, reasons, set_rows
from tests.bench.scores.test_leaderboard import attempt

BOARD = leaderboard(
    {
        "good": [attempt("a", 0.125, nees=1.0, nees_freedom=10.0), attempt("b", 0.25)],
        "bad|<b>": [attempt("a", 0.5), attempt("b").replaced(failure="no `corners`"), attempt("c")],
    },
    {"good": "run --fast", "bad|<b>": "run `rm`"},
    {"other": "no wheel"},
)


def test_a_calibrator_has_a_row() -> None:
    heads, first, second = board_rows(BOARD)
    assert dict(zip(heads, first, strict=True)) == {
        "calibrator": "good",
        "sets scored": "2 of 2",
        "RMS px": "0.125",
        "RMS px, own sets": "0.188",
        "worst view px": "0.25",
        "RMS mm": "-",
        "triangulation mm": "-",
        "focal length %": "-",
        "NEES": "1 [0.32, 2.05]",
        "s per set": "2.0",
    }
    assert second[:3] == ["bad|<b>", "1 of 3", "0.5"]


def test_a_set_has_a_row_that_tells_failed_from_not_tried() -> None:
    assert set_rows(BOARD) == [
        ["RMS px", "good", "bad|<b>"],
        ["a", "0.125", "0.5"],
        ["b", "0.25", "failed"],
        ["c", "not tried", "failed"],
    ]


def test_a_reason_is_told_once() -> None:
    tried = [attempt(name).replaced(failure="no corners") for name in "xyz"]
    board = leaderboard({"one": [*tried, attempt("a", 0.1)]}, {"one": ""}, {})
    assert reasons(board) == [("one", "no corners", ("x", "y", "z"))]


def test_markdown_shows_names_as_they_are() -> None:
    text = markdown(BOARD)
    assert "| bad\\|&lt;b&gt; | 1 of 3 |" in text
    assert "- other: no wheel" in text
    assert "- bad\\|&lt;b&gt; on b: no \\`corners\\`" in text
    assert "`run _rm_`" in text
    tables = [line for line in text.splitlines() if line.startswith("|")]
    assert {line.replace("\\|", "").count("|") for line in tables} == {11, 4}


def test_without_a_common_set_it_says_so() -> None:
    apart = leaderboard({"one": [attempt("a", 0.1)], "two": [attempt("b", 0.1)]}, {"one": "", "two": ""}, {})
    assert common_text(apart).startswith("No set was scored by all")
    assert board_rows(apart)[1][2:4] == ["-", "0.1"]
