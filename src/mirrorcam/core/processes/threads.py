"""A `map` over threads for many short jobs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

MapFunction = Callable[..., Iterable[Any]]


def thread_map(workers: int) -> MapFunction:
    """Return a `map` that shares its jobs evenly among threads, of which the calling thread is one.

    Each call hands over one share of the jobs per thread: for jobs of a fraction of a millisecond, handing over each of
    them would take longer than the jobs. Jobs must not call the same `map`. An exception of a job is raised once all
    threads have ended.
    """
    if workers == 1:
        return map
    pool = ThreadPoolExecutor(workers - 1)

    def run(function: Callable[..., Any], *iterables: Iterable[Any]) -> Iterator[Any]:
        jobs = list(zip(*iterables, strict=False))
        results: list[Any] = [None] * len(jobs)

        def do_share(first: int) -> None:
            for number in range(first, len(jobs), workers):
                results[number] = function(*jobs[number])

        others = [pool.submit(do_share, first) for first in range(1, min(workers, len(jobs)))]
        try:
            do_share(0)
        finally:
            errors = [other.exception() for other in others]
        for error in errors:
            if error is not None:
                raise error
        return iter(results)

    return run
