"""Processes that share work: answers as they are, no process left behind, and any of them may die."""

from __future__ import annotations

import multiprocessing
import operator
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.calls import Call
from mirrorcam.core.processes.worker_pool import ATTEMPTS, Died, _Queue, call_all, in_two_processes, run_local
from mirrorcam.core.processes.worker_process import ONE_THREAD
from tests.core.processes.processes import ended, finding_tests, first_line
from tests.nightly import a_few

TASKS = [f"{40 + number}" for number in range(6)]


def noted(folder: Path, task: str) -> str:
    """Answer with the task itself, and leave a mark for each time that it was asked for."""
    with (folder / task).open("a") as stream:
        stream.write("x")
    return task


def killed_once(folder: Path, task: str) -> str:
    answer = noted(folder, task)
    if answer == "42" and len((folder / "42").read_text()) == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return answer


def always_killed(folder: Path, task: str) -> str:
    answer = noted(folder, task)
    if answer == "42":
        os.kill(os.getpid(), signal.SIGKILL)
    return answer


def leaving(task: str) -> str:
    os._exit(3)


def broken(task: str) -> str:
    raise ModuleNotFoundError("No module named 'casadi'")


def stuck(task: str) -> str:
    if task != "40":
        time.sleep(300)
    return "40"


def environment(task: str) -> str:
    ignores = signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, set())
    return " ".join((*(os.environ[name] for name in ONE_THREAD), f"{ignores}"))


@pytest.mark.parametrize("workers", [1, 2])
def test_every_task_is_answered_once(tmp_path: Path, workers: int) -> None:
    answers = dict(run_local(TASKS, workers, partial(noted, tmp_path)))
    assert answers == {number: f"{40 + number}" for number in range(6)}
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {f"{40 + n}": "x" for n in range(6)}


def test_there_are_no_more_workers_than_tasks(tmp_path: Path) -> None:
    answers = run_local(TASKS[:1], 9, partial(noted, tmp_path))
    assert next(answers) == (0, "40")
    assert multiprocessing.active_children() == []
    assert list(answers) == []


def test_a_worker_that_dies_loses_only_what_it_was_doing(tmp_path: Path) -> None:
    answers = dict(run_local(TASKS, 2, partial(killed_once, tmp_path)))
    assert answers == {number: f"{40 + number}" for number in range(6)}
    marks = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert marks == {f"{40 + number}": "x" for number in range(6)} | {"42": "xx"}


def test_a_task_that_kills_all_its_workers_is_given_up_and_the_others_are_done(tmp_path: Path) -> None:
    answers = dict(run_local(TASKS, 2, partial(always_killed, tmp_path)))
    assert answers.pop(2) == Died("3 workers died of it, the last by signal 9")
    assert answers == {number: f"{40 + number}" for number in range(6) if number != 2}
    assert len((tmp_path / "42").read_text()) == ATTEMPTS == 3


def test_how_a_worker_ended_is_reported() -> None:
    assert list(run_local(TASKS[:1], 1, leaving)) == [(0, Died("3 workers died of it, the last with exit code 3"))]


def test_a_worker_that_cannot_work_at_all_ends_the_work() -> None:
    with pytest.raises(RuntimeError, match=r"a worker failed: (.|\n)*No module named 'casadi'"):
        list(run_local(TASKS, 2, broken))
    assert multiprocessing.active_children() == []


def test_workers_compute_in_one_thread_and_leave_interruptions_to_their_parent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    assert list(run_local(TASKS[:1], 1, environment)) == [(0, "1 1 1 1 True")]
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "MKL_NUM_THREADS" not in os.environ
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, set())


def test_whoever_stops_listening_leaves_no_worker_behind(tmp_path: Path) -> None:
    answers = run_local(TASKS, 2, partial(noted, tmp_path))
    next(answers)
    assert multiprocessing.active_children() != []
    answers.close()
    assert multiprocessing.active_children() == []


def test_nobody_waits_for_an_answer_that_is_no_longer_wanted() -> None:
    answers = run_local(TASKS, 2, stuck)
    assert next(answers) == (0, "40")
    before = time.monotonic()
    answers.close()
    assert time.monotonic() - before < 30


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


PRELOADED = ("mirrorcam.core.values",)


@pytest.mark.parametrize(("workers", "preload"), [(1, ()), (2, ()), (2, PRELOADED)])
def test_calls_are_answered_in_their_order(workers: int, preload: tuple[str, ...]) -> None:
    calls: list[Call] = [(operator.add, (1, 2)), (operator.mul, (3, 4)), (pow, (2, 5))]
    done: list[None] = []
    assert call_all(calls, workers, lambda: done.append(None), preload=preload) == [3, 12, 32]
    assert len(done) == 3
    assert multiprocessing.active_children() == []


@pytest.mark.parametrize("workers", [1, 2])
def test_bad_input_is_raised_as_it_is(workers: int) -> None:
    with pytest.raises(InputError, match=r"^mount: refused$"):
        call_all([(operator.add, (1, 2)), (refuse, ("mount",))], workers)
    assert multiprocessing.active_children() == []


def refuse(name: str) -> None:
    raise InputError(f"{name}: refused")


def test_a_call_that_kills_its_workers_does_not_hang() -> None:
    with pytest.raises(RuntimeError, match=r"^3 workers died of it, the last with exit code 3$"):
        call_all([(os._exit, (3,)), (pow, (2, 5))], 2, preload=PRELOADED)
    assert multiprocessing.active_children() == []


def test_preloaded_workers_compute_in_one_thread_and_leave_interruptions_to_their_parent() -> None:
    assert call_all([(environment, ("",)), (pow, (2, 5))], 2, preload=PRELOADED) == ["1 1 1 1 True", 32]


@pytest.mark.parametrize(("number", "processes"), [(1, 1), (2, 2)])
def test_two_processes_are_used_where_there_are_two_cores(
    number: int, processes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mirrorcam.core.processes.worker_pool.cores", lambda: number)
    with in_two_processes(PRELOADED) as calls:
        assert len(set(calls([(os.getpid, ()), (os.getpid, ())]))) == processes
    assert multiprocessing.active_children() == []


OWNER = """
import sys
from mirrorcam.core.processes.worker_pool import call_all
from tests.core.processes.test_worker_pool import PRELOADED, busy
if __name__ == "__main__":
    preload = {"fork": PRELOADED, "spawn": (), "preload": ("tests.core.processes.slow_to_load",)}[sys.argv[1]]
    call_all([(busy, (name,)) for name in sys.argv[2:]], 2, preload=preload)
"""


def busy(path: str) -> None:
    """Note the process, then compute without letting another thread of it run."""
    Path(path).write_text(f"{os.getpid()}\n")
    sys.setswitchinterval(1000.0)
    while True:
        pass


@pytest.mark.skipif(sys.platform != "linux", reason="native code is ended in the middle on Linux only")
@pytest.mark.parametrize("start", a_few(2, ["fork", "spawn", "preload"]))
def test_workers_end_with_a_parent_that_is_killed(start: str, tmp_path: Path) -> None:
    (tmp_path / "owner.py").write_text(OWNER)
    names = [tmp_path / "0", tmp_path / "1"]
    environment = finding_tests() | {"SLOW_TO_LOAD": str(names[0])}
    names = names[:1] if start == "preload" else names
    process = subprocess.Popen([sys.executable, tmp_path / "owner.py", start, *names], env=environment)
    workers = [int(first_line(name)) for name in names]
    process.kill()
    process.wait()
    for worker in workers:
        assert ended(worker)
