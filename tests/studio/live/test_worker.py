"""A process and its thread: what they do, how they fail, and that both end."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable

import pytest

from mirrorcam.core.values import InputError
from mirrorcam.studio.live import worker as live_worker
from mirrorcam.studio.live.worker import LiveWorker
from tests.core.processes.processes import ended

LONG_S = 60.0


def refuse(text: str) -> None:
    raise InputError(text)


def failing(function: Callable[..., object], *arguments: object) -> str:
    """What is said of work that makes one call which fails."""
    said: list[str] = []
    told = threading.Event()

    def tell(line: str) -> None:
        said.append(line)
        told.set()

    worker = LiveWorker("tests", lambda: worker.process.call(function, *arguments), tell)
    worker.start()
    assert told.wait(LONG_S)
    worker.close()
    (line,) = said
    return line


def test_work_that_fails_says_why_in_one_line() -> None:
    assert failing(refuse, "no such layer") == "no such layer"
    assert failing(os._exit, 3) == "the process for tests has ended with exit code 3"


@pytest.mark.parametrize("at_once", [True, False])
def test_closing_ends_work_that_waits_and_the_process(at_once: bool) -> None:
    said: list[str] = []
    pids: list[int] = []
    begun = threading.Event()

    def work() -> None:
        pids.append(worker.process.call(os.getpid))
        begun.set()
        with worker.changed:
            worker.changed.wait_for(worker.ending.is_set)
        pids.append(-1)

    worker = LiveWorker("tests", work, said.append)
    worker.start()
    assert begun.wait(LONG_S)
    worker.close(at_once=at_once)
    assert ended(pids[0]) and pids[1:] == [-1] and said == []


@pytest.mark.parametrize("at_once", [True, False])
def test_closing_ends_a_call_at_once_or_after_a_time(monkeypatch: pytest.MonkeyPatch, at_once: bool) -> None:
    monkeypatch.setattr(live_worker, "ENDING_S", LONG_S if at_once else 0.2)
    said: list[str] = []
    pids: list[int] = []
    begun = threading.Event()

    def work() -> None:
        pids.append(worker.process.call(os.getpid))
        begun.set()
        worker.process.call(time.sleep, 300.0)

    worker = LiveWorker("tests", work, said.append)
    worker.start()
    assert begun.wait(LONG_S)
    worker.close(at_once=at_once)
    assert ended(pids[0]) and said == []


def test_one_that_has_not_been_started_can_be_closed() -> None:
    worker = LiveWorker("tests", lambda: None, lambda line: None)
    pid = worker.process.call(os.getpid)
    worker.close()
    assert ended(pid)
