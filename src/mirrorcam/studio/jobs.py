"""Commands that a page starts, as processes of their own: their progress, their end, and what they made."""

from __future__ import annotations

import re
import shlex
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from mirrorcam.cad.plan.back_table import Kind as Adapter
from mirrorcam.core.processes.child_command import ENDING_S, ChildCommand
from mirrorcam.core.values import InputError, Value

JobKind = Literal["parts", "set", "run"]
State = Literal["running", "done", "failed", "cancelled"]
PROGRESS = re.compile(r"(\d+)/(\d+) ")
FRAMES = 12


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
    bytes: int
    """Size of the files in it once the job has ended; 0 before."""


@dataclass(frozen=True)
class Plan:
    """A command of a job: its arguments, the folder that it writes, and the page or file of it to open."""

    arguments: tuple[str, ...]
    folder: str
    page: str


def plans(folder: Path, adapter: Adapter = "none") -> dict[JobKind, Plan]:
    """What can be made of the design in a folder, which holds its layout.json and design.toml.

    `adapter` is the kind of what carries the device.
    """
    layout, carried = str(folder / "layout.json"), ("--adapter", adapter)
    return {
        "parts": Plan(("cad", layout, *carried, "--out", str(folder / "parts")), "parts", "index.html"),
        "set": Plan(("render", layout, "--frames", str(FRAMES), "--out", str(folder / "set")), "set", "dataset.json"),
        "run": Plan(("run", str(folder / "design.toml"), *carried, "--out", str(folder / "run")), "run", "index.html"),
    }


@dataclass(frozen=True)
class _Job:
    number: int
    kind: JobKind
    design: str
    plan: Plan
    command: ChildCommand

    @property
    def state(self) -> State:
        code = self.command.returncode
        if code is None:
            return "running"
        if self.command.cancelled:
            return "cancelled"
        return "done" if code == 0 else "failed"


class Jobs:
    """The jobs of a studio, below one folder; one works at a time on each design, any number are remembered."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._jobs: dict[int, _Job] = {}
        self._lock = threading.Lock()

    def start(self, kind: JobKind, design: str, adapter: Adapter = "none") -> JobReport:
        """Start what makes `kind` of the design in the folder of this name, for what carries the device.

        Raises InputError where one works there.
        """
        plan = plans(self.root / design, adapter)[kind]
        with self._lock:
            made = [job for job in self._jobs.values() if (job.design, job.kind) == (design, kind)]
            if any(job.state == "running" for job in made):
                raise InputError(f"{design}: that is being made already")
            job = _Job(len(self._jobs) + 1, kind, design, plan, ChildCommand(plan.arguments))
            self._jobs[job.number] = job
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
        job.command.cancel()

    def close(self) -> None:
        """End all jobs."""
        jobs = list(self._jobs.values())
        for job in jobs:
            job.command.cancel()
        for job in jobs:
            job.command.wait(ENDING_S + 1.0)

    def _report(self, job: _Job) -> JobReport:
        state, lines = job.state, job.command.lines
        counted = [found for line in lines if (found := PROGRESS.search(line))]
        share = float(counted[-1][1]) / max(float(counted[-1][2]), 1.0) if counted else None
        page = f"{job.design}/{job.plan.folder}/{job.plan.page}"
        return JobReport(
            number=job.number,
            kind=job.kind,
            design=job.design,
            command=shown(job.plan.arguments),
            state=state,
            seconds=round(job.command.seconds, 1),
            progress=1.0 if state == "done" else share,
            lines=list(lines),
            page=page if state != "running" and (self.root / page).is_file() else "",
            folder=f"{job.design}/{job.plan.folder}",
            bytes=0 if state == "running" else bytes_of(self.root / job.design / job.plan.folder),
        )


def bytes_of(folder: Path) -> int:
    """Size of all files in a folder; 0 where there is none."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def shown(arguments: Sequence[str]) -> str:
    """The command as one would type it."""
    return shlex.join(["mirrorcam", *arguments])
