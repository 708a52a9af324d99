"""The page of a leaderboard: one file, the best of a set marked, failures with their reasons, names escaped."""

from __future__ import annotations

import re

from mirrorcam.bench.leaderboard_files import EDGE, WIDTH, leaderboard_page, rms_chart
from mirrorcam.bench.scores.leaderboard import Leaderboard, leaderboard
from tests.bench.scores.test_leaderboard import attempt

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
