"""Tasks on all cores of this machine: processes of one thread each, of which any may die without harm to the rest."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Generic, TypeVar

Answer = TypeVar("Answer")
Work = Callable[[str], Answer]

ATTEMPTS = 3
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)


@dataclass(frozen=True)
class Died:
    """The end of every worker that tried a task."""

    reason: str


@dataclass(frozen=True)
class Done(Generic[Answer]):
    """What a worker sends back, whatever type its answer is of."""

    answer: Answer


@dataclass
class _Worker:
    process: BaseProcess
    connection: Connection
    task: int


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def _serve(connection: Connection, work: Work[Answer]) -> None:
    """Answer tasks until the other end closes; with a traceback where the work, which fails by no task, is broken."""
    while True:
        try:
            task = connection.recv()
        except (EOFError, OSError):  # closed, or reset by a parent that leaves an answer unread
            return
        try:
            done: Done[Answer] | str = Done(work(task))
        except Exception:
            done = traceback.format_exc()
        try:
            connection.send(done)
        except OSError:
            return


@contextmanager
def _for_children() -> Iterator[None]:
    """What is started within the block computes in one thread, and never sees Ctrl-C: that is for its parent."""
    if sys.platform != "win32":
        resource_tracker.ensure_running()  # which, started by the first process, would let Ctrl-C through again
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    held = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if sys.platform != "win32" else set()
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        if sys.platform != "win32":
            signal.pthread_sigmask(signal.SIG_SETMASK, held)


class _Queue:
    """Who does what next: a worker stays with its group; one without takes a whole group, then half of another's."""

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


def run_local(
    tasks: Sequence[str], workers: int, work: Work[Answer], groups: Sequence[Sequence[int]] | None = None
) -> Generator[tuple[int, Answer | Died], None, None]:
    """Number and answer of each task, as they come, from at most `workers` processes.

    Tasks of a group go to one worker as far as that leaves none idle: what it has made for one serves the next.
    A worker that dies loses what it was doing, and only that: another takes its place and tries it again, until
    ATTEMPTS have died of it. Ends all workers when closed. Raises RuntimeError where a worker cannot work at all.
    """
    context = get_context("spawn")
    queue = _Queue([range(len(tasks))] if groups is None else groups)
    deaths = [0] * len(tasks)
    busy: dict[int, _Worker] = {}

    def hire(place: int) -> None:
        task = queue.next(place)
        if task is None:
            return
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs, work), daemon=True)
        with _for_children():
            process.start()
        theirs.close()
        busy[place] = _Worker(process, ours, task)
        _give(busy[place], tasks[task])

    try:
        for place in range(min(workers, len(tasks))):
            hire(place)
        while busy:
            ready = wait([worker.connection for worker in busy.values()])
            for place, worker in [(p, w) for p, w in busy.items() if w.connection in ready]:
                try:
                    got = worker.connection.recv()
                except (EOFError, OSError):
                    del busy[place]
                    deaths[worker.task] += 1
                    reason = _buried(worker)
                    if deaths[worker.task] < ATTEMPTS:
                        queue.again(place, worker.task)
                    else:
                        yield worker.task, Died(f"{ATTEMPTS} workers died of it, the last {reason}")
                    hire(place)
                    continue
                if isinstance(got, str):
                    raise RuntimeError(f"a worker cannot work: {got}")
                done, following = worker.task, queue.next(place)
                if following is None:
                    del busy[place]
                    worker.connection.close()
                    worker.process.join()
                else:
                    worker.task = following
                    _give(worker, tasks[following])
                yield done, got.answer
    finally:
        for worker in busy.values():
            worker.process.kill()
            _buried(worker)


def _give(worker: _Worker, task: str) -> None:
    try:
        worker.connection.send(task)
    except OSError:
        return  # it has died; whoever waits for its answer finds that out


def _buried(worker: _Worker) -> str:
    """How a worker ended."""
    worker.connection.close()
    worker.process.join()
    code = worker.process.exitcode
    return f"by signal {-code}" if code is not None and code < 0 else f"with exit code {code}"
