"""Folders of a page's designs, and the commands started there: their progress and results."""

from __future__ import annotations

import re
import shlex
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from mirrorcam.cad.plan.back_table import Kind as Adapter
from mirrorcam.core.disk.files import numbered, write_text
from mirrorcam.core.disk.zip_files import files_to_zip, write_zip
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.child_command import ENDING_S, ChildCommand
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
    if layout.spec is None:
        raise ValueError("the layout has no spec, expected one that was designed")
    if not (folder / "layout.json").is_file():
        layout.save(folder / "layout.json")
    if not (folder / DESIGN_FILE).is_file():
        write_text(folder / DESIGN_FILE, request_toml(layout.spec))
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
PROGRESS = re.compile(r"(\d+)/(\d+) ")
FRAMES = 12


class JobReport(Value):
    """State of a job for a page; `progress` is from 0 to 1, null if unknown."""

    number: int
    kind: JobKind
    subject: str
    """Folder that the job reads, below the root: of a design, or of calibration pictures."""
    command: str
    state: State
    seconds: float
    progress: float | None
    lines: list[str]
    page: str
    """Path of the result below the address of files; empty without one."""
    folder: str
    bytes: int
    """Size of the files in `folder` once the job has ended; 0 before."""


@dataclass(frozen=True)
class Plan:
    """The command of a job: kind, folder that it reads, arguments, output folder, and the page or file to open.

    Folders are below the root of all jobs, and `page` is below the output folder.
    """

    kind: JobKind
    subject: str
    arguments: tuple[str, ...]
    folder: str
    page: str


def plan(root: Path, kind: JobKind, design: str, adapter: Adapter = "none") -> Plan:
    """Return the job of a kind for the design in the folder `root / design`; `adapter` is the back of the device."""
    folder, back = root / design, ("--adapter", adapter)
    layout, out = str(folder / "layout.json"), ("--out", str(folder / kind))
    arguments, page = {
        "parts": (("cad", layout, *back, *out), "index.html"),
        "set": (("render", layout, "--frames", str(FRAMES), *out), "dataset.json"),
        "run": (("run", str(folder / DESIGN_FILE), *back, *out), "index.html"),
    }[kind]
    return Plan(kind, design, arguments, f"{design}/{kind}", page)


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

    @property
    def state(self) -> State:
        code = self.command.returncode
        if code is None:
            return "running"
        if self.command.cancelled:
            return "cancelled"
        if code == 1 and self.plan.kind == "calibration":
            return "alarm"
        return "done" if code == 0 else "failed"


class Jobs:
    """The jobs of a studio, below one folder; one runs at a time for each subject and kind."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._jobs: dict[int, _Job] = {}
        self._bytes: dict[int, int] = {}
        self._lock = threading.Lock()

    def start(self, plan: Plan) -> JobReport:
        """Start a job. Raises InputError if one of its kind runs already for the same subject."""
        with self._lock:
            running = (job.plan for job in self._jobs.values() if job.state == "running")
            if any((other.kind, other.subject) == (plan.kind, plan.subject) for other in running):
                raise InputError(f"{plan.subject}: such a job is running already, expected it to end first")
            job = _Job(len(self._jobs) + 1, plan, ChildCommand(plan.arguments))
            self._jobs[job.number] = job
        return self._report(job)

    def reports(self) -> list[JobReport]:
        """Return all jobs, the newest first."""
        with self._lock:
            jobs = list(self._jobs.values())
        return [self._report(job) for job in reversed(jobs)]

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

    def _report(self, job: _Job) -> JobReport:
        state, lines, plan = job.state, job.command.lines, job.plan
        counted = [match for line in lines if (match := PROGRESS.search(line))]
        fraction = float(counted[-1][1]) / max(float(counted[-1][2]), 1.0) if counted else None
        page, ended = f"{plan.folder}/{plan.page}", state != "running"
        if ended and job.number not in self._bytes:
            self._bytes[job.number] = bytes_of(self.root / plan.folder)
        return JobReport(
            number=job.number,
            kind=plan.kind,
            subject=plan.subject,
            command=command_line(plan.arguments),
            state=state,
            seconds=round(job.command.seconds, 1),
            progress=1.0 if state in ("done", "alarm") else fraction,
            lines=list(lines),
            page=page if ended and (self.root / page).is_file() else "",
            folder=plan.folder,
            bytes=self._bytes.get(job.number, 0),
        )


def bytes_of(folder: Path) -> int:
    """Return the size of all files in a folder; 0 without one."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def command_line(arguments: Sequence[str]) -> str:
    """Return the command as typed."""
    return shlex.join(["mirrorcam", *arguments])
