"""Calibration from the pictures that a live session took: `mirrorcam calibrate` as a process of its own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from mirrorcam.core.processes.child_command import ChildCommand

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
        given = [str(pictures), "--board", str(board), "--layout", str(layout), "--out", str(out)]
        self._command = ChildCommand(["calibrate", *given])

    def state(self) -> CalibrationState:
        """How far it is."""
        command, code = self._command, self._command.returncode
        state: State = "running" if code is None else "cancelled" if command.cancelled else _STATES.get(code, "failed")
        written = state in ("done", "alarm")
        return CalibrationState(
            state,
            command.lines,
            self.out / "report.html" if written else None,
            self.out / "layout.json" if written else None,
        )

    def wait(self, timeout_s: float | None = None) -> CalibrationState:
        """How far it is once it has ended, or after a time."""
        self._command.wait(timeout_s)
        return self.state()

    def cancel(self) -> None:
        """End it as Ctrl-C would; it is killed where that takes long."""
        self._command.cancel()
        self._command.wait()
