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
    """A task whose workers all died."""

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

    A worker that dies loses only its current task. A new worker repeats the task, until it has killed `ATTEMPTS`
    workers. Closing the generator ends all workers.

    Parameters
    ----------
    tasks, work
        The tasks, and the module-level function for each.
    workers
        Maximum number of processes.
    groups
        Indices of tasks that one worker should do, because they share data, unless others are idle; by default, tasks
        start in order.
    preload
        Modules that are slow to load. If the system supports it, they are loaded once, in a process from which workers
        are forked.

    Raises
    ------
    InputError
        As raised by the work.
    RuntimeError
        With the traceback of any other exception of the work.
    """
    pool = _Pool(tasks, work, _Queue([range(len(tasks))] if groups is None else groups), preload)
    try:
        for slot in range(min(workers, len(tasks))):
            pool.start(slot)
        while pool.busy:
            yield from pool.answers()
    finally:
        pool.kill()


def call_all(
    calls: Sequence[Call], workers: int, done: Callable[[], None] = lambda: None, *, preload: Sequence[str] = ()
) -> list[Any]:
    """Return the results of function calls, in order; `done` is called after each.

    With one worker, this process makes the calls; otherwise `run_local` does. The first error is raised; a call that
    kills its workers raises RuntimeError.
    """
    answers: dict[int, Any] = {}
    in_this_process = ((number, _call(call)) for number, call in enumerate(calls))
    with closing(in_this_process if workers == 1 else run_local(calls, workers, _call, preload=preload)) as results:
        for number, answer in results:
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
    """Order of tasks: a worker finishes its group; an idle one takes a new group, or else half of another worker's."""

    def __init__(self, groups: Sequence[Sequence[int]]) -> None:
        self._unassigned = [list(group) for group in groups]
        self._assigned: dict[int, list[int]] = {}

    def next(self, slot: int) -> int | None:
        own = self._assigned.setdefault(slot, [])
        if not own and self._unassigned:
            own += self._unassigned.pop(0)
        if not own:
            longest = max(self._assigned.values(), key=len)
            half = len(longest) // 2
            own += longest[half:]
            del longest[half:]
        return own.pop(0) if own else None

    def put_back(self, slot: int, task: int) -> None:
        self._assigned[slot].insert(0, task)


class _Pool(Generic[Task, Answer]):
    """The workers of a pool; each does one task at a time."""

    def __init__(self, tasks: Sequence[Task], work: Work[Task, Answer], queue: _Queue, preload: Sequence[str]) -> None:
        self._tasks, self._work, self._queue, self._preload = tasks, work, queue, preload
        self._deaths = [0] * len(tasks)
        self.busy: dict[int, _Busy] = {}

    def start(self, slot: int) -> None:
        """Start a worker on the next task, if any."""
        task = self._queue.next(slot)
        if task is not None:
            self.busy[slot] = _Busy(WorkerProcess(preload=self._preload), task)
            self._send(self.busy[slot])

    def answers(self) -> Iterator[tuple[int, Answer | Died]]:
        """Wait for workers, take the answers of the ready ones, and send them their next tasks."""
        ready = wait([busy.worker.connection for busy in self.busy.values()])
        for slot, busy in [item for item in self.busy.items() if item[1].worker.connection in ready]:
            task = busy.task
            try:
                answer = busy.worker.answer()
            except WorkerDied as death:
                if self._replace(slot):
                    yield task, Died(f"{ATTEMPTS} workers died of it, the last {death}")
                continue
            next_task = self._queue.next(slot)
            if next_task is None:
                del self.busy[slot]
                busy.worker.end()
            else:
                busy.task = next_task
                self._send(busy)
            yield task, answer

    def _replace(self, slot: int) -> bool:
        """Replace a worker that died; return whether its task is given up."""
        task = self.busy.pop(slot).task
        self._deaths[task] += 1
        given_up = self._deaths[task] >= ATTEMPTS
        if not given_up:
            self._queue.put_back(slot, task)
        self.start(slot)
        return given_up

    def _send(self, busy: _Busy) -> None:
        busy.worker.send(self._work, self._tasks[busy.task])

    def kill(self) -> None:
        """End all workers at once."""
        for busy in self.busy.values():
            busy.worker.kill()
