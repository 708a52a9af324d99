"""Other programs as child processes that end with this process, however it ends.

Between the two stands a small Python process, this file. Its standard input is a pipe of which this process holds the
other end; the system closes that when this process ends, even if it is killed, and the child is ended then: killed, or
interrupted first, as by Ctrl-C, where it has files to finish. This works alike on all systems.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress

# On Windows, no process but a whole group is interrupted, by Ctrl-Break.
if sys.platform == "win32":
    _INTERRUPT, NEW_GROUP = signal.CTRL_BREAK_EVENT, subprocess.CREATE_NEW_PROCESS_GROUP
else:
    _INTERRUPT, NEW_GROUP = signal.SIGINT, 0
"""What interrupts a program, and the flag with which one is created in a group of its own."""


def supervised(command: Sequence[str], *, ending_s: float = 0.0) -> list[str]:
    """The command line of the process between: it runs a program, and ends it where its own standard input closes.

    With `ending_s`, the program is interrupted then, as by Ctrl-C, and killed if it has not ended after that time. The
    exit code is that of the program; 128 and the number of a signal where one has ended it.
    """
    return [sys.executable, "-I", "-S", __file__, str(ending_s), *command]


def run_program(
    command: Sequence[str], *, timeout_s: float, environment: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[bytes]:
    """Run a program to its end, without standard input, and return its output.

    An exception here, such as KeyboardInterrupt, ends it too. Raises subprocess.TimeoutExpired.
    """
    theirs, ours = os.pipe()
    try:
        process = subprocess.Popen(
            supervised(command),
            stdin=theirs,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=None if environment is None else dict(environment),
        )
    except BaseException:
        os.close(ours)
        raise
    finally:
        os.close(theirs)
    with process:
        try:
            out, err = process.communicate(timeout=timeout_s)
        finally:
            os.close(ours)
    return subprocess.CompletedProcess(command, process.returncode, out, err)


def _supervise(command: Sequence[str], ending_s: float) -> int:
    """Run a program until it ends or standard input is closed; return its exit code."""
    # Ctrl-C is handled by the parent process. A program that may be interrupted must not inherit that it is ignored.
    signal.signal(signal.SIGINT, (lambda *_: None) if ending_s else signal.SIG_IGN)
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, creationflags=NEW_GROUP if ending_s else 0)

    def end_with_input() -> None:
        while os.read(0, 1):
            pass
        try:
            if ending_s:
                process.send_signal(_INTERRUPT)
                with suppress(subprocess.TimeoutExpired):
                    process.wait(ending_s)
        finally:
            process.kill()

    threading.Thread(target=end_with_input, daemon=True).start()
    code = process.wait()
    return code if code >= 0 else 128 - code


if __name__ == "__main__":
    sys.exit(_supervise(sys.argv[2:], float(sys.argv[1])))
