"""A sweep keeps every design as it is finished, does again only what is missing, and says the same in any order."""

from __future__ import annotations

import csv
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import pytest

from mirrorcam.core.disk.output_folder import HIDDEN
from mirrorcam.core.disk.program import program_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.worker_pool import Died
from mirrorcam.designs import design_sweep
from mirrorcam.designs.design_sweep import Answer, file_text, layout_name, table_of, write_table
from mirrorcam.designs.sweep_files import design_locally
from mirrorcam.optics.design.spec_grid import Outcome
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from tests.designs.made_up_designs import SPECS, Counting, solved, sweep_into


def files_of(folder: Path) -> dict[str, bytes]:
    files = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    return {name: content for name, content in files.items() if not name.startswith(HIDDEN)}


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Outcome]]:
    """A folder with the four designs of SPECS, made one after another in one process."""
    folder = tmp_path_factory.mktemp("finished")
    outcomes = sweep_into(SPECS, folder, partial(design_locally, workers=1))
    assert [outcome.status for outcome in outcomes] == ["solved"] * 4
    return folder, outcomes


def test_outcomes_come_in_the_order_of_the_specs(tmp_path: Path) -> None:
    said: list[tuple[int, int]] = []
    outcomes = sweep_into(SPECS, tmp_path, Counting(), lambda done, total: said.append((done, total)))
    assert [outcome.spec for outcome in outcomes] == list(SPECS)
    assert said == [(0, 4), (1, 4), (2, 4), (3, 4), (4, 4)]


def test_what_is_finished_is_not_done_again(tmp_path: Path) -> None:
    first = sweep_into(SPECS[:2], tmp_path, Counting(solved))
    runner = Counting(solved)
    outcomes = sweep_into(SPECS, tmp_path, runner)
    assert sorted(runner.asked, key=SPECS.index) == list(SPECS[2:])
    assert outcomes[:2] == first
    again = Counting()
    assert sweep_into(SPECS, tmp_path, again) == outcomes
    assert again.asked == []


def layout_of(folder: Path) -> Path:
    return min((folder / "layouts").iterdir())


def test_a_layout_that_was_deleted_comes_back_and_one_that_was_changed_is_refused(tmp_path: Path) -> None:
    sweep_into(SPECS, tmp_path, Counting(solved))
    before, name = files_of(tmp_path), layout_of(tmp_path).name
    layout_of(tmp_path).unlink()
    runner = Counting(solved)
    sweep_into(SPECS, tmp_path, runner)
    assert runner.asked == []
    assert files_of(tmp_path) == before
    layout_of(tmp_path).write_text("{ }")
    with pytest.raises(InputError, match=rf"{name}: was changed since this command wrote it"):
        sweep_into(SPECS, tmp_path, Counting(solved))
    assert layout_of(tmp_path).read_text() == "{ }"


def test_designs_of_another_program_are_made_again_and_one_that_has_become_infeasible_loses_its_layout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweep_into(SPECS, tmp_path, Counting(solved))
    monkeypatch.setattr(design_sweep, "program_of", lambda code: {"code": "0" * 64})
    runner = Counting()
    sweep_into(SPECS[1:], tmp_path, runner)
    assert len(runner.asked) == 3
    assert [path.name for path in (tmp_path / "layouts").iterdir()] == [Path(layout_name(SPECS[0])).name]


def test_a_failure_is_reported_and_retried(tmp_path: Path) -> None:
    def died(specs: Sequence[DesignSpec]) -> Iterator[tuple[int, Answer | Died]]:
        yield 0, Died("3 workers died of it, the last by signal 9")

    (outcome,) = sweep_into(SPECS[:1], tmp_path, died)
    assert (outcome.status, outcome.finding) == ("failed", "3 workers died of it, the last by signal 9")
    runner = Counting(solved)
    assert [outcome.status for outcome in sweep_into(SPECS[:1], tmp_path, runner)] == ["solved"]
    assert len(runner.asked) == 1


def test_a_worker_of_other_versions_is_refused_and_nothing_of_it_kept(tmp_path: Path) -> None:
    def foreign(specs: Sequence[DesignSpec]) -> Iterator[tuple[int, Answer | Died]]:
        yield 0, Answer(file_text(solved(specs[0])), "{}", program_of(design_sweep.CODE) | {"scipy": "1.0"})

    with pytest.raises(InputError, match=r"^scipy of a worker differs from this machine's"):
        sweep_into(SPECS, tmp_path, foreign)
    assert files_of(tmp_path) == {}


@pytest.mark.slow
def test_any_number_of_workers_in_any_order_gives_the_same_bytes(
    finished: tuple[Path, list[Outcome]], tmp_path: Path
) -> None:
    folder, outcomes = finished

    def backwards(specs: Sequence[DesignSpec]) -> Iterator[tuple[int, Answer | Died]]:
        for number, got in design_locally(specs[::-1], 2):
            yield len(specs) - 1 - number, got

    assert sweep_into(SPECS, tmp_path, backwards) == outcomes
    assert files_of(tmp_path) == files_of(folder)
    for outcome in outcomes:
        layout = Layout.load(tmp_path / layout_name(outcome.spec))
        assert (layout.spec, layout.metrics) == (outcome.spec, outcome.metrics)


