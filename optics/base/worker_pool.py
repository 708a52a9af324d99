"""Tasks on all cores of this machine: processes of one thread each, of which any may die without harm to the rest."""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from multiprocessing import get_all_start_methods, get_context, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from mirrorcam.optics.base.values import InputError

if TYPE_CHECKING:
    from multiprocessing.context import ForkServerContext, SpawnContext

    _Context = ForkServerContext | SpawnContext

if sys.platform == "linux":
    import fcntl

Task = TypeVar("Task")
Answer = TypeVar("Answer")
Work = Callable[[Task], Answer]
Call = tuple[Callable[..., Any], tuple[Any, ...]]
"""A function of a module, and its arguments."""

WITH_PARENT = f"{__package__}.with_parent"
ATTEMPTS = 3
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)


@dataclass(frozen=True)
class Died:
    """The end of every worker that tried a task."""

    reason: str


@dataclass(frozen=True)
class _Done(Generic[Answer]):
    """A worker's reply, of whatever type its answer is."""

    answer: Answer


@dataclass
class _Worker:
    process: BaseProcess
    connection: Connection
    lifeline: Connection
    """End of a pipe that closes with this process."""
    task: int


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def run_local(
    tasks: Sequence[Task],
    workers: int,
    work: Work[Task, Answer],
    groups: Sequence[Sequence[int]] | None = None,
    *,
    preload: Sequence[str] = (),
) -> Generator[tuple[int, Answer | Died], None, None]:
    """Yield number and answer of each task, as they come, from at most `workers` processes.

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
    pool = _Pool(tasks, work, _Queue([range(len(tasks))] if groups is None else groups), _context(preload))
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
    """Return what functions give for their arguments, in order; `done` is called as each comes.

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


def _call(call: Call) -> Any:
    function, arguments = call
    return function(*arguments)


def _context(preload: Sequence[str]) -> _Context:
    if preload and "forkserver" in get_all_start_methods():
        context = get_context("forkserver")
        context.set_forkserver_preload([WITH_PARENT, *preload])
        return context
    return get_context("spawn")


class _Queue:
    """Order of tasks: a worker stays with its group; one without takes a whole group, then half of another's."""

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
    """Workers by their places; each does one task at a time."""

    def __init__(self, tasks: Sequence[Task], work: Work[Task, Answer], queue: _Queue, context: _Context) -> None:
        self._tasks, self._work, self._queue, self._context = tasks, work, queue, context
        self._deaths = [0] * len(tasks)
        self.busy: dict[int, _Worker] = {}

    def start(self, place: int) -> None:
        """Start a worker on the next task, if there is any."""
        task = self._queue.next(place)
        if task is None:
            return
        ours, theirs = self._context.Pipe()
        their_lifeline, lifeline = self._context.Pipe(duplex=False)
        process = self._context.Process(target=_serve, args=(theirs, their_lifeline, self._work), daemon=True)
        with _for_children():
            process.start()
        _kill_when_closed(process, their_lifeline)
        theirs.close()
        their_lifeline.close()
        self.busy[place] = _Worker(process, ours, lifeline, task)
        self._give(self.busy[place])

    def answers(self) -> Iterator[tuple[int, Answer | Died]]:
        """Wait for a worker, take what those that are ready have, and give them their next tasks."""
        ready = wait([worker.connection for worker in self.busy.values()])
        for place, worker in [(p, w) for p, w in self.busy.items() if w.connection in ready]:
            task = worker.task
            try:
                got = worker.connection.recv()
            except (EOFError, OSError):
                reason = self._replace(place)
                if reason is not None:
                    yield task, Died(reason)
                continue
            if isinstance(got, InputError):
                raise got
            if isinstance(got, str):
                raise RuntimeError(f"a worker cannot work: {got}")
            following = self._queue.next(place)
            if following is None:
                del self.busy[place]
                _ended(worker)
            else:
                worker.task = following
                self._give(worker)
            yield task, got.answer

    def _replace(self, place: int) -> str | None:
        """Start another worker for one that has died; say why its task is given up, where it is."""
        worker = self.busy.pop(place)
        self._deaths[worker.task] += 1
        ended = _ended(worker)
        given_up = self._deaths[worker.task] >= ATTEMPTS
        if not given_up:
            self._queue.again(place, worker.task)
        self.start(place)
        return f"{ATTEMPTS} workers died of it, the last {ended}" if given_up else None

    def _give(self, worker: _Worker) -> None:
        try:
            worker.connection.send(self._tasks[worker.task])
        except OSError:
            return  # it has died, which is noticed where its answer is awaited

    def kill(self) -> None:
        """End all workers at once."""
        for worker in self.busy.values():
            worker.process.kill()
        for worker in self.busy.values():
            _ended(worker)


def _ended(worker: _Worker) -> str:
    """Say how a worker ended."""
    worker.connection.close()
    worker.process.join()
    worker.lifeline.close()
    code = worker.process.exitcode
    return f"by signal {-code}" if code is not None and code < 0 else f"with exit code {code}"


def _serve(connection: Connection, lifeline: Connection, work: Work[Any, Any]) -> None:
    """Answer tasks until the other end closes; with the error where the work raises one."""
    threading.Thread(target=_end_with, args=(lifeline,), name="end with parent", daemon=True).start()
    while True:
        try:
            task = connection.recv()
        except (EOFError, OSError):  # closed, or reset by a parent that leaves an answer unread
            return
        done: _Done[Any] | InputError | str
        try:
            done = _Done(work(task))
        except InputError as error:
            done = error
        except Exception:
            done = traceback.format_exc()
        try:
            connection.send(done)
        except OSError:
            return


def _kill_when_closed(process: BaseProcess, lifeline: Connection) -> None:
    """Have the system kill a worker when the other end of its pipe closes, on Linux.

    A thread of the worker sees that too, but does not run while libraries are loaded or native code keeps Python.
    """
    if sys.platform == "linux" and process.pid is not None:
        fcntl.fcntl(lifeline, fcntl.F_SETOWN, process.pid)
        fcntl.fcntl(lifeline, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(lifeline, fcntl.F_SETFL, os.O_ASYNC)


def _end_with(lifeline: Connection) -> None:
    """End this process, in the middle of a task too, when the other end of a pipe closes."""
    wait([lifeline])
    os._exit(1)


@contextmanager
def _for_children() -> Iterator[None]:
    """Give processes started within the block one thread each, and block Ctrl-C, which is for their parent."""
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
