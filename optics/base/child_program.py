"""Other programs as child processes that end with this process, however it ends.

Between the two stands a small Python process, this file. Its standard input is a pipe of which this process holds the
other end; the system closes that when this process ends, even if it is killed, and the child is killed then. This
works alike on all systems.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence


def run_program(
    command: Sequence[str], *, timeout_s: float, environment: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[bytes]:
    """Run a program to its end, without standard input, and return its output.

    An exception here, such as KeyboardInterrupt, ends it too. Raises subprocess.TimeoutExpired.
    """
    theirs, ours = os.pipe()
    try:
        process = subprocess.Popen(
            [sys.executable, "-I", "-S", __file__, *command],
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


def _supervise(command: Sequence[str]) -> int:
    """Run a program until it ends or standard input is closed; return its exit code."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is handled by the parent process
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL)

    def end_with_input() -> None:
        while os.read(0, 1):
            pass
        process.kill()

    threading.Thread(target=end_with_input, daemon=True).start()
    code = process.wait()
    return code if code >= 0 else 128 - code


if __name__ == "__main__":
    sys.exit(_supervise(sys.argv[1:]))
