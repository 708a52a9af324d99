"""Folders of a page's designs, and the commands started there: their progress and results."""

from __future__ import annotations

import re
import shlex
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

from mirrorcam.cad.plan.back_table import Kind as Adapter
from mirrorcam.core.disk.files import numbered, write_text
from mirrorcam.core.disk.zip_files import files_to_zip, write_zip
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.child_command import COUNT, ENDING_S, ChildCommand
from mirrorcam.core.values import Value
from mirrorcam.designs.design_files import DESIGN_FILE, request_toml
from mirrorcam.optics.geometry.layout import Layout

NAME = re.compile(r"[\w.-]{1,100}")


def folder_name(layout: Layout) -> str:
    """Return the name of a design's folder, which depends only on the design."""
    return f"{layout.arrangement.text.replace(' ', '')}-{layout.identity[:8]}"


def write_folder(root: Path, layout: Layout) -> str:
    """Write layout.json and design.toml of a design below `root` if missing; return the folder's name."""
    name = folder_name(layout)
    folder = root / name
    if not (folder / "layout.json").is_file():
        layout.save(folder / "layout.json")
    if not (folder / DESIGN_FILE).is_file():
        write_text(folder / DESIGN_FILE, request_toml(layout.designed_spec))
    return name


def zipped(root: Path, name: str) -> Path:
    """Write a folder below `root` as a temporary ZIP file.

    The same files give the same bytes. Raises InputError for a folder that does not exist or is outside `root`.
    """
    parts = name.split("/")
    folder = root.joinpath(*parts)
    if not all(NAME.fullmatch(part) and part not in (".", "..") for part in parts) or not folder.is_dir():
        raise InputError(f"{name[:100]}: no such folder")
    files = files_to_zip(folder)
    with tempfile.NamedTemporaryFile(suffix=".zip", delete=False) as file:
        path = Path(file.name)
    try:
        write_zip(path, {f"{parts[0]}/{name}": source for name, source in files.items()})
    except BaseException:
        path.unlink()
        raise
    return path


JobKind = Literal["parts", "set", "run", "calibration"]
State = Literal["running", "done", "alarm", "failed", "cancelled"]
"""State of a job; "alarm": its files are complete, but the check of its command failed."""
STEP = re.compile(r"(\w+) +step (\d+) of (\d+),")
"""Beginning of the line with which a command begins one of its steps."""
FRAMES = 12


class JobReport(Value):
    """State of a job for a page.

    `progress` of all its steps is from 0 to 1, null if unknown; `step` is the current one in words. Only the newest job
    of a folder offers files: a page to open and the size of all.
    """

    number: int
    kind: JobKind
    subject: str
    """Folder that the job reads, below the root: of a design, or of calibration pictures."""
    command: str
    state: State
    seconds: float
    step: str
    progress: float | None
    lines: list[str]
    page: str
    """Path below the address of files: of the result if it is complete, else of a finished step; empty without one."""
    folder: str
    bytes: int
    """Size of the files in `folder` once the job has ended; 0 before."""


@dataclass(frozen=True)
class Plan:
    """The command of a job: kind, folder that it reads, arguments, output folder, and the page or file to open.

    Folders are below the root of all jobs, and `page` is below the output folder, as is `step_page` of a finished step.
    """

    kind: JobKind
    subject: str
    arguments: tuple[str, ...]
    folder: str
    page: str
    step_page: str = ""


def plan(root: Path, kind: JobKind, design: str, adapter: Adapter = "none") -> Plan:
    """Return the job of a kind for the design in the folder `root / design`; `adapter` is the back of the device."""
    folder, back = root / design, ("--adapter", adapter)
    layout, out = str(folder / "layout.json"), ("--out", str(folder / kind))
    arguments, page = {
        "parts": (("cad", layout, *back, *out), "index.html"),
        "set": (("render", layout, "--frames", str(FRAMES), *out), "dataset.json"),
        "run": (("run", str(folder / DESIGN_FILE), *back, *out), "index.html"),
    }[kind]
    return Plan(kind, design, arguments, f"{design}/{kind}", page, "cad/index.html" if kind == "run" else "")


