"""A single-threaded worker process that makes one call at a time, and may be killed during a call and restarted."""

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
"""Priority of killing workers at exit: multiprocessing waits for its processes after it has run all priorities >= 0."""

_STARTING = threading.Lock()


class WorkerDied(Exception):
    """The process ended before it answered a call; the message states how."""


@dataclass(frozen=True)
class _Done:
    """A worker's reply to a successful call."""

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
        """Wait for the end of the process, and describe it; thread-safe."""
        with self.ending:
            self.process.join()
            self.lifeline.close()
            self.kill_at_exit.cancel()
        code = self.process.exitcode
        return f"by signal {-code}" if code is not None and code < 0 else f"with exit code {code}"


class WorkerProcess:
    """A process that makes calls, one at a time, until it is ended.

    It ends with this process, even if that is killed, and ignores Ctrl-C. It may have its own workers. Any thread may
    call and kill; `send` and `answer` must be used by one thread.

    Parameters
    ----------
    preload
        Modules that are slow to load. If the system supports it, a process loads them once, when the first worker is
        constructed, and workers are forked from it in milliseconds. On Linux, that process ends with the thread that
        constructed the first worker.
    """

    def __init__(self, *, preload: Sequence[str] = ()) -> None:
        self._running: _Running | None = None
        self._pending: _Running | None = None
        """The process that has an unanswered call."""
        self._closed = False
        self._state, self._calling = threading.Lock(), threading.Lock()
        self._context: _Context = begin_loading(preload) if preload else get_context("spawn")

    @property
    def connection(self) -> Connection:
        """The connection to pass to `multiprocessing.connection.wait`. Starts the process."""
        return self._start().connection

    def start(self) -> None:
        """Start the process unless it runs; calls do so, too."""
        self._start()

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a module-level function in the process; function, arguments and result must be picklable.

        Raises
        ------
        InputError
            As raised by the function.
        RuntimeError
            With the traceback of any other exception of the function.
        WorkerDied
            If the process ended, or was killed, before the answer. The next call starts another.
        """
        with self._calling:
            self.send(function, *arguments)
            return self.answer()

    def send(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Begin a call; `answer` waits for its result. For one thread with several workers."""
        self._pending = self._start()
        try:
            self._pending.connection.send((function, arguments))
        except OSError:
            return  # it died, which `answer` reports

    def answer(self) -> Any:
        """Wait for the result of the call sent, see `call`. Raises ValueError without one."""
        running, self._pending = self._pending, None
        if running is None:
            raise ValueError("no call was sent, expected one to answer")
        try:
            reply = running.connection.recv()
        except (EOFError, OSError):
            self._forget(running)
            raise WorkerDied(running.ended()) from None
        if isinstance(reply, InputError):
            raise reply
        if isinstance(reply, str):
            raise RuntimeError(f"a worker failed: {reply}")
        return reply.answer

    def end(self) -> None:
        """End the idle process."""
        running = self._running
        if running is not None:
            self._forget(running)
            running.connection.close()
            running.ended()

    def kill(self) -> None:
        """Kill the process; a call in progress raises WorkerDied, waiting calls continue."""
        with self._state:
            running, self._running = self._running, None
            if running is not None:
                running.process.kill()
        if running is not None:
            running.ended()

    def close(self) -> None:
        """Kill the process and start no other: waiting and later calls raise WorkerDied."""
        with self._state:
            self._closed = True
        self.kill()

    def _start(self) -> _Running:
        with self._state:
            if self._closed:
                raise WorkerDied("closed")
            if self._running is None:
                self._running = _start_process(self, self._context)
            return self._running

    def _forget(self, running: _Running) -> None:
        """Make the next call start another process."""
        with self._state:
            if self._running is running:
                self._running = None


def begin_loading(preload: Sequence[str]) -> _Context:
    """Begin to load modules for later workers, if the system supports it; see `WorkerProcess`.

    If called before this process imports them, they load on another core at the same time.
    """
    if "forkserver" not in get_all_start_methods():
        return get_context("spawn")
    context = get_context("forkserver")
    context.set_forkserver_preload([WITH_PARENT, *preload])
    with _for_children():
        forkserver.ensure_running()
    return context


def _start_process(worker: WorkerProcess, context: _Context) -> _Running:
    connection, child_connection = context.Pipe()
    child_lifeline, lifeline = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(child_connection, child_lifeline), name="worker")
    with _for_children():
        process.start()
    _kill_when_closed(process, child_lifeline)
    child_connection.close()
    child_lifeline.close()
    return _Running(process, connection, lifeline, Finalize(worker, process.kill, exitpriority=KILLED_FIRST))


def _serve(connection: Connection, lifeline: Connection) -> None:
    """Answer calls, with their results or errors, until the other end closes."""
    threading.Thread(target=_exit_when_closed, args=(lifeline,), name="end with parent", daemon=True).start()
    while True:
        try:
            done = _answer(connection)
        except (EOFError, OSError):  # closed, or reset by a parent that did not read an answer
            return
        try:
            connection.send(done)
        except OSError:
            return
        except Exception:
            connection.send(traceback.format_exc())


def _answer(connection: Connection) -> _Done | InputError | str:
    """Return the reply to the next call; raises EOFError or OSError if the connection closes."""
    message = connection.recv_bytes()
    try:
        function, arguments = ForkingPickler.loads(message)
        return _Done(function(*arguments))
    except InputError as error:
        return error
    except Exception:
        return traceback.format_exc()


def _kill_when_closed(process: BaseProcess, lifeline: Connection) -> None:
    """On Linux, make the system kill a worker when the other end of its pipe closes.

    A thread of the worker also notices it, but does not run while libraries load or native code holds the GIL.
    """
    if sys.platform == "linux" and process.pid is not None:
        fcntl.fcntl(lifeline, fcntl.F_SETOWN, process.pid)
        fcntl.fcntl(lifeline, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(lifeline, fcntl.F_SETFL, os.O_ASYNC)


def _exit_when_closed(lifeline: Connection) -> None:
    """End this process, even during a call, when the other end of a pipe closes."""
    wait([lifeline])
    os._exit(1)


@contextmanager
def _for_children() -> Iterator[None]:
    """Start processes within the block with one thread each and with Ctrl-C blocked, which their parent handles."""
    with _STARTING:
        if sys.platform != "win32":
            resource_tracker.ensure_running()  # started by the first process, it would unblock Ctrl-C
        previous = {name: os.environ.get(name) for name in ONE_THREAD}
        os.environ.update(ONE_THREAD)
        old_mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if sys.platform != "win32" else set()
        try:
            yield
        finally:
            for name, value in previous.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value
            if sys.platform != "win32":
                signal.pthread_sigmask(signal.SIG_SETMASK, old_mask)
