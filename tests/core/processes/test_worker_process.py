"""A process that makes one call at a time: answers, errors, its end at any moment, and its start again."""

from __future__ import annotations

import ctypes
import multiprocessing
import operator
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.worker_process import ONE_THREAD, WorkerDied, WorkerProcess
from tests.core.processes.processes import ended, finding_tests, first_line
from tests.nightly import a_few

PRELOADED = ("mirrorcam.core.values",)


@pytest.fixture(params=[(), PRELOADED], ids=["spawned", "preloaded"])
def worker(request: pytest.FixtureRequest) -> Iterator[WorkerProcess]:
    process = WorkerProcess(preload=request.param)
    yield process
    process.kill()
    assert multiprocessing.active_children() == []


def refuse(name: str) -> None:
    raise InputError(f"{name}: refused")


def environment() -> str:
    ignores = signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, set())
    return " ".join((*(os.environ[name] for name in ONE_THREAD), f"{ignores}"))


def stuck(path: Path) -> None:
    """Note the process, then wait in native code that lets no other thread of it run."""
    path.write_text(f"{os.getpid()}\n")
    ctypes.PyDLL(None).sleep(300)


def unspeakable() -> object:
    return lambda: None


def test_one_process_makes_call_after_call(worker: WorkerProcess) -> None:
    assert worker.call(pow, 2, 5) == 32
    assert worker.call(operator.add, "a", "b") == "ab"
    first, second = worker.call(os.getpid), worker.call(os.getpid)
    assert first == second != os.getpid()


def test_errors_are_raised_here_and_the_process_works_on(worker: WorkerProcess) -> None:
    number = worker.call(os.getpid)
    with pytest.raises(InputError, match=r"^mount: refused$"):
        worker.call(refuse, "mount")
    with pytest.raises(RuntimeError, match=r"Traceback(.|\n)*ZeroDivisionError"):
        worker.call(operator.truediv, 1, 0)
    with pytest.raises(RuntimeError, match=r"Traceback(.|\n)*FileNotFoundError"):
        worker.call(os.listdir, "/none/such")
    with pytest.raises(RuntimeError, match=r"Traceback(.|\n)*pickle"):
        worker.call(unspeakable)
    assert worker.call(os.getpid) == number


def test_a_process_that_dies_is_reported_and_the_next_call_starts_another(worker: WorkerProcess) -> None:
    with pytest.raises(WorkerDied, match=r"^with exit code 3$"):
        worker.call(os._exit, 3)
    with pytest.raises(WorkerDied, match=r"^by signal 9$"):
        worker.call(signal.raise_signal, signal.SIGKILL)
    assert worker.call(pow, 2, 5) == 32


def test_a_process_that_died_before_a_call_is_reported_too(worker: WorkerProcess) -> None:
    os.kill(worker.call(os.getpid), signal.SIGKILL)
    multiprocessing.connection.wait([worker.connection])
    with pytest.raises(WorkerDied):
        worker.call(pow, 2, 5)
    assert worker.call(pow, 2, 5) == 32


def test_another_thread_ends_a_call_in_native_code(worker: WorkerProcess, tmp_path: Path) -> None:
    died: list[str] = []

    def call() -> None:
        with pytest.raises(WorkerDied) as death:
            worker.call(stuck, tmp_path / "pid")
        died.append(str(death.value))

    thread = threading.Thread(target=call)
    thread.start()
    number = int(first_line(tmp_path / "pid"))
    worker.kill()
    assert ended(number)
    thread.join()
    assert died == ["by signal 9"]
    worker.kill()
    assert worker.call(os.getpid) != number


def test_a_kill_is_of_the_call_that_is_made_not_of_those_that_wait(worker: WorkerProcess, tmp_path: Path) -> None:
    died: list[str] = []

    def call(name: str) -> None:
        try:
            worker.call(stuck, tmp_path / name)
        except WorkerDied:
            died.append(name)

    threads = {name: threading.Thread(target=call, args=(name,)) for name in ("first", "second")}
    threads["first"].start()
    first_line(tmp_path / "first")
    threads["second"].start()
    killing = threading.Thread(target=worker.kill)
    killing.start()
    killing.join(30.0)
    assert not killing.is_alive()
    threads["first"].join(30.0)
    assert died == ["first"]
    first_line(tmp_path / "second")
    worker.kill()
    threads["second"].join(30.0)
    assert died == ["first", "second"]


