"""Commands that a page starts, as processes of their own: their progress, their end, and what they made."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from mirrorcam.optics.base.values import InputError, Value

JobKind = Literal["parts", "set", "run"]
State = Literal["running", "done", "failed", "cancelled"]
LINES_KEPT = 40
PROGRESS = re.compile(r"(\d+)/(\d+) ")
FRAMES = 12
CANCELLING_S = 10.0
"""Time that a cancelled command has to finish its file; it is killed afterwards."""


class JobReport(Value):
    """What a page shows of a job; `progress` is from 0 to 1, null where it is not known."""

    number: int
    kind: JobKind
    design: str
    command: str
    state: State
    seconds: float
    progress: float | None
    lines: list[str]
    page: str
    """The result to open, below the address of files; empty where there is none (yet)."""
    folder: str


@dataclass(frozen=True)
class Plan:
    """A command of a job: its arguments, the folder that it writes, and the page or file of it to open."""

    arguments: tuple[str, ...]
    folder: str
    page: str


def plans(folder: Path) -> dict[JobKind, Plan]:
    """What can be made of the design in a folder, which holds its layout.json and design.toml."""
    layout = str(folder / "layout.json")
    return {
        "parts": Plan(("cad", layout, "--out", str(folder / "parts")), "parts", "index.html"),
        "set": Plan(("render", layout, "--frames", str(FRAMES), "--out", str(folder / "set")), "set", "dataset.json"),
        "run": Plan(("run", str(folder / "design.toml"), "--out", str(folder / "run")), "run", "index.html"),
    }


@dataclass
class _Job:
    number: int
    kind: JobKind
    design: str
    plan: Plan
    process: subprocess.Popen[str]
    began: float
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=LINES_KEPT))
    ended: float | None = None
    cancelled: bool = False


class Jobs:
    """The jobs of a studio, below one folder; one works at a time on each design, any number are remembered."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._jobs: dict[int, _Job] = {}
        self._lock = threading.Lock()

    def start(self, kind: JobKind, design: str) -> JobReport:
        """Start what makes `kind` of the design in the folder of this name. Raises InputError where one works there."""
        plan = plans(self.root / design)[kind]
        with self._lock:
            if any(job.ended is None and (job.design, job.kind) == (design, kind) for job in self._jobs.values()):
                raise InputError(f"{design}: that is being made already")
            process = subprocess.Popen(
                [sys.executable, "-m", "mirrorcam", *plan.arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                encoding="utf-8",
                errors="replace",
                start_new_session=True,
            )
            job = _Job(len(self._jobs) + 1, kind, design, plan, process, time.monotonic())
            self._jobs[job.number] = job
        threading.Thread(target=self._follow, args=(job,), daemon=True, name=f"job {job.number}").start()
        return self._report(job)

    def reports(self) -> list[JobReport]:
        """All jobs, the newest first."""
        with self._lock:
            jobs = list(self._jobs.values())
        return [self._report(job) for job in reversed(jobs)]

    def cancel(self, number: int) -> None:
        """Let a job end as Ctrl-C would: finished files stay. Raises InputError for one that is not there."""
        job = self._jobs.get(number)
        if job is None:
            raise InputError(f"job {number}: not known")
        if job.ended is None:
            job.cancelled = True
            job.process.send_signal(signal.SIGINT)
            threading.Timer(CANCELLING_S, job.process.kill).start()

    def close(self) -> None:
        """End all jobs."""
        for job in list(self._jobs.values()):
            if job.ended is None:
                self.cancel(job.number)
        for job in list(self._jobs.values()):
            job.process.wait(CANCELLING_S + 1.0)

    def _follow(self, job: _Job) -> None:
        assert job.process.stdout is not None
        for line in job.process.stdout:
            job.lines.append(line.rstrip())
        job.process.wait()
        job.ended = time.monotonic()

    def _report(self, job: _Job) -> JobReport:
        state = self._state(job)
        counted = [found for line in job.lines if (found := PROGRESS.search(line))]
        share = float(counted[-1][1]) / max(float(counted[-1][2]), 1.0) if counted else None
        page = f"{job.design}/{job.plan.folder}/{job.plan.page}"
        return JobReport(
            number=job.number,
            kind=job.kind,
            design=job.design,
            command=shown(job.plan.arguments),
            state=state,
            seconds=round((job.ended or time.monotonic()) - job.began, 1),
            progress=1.0 if state == "done" else share,
            lines=list(job.lines),
            page=page if state != "running" and (self.root / page).is_file() else "",
            folder=f"{job.design}/{job.plan.folder}",
        )

    def _state(self, job: _Job) -> State:
        if job.ended is None:
            return "running"
        if job.cancelled:
            return "cancelled"
        return "done" if job.process.returncode == 0 else "failed"


def shown(arguments: Sequence[str]) -> str:
    """The command as one would type it."""
    import shlex

    return shlex.join(["mirrorcam", *arguments])
