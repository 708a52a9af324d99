"""Work shared by processes: answers in order, errors as they are, no process left behind."""

from __future__ import annotations

import operator
import os
import time
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children

import pytest

from mirrorcam.cad.process_pool import Task, crew, results
from mirrorcam.optics.base.values import InputError


@pytest.mark.parametrize("workers", [1, 2])
def test_answers_come_in_the_order_of_the_tasks(workers: int) -> None:
    tasks: list[Task] = [(operator.add, (1, 2)), (operator.mul, (3, 4)), (pow, (2, 5))]
    done: list[None] = []
    with crew(workers) as executor:
        assert results(executor, tasks, lambda: done.append(None)) == [3, 12, 32]
    assert len(done) == 3
    assert active_children() == []


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_of_the_work_is_raised_as_it_is(workers: int) -> None:
    tasks: list[Task] = [(operator.add, (1, 2)), (refuse, ("mount",))]
    with pytest.raises(InputError, match=r"^mount: refused$"), crew(workers) as executor:
        results(executor, tasks, lambda: None)
    assert active_children() == []


def refuse(name: str) -> None:
    raise InputError(f"{name}: refused")


def test_a_process_that_dies_is_no_hang() -> None:
    started = time.monotonic()
    with pytest.raises(BrokenProcessPool), crew(2) as executor:
        results(executor, [(os._exit, (3,))], lambda: None)
    assert time.monotonic() - started < 60.0
