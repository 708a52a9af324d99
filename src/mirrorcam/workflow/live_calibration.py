"""Calibration from the pictures that a live session took: `mirrorcam calibrate` as a process of its own."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

LINES_KEPT = 40
ENDING_S = 10.0
"""Time that a cancelled calibration has to finish its file."""

State = Literal["running", "done", "alarm", "failed", "cancelled"]
_STATES: dict[int, State] = {0: "done", 1: "alarm"}


@dataclass(frozen=True)
class CalibrationState:
    """How far a calibration is.

    Attributes
    ----------
    state
        "alarm" where it is done, but the diagnostics contradict the model.
    lines
        The last lines that it has printed.
    report
        report.html, once it is there.
    layout
        The calibrated layout.json, once it is there.
    """

    state: State
    lines: tuple[str, ...]
    report: Path | None
    layout: Path | None


class CalibrationRun:
    """A calibration that has been started."""

    def __init__(self, pictures: Path, board: Path, layout: Path, out: Path) -> None:
        self.out = out
        self._lines: deque[str] = deque(maxlen=LINES_KEPT)
        self._cancelled = False
        given = ["calibrate", str(pictures), "--board", str(board), "--layout", str(layout), "--out", str(out)]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "mirrorcam", *given],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
        )
        self._thread = threading.Thread(target=self._follow, name="calibration", daemon=True)
        self._thread.start()

    def state(self) -> CalibrationState:
        """How far it is."""
        code = self._process.poll()
        state: State = "running" if code is None else "cancelled" if self._cancelled else _STATES.get(code, "failed")
        written = state in ("done", "alarm")
        return CalibrationState(
            state,
            tuple(self._lines),
            self.out / "report.html" if written else None,
            self.out / "layout.json" if written else None,
        )

    def wait(self, timeout_s: float | None = None) -> CalibrationState:
        """How far it is once it has ended, or after a time."""
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return self.state()
        self._thread.join(1.0)
        return self.state()

    def cancel(self) -> None:
        """End it as Ctrl-C would; it is killed where that takes long."""
        if self._process.poll() is None:
            self._cancelled = True
            self._process.send_signal(signal.SIGINT)
            try:
                self._process.wait(ENDING_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()

    def _follow(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.append(line.rstrip())
