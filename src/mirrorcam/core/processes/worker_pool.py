"""Tasks on all cores of this machine, in single-threaded processes; the death of one does not affect the others."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from multiprocessing.connection import wait
from typing import Any, Generic, TypeVar

from mirrorcam.core.processes.calls import Call, Calls, in_parallel, in_turn
from mirrorcam.core.processes.worker_process import WorkerDied, WorkerProcess

Task = TypeVar("Task")
Answer = TypeVar("Answer")
Work = Callable[[Task], Answer]
ATTEMPTS = 3


@dataclass(frozen=True)
class Died:
    """A task whose every worker died."""

    reason: str


@dataclass
class _Busy:
    worker: WorkerProcess
    task: int


def cores() -> int:
    """Return the number of cores available to this process."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def run_local(
    tasks: Sequence[Task],
    workers: int,
    work: Work[Task, Answer],
    groups: Sequence[Sequence[int]] | None = None,
    *,
    preload: Sequence[str] = (),
) -> Generator[tuple[int, Answer | Died], None, None]:
    """Yield index and answer of each task as it is finished, from at most `workers` processes.

    A worker that dies loses what it was doing, and only that: another takes its place and tries it again, until
    ATTEMPTS have died of it. Ends all workers when closed.

    Parameters
    ----------
    groups : numbers of tasks that go to one worker as far as that leaves none idle, as what it has made for one serves
        the next; without, tasks are given out in their order
    preload : modules that are slow to load; where the system can, they are loaded once, in a process that the workers
        are copies of

    Raises
    ------
    InputError
        as the work has raised it.
    RuntimeError
        with its traceback where the work raised anything else: then no worker can do it.
    """
    pool = _Pool(tasks, work, _Queue([range(len(tasks))] if groups is None else groups), preload)
    try:
        for place in range(min(workers, len(tasks))):
            pool.start(place)
        while pool.busy:
            yield from pool.answers()
    finally:
        pool.kill()


def call_all(
    calls: Sequence[Call], workers: int, done: Callable[[], None] = lambda: None, *, preload: Sequence[str] = ()
) -> list[Any]:
    """Return the results of function calls, in order; `done` is called after each.

    With one worker, this process makes the calls; else they are `run_local`. The first error is raised, and a call of
    which its workers die is a RuntimeError.
    """
    answers: dict[int, Any] = {}
    here = ((number, _call(call)) for number, call in enumerate(calls))
    with closing(here if workers == 1 else run_local(calls, workers, _call, preload=preload)) as numbered:
        for number, answer in numbered:
            if isinstance(answer, Died):
                raise RuntimeError(answer.reason)
            answers[number] = answer
            done()
    return [answers[number] for number in range(len(calls))]


@contextmanager
def in_two_processes(preload: Sequence[str]) -> Iterator[Calls]:
    """Yield a `Calls` that uses this process and, on a machine with another core, a worker with preloaded modules."""
    if cores() == 1:
        yield in_turn
        return
    worker = WorkerProcess(preload=preload)
    try:
        yield in_parallel(worker)
    finally:
        worker.kill()


def _call(call: Call) -> Any:
    function, arguments = call
    return function(*arguments)


class _Queue:
    """Order of tasks: a worker stays with its group; an idle one takes a new group, then half of another worker's."""

    def __init__(self, groups: Sequence[Sequence[int]]) -> None:
        self._waiting = [list(group) for group in groups]
        self._own: dict[int, list[int]] = {}

    def next(self, place: int) -> int | None:
        own = self._own.setdefault(place, [])
        if not own and self._waiting:
            own += self._waiting.pop(0)
        if not own:
            most = max(self._own.values(), key=len)
            left = len(most) // 2
            own += most[left:]
            del most[left:]
        return own.pop(0) if own else None

    def again(self, place: int, task: int) -> None:
        self._own[place].insert(0, task)


class _Pool(Generic[Task, Answer]):
    """The workers of a pool; each does one task at a time."""

    def __init__(self, tasks: Sequence[Task], work: Work[Task, Answer], queue: _Queue, preload: Sequence[str]) -> None:
        self._tasks, self._work, self._queue, self._preload = tasks, work, queue, preload
        self._deaths = [0] * len(tasks)
        self.busy: dict[int, _Busy] = {}

    def start(self, place: int) -> None:
        """Start a worker on the next task, if any."""
        task = self._queue.next(place)
        if task is not None:
            self.busy[place] = _Busy(WorkerProcess(preload=self._preload), task)
            self._give(self.busy[place])

    def answers(self) -> Iterator[tuple[int, Answer | Died]]:
        """Wait for workers, take the answers of the ready ones, and send them their next tasks."""
        ready = wait([busy.worker.connection for busy in self.busy.values()])
        for place, busy in [(p, b) for p, b in self.busy.items() if b.worker.connection in ready]:
            task = busy.task
            try:
                answer = busy.worker.answer()
            except WorkerDied as death:
                if self._given_up(place):
                    yield task, Died(f"{ATTEMPTS} workers died of it, the last {death}")
                continue
            following = self._queue.next(place)
            if following is None:
                del self.busy[place]
                busy.worker.end()
            else:
                busy.task = following
                self._give(busy)
            yield task, answer

    def _given_up(self, place: int) -> bool:
        """Replace a worker that died; return whether its task is abandoned."""
        task = self.busy.pop(place).task
        self._deaths[task] += 1
        given_up = self._deaths[task] >= ATTEMPTS
        if not given_up:
            self._queue.again(place, task)
        self.start(place)
        return given_up

    def _give(self, busy: _Busy) -> None:
        busy.worker.send(self._work, self._tasks[busy.task])

    def kill(self) -> None:
        """End all workers at once."""
        for busy in self.busy.values():
            busy.worker.kill()