@pytest.mark.slow
def test_a_killed_worker_costs_no_finished_design_and_changes_none(
    finished: tuple[Path, list[Outcome]], tmp_path: Path
) -> None:
    folder, outcomes = finished
    kept: list[list[str]] = []

    def with_a_kill(specs: Sequence[DesignSpec]) -> Iterator[tuple[int, Answer | Died]]:
        for number, got in design_locally(specs, 2):
            if not kept:
                victims = multiprocessing.active_children()
                assert len(victims) == 2
                for victim in victims:
                    assert victim.pid is not None
                    os.kill(victim.pid, signal.SIGKILL)
            yield number, got
            kept.append([path.name for path in (tmp_path / "layouts").iterdir()])

    assert sweep_into(SPECS, tmp_path, with_a_kill) == outcomes
    assert [len(names) for names in kept] == [1, 2, 3, 4]
    assert files_of(tmp_path) == files_of(folder)


def sweeping(folder: Path) -> subprocess.Popen[str]:
    """`mirrorcam sweep` over eight designs into folder/out, in a process group of its own."""
    grid = "counts = [[1, 2], [2, 1]]\ntradeoffs = [0.3, 0.6]\nscales_mm = [80, 90]\n"
    (folder / "sweep.toml").write_text(grid, encoding="utf-8")
    command = [sys.executable, "-m", "mirrorcam", "sweep", "sweep.toml", "--workers", "2"]
    return subprocess.Popen(
        [*command, "--out", "out"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def wait_until(true: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.02)


def alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.slow
@pytest.mark.parametrize("kill", [pytest.param(False, id="Ctrl-C"), pytest.param(True, id="killed")])
def test_an_interrupted_sweep_is_continued(kill: bool, finished: tuple[Path, list[Outcome]], tmp_path: Path) -> None:
    layouts = tmp_path / "out" / "layouts"
    process = sweeping(tmp_path)
    try:
        wait_until(lambda: len(list(layouts.glob("[!.]*"))) >= 1)
        if kill:
            process.kill()
        else:
            os.killpg(process.pid, signal.SIGINT)
        _, said = process.communicate(timeout=60)
        wait_until(lambda: not alive(process.pid))
    finally:
        if alive(process.pid):
            os.killpg(process.pid, signal.SIGKILL)
    if kill:
        assert process.returncode == -signal.SIGKILL
    else:
        assert (process.returncode, said) == (130, "mirrorcam: interrupted; finished files are complete\n")
    assert not (tmp_path / "out" / "sweep.csv").exists()
    before = {path.name: path.stat().st_mtime_ns for path in layouts.glob("[!.]*")}
    assert 1 <= len(before) < 8
    again = sweeping(tmp_path)
    printed, said = again.communicate(timeout=120)
    assert (again.returncode, said) == (0, "")
    assert "8 solved, 0 infeasible, 0 failed" in printed
    assert {name: (layouts / name).stat().st_mtime_ns for name in before} == before
    with (tmp_path / "out" / "sweep.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["rows"], row["scale_mm"], row["tradeoff"]) for row in rows] == [
        (count, scale, tradeoff) for count in "12" for scale in ("80.0", "90.0") for tradeoff in ("0.3", "0.6")
    ]
    folder, outcomes = finished
    for outcome in outcomes:
        name = layout_name(outcome.spec)
        assert (tmp_path / "out" / name).read_bytes() == (folder / name).read_bytes()


TABLE = [
    *(solved(spec) for spec in SPECS[:2]),
    Outcome(spec=SPECS[2], status="infeasible", constraint="spacing", finding='2 mm, "too close"'),
]


def test_tables_hold_the_same_in_every_format(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    rows = table_of(TABLE)
    for suffix in ("csv", "json", "parquet"):
        write_table(tmp_path / f"sweep.{suffix}", rows)
        first = (tmp_path / f"sweep.{suffix}").read_bytes()
        write_table(tmp_path / f"sweep.{suffix}", table_of(TABLE))
        assert (tmp_path / f"sweep.{suffix}").read_bytes() == first
    assert json.loads((tmp_path / "sweep.json").read_text()) == {"schema": "mirrorcam.sweep-table/1", "designs": rows}
    table = parquet.read_table(tmp_path / "sweep.parquet")
    assert table.to_pylist() == rows
    assert {str(table.schema.field(name).type) for name in ("scale_mm", "grid_error")} == {"double"}
    with (tmp_path / "sweep.csv").open(newline="") as stream:
        cells = list(csv.DictReader(stream))
    assert [row["depths_mm"] for row in cells] == ["300 500"] * 3
    assert [row["grid_error"] for row in cells] == ["0.3", "0.6", ""]
    assert [row["finding"] for row in cells] == ["", "", '2 mm, "too close"']
    assert [row["layout"] for row in cells] == [*(layout_name(spec) for spec in SPECS[:2]), ""]
    assert list(cells[0]) == list(rows[0])


@pytest.mark.slow
def test_the_table_holds_no_time(finished: tuple[Path, list[Outcome]]) -> None:
    assert not [name for name in table_of(finished[1])[0] if "second" in name]


def test_a_folder_that_cannot_be_written_is_refused_before_any_work(tmp_path: Path) -> None:
    runner = Counting()
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InputError, match="out: is a file, expected a folder"):
        sweep_into(SPECS, tmp_path / "out", runner)
    assert runner.asked == []
    shutil.rmtree(tmp_path)