PICTURES, CALIBRATIONS = "pictures", "calibrations"
"""Folders of calibration pictures, and of what was calibrated from them, below the root."""


def calibration_plan(root: Path, board: Path, layout: Path) -> Plan:
    """Return the job that calibrates a layout from the pictures taken, into a new folder."""
    out = numbered(root / CALIBRATIONS, "calibration", "")
    arguments = (*("calibrate", str(root / PICTURES), "--board", str(board)), *("--layout", str(layout)))
    return Plan("calibration", PICTURES, (*arguments, "--out", str(out)), f"{CALIBRATIONS}/{out.name}", "report.html")


@dataclass(frozen=True)
class _Job:
    number: int
    plan: Plan
    command: ChildCommand
    folder: Path
    started: float = field(default_factory=time.time)

    @cached_property
    def bytes(self) -> int:
        """The size of its files, once it has ended."""
        return bytes_of(self.folder)

    @property
    def state(self) -> State:
        code = self.command.returncode
        if code is None:
            return "running"
        if self.command.cancelled:
            return "cancelled"
        page = self.folder / self.plan.page
        if code == 1 and page.is_file() and page.stat().st_mtime >= self.started:
            return "alarm"
        return "done" if code == 0 else "failed"


def progress(lines: Sequence[str]) -> tuple[str, float | None]:
    """Return the current step of a command in words, and the share that is done of all steps; None if unknown."""
    begun, steps, share, text, counted = 1, 1, None, "", ""
    for line in lines:
        if step := STEP.match(line):
            begun, steps, share, counted = int(step[2]), int(step[3]), 0.0, ""
            text = f"step {begun} of {steps}: {step[1]}"
        elif count := COUNT.search(line):
            share, counted = int(count[1]) / max(int(count[2]), 1), f"{count[1]} of {count[2]}"
    return ", ".join(filter(None, (text, counted))), None if share is None else (begun - 1 + share) / steps


class Jobs:
    """The jobs of a studio, below one folder; one runs at a time for each subject and kind."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._jobs: dict[int, _Job] = {}
        self._lock = threading.Lock()

    def start(self, plan: Plan) -> JobReport:
        """Start a job. Raises InputError if one of its kind runs already for the same subject."""
        with self._lock:
            running = (job.plan for job in self._jobs.values() if job.state == "running")
            if any((other.kind, other.subject) == (plan.kind, plan.subject) for other in running):
                raise InputError(f"{plan.subject}: such a job is running already, expected it to end first")
            job = _Job(len(self._jobs) + 1, plan, ChildCommand(plan.arguments), self.root / plan.folder)
            self._jobs[job.number] = job
        return self._report(job, is_newest=True)

    def reports(self) -> list[JobReport]:
        """Return all jobs, the newest first."""
        with self._lock:
            jobs = list(self._jobs.values())
        newest = {job.plan.folder: job for job in jobs}
        return [self._report(job, is_newest=newest[job.plan.folder] is job) for job in reversed(jobs)]

    def cancel(self, number: int) -> None:
        """Interrupt a job as Ctrl-C would: finished files stay. Raises InputError for an unknown job."""
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

    def _report(self, job: _Job, *, is_newest: bool) -> JobReport:
        state, lines, plan = job.state, job.command.lines, job.plan
        step, share = progress(lines)
        offers, complete = is_newest and state != "running", state in ("done", "alarm")
        name = plan.page if complete else plan.step_page
        return JobReport(
            number=job.number,
            kind=plan.kind,
            subject=plan.subject,
            command=command_line(plan.arguments),
            state=state,
            seconds=round(job.command.seconds, 1),
            step=step,
            progress=1.0 if complete else share,
            lines=list(lines),
            page=f"{plan.folder}/{name}" if offers and name and (job.folder / name).is_file() else "",
            folder=plan.folder,
            bytes=job.bytes if offers else 0,
        )


def bytes_of(folder: Path) -> int:
    """Return the size of all files in a folder; 0 without one."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def command_line(arguments: Sequence[str]) -> str:
    """Return the command as typed."""
    return shlex.join(["mirrorcam", *arguments])
