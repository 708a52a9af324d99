"""Processes that work for a sweep: any of them may die, and only what it was doing is done again."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mirrorcam.optics.design.spec_grid import structure
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.workflow.sweep_run import design_here, in_order
from mirrorcam.workflow.sweep_work import Answer
from mirrorcam.workflow.workers import ATTEMPTS, ONE_THREAD, Died, _Queue

SPECS = [DesignSpec(scale_mm=40.0 + number) for number in range(6)]


def scale_of(spec_json: str) -> str:
    return f"{DesignSpec.model_validate_json(spec_json).scale_mm:g}"


def noted(folder: Path, spec_json: str) -> Answer:
    """Answer with the scale of the spec, and leave a mark for each time that it was asked for."""
    with (folder / scale_of(spec_json)).open("a") as stream:
        stream.write("x")
    return Answer(scale_of(spec_json))


def killed_once(folder: Path, spec_json: str) -> Answer:
    answer = noted(folder, spec_json)
    if answer.record == "42" and len((folder / "42").read_text()) == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return answer


def always_killed(folder: Path, spec_json: str) -> Answer:
    answer = noted(folder, spec_json)
    if answer.record == "42":
        os.kill(os.getpid(), signal.SIGKILL)
    return answer


def leaving(spec_json: str) -> Answer:
    os._exit(3)


def broken(spec_json: str) -> Answer:
    raise ModuleNotFoundError("No module named 'casadi'")


def stuck(spec_json: str) -> Answer:
    if scale_of(spec_json) != "40":
        time.sleep(300)
    return Answer("40")


def environment(spec_json: str) -> Answer:
    ignores = signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, set())
    return Answer(" ".join(os.environ[name] for name in ONE_THREAD), f"{ignores}")


@pytest.mark.parametrize("workers", [1, 2])
def test_every_spec_is_answered_once(tmp_path: Path, workers: int) -> None:
    answers = dict(design_here(SPECS, workers, partial(noted, tmp_path)))
    assert answers == {number: Answer(f"{40 + number}") for number in range(6)}
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {f"{40 + n}": "x" for n in range(6)}


def test_there_are_no_more_workers_than_specs(tmp_path: Path) -> None:
    answers = design_here(SPECS[:1], 9, partial(noted, tmp_path))
    assert next(answers) == (0, Answer("40"))
    assert multiprocessing.active_children() == []
    assert list(answers) == []


def test_a_worker_that_dies_loses_only_what_it_was_doing(tmp_path: Path) -> None:
    answers = dict(design_here(SPECS, 2, partial(killed_once, tmp_path)))
    assert answers == {number: Answer(f"{40 + number}") for number in range(6)}
    marks = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert marks == {f"{40 + number}": "x" for number in range(6)} | {"42": "xx"}


def test_a_spec_that_kills_all_its_workers_is_given_up_and_the_others_are_done(tmp_path: Path) -> None:
    answers = dict(design_here(SPECS, 2, partial(always_killed, tmp_path)))
    assert answers.pop(2) == Died("3 workers died of it, the last by signal 9")
    assert answers == {number: Answer(f"{40 + number}") for number in range(6) if number != 2}
    assert len((tmp_path / "42").read_text()) == ATTEMPTS == 3


def test_how_a_worker_ended_is_told() -> None:
    assert list(design_here(SPECS[:1], 1, leaving)) == [(0, Died("3 workers died of it, the last with exit code 3"))]


def test_a_worker_that_cannot_work_at_all_ends_the_sweep() -> None:
    with pytest.raises(RuntimeError, match=r"a worker cannot work: (.|\n)*No module named 'casadi'"):
        list(design_here(SPECS, 2, broken))
    assert multiprocessing.active_children() == []


def test_workers_compute_in_one_thread_and_leave_interruptions_to_their_parent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    assert list(design_here(SPECS[:1], 1, environment)) == [(0, Answer("1 1 1 1", "True"))]
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "MKL_NUM_THREADS" not in os.environ
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, set())


def test_whoever_stops_listening_leaves_no_worker_behind(tmp_path: Path) -> None:
    answers = design_here(SPECS, 2, partial(noted, tmp_path))
    next(answers)
    assert multiprocessing.active_children() != []
    answers.close()
    assert multiprocessing.active_children() == []


def test_nobody_waits_for_a_design_that_is_no_longer_wanted() -> None:
    answers = design_here(SPECS, 2, stuck)
    assert next(answers) == (0, Answer("40"))
    before = time.monotonic()
    answers.close()
    assert time.monotonic() - before < 30


def test_specs_of_one_structure_follow_each_other_and_the_largest_arrays_come_first() -> None:
    counts = [(2, 2), (3, 3), (2, 2), (1, 2), (3, 3)]
    specs = [DesignSpec(rows=rows, cols=cols, scale_mm=60.0 + n) for n, (rows, cols) in enumerate(counts)]
    specs.append(specs[1].replaced(depths_mm=(400.0,)))
    groups = in_order(specs)
    assert groups == [[1, 4], [5], [0, 2], [3]]
    assert all(len({structure(specs[number]) for number in group}) == 1 for group in groups)


def test_a_worker_keeps_to_its_group_while_there_is_any_left_of_it() -> None:
    queue = _Queue([[0, 1, 2], [3, 4, 5]])
    assert [queue.next(place) for place in (7, 8, 7, 8, 8, 7)] == [0, 3, 1, 4, 5, 2]
    assert (queue.next(7), queue.next(8)) == (None, None)


def test_a_worker_without_a_group_takes_half_of_the_longest() -> None:
    queue = _Queue([[0, 1, 2, 3, 4]])
    assert [queue.next(0), queue.next(1), queue.next(1), queue.next(0), queue.next(0)] == [0, 3, 4, 1, 2]


@given(st.lists(st.integers(0, 6), max_size=6), st.lists(st.integers(0, 3), min_size=30, max_size=30))
def test_every_task_is_given_out_once_whoever_asks(sizes: list[int], places: list[int]) -> None:
    numbers = iter(range(sum(sizes)))
    queue = _Queue([[next(numbers) for _ in range(size)] for size in sizes if size])
    given_out = [queue.next(place) for place in places]
    while (task := queue.next(0)) is not None:
        given_out.append(task)
    assert sorted(task for task in given_out if task is not None) == list(range(sum(sizes)))
