"""A process of one thread that makes one call at a time: it may be killed in the middle of one, and started again."""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import forkserver, get_all_start_methods, get_context, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from multiprocessing.util import Finalize
from typing import TYPE_CHECKING, Any

from mirrorcam.core.errors import InputError

if TYPE_CHECKING:
    from multiprocessing.context import ForkServerContext, SpawnContext

    _Context = ForkServerContext | SpawnContext

if sys.platform == "linux":
    import fcntl

WITH_PARENT = f"{__package__}.with_parent"
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
KILLED_FIRST = 10
"""Priority of killing workers at exit: multiprocessing waits for its processes after all priorities from 0 on."""

_STARTING = threading.Lock()


class WorkerDied(Exception):
    """The process that made a call has ended before its answer; the message says how."""


@dataclass(frozen=True)
class _Done:
    """A worker's reply, whatever its answer is."""

    answer: Any


@dataclass(frozen=True)
class _Running:
    process: BaseProcess
    connection: Connection
    lifeline: Connection
    """End of a pipe that closes with this process."""
    kill_at_exit: Finalize[None]

    ending: threading.Lock = field(default_factory=threading.Lock)

    def ended(self) -> str:
        """Wait for the end of the process, and say how it ended; any thread may."""
        with self.ending:
            self.process.join()
            self.lifeline.close()
            self.kill_at_exit.cancel()
        code = self.process.exitcode
        return f"by signal {-code}" if code is not None and code < 0 else f"with exit code {code}"


class WorkerProcess:
    """A process that makes calls, one at a time, until it is ended.

    It ends with this process, also if that is killed, and leaves Ctrl-C to it. It may have workers of its own. Any
    thread may call and kill; `send` and `answer` are for one thread.

    Parameters
    ----------
    preload
        Modules that are slow to load. Where the system can, they are loaded once, from the construction of the first
        worker on, in a process that all workers are copies of, so that starting one takes milliseconds. Linux ends that
        process with the thread that constructed the first worker.
    """

    def __init__(self, *, preload: Sequence[str] = ()) -> None:
        self._running: _Running | None = None
        self._asked: _Running | None = None
        """What a call was sent to."""
        self._closed = False
        self._state, self._calling = threading.Lock(), threading.Lock()
        self._context: _Context = begin_loading(preload) if preload else get_context("spawn")

    @property
    def connection(self) -> Connection:
        """What `multiprocessing.connection.wait` waits for until there is an answer. Starts the process."""
        return self._start().connection

    def start(self) -> None:
        """Start the process unless it runs; a call does that, too."""
        self._start()

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return what a function of a module gives for arguments, all of which can be pickled.

        Raises
        ------
        InputError
            as the function has raised it.
        RuntimeError
            with its traceback where the function raised anything else.
        WorkerDied
            where the process ended, or was killed, before the answer. The next call starts another.
        """
        with self._calling:
            self.send(function, *arguments)
            return self.answer()

    def send(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Begin a call, whose `answer` is taken later; for one thread that has several workers."""
        self._asked = self._start()
        try:
            self._asked.connection.send((function, arguments))
        except OSError:
            return  # it has died, which is noticed where its answer is awaited

    def answer(self) -> Any:
        """Wait for the answer to what was sent; see `call`. Raises ValueError where nothing was."""
        running, self._asked = self._asked, None
        if running is None:
            raise ValueError("nothing was sent, expected a call that is answered")
        try:
            got = running.connection.recv()
        except (EOFError, OSError):
            self._forget(running)
            raise WorkerDied(running.ended()) from None
        if isinstance(got, InputError):
            raise got
        if isinstance(got, str):
            raise RuntimeError(f"a worker cannot work: {got}")
        return got.answer

    def end(self) -> None:
        """Let the process end, which makes no call now."""
        running = self._running
        if running is not None:
            self._forget(running)
            running.connection.close()
            running.ended()

    def kill(self) -> None:
        """End the process at once, in the middle of a call too; that call raises WorkerDied, waiting calls continue."""
        with self._state:
            running, self._running = self._running, None
            if running is not None:
                running.process.kill()
        if running is not None:
            running.ended()

    def close(self) -> None:
        """End the process at once and start no other: calls that wait, and later ones, raise WorkerDied."""
        with self._state:
            self._closed = True
        self.kill()

    def _start(self) -> _Running:
        with self._state:
            if self._closed:
                raise WorkerDied("closed")
            if self._running is None:
                self._running = _started(self, self._context)
            return self._running

    def _forget(self, running: _Running) -> None:
        """Let the next call start another process than this one."""
        with self._state:
            if self._running is running:
                self._running = None


def begin_loading(preload: Sequence[str]) -> _Context:
    """Begin to load the modules of workers to come, where the system can; see `WorkerProcess`.

    Called before this process loads them itself, it does so on another core at the same time.
    """
    if "forkserver" not in get_all_start_methods():
        return get_context("spawn")
    context = get_context("forkserver")
    context.set_forkserver_preload([WITH_PARENT, *preload])
    with _for_children():
        forkserver.ensure_running()
    return context


def _started(worker: WorkerProcess, context: _Context) -> _Running:
    ours, theirs = context.Pipe()
    their_lifeline, lifeline = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(theirs, their_lifeline), name="worker")
    with _for_children():
        process.start()
    _kill_when_closed(process, their_lifeline)
    theirs.close()
    their_lifeline.close()
    return _Running(process, ours, lifeline, Finalize(worker, process.kill, exitpriority=KILLED_FIRST))


def _serve(connection: Connection, lifeline: Connection) -> None:
    """Make calls until the other end closes, and answer each; with the error where one is raised."""
    threading.Thread(target=_end_with, args=(lifeline,), name="end with parent", daemon=True).start()
    while True:
        try:
            done = _answer(connection)
        except (EOFError, OSError):  # closed, or reset by a parent that leaves an answer unread
            return
        try:
            connection.send(done)
        except OSError:
            return
        except Exception:
            connection.send(traceback.format_exc())


def _answer(connection: Connection) -> _Done | InputError | str:
    """The reply to the next call; raises EOFError or OSError where there is none to come."""
    message = connection.recv_bytes()
    try:
        function, arguments = ForkingPickler.loads(message)
        return _Done(function(*arguments))
    except InputError as error:
        return error
    except Exception:
        return traceback.format_exc()


def _kill_when_closed(process: BaseProcess, lifeline: Connection) -> None:
    """Have the system kill a worker when the other end of its pipe closes, on Linux.

    A thread of the worker sees that too, but does not run while libraries are loaded or native code keeps Python.
    """
    if sys.platform == "linux" and process.pid is not None:
        fcntl.fcntl(lifeline, fcntl.F_SETOWN, process.pid)
        fcntl.fcntl(lifeline, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(lifeline, fcntl.F_SETFL, os.O_ASYNC)


def _end_with(lifeline: Connection) -> None:
    """End this process, in the middle of a call too, when the other end of a pipe closes."""
    wait([lifeline])
    os._exit(1)


@contextmanager
def _for_children() -> Iterator[None]:
    """Give processes started within the block one thread each, and block Ctrl-C, which is for their parent."""
    with _STARTING:
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
