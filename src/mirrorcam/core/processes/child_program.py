"""Other programs as child processes that end with this process, however it ends.

A small Python process, which runs this file, supervises the child. Its standard input is a pipe from this process; the
system closes the pipe when this process ends, even if it is killed, and the supervisor then kills the child, or first
interrupts it, as by Ctrl-C, if it has files to finish. This works on all systems.

Other programs may leave processes behind. With `tree`, these end with the program: on Linux every descendant, even in
other sessions; on other POSIX systems its process group; on Windows the program alone. Not covered are processes
that a system service starts for it (cron, systemd, a container engine), and other users' processes. If a program kills
its supervisor, on Linux `adopting_orphans` ends the remaining processes.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

# On Windows, only a process group can be interrupted, by Ctrl-Break.
if sys.platform == "win32":
    _INTERRUPT, NEW_GROUP = signal.CTRL_BREAK_EVENT, subprocess.CREATE_NEW_PROCESS_GROUP
else:
    _INTERRUPT, NEW_GROUP = signal.SIGINT, 0
"""Signal that interrupts a program, and flag that starts one in its own process group."""
TREE_ENDING_S = 10.0
"""Time limit for ending the processes of a tree."""
_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36


def supervised(command: Sequence[str] | str, *, ending_s: float = 0.0, tree: bool = False) -> list[str]:
    """Return the command line of the supervisor, which runs a program and ends it when its own standard input closes.

    A str is a shell command. With `ending_s`, the program is first interrupted, as by Ctrl-C, and then killed
    after that time. With `tree`, the program runs in its own session, and its descendants end with it. The
    exit code is the program's, or 128 plus the number of the signal that ended it.
    """
    shell, words = (True, [command]) if isinstance(command, str) else (False, list(command))
    return [sys.executable, "-I", "-S", __file__, str(ending_s), f"{tree:d}", f"{shell:d}", *words]


def run_program(
    command: Sequence[str], *, timeout_s: float, environment: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[bytes]:
    """Run a program to its end, without standard input, and return its output.

    An exception such as KeyboardInterrupt ends the program, too. Raises subprocess.TimeoutExpired.
    """
    read_end, write_end = os.pipe()
    try:
        process = subprocess.Popen(
            supervised(command),
            stdin=read_end,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=None if environment is None else dict(environment),
        )
    except BaseException:
        os.close(write_end)
        raise
    finally:
        os.close(read_end)
    with process:
        try:
            out, err = process.communicate(timeout=timeout_s)
        finally:
            os.close(write_end)
    return subprocess.CompletedProcess(command, process.returncode, out, err)


def _supervise(command: Sequence[str], ending_s: float, *, tree: bool, shell: bool) -> int:
    """Run a program until it ends or standard input is closed; return its exit code."""
    # The parent handles Ctrl-C. A program that may be interrupted must not inherit the ignored signal.
    signal.signal(signal.SIGINT, (lambda *_: None) if ending_s else signal.SIG_IGN)
    process = subprocess.Popen(
        command[0] if shell else command,
        shell=shell,
        stdin=subprocess.DEVNULL,
        creationflags=NEW_GROUP if ending_s else 0,
        start_new_session=tree,
        preexec_fn=_adopting() if tree else None,  # noqa: PLW1509  no other thread runs yet
    )
    ended = threading.Event()

    def end_with_input() -> None:
        while os.read(0, 1):
            pass
        try:
            if ending_s and not ended.is_set():
                os.kill(process.pid, _INTERRUPT)
                ended.wait(ending_s)
        finally:
            if tree and sys.platform != "win32":
                _kill_tree(process.pid)
            else:
                process.kill()

    threading.Thread(target=end_with_input, daemon=True).start()
    if tree and sys.platform != "win32":
        code = _reaped(process.pid)
        ended.set()
        _end_tree(process.pid)
    else:
        code = process.wait()
        ended.set()
    return code if code >= 0 else 128 - code


@contextmanager
def adopting_orphans() -> Iterator[Callable[[], None]]:
    """On Linux, make this process adopt its orphaned descendants within the block; yield a function that ends them.

    Only processes of other sessions that began within the block are ended: the processes of a `tree` are in such
    sessions, and cannot join this process's session. On other systems, nothing is ended.
    """
    if sys.platform != "linux":
        yield lambda: None
        return
    from ctypes import CDLL

    prctl, earlier = CDLL(None).prctl, _descendants()
    prctl(_PR_SET_CHILD_SUBREAPER, 1)
    try:
        yield lambda: _end_orphans(earlier)
    finally:
        prctl(_PR_SET_CHILD_SUBREAPER, 0)


def _adopting() -> Callable[[], object] | None:
    """On Linux, adopt orphaned descendants; return a function by which a child is killed with this process."""
    if sys.platform != "linux":
        return None
    from ctypes import CDLL

    prctl = CDLL(None).prctl
    prctl(_PR_SET_CHILD_SUBREAPER, 1)
    return lambda: prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


if sys.platform != "win32":

    def _reaped(pid: int) -> int:
        """Wait for a child, reaping all others; return its exit code, or minus the signal."""
        while True:
            child, status = os.waitpid(-1, 0)
            if child == pid:
                return os.waitstatus_to_exitcode(status)

    def _end_tree(pid: int) -> None:
        """Kill the remaining tree of a child, and wait for its end up to a time limit."""
        deadline = time.monotonic() + TREE_ENDING_S
        with suppress(ChildProcessError):  # no process is left
            while time.monotonic() < deadline:
                _kill_tree(pid)
                while os.waitpid(-1, os.WNOHANG)[0]:
                    pass
                time.sleep(0.005)

    def _kill_tree(pid: int) -> None:
        """Kill the group of a child, and every descendant of this process if the system lists them."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(pid, signal.SIGKILL)
        _kill_all(_descendants)

    def _kill_all(current: Callable[[], set[int]]) -> set[int]:
        """Kill all processes that `current` returns, even new ones; return their IDs."""
        # Stop them first: a running process could start others faster than they are killed.
        stopped: set[int] = set()
        while new := current() - stopped:
            _signal(new, signal.SIGSTOP)
            stopped |= new
        _signal(stopped, signal.SIGKILL)
        return stopped

    def _end_orphans(earlier: set[int]) -> None:
        """Kill new descendants of this process in other sessions; wait for their end up to a time limit."""
        deadline, remaining = time.monotonic() + TREE_ENDING_S, _kill_all(lambda: _of_other_sessions() - earlier)
        while remaining and time.monotonic() < deadline:
            for pid in remaining.copy():
                with suppress(ChildProcessError):
                    os.waitpid(pid, os.WNOHANG)
            remaining &= _descendants()
            time.sleep(0.005)

    def _of_other_sessions() -> set[int]:
        others, own = set(), os.getsid(0)
        for pid in _descendants():
            with suppress(ProcessLookupError, PermissionError):
                if os.getsid(pid) != own:
                    others.add(pid)
        return others

    def _signal(processes: set[int], number: int) -> None:
        for pid in processes:
            with suppress(ProcessLookupError, PermissionError):
                os.kill(pid, number)

    def _descendants() -> set[int]:
        """Return the IDs of all descendants of this process on Linux; an empty set elsewhere."""
        children: dict[int, list[int]] = {}
        try:
            numbers = [int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit()]
        except FileNotFoundError:
            return set()
        for number in numbers:
            with suppress(OSError):  # it has ended meanwhile
                parent = int(Path(f"/proc/{number}/stat").read_bytes().rpartition(b")")[2].split()[1])
                children.setdefault(parent, []).append(number)
        descendants, pending = set(), [os.getpid()]
        while pending:
            direct = children.get(pending.pop(), [])
            descendants.update(direct)
            pending += direct
        return descendants


if __name__ == "__main__":
    _ending_s, _tree, _shell, *_command = sys.argv[1:]
    sys.exit(_supervise(_command, float(_ending_s), tree=_tree == "1", shell=_shell == "1"))
