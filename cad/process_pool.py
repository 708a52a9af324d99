"""Work shared by processes that have the CAD kernel loaded."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_all_start_methods, get_context
from multiprocessing.context import BaseContext
from typing import Any

Task = tuple[Callable[..., Any], tuple[Any, ...]]


@contextmanager
def crew(workers: int) -> Iterator[Executor | None]:
    """Processes for `results`; None where there is but one worker, which is this process.

    Work that has begun is finished before an error goes on, except after Ctrl-C, which ends all processes at once.
    """
    if workers == 1:
        yield None
        return
    context: BaseContext = get_context("forkserver" if "forkserver" in get_all_start_methods() else "spawn")
    # The kernel takes seconds to load: once, in the process that the others are copies of, where there is such a one.
    context.set_forkserver_preload(["mirrorcam.cad.device_files"])
    executor = ProcessPoolExecutor(
        workers, mp_context=context, initializer=signal.signal, initargs=(signal.SIGINT, signal.SIG_DFL)
    )
    try:
        yield executor
    finally:
        executor.shutdown(cancel_futures=True)


def results(executor: Executor | None, tasks: Iterable[Task], done: Callable[[], None]) -> list[Any]:
    """What functions give for their arguments, in order; `done` is called as each comes. The first error is raised."""
    if executor is None:
        given = []
        for function, arguments in tasks:
            given.append(function(*arguments))
            done()
        return given
    futures = [executor.submit(function, *arguments) for function, arguments in tasks]
    for future in as_completed(futures):
        future.result()
        done()
    return [future.result() for future in futures]
