"""Independent calls: their answers in order, wherever they are made, and nothing left over."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.calls import Call, Calls, counted, in_parallel, in_turn
from mirrorcam.core.processes.worker_process import WorkerProcess
from tests.core.processes.processes import ended, first_line


@pytest.fixture
def worker() -> Iterator[WorkerProcess]:
    process = WorkerProcess()
    yield process
    process.kill()
    assert multiprocessing.active_children() == []


@pytest.fixture(params=["in turn", "in parallel"])
def calls(request: pytest.FixtureRequest, worker: WorkerProcess) -> Calls:
    return in_turn if request.param == "in turn" else in_parallel(worker)


def refuse(name: str) -> None:
    raise InputError(f"{name}: refused")


def noted(path: Path, wait_s: float = 0.0) -> int:
    with path.open("a") as stream:
        stream.write(f"{os.getpid()}\n")
    time.sleep(wait_s)
    return os.getpid()


def killed_elsewhere(here: int) -> int:
    """The process, which ends where it is another than this."""
    if os.getpid() != here:
        signal.raise_signal(signal.SIGKILL)
    return os.getpid()


@pytest.mark.parametrize("count", [0, 1, 2, 3, 7])
def test_answers_come_in_order(calls: Calls, count: int) -> None:
    asked: list[Call] = [(pow, (2, number)) for number in range(count)]
    assert list(calls(asked)) == [2**number for number in range(count)]
    assert list(calls(asked)) == [2**number for number in range(count)]


def test_errors_are_raised_where_their_answers_are(calls: Calls) -> None:
    answers = calls([(pow, (2, 3)), (refuse, ("mount",))])
    assert next(answers) == 8
    with pytest.raises(InputError, match=r"^mount: refused$"):
        next(answers)


def test_calls_in_turn_are_made_when_they_are_asked_for(tmp_path: Path) -> None:
    answers = in_turn([(noted, (tmp_path / "0",)), (noted, (tmp_path / "1",))])
    next(answers)
    answers.close()
    assert [path.name for path in tmp_path.iterdir()] == ["0"]


def test_two_are_made_at_the_same_time_in_two_processes(worker: WorkerProcess, tmp_path: Path) -> None:
    first, second = in_parallel(worker)([(first_line, (tmp_path / "1",)), (noted, (tmp_path / "1",))])
    assert first == str(second)
    assert second != os.getpid()


def test_all_that_the_worker_has_no_time_for_is_made_here(worker: WorkerProcess, tmp_path: Path) -> None:
    asked: list[Call] = [(noted, (tmp_path / f"{number}",)) for number in range(4)]
    found = list(in_parallel(worker)([*asked, (first_line, (tmp_path / "3",))]))
    assert found == [os.getpid()] * 4 + [str(os.getpid())]


def test_a_call_of_which_the_worker_dies_is_made_here(worker: WorkerProcess) -> None:
    here = os.getpid()
    assert list(in_parallel(worker)([(killed_elsewhere, (here,))] * 3)) == [here] * 3


def test_what_nobody_wants_any_more_is_not_waited_for(worker: WorkerProcess, tmp_path: Path) -> None:
    answers = in_parallel(worker)([(first_line, (tmp_path / "1",)), (noted, (tmp_path / "1", 300.0))])
    number = int(next(answers))
    answers.close()
    assert ended(number)
    assert list(in_parallel(worker)([(pow, (2, 5)), (pow, (2, 6))])) == [32, 64]


def test_results_and_those_expected_are_counted_and_never_fewer(calls: Calls) -> None:
    reported: list[tuple[int, int]] = []
    count = counted(calls, lambda *both: reported.append(both), 4)
    assert list(count([(abs, (-1,)), (abs, (-2,))])) == [1, 2]
    assert reported == [(0, 4), (1, 4), (2, 4)]
    more = count([(abs, (-3,))] * 3)
    assert next(more) == 3
    more.close()
    assert list(count([(abs, (-4,))])) == [4]
    assert reported[3:] == [(2, 5), (3, 5), (3, 5), (4, 5)]


def test_an_exception_of_the_report_ends_the_calls(calls: Calls, tmp_path: Path) -> None:
    def stop(done: int, total: int) -> None:
        if done == 1:
            raise InterruptedError(f"{done} of {total}")

    with pytest.raises(InterruptedError, match="1 of 3"):
        list(counted(calls, stop)([(abs, (-1,))] * 3))
