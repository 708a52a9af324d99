"""The files that a calibrator's command leaves: taken over where they are files of a calibration, and nothing else."""

from __future__ import annotations

import os
import shutil
import stat
from pathlib import Path

from mirrorcam.bench.calibrator_run import RESULT
from mirrorcam.core.disk.files import is_inside
from mirrorcam.core.values import InputError

LOG = "log.txt"
"""The log of the command, as which no file of its own is taken."""
COVARIANCE = "covariance.json"
MOST_FILES, MOST_BYTES, DEEPEST = 10_000, 1_000_000_000, 10
"""Of all files and folders that a command may leave, and how deep these may nest."""


def take_result(result: Path, place: Path) -> None:
    """Copy the files in a folder that a command has filled into another, which is there and empty.

    Raises InputError in one line, before anything is copied, where the folder or anything in it is not what a
    calibration is: a link, a pipe, a name that cannot be printed, or more than a calibration takes.
    """
    for name in _names(result):
        path = result / name
        try:
            source = path.open("rb")
        except OSError as error:
            raise InputError(f"${RESULT}/{name}: cannot be read: {error.strerror}") from None
        with source:
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            with (place / name).open("wb") as copy:
                shutil.copyfileobj(source, copy)


def calibration_of(place: Path) -> Path:
    """The one file that a command has left, or the folder of several; raises InputError for none."""
    names = [path for path in sorted(place.iterdir()) if path.name not in (LOG, COVARIANCE)]
    if not names:
        raise InputError(f"the command left no file in ${RESULT}, expected its calibration there")
    return names[0] if len(names) == 1 else place


def _names(result: Path) -> list[str]:
    """Paths of all files in a folder that a command has filled; raises InputError for anything else in it."""
    if not os.path.lexists(result):
        raise InputError(f"the command removed ${RESULT}, expected its calibration there")
    if not stat.S_ISDIR(result.lstat().st_mode):
        raise InputError(f"the command replaced ${RESULT}, expected its calibration in this folder")
    found: list[str] = []
    waiting, count, total = [""], 0, 0
    while waiting:
        folder = waiting.pop()
        try:
            entries = os.scandir(result / folder)
        except OSError as error:
            raise InputError(f"${RESULT}/{folder}: cannot be read: {error.strerror}") from None
        with entries:
            for entry in entries:
                name = f"{folder}/{entry.name}" if folder else entry.name
                status = entry.stat(follow_symlinks=False)
                count, total = count + 1, total + status.st_size
                if count > MOST_FILES or total > MOST_BYTES:
                    raise InputError(
                        f"the command left more than {MOST_FILES} files or {MOST_BYTES // 10**9} GB in ${RESULT}, "
                        "expected its calibration alone"
                    )
                _refuse(result, name, status.st_mode)
                if stat.S_ISDIR(status.st_mode):
                    waiting.append(name)
                elif name != LOG:
                    found.append(name)
    return sorted(found)


def _refuse(result: Path, name: str, mode: int) -> None:
    """Raise InputError for what is not a file or folder of a calibration."""
    shown = name[-80:].encode("unicode_escape", "surrogatepass").decode()
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        what = "a link" if stat.S_ISLNK(mode) else "not a regular file"
        raise InputError(f"${RESULT}/{shown}: is {what}, expected the files of a calibration")
    if not name.isprintable() or not is_inside(result, name):
        raise InputError(f"the command left a file named '{shown}', expected a name of printable characters")
    if name.count("/") >= DEEPEST:
        raise InputError(f"${RESULT}/{shown}: is nested too deeply, expected the files of a calibration")
