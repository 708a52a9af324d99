"""Independent function calls: in sequence, or partly in another process at the same time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from typing import Any

from mirrorcam.core.processes.worker_process import WorkerDied, WorkerProcess
from mirrorcam.core.progress import Progress

Call = tuple[Callable[..., Any], tuple[Any, ...]]
"""A function of a module, and its arguments."""

Calls = Callable[[Sequence[Call]], Generator[Any, None, None]]
"""Makes independent calls and yields their results in order; closing the generator cancels the rest."""


def in_turn(calls: Sequence[Call]) -> Generator[Any, None, None]:
    """Make calls in this process, each when its result is requested."""
    for function, arguments in calls:
        yield function(*arguments)


def counted(calls: Calls, progress: Progress, expected: int = 0) -> Calls:
    """Make calls as `calls` does, and report the number of results and of those expected.

    The number expected grows if more calls are requested. It never decreases, even if calls are cancelled.
    """
    done, total = 0, expected

    def make(requested: Sequence[Call]) -> Generator[Any, None, None]:
        nonlocal done, total
        total = max(total, done + len(requested))
        progress(done, total)
        with closing(calls(requested)) as results:
            for result in results:
                done += 1
                progress(done, total)
                yield result

    return make


def in_parallel(worker: WorkerProcess) -> Calls:
    """Make calls in this process from the first onwards, and meanwhile in a worker from the last backwards.

    A single call is made in this process, and so is a call that kills the worker. An error is raised when its result is
    requested. The worker is killed once its result is no longer needed.
    """

    def make(calls: Sequence[Call]) -> Generator[Any, None, None]:
        pending, answers = deque(range(len(calls))), dict[int, Any]()
        in_worker: int | None = None
        try:
            for number in range(len(calls)):
                while number not in answers:
                    if in_worker is not None and (not pending or worker.connection.poll()):
                        answers[in_worker] = _answer(worker, calls[in_worker])
                        in_worker = None
                        continue
                    if in_worker is None and len(pending) > 1:
                        in_worker = pending.pop()
                        worker.send(calls[in_worker][0], *calls[in_worker][1])
                    local = pending.popleft()
                    function, arguments = calls[local]
                    answers[local] = function(*arguments)
                yield answers.pop(number)
        finally:
            if in_worker is not None:
                worker.kill()

    return make


def _answer(worker: WorkerProcess, call: Call) -> Any:
    """Return the worker's answer; if it dies, call the function in this process."""
    function, arguments = call
    try:
        return worker.answer()
    except WorkerDied:
        return function(*arguments)
