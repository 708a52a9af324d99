"""A map over threads gives the results of `map`, on several threads, and raises what a job raises."""

from __future__ import annotations

import threading

import pytest

from mirrorcam.core.processes.threads import thread_map


@pytest.mark.parametrize("workers", [1, 2, 3, 8])
@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_results_are_those_of_map(workers: int, count: int) -> None:
    run = thread_map(workers)
    numbers = range(count)
    assert list(run(lambda a, b: 10 * a + b, numbers, reversed(numbers))) == list(
        map(lambda a, b: 10 * a + b, numbers, reversed(numbers))
    )


def test_jobs_run_at_the_same_time_and_on_the_calling_thread_too() -> None:
    together = threading.Barrier(3, timeout=10.0)
    threads = list(thread_map(3)(lambda _: (together.wait(), threading.current_thread())[1], range(3)))
    assert len(set(threads)) == 3
    assert threading.current_thread() in threads


@pytest.mark.parametrize("failing", [0, 1, 4])
def test_an_exception_of_a_job_is_raised_after_all_threads_ended(failing: int) -> None:
    done = []

    def job(number: int) -> None:
        if number == failing:
            raise ValueError(f"job {number}")
        done.append(number)

    with pytest.raises(ValueError, match=f"job {failing}"):
        thread_map(2)(job, range(6))
    other_share = {number for number in range(6) if number % 2 != failing % 2}
    assert other_share <= set(done)
