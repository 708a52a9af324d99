"""A calibrator's command, run on one set: how long it took, why it failed, and what it printed."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mirrorcam.core.processes.child_program import TREE_ENDING_S, adopting_orphans, supervised

HEAD_BYTES, TAIL_BYTES = 1_000_000, 100_000
"""Bytes from the beginning, and from the end, of what a command prints that its log keeps."""
LAST_BYTES = 2000
"""Bytes of the end of a log in which the line that says what was wrong is looked for."""
SET, RESULT = "MIRRORCAM_SET", "MIRRORCAM_RESULT"
_SIGNALLED = 128


@dataclass(frozen=True)
class CalibratorRun:
    """How a command ended: after how long, why it failed (empty where it did not), and what it printed."""

    seconds: float
    failure: str
    log: bytes


def run_calibrator(command: str, seen: Path, result: Path, timeout_s: float) -> CalibratorRun:
    """Run a line for the shell on one set, with the folder that it sees and that of its result in its environment.

    Both paths are absolute. What it has started ends with it, after `timeout_s` at the latest, and with this process.
    """
    places = {SET: seen, RESULT: result}
    started = time.monotonic()
    with adopting_orphans() as end_orphans:
        process = subprocess.Popen(
            supervised(command, tree=True),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=os.environ | {name: f"{path}" for name, path in places.items()},
            start_new_session=True,
        )
        printed = _Printed(process)
        try:
            code: int | None = process.wait(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            _end(process)
            if process.returncode < 0:  # by a signal: the command has killed what was to end the rest of it
                end_orphans()
    seconds = time.monotonic() - started
    log = printed.log()
    if code is None:
        return CalibratorRun(seconds, f"the command took longer than {timeout_s:g} s", log)
    return CalibratorRun(seconds, _failure(code, log, places) if code else "", log)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a command that has not ended, with all that it has started."""
    assert process.stdin is not None
    process.stdin.close()
    if process.poll() is None and hasattr(signal, "SIGCONT"):
        process.send_signal(signal.SIGCONT)  # which the command may have stopped
    try:
        process.wait(TREE_ENDING_S + 2.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _failure(code: int, log: bytes, places: Mapping[str, Path]) -> str:
    said = _last_line(log)
    for name, path in places.items():
        said = said.replace(f"{path}", f"${name}")
    number = code - _SIGNALLED if code > 0 else -code
    if number in set(signal.Signals):
        ended = f"signal {number} ended the command"
    else:
        ended = f"the command ended with exit code {code}"
    return ended + (f": {said}" if said else "")


def _last_line(log: bytes) -> str:
    lines = log[-LAST_BYTES:].decode("utf-8", errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "")


class _Printed:
    """What a process prints, of which its log keeps the beginning and the end; a thread takes it in."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        self._stream = process.stdout
        self._head, self._tail, self._count = bytearray(), bytearray(), 0
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._take, name="output of a command", daemon=True)
        self._thread.start()

    def _take(self) -> None:
        with self._stream:
            while block := os.read(self._stream.fileno(), 1 << 16):
                with self._lock:
                    self._count += len(block)
                    room = HEAD_BYTES - len(self._head)
                    self._head += block[:room]
                    self._tail += block[room:] if room < len(block) else b""
                    if len(self._tail) > 2 * TAIL_BYTES:
                        del self._tail[:-TAIL_BYTES]

    def log(self) -> bytes:
        """All of it, or its beginning and its end; what a process prints that has outlived the command is left out."""
        self._thread.join(2.0)
        with self._lock:
            tail = bytes(self._tail[-TAIL_BYTES:])
            left_out = self._count - len(self._head) - len(tail)
            between = b"\n[%d bytes are left out here]\n" % left_out if left_out else b""
            return bytes(self._head) + between + tail