def test_an_answer_without_a_call_is_refused(worker: WorkerProcess) -> None:
    with pytest.raises(ValueError, match="no call was sent"):
        worker.answer()


def test_answers_of_several_are_waited_for(worker: WorkerProcess) -> None:
    other = WorkerProcess()
    other.send(time.sleep, 300)
    worker.send(pow, 2, 5)
    assert multiprocessing.connection.wait([worker.connection, other.connection]) == [worker.connection]
    assert worker.answer() == 32
    other.kill()


def test_it_computes_in_one_thread_and_leaves_interruptions_to_its_parent(
    worker: WorkerProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert worker.call(environment) == "1 1 1 1 True"
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, set())


def test_it_may_have_a_worker_of_its_own(worker: WorkerProcess) -> None:
    assert worker.call(one_below, 2) == 32


def one_below(levels: int) -> int:
    """2 to the power of 5, as a worker so many levels below this process finds it."""
    worker = WorkerProcess(preload=PRELOADED)
    try:
        below: int = worker.call(one_below, levels - 1) if levels > 1 else worker.call(pow, 2, 5)
    finally:
        worker.end()
    return below


def test_an_end_without_a_call_is_not_a_death() -> None:
    worker = WorkerProcess()
    worker.end()
    number = worker.call(os.getpid)
    worker.end()
    assert ended(number, within_s=0.0)


def test_a_worker_that_nobody_holds_any_more_ends() -> None:
    number = WorkerProcess().call(os.getpid)
    assert ended(number)


OWNER = """
import os, sys
from pathlib import Path
from mirrorcam.core.processes.worker_process import WorkerProcess
from tests.core.processes.test_worker_process import PRELOADED, call_below, stuck
if __name__ == "__main__":
    worker = WorkerProcess(preload=PRELOADED if sys.argv[1] == "preload" else ())
    if sys.argv[2] == "exit":
        worker.send(call_below, Path(sys.argv[3]), Path(sys.argv[4]))
        while not Path(sys.argv[4]).exists():
            pass
    else:
        worker.call(call_below, Path(sys.argv[3]), Path(sys.argv[4]))
"""


def call_below(path: Path, below: Path) -> None:
    """Note the process, and have a worker of it note itself and wait."""
    path.write_text(f"{os.getpid()}\n")
    WorkerProcess().call(stuck, below)


@pytest.mark.skipif(sys.platform != "linux", reason="native code is ended in the middle on Linux only")
@pytest.mark.parametrize("start", a_few(2, ["spawn", "preload"]))
@pytest.mark.parametrize("end", ["exit", "kill"])
def test_it_ends_with_its_parent_and_so_do_its_own(start: str, end: str, tmp_path: Path) -> None:
    (tmp_path / "owner.py").write_text(OWNER)
    names = [tmp_path / "0", tmp_path / "1"]
    process = subprocess.Popen([sys.executable, tmp_path / "owner.py", start, end, *names], env=finding_tests())
    numbers = [int(first_line(name)) for name in names]
    if end == "kill":
        process.kill()
    process.wait(60)
    for number in numbers:
        assert ended(number)


def test_a_closed_worker_starts_no_other_process_for_calls_that_wait(worker: WorkerProcess, tmp_path: Path) -> None:
    died: list[str] = []

    def call(function: Callable[..., None], *arguments: Path) -> None:
        try:
            worker.call(function, *arguments)
        except WorkerDied as error:
            died.append(str(error))

    threads = [threading.Thread(target=call, args=(stuck, tmp_path / "first"))]
    threads += [threading.Thread(target=call, args=(stuck, tmp_path / f"waiting{k}")) for k in range(3)]
    threads[0].start()
    while not (tmp_path / "first").exists():
        time.sleep(0.01)
    for thread in threads[1:]:
        thread.start()
    worker.close()
    for thread in threads:
        thread.join(10.0)
    assert len(died) == 4
    assert sorted(path.name for path in tmp_path.iterdir()) == ["first"]
    with pytest.raises(WorkerDied, match="closed"):
        worker.call(pow, 2, 5)
