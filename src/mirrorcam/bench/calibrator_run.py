"""A calibrator run on one set: its blind inputs, its command, and its result files."""

from __future__ import annotations

import os
import shutil
import signal
import stat
import subprocess
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import Field

from mirrorcam import Layout
from mirrorcam.core.disk.files import inside, is_inside, stored_bytes, write_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.child_program import TREE_ENDING_S, adopting_orphans, supervised
from mirrorcam.core.values import Matrix3, Value
from mirrorcam.optics.camera_files.write.virtual_cameras import VirtualCamera, virtual_cameras
from mirrorcam.render_scenes.sets.dataset import USER_FILES, Dataset

VIEWS = "views.json"


class DescribedView(Value):
    """A mirror as a camera of the flipped frame: its sub-image and its nominal camera.

    Attributes
    ----------
    x, y, width, height
        Rectangle of the view in the flipped frame, px.
    outline_px
        Corners (n, 2) of the mirror's sub-image in the flipped frame, px.
    camera_matrix
        Camera matrix (3, 3), for the complete flipped frame.
    """

    name: str
    x: int
    y: int
    width: int
    height: int
    outline_px: tuple[tuple[float, float], ...]
    camera_matrix: Matrix3

    @classmethod
    def of(cls, view: VirtualCamera) -> DescribedView:
        """Return the description of a mirror's camera."""
        rectangle = view.sub_image
        return cls(
            name=view.name,
            x=rectangle.x,
            y=rectangle.y,
            width=rectangle.width,
            height=rectangle.height,
            outline_px=view.outline_px.tolist(),
            camera_matrix=view.camera.matrix,
        )


class DescribedViews(Value):
    """`views.json` of a set: the nominal views of a device, for calibrators without a model of mirrors.

    The `views.json` of an exported light field is a different file, with the schema `mirrorcam.views/1`.
    `flip_code` is the argument of `cv2.flip` that turns a frame into the picture of each view's camera.
    """

    schema_id: Literal["mirrorcam.device_views/1"] = Field(default="mirrorcam.device_views/1", alias="schema")
    width_px: int
    height_px: int
    flip_code: Literal[0, 1]
    views: tuple[DescribedView, ...]


def described_views(layout: Layout) -> DescribedViews:
    """Return the views of a nominal layout."""
    views = virtual_cameras(layout)
    return DescribedViews(
        width_px=layout.camera.width_px,
        height_px=layout.camera.height_px,
        flip_code=1 if views[0].flip == "left-right" else 0,
        views=tuple(map(DescribedView.of, views)),
    )


def write_blind_set(folder: Path, target: Path) -> None:
    """Copy a set's pictures, nominal layout and board, but no ground truth, into a new folder; add `views.json`.

    Raises InputError if the set lacks a file.
    """
    dataset = Dataset.load(folder)
    names = (*USER_FILES, *dataset.frame_names, *dataset.base_names, *filter(None, [dataset.video_name]))
    for name in names:
        source = inside(folder, name)
        stored_bytes(source)
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target / name)
    described = described_views(Layout.load(folder / USER_FILES[0]))
    write_text(target / VIEWS, described.model_dump_json(by_alias=True) + "\n")


HEAD_BYTES, TAIL_BYTES = 1_000_000, 100_000
"""Number of bytes from the beginning and from the end of a command's output that its log keeps."""
MESSAGE_BYTES = 2000
"""Number of bytes at the end of a log that are searched for the error message."""
SET, RESULT = "MIRRORCAM_SET", "MIRRORCAM_RESULT"
_SIGNAL_BASE = 128


@dataclass(frozen=True)
class CalibratorRun:
    """The outcome of a command: duration, reason for a failure (empty on success), and output."""

    seconds: float
    failure: str
    log: bytes


