"""Calibrators beside each other: which sets are common, what is averaged, how they are ordered, and what is refused."""

from __future__ import annotations

import pytest

from mirrorcam.bench.scores.consistency import Nees
from mirrorcam.bench.scores.leaderboard import Attempt, Leaderboard, leaderboard
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric


def attempt(
    name: str, rms_px: float | None = None, *, sha256: str = "", seconds: float = 2.0, **more: float
) -> Attempt:
    """A set with a score of that error, or without a score."""
    figures = {} if rms_px is None else {"rms_px": rms_px, "worst_view_rms_px": 2.0 * rms_px, **more}
    return Attempt(
        name=name,
        why="",
        dataset_sha256=sha256 or name,
        seconds=seconds,
        figures={key: Metric(value=value, unit="1") for key, value in figures.items()},
        failure="" if rms_px is not None else f"no corners in {name}",
    )


def board(**attempts: list[Attempt]) -> Leaderboard:
    return leaderboard(attempts, dict.fromkeys(attempts, "calibrate"), {})


def test_only_sets_that_all_scored_are_compared() -> None:
    found = board(
        first=[attempt("a", 0.1), attempt("b", 0.3), attempt("c", 5.0)], second=[attempt("a", 0.2), attempt("b", 0.2)]
    )
    assert found.common == ("a", "b")
    assert [each.name for each in found.sets] == ["a", "b", "c"]
    first = next(row for row in found.rows if row.calibrator == "first")
    assert first.over_common["rms_px"] == pytest.approx(0.2)
    assert first.over_common["worst_view_rms_px"] == pytest.approx(0.6)
    assert first.over_own["rms_px"] == pytest.approx(5.4 / 3.0)
    assert first.rms_px == {"a": 0.1, "b": 0.3, "c": 5.0}


def test_the_best_comes_first_and_who_scored_nothing_last() -> None:
    found = board(none=[attempt("a"), attempt("b")], worse=[attempt("a", 0.2)], better=[attempt("a", 0.1)])
    assert [row.calibrator for row in found.rows] == ["better", "worse", "none"]
    assert found.common == ("a",)  # a calibrator without any score does not empty the common sets
    assert found.rows[-1].failures == {"a": "no corners in a", "b": "no corners in b"}
    assert found.rows[-1].seconds is None
    assert found.rows[-1].over_common == {} == found.rows[-1].over_own


def test_a_failed_set_is_not_common() -> None:
    found = board(first=[attempt("a", 0.1), attempt("b", 0.1)], second=[attempt("a", 0.2), attempt("b")])
    assert found.common == ("a",)


def test_sets_are_the_same_by_their_checksums() -> None:
    found = board(first=[attempt("a", 0.1, sha256="1111111")], second=[attempt("a", 0.2, sha256="2222222")])
    assert [each.name for each in found.sets] == ["a 111111", "a 222222"]
    assert found.common == ()
    assert [row.rms_px for row in found.rows] == [{"a 111111": 0.1}, {"a 222222": 0.2}]


def test_consistency_is_over_all_degrees_of_freedom() -> None:
    found = board(one=[attempt("a", 0.1, nees=2.0, nees_freedom=10.0), attempt("b", 0.1, nees=1.0, nees_freedom=30.0)])
    over, together = found.rows[0].over_common, Nees(50.0, 40)
    assert over["nees"] == pytest.approx(1.25)
    assert over["nees_freedom"] == 40.0
    assert (over["nees_low"], over["nees_high"]) == pytest.approx(together.interval)


def test_a_figure_that_a_score_lacks_has_no_mean() -> None:
    found = board(one=[attempt("a", 0.1, rms_mm=1.0, nees=1.0, nees_freedom=9.0), attempt("b", 0.1)])
    assert not found.rows[0].over_common.keys() & {"rms_mm", "nees"}


def test_results_that_do_not_fit_together_are_refused() -> None:
    with pytest.raises(InputError, match="one: the set a appears twice"):
        board(one=[attempt("a", 0.1), attempt("a", 0.2)])
    with pytest.raises(InputError, match="one: rms_px of a is 1e\\+12"):
        board(one=[attempt("a", 1e12)])
    with pytest.raises(InputError, match="one: a took -1 s"):
        board(one=[attempt("a", 0.1, seconds=-1.0)])
    bare = attempt("a", 0.1).replaced(figures={})
    with pytest.raises(InputError, match="one: the score of a lacks rms_px"):
        board(one=[bare])
