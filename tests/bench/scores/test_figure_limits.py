"""Limits: of which figures, which way they go, and that a figure which is not given does not keep one."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.bench.scores.score_report import Limits, checks, figure_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric


def loaded(folder: Path, text: str) -> Limits:
    path = folder / "limits.toml"
    path.write_text(text)
    return Limits.load(path)


def test_limits_of_sets_and_of_means(tmp_path: Path) -> None:
    limits = loaded(tmp_path, "rms_px = 0.1\nview_0_1_max_px = 1\n[over_sets]\nscale_error_percent = 0.02\n")
    assert limits.each == {"rms_px": 0.1, "view_0_1_max_px": 1.0}
    assert limits.over_sets == {"scale_error_percent": 0.02}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("rmspx = 0.1", "'rmspx' is not a figure, did you mean rms_px?"),
        ("zzz = 0.1", "'zzz' is not a figure, expected a figure of `mirrorcam score`, such as rms_px"),
        (f"rms_px = 1{'0' * 40}\nnees = -1", "nees: '-1', expected a limit of 0 or more"),
        (f"rms_px = 1{'0' * 400}", "an integer of more than 300 digits"),
        ("rms_px = inf", "rms_px: 'inf', expected a limit"),
        (f"{'.'.join('a' * 100_000)} = 1", "a key of more than"),
        ("view_0_0_nees = 1", "'view_0_0_nees' is not a figure"),
        ("rms_px = -1", "rms_px: '-1', expected a limit of 0 or more"),
        ("rms_px = true", "rms_px: 'True', expected a limit"),
        ("rms_px = inf", "rms_px: 'inf', expected a limit"),
        ('rms_px = "low"', "rms_px: 'low', expected a limit"),
        ("over_sets = 1", "over_sets: expected a table"),
        ("rms_px = ", "not valid TOML"),
    ],
)
def test_what_is_no_limit_is_refused_in_one_line(text: str, complaint: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        loaded(tmp_path, text)
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "value", "limit", "passed"),
    [
        ("rms_px", 0.1, 0.1, True),
        ("rms_px", 0.100001, 0.1, False),
        ("bias_x_px", -0.2, 0.1, False),
        ("scale_error_percent", -0.05, 0.1, True),
        ("shown_share", 0.99, 1.0, False),
        ("shown_share", 1.0, 0.9, True),
        ("view_0_0_shown_share", 0.8, 0.9, False),
    ],
)
def test_errors_are_limited_by_size_and_shares_from_below(name: str, value: float, limit: float, passed: bool) -> None:
    (check,) = checks({name: limit}, {name: Metric(value=value, unit="1")}, {})
    assert check.passed is passed
    assert check.at_least is name.endswith("shown_share")


def test_what_is_not_given_keeps_no_limit() -> None:
    (check,) = checks({"nees": 2.0}, {}, {"nees": "no covariance"})
    assert (check.passed, check.value, check.reason) == (False, None, "no covariance")


def test_names_of_views_are_taken_off() -> None:
    assert figure_of("view_10_2_rms_px") == "rms_px"
    assert figure_of("view_0_0_nees") == "view_0_0_nees"
    assert figure_of("rms_px") == "rms_px"
