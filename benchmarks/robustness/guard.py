"""Monitored attempts with bad input: exceptions, opened files, time and memory."""

from __future__ import annotations

import multiprocessing
import resource
import signal
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

from benchmarks.robustness.file_access import watched_files

MAX_S = 20.0
LONG_S = 2.0
"""Processor time above which an attempt counts as slow."""
MAX_MEMORY_BYTES = 1 << 30
MAX_MESSAGE = 300

Attempt = Callable[[int, Path], str]
"""Writes the bad input of a seed into an empty folder and uses it; returns what is wrong with the outcome, or ""."""


@dataclass(frozen=True)
class Category:
    """A kind of bad input: the number of attempts of the full table, and the attempt of a seed.

    Attributes
    ----------
    longest_s
        Maximum time of an attempt.
    tested
        Number of attempts in the default tests.
    """

    name: str
    count: int
    attempt: Attempt
    max_s: float = MAX_S
    tested: int = 8


@dataclass
class Tally:
    """Outcome of the attempts of a category: their number, and the wrong and the slow ones, by seed.

    `slow` has the processor times of those that took more than `LONG_S`.
    """

    category: str
    tried: int = 0
    wrong: dict[int, str] = field(default_factory=dict)
    slow: dict[int, float] = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def right(self) -> int:
        return self.tried - len(self.wrong)


def tally(category: Category, seeds: Sequence[int], workers: int) -> Tally:
    """Make the attempts of a category with these seeds, in worker processes."""
    start_s, result = time.monotonic(), Tally(category.name)
    # A new process for each worker: a crash or memory of one attempt is not that of another.
    # It makes one attempt beforehand, in which it loads what all attempts need.
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _timed, ((category, seeds[0]),)) as pool:
        for seed, (wrong, taken_s) in zip(
            seeds, pool.map(_timed, [(category, seed) for seed in seeds], chunksize=16), strict=True
        ):
            result.tried += 1
            if wrong:
                result.wrong[seed] = wrong
            if taken_s > LONG_S:
                result.slow[seed] = taken_s
    result.seconds = time.monotonic() - start_s
    return result


class _Timeout(BaseException):
    """Raised in an attempt that does not end."""


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise _Timeout


def _timed(task: tuple[Category, int]) -> tuple[str, float]:
    category, seed = task
    start_s = time.process_time()
    wrong = run_monitored(category.attempt, seed, category.max_s)
    return wrong, time.process_time() - start_s


def run_monitored(attempt: Attempt, seed: int, max_s: float = MAX_S) -> str:
    """Make one attempt in a separate folder; return what is wrong with its outcome, or ""."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    signal.signal(signal.SIGALRM, _interrupt)
    signal.setitimer(signal.ITIMER_REAL, max_s)
    try:
        with tempfile.TemporaryDirectory() as folder, watched_files() as elsewhere:
            wrong = attempt(seed, Path(folder))
    except _Timeout:
        return f"took longer than {max_s:g} s"
    except Exception:
        return "traceback: " + traceback.format_exc().strip().splitlines()[-1]
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    growth_bytes = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    if not wrong and elsewhere:
        return elsewhere[0]
    return wrong or (f"took {growth_bytes / 2**20:.0f} MB of memory" if growth_bytes > MAX_MEMORY_BYTES else "")


def message_fault(message: str) -> str:
    """Return what is wrong with the message of a refusal, or ""."""
    if "\n" in message:
        return f"message of {message.count(chr(10)) + 1} lines: {message[:80]!r}"
    return f"message of {len(message)} characters" if len(message) > MAX_MESSAGE else ""


def lines(tallies: Sequence[Tally], max_lines: int = 5) -> Iterator[str]:
    """Yield the lines of the table of tallies, and the first wrong outcomes of each."""
    slow = f"over {LONG_S:g} s"
    yield f"{'category':<28}{'tried':>8}{'right':>8}{'wrong':>8}{slow:>10}{'s':>8}"
    for result in tallies:
        counts = f"{result.tried:>8}{result.right:>8}{len(result.wrong):>8}{len(result.slow):>10}"
        yield f"{result.category:<28}{counts}{result.seconds:>8.0f}"
    for result in tallies:
        for seed, wrong in list(result.wrong.items())[:max_lines]:
            yield f"{result.category}, seed {seed}: {wrong[:200]}"
        for seed, taken_s in list(result.slow.items())[:max_lines]:
            yield f"{result.category}, seed {seed}: {taken_s:.1f} s of processor time"
