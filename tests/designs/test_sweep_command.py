"""`mirrorcam sweep`: what it refuses, what it sums up, and its exit code."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam import cli
from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.designs.design_sweep import Runner
from mirrorcam.designs.sweep_command import summary
from mirrorcam.optics.design.spec_grid import Outcome
from mirrorcam.optics.geometry.design_spec import DesignSpec
from tests.command_line import assert_refused_here
from tests.designs.made_up_designs import SPECS, Counting, solved

PAIRS = "counts = [[1, 2]]\n"


def test_a_summary_names_what_bound_most_often_and_every_failure() -> None:
    outcomes = [
        solved(SPECS[0]),
        solved(SPECS[1]),
        Outcome(spec=SPECS[2], status="infeasible", constraint="spacing"),
        Outcome(spec=SPECS[0], status="infeasible", constraint="depth"),
        Outcome(spec=SPECS[1], status="infeasible", constraint="depth"),
        Outcome(spec=SPECS[3], status="failed", finding="RuntimeError: no"),
    ]
    assert summary(outcomes) == [
        "2 solved, 3 infeasible, 1 failed",
        "infeasible for depth (2), spacing (1)",
        "2x1 scale 80 depths 300,500 tradeoff 0.6 failed: RuntimeError: no",
    ]


def stand_in(monkeypatch: pytest.MonkeyPatch, runner: Runner) -> None:
    monkeypatch.setattr("mirrorcam.designs.sweep_files.design_locally", lambda specs, workers: runner(specs))


def test_the_command_ends_with_1_where_a_design_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    stand_in(monkeypatch, Counting(lambda spec: Outcome(spec=spec, status="failed", finding="RuntimeError: no")))
    (tmp_path / "sweep.toml").write_text(PAIRS)
    assert cli.main(["sweep", str(tmp_path / "sweep.toml"), "--out", str(tmp_path / "out")]) == 1
    assert "0 solved, 0 infeasible, 9 failed" in capfd.readouterr().out
    assert (tmp_path / "out" / "sweep.csv").read_text().count("RuntimeError: no") == 9


def test_without_a_solved_design_there_is_a_table_and_no_figure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    stand_in(monkeypatch, Counting())
    with output_folder(tmp_path, "sweep") as output, output.staged() as folder:
        (folder / "pareto.png").write_bytes(b"of an earlier sweep")
    (tmp_path / "sweep.toml").write_text(PAIRS)
    assert cli.main(["sweep", str(tmp_path / "sweep.toml"), "--table", "json", "--out", str(tmp_path)]) == 1
    printed = capfd.readouterr().out
    assert "infeasible for depth (9)" in printed
    assert "sweep.json written" in printed
    assert not (tmp_path / "pareto.png").exists()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("--table xls", "--table 'xls': expected one of csv, parquet, json"),
        ("--workers 0", "--workers '0': expected 1 to 1024"),
        ("--workers 2 --scheduler tcp://host:1", "--workers and --scheduler: expected one of the two"),
        ("folding.toml", "is not monotonic on the sensor"),
        ("--out folding.json", "folding.json"),
        ("none.toml", "none.toml: no such file"),
    ],
)
def test_a_bad_command_line_is_refused_in_one_line(
    tmp_path: Path,
    arguments: str,
    expected: str,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    camera = DesignSpec().camera.replaced(distortion=[-0.9, 0.0, 0.0, 0.0, 0.0])
    (tmp_path / "folding.json").write_text(camera.model_dump_json())
    (tmp_path / "folding.toml").write_text('[common]\ncamera = "folding.json"\n')
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    assert_refused_here(["sweep", *arguments.split()], capfd, expected)
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("arguments", "extra"), [("--table parquet", "parquet"), ("--scheduler tcp://localhost:1", "cluster")]
)
def test_a_missing_extra_is_named_before_any_work(
    arguments: str, extra: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("mirrorcam.core.extras.find_spec", lambda module: None)
    stand_in(monkeypatch, Counting())
    assert cli.main(["sweep", *arguments.split()]) == 2
    assert f'pip install "mirrorcam[{extra}]"' in capfd.readouterr().err
    assert list(tmp_path.iterdir()) == []
