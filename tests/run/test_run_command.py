"""`mirrorcam run`: which recipe goes into which folder, what is printed of it, and its exit code."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from mirrorcam import cli
from mirrorcam.core.console.reporter import Reporter
from mirrorcam.core.values import Metric
from mirrorcam.run.pipeline import Recipe, RunFigures, full_recipe, quick_recipe
from tests.command_line import assert_refused_here

PARTS = {"holder.seat_error_mm": Metric(value=0.0, unit="mm", limit=0.001)}
TRUTH = {
    "normal_error_max_deg": Metric(value=0.01, unit="deg", limit=0.02),
    "corners": Metric(value=40000.0, unit="1"),
}


class Runs:
    """A stand-in for `run_all` that remembers what it was asked for."""

    def __init__(self, parts: dict[str, Metric]) -> None:
        self.figures = RunFigures({}, parts, TRUTH)
        self.asked: list[tuple[Recipe, Path, str]] = []

    def __call__(self, recipe: Recipe, root: Path, command: str, reporter: Reporter, *, force: bool) -> RunFigures:
        self.asked.append((recipe, root, command))
        return self.figures


@pytest.mark.parametrize(
    ("arguments", "recipe", "root", "command"),
    [
        ("", full_recipe(0), "output/default", "mirrorcam run --seed 0"),
        ("--quick --seed 3", quick_recipe(3), "output/quick", "mirrorcam run --quick --seed 3"),
        ("--out elsewhere", full_recipe(0), "elsewhere", "mirrorcam run --seed 0"),
        (
            "--adapter tripod --mounting screws",
            replace(full_recipe(0), adapter="tripod", mounting="screws"),
            "output/default",
            "mirrorcam run --adapter tripod --mounting screws --seed 0",
        ),
    ],
)
def test_options_choose_the_recipe_and_the_folder(
    arguments: str, recipe: Recipe, root: str, command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = Runs(PARTS)
    monkeypatch.setattr("mirrorcam.run.pipeline.run_all", runs)
    assert cli.main(["run", *arguments.split()]) == 0
    assert runs.asked == [(recipe, Path(root), command)]


def test_what_fails_and_what_has_a_limit_is_printed(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    failed = {"holder.wall_mm": Metric(value=0.4, unit="mm", limit=0.8, lower_is_better=False)}
    monkeypatch.setattr("mirrorcam.run.pipeline.run_all", Runs(PARTS | failed))
    assert cli.main(["run"]) == 1
    printed = capfd.readouterr().out
    assert printed.count("FAIL") == 1
    assert "wall" in printed.lower()
    assert "seat" not in printed.lower()
    assert "40000" not in printed
    assert "0.02" in printed
    assert "open output/default/index.html" in printed


def test_a_seed_below_zero_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused_here(["run", "--seed", "-1"], capfd, "--seed '-1': expected 0 to 2^63 - 1")
    assert_refused_here(
        ["run", "--quick", "design.toml"], capfd, "--quick and design.toml: expected at most one of the two"
    )
    assert list(tmp_path.iterdir()) == []