def run_calibrator(command: str, inputs: Path, result: Path, timeout_s: float) -> CalibratorRun:
    """Run a shell command on one set; environment variables state the folders of its inputs and its result.

    Both paths are absolute. The command's descendants end with it, after `timeout_s` at the latest, or with this
    process.
    """
    folders = {SET: inputs, RESULT: result}
    started = time.monotonic()
    with adopting_orphans() as end_orphans:
        process = subprocess.Popen(
            supervised(command, tree=True),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=os.environ | {name: f"{path}" for name, path in folders.items()},
            start_new_session=True,
        )
        output = _Output(process)
        try:
            code: int | None = process.wait(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            _end(process)
            if process.returncode < 0:  # a signal: the command killed its supervisor
                end_orphans()
    seconds = time.monotonic() - started
    log = output.log()
    if code is None:
        return CalibratorRun(seconds, f"the command took longer than {timeout_s:g} s", log)
    return CalibratorRun(seconds, _failure(code, log, folders) if code else "", log)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a running command with its descendants."""
    assert process.stdin is not None
    process.stdin.close()
    if process.poll() is None and hasattr(signal, "SIGCONT"):
        process.send_signal(signal.SIGCONT)  # in case the command stopped its supervisor
    try:
        process.wait(TREE_ENDING_S + 2.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _failure(code: int, log: bytes, folders: Mapping[str, Path]) -> str:
    message = _last_line(log)
    for name, path in folders.items():
        message = message.replace(f"{path}", f"${name}")
    signal_number = code - _SIGNAL_BASE if code > 0 else -code
    if signal_number in set(signal.Signals):
        outcome = f"signal {signal_number} ended the command"
    else:
        outcome = f"the command ended with exit code {code}"
    return outcome + (f": {message}" if message else "")


def _last_line(log: bytes) -> str:
    lines = log[-MESSAGE_BYTES:].decode("utf-8", errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "")


class _Output:
    """Output of a process, read by a thread; the log keeps its beginning and end."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        self._stream = process.stdout
        self._head, self._tail, self._count = bytearray(), bytearray(), 0
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._read, name="output of a command", daemon=True)
        self._thread.start()

    def _read(self) -> None:
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
        """Return the output, or its beginning and end, up to the end of the command."""
        self._thread.join(2.0)
        with self._lock:
            tail = bytes(self._tail[-TAIL_BYTES:])
            omitted = self._count - len(self._head) - len(tail)
            gap = b"\n[%d bytes are omitted here]\n" % omitted if omitted else b""
            return bytes(self._head) + gap + tail


LOG = "log.txt"
"""The log of the command; a result file of this name is ignored."""
COVARIANCE = "covariance.json"
MAX_FILES, MAX_BYTES, MAX_DEPTH = 10_000, 1_000_000_000, 10
"""Limits on the files and folders of a result: number, total size and nesting depth."""


def copy_result(result: Path, target: Path) -> None:
    """Copy the files in a command's result folder into an existing, empty folder.

    Raises InputError, before anything is copied, for content that no calibration has: a link, a pipe, an
    unprintable name, or too many or too large files.
    """
    for name in _names(result):
        path = result / name
        try:
            source = path.open("rb")
        except OSError as error:
            raise InputError(f"${RESULT}/{name}: cannot be read: {error.strerror}") from None
        with source:
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            with (target / name).open("wb") as copy:
                shutil.copyfileobj(source, copy)


def calibration_path(folder: Path) -> Path:
    """Return the single result file of a command, or the folder of several; raises InputError for none."""
    names = [path for path in sorted(folder.iterdir()) if path.name not in (LOG, COVARIANCE)]
    if not names:
        raise InputError(f"the command left no file in ${RESULT}, expected its calibration there")
    return names[0] if len(names) == 1 else folder


def _names(result: Path) -> list[str]:
    """Return the names of all files in a result folder; raises InputError for anything else in it."""
    if not os.path.lexists(result):
        raise InputError(f"the command removed ${RESULT}, expected its calibration there")
    if not stat.S_ISDIR(result.lstat().st_mode):
        raise InputError(f"the command replaced ${RESULT}, expected its calibration in this folder")
    names: list[str] = []
    pending, count, total = [""], 0, 0
    while pending:
        folder = pending.pop()
        try:
            entries = os.scandir(result / folder)
        except OSError as error:
            raise InputError(f"${RESULT}/{folder}: cannot be read: {error.strerror}") from None
        with entries:
            for entry in entries:
                name = f"{folder}/{entry.name}" if folder else entry.name
                status = entry.stat(follow_symlinks=False)
                count, total = count + 1, total + status.st_size
                if count > MAX_FILES or total > MAX_BYTES:
                    raise InputError(
                        f"the command left more than {MAX_FILES} files or {MAX_BYTES // 10**9} GB in ${RESULT}, "
                        "expected only its calibration"
                    )
                _check_entry(result, name, status.st_mode)
                if stat.S_ISDIR(status.st_mode):
                    pending.append(name)
                elif name != LOG:
                    names.append(name)
    return sorted(names)


def _check_entry(result: Path, name: str, mode: int) -> None:
    """Raise InputError unless the path is a file or folder of a calibration."""
    printable_name = name[-80:].encode("unicode_escape", "surrogatepass").decode()
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        kind = "a link" if stat.S_ISLNK(mode) else "not a regular file"
        raise InputError(f"${RESULT}/{printable_name}: is {kind}, expected the files of a calibration")
    if not name.isprintable() or not is_inside(result, name):
        raise InputError(f"the command left a file named '{printable_name}', expected a name of printable characters")
    if name.count("/") >= MAX_DEPTH:
        raise InputError(f"${RESULT}/{printable_name}: is nested too deeply, expected the files of a calibration")
