"""Attempts with bad input, each watched: what it raises and opens, how long it takes, how much memory it needs."""

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

LONGEST_S = 20.0
LONG_S = 2.0
"""Processor time within which nearly all attempts are to end."""
LARGEST_BYTES = 1 << 30
LONGEST_MESSAGE = 300

Attempt = Callable[[int, Path], str]
"""Makes the bad input of a seed in an empty folder and uses it: returns what is wrong with the outcome, or nothing."""


@dataclass(frozen=True)
class Category:
    """A kind of bad input: how many attempts the full table makes, and the attempt of a seed.

    Attributes
    ----------
    longest_s
        Time that an attempt may take.
    tested
        Number of attempts in the default tests.
    """

    name: str
    count: int
    attempt: Attempt
    longest_s: float = LONGEST_S
    tested: int = 8


@dataclass
class Tally:
    """Outcome of the attempts of a category: how many were made, what was wrong and which took long, by seed.

    `slow` has the processor time of those that took more than `LONG_S`.
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
    begun, found = time.monotonic(), Tally(category.name)
    # A new process for each worker: a crash or memory of one attempt is not that of another.
    # It makes one attempt beforehand, in which it loads what all attempts need.
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _watched, ((category, seeds[0]),)) as pool:
        for seed, (wrong, taken_s) in zip(
            seeds, pool.map(_watched, [(category, seed) for seed in seeds], chunksize=16), strict=True
        ):
            found.tried += 1
            if wrong:
                found.wrong[seed] = wrong
            if taken_s > LONG_S:
                found.slow[seed] = taken_s
    found.seconds = time.monotonic() - begun
    return found


class _TookTooLong(BaseException):
    """Raised in an attempt that does not end."""


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise _TookTooLong


def _watched(task: tuple[Category, int]) -> tuple[str, float]:
    category, seed = task
    begun = time.process_time()
    wrong = watched(category.attempt, seed, category.longest_s)
    return wrong, time.process_time() - begun


def watched(attempt: Attempt, seed: int, longest_s: float = LONGEST_S) -> str:
    """Make one attempt in a folder of its own; returns what is wrong with its outcome, or nothing."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    signal.signal(signal.SIGALRM, _interrupt)
    signal.setitimer(signal.ITIMER_REAL, longest_s)
    try:
        with tempfile.TemporaryDirectory() as folder, watched_files() as elsewhere:
            wrong = attempt(seed, Path(folder))
    except _TookTooLong:
        return f"took longer than {longest_s:g} s"
    except Exception:
        return "traceback: " + traceback.format_exc().strip().splitlines()[-1]
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    if not wrong and elsewhere:
        return elsewhere[0]
    return wrong or (f"took {grown / 2**20:.0f} MB of memory" if grown > LARGEST_BYTES else "")


def refused_well(message: str) -> str:
    """What is wrong with the message of a refusal, or nothing."""
    if "\n" in message:
        return f"message of {message.count(chr(10)) + 1} lines: {message[:80]!r}"
    return f"message of {len(message)} characters" if len(message) > LONGEST_MESSAGE else ""


def lines(tallies: Sequence[Tally], shown: int = 5) -> Iterator[str]:
    """The table of the tallies, and the first wrong outcomes of each."""
    past = f"past {LONG_S:g} s"
    yield f"{'category':<28}{'tried':>8}{'right':>8}{'wrong':>8}{past:>10}{'s':>8}"
    for each in tallies:
        counts = f"{each.tried:>8}{each.right:>8}{len(each.wrong):>8}{len(each.slow):>10}"
        yield f"{each.category:<28}{counts}{each.seconds:>8.0f}"
    for each in tallies:
        for seed, wrong in list(each.wrong.items())[:shown]:
            yield f"{each.category}, seed {seed}: {wrong[:200]}"
        for seed, taken_s in list(each.slow.items())[:shown]:
            yield f"{each.category}, seed {seed}: {taken_s:.1f} s of processor time"
