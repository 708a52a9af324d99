"""Folders that commands write their results into: one command at a time, without loss of the user's files.

In a folder of results, the hidden folder `.mirrorcam` holds the record of what commands have written there, the store
of results that are not made again and, while a command works, its lock and the files that it has not finished.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from glob import has_magic
from pathlib import Path

from filelock import FileLock, Timeout
from pydantic import Field

from mirrorcam.core.disk.files import inside, read_record, write_text
from mirrorcam.core.disk.results import Results
from mirrorcam.core.disk.written_files import ADVICE, FORCE_ADVICE, FolderRecord, discard, refuse_blocked
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Value

HIDDEN = ".mirrorcam"
RECORD, LOCK, HOLDER, UNFINISHED, RESULTS = "written.jsonl", "lock", "holder.json", "unfinished", "results"


class Holder(Value):
    """The process that writes into a folder."""

    command: str = Field(max_length=40)
    process: int
    host: str = Field(max_length=255)
    since: datetime

    def __str__(self) -> str:
        return (
            f"mirrorcam {self.command}, process {self.process} on {self.host} since {self.since:%Y-%m-%d %H:%M:%S} UTC"
        )


@dataclass(frozen=True)
class OutputFolder:
    """A folder that a command writes into while it holds its lock: get one from `output_folder`.

    Attributes
    ----------
    root
        The folder that is locked.
    record
        What commands have written into it.
    command
        Name of the command; it replaces only what it wrote itself. A record that came with a shared folder says
        so of files whose checksum its author knew: files that came with it, never those that the user adds.
    part
        Subfolder that is written, with a record of its own; empty for the root itself.
    group
        Name of files that are replaced together, with a record of their own; empty for all others.
    force
        Whether any file may be replaced; None where the command has no such option.
    """

    root: Path
    record: FolderRecord
    command: str
    part: str = ""
    group: str = ""
    force: bool | None = None

    @property
    def path(self) -> Path:
        """The folder that is written."""
        return self.root / self.part

    def subfolder(self, name: str) -> OutputFolder:
        """Return a subfolder, with a record of its own; raises InputError for a link that leads out of the folder."""
        inside(self.root, name)
        return replace(self, part=name)

    def grouped(self, name: str) -> OutputFolder:
        """Return the same folder for a group of files that are replaced together, whatever else is written there."""
        return replace(self, group=name)

    @property
    def results(self) -> Results:
        """The store of results of all commands that write into the locked folder."""
        return Results(results_folder(self.root))

    @property
    def unfinished(self) -> Path:
        """Folder for files that are not finished, which may hold what a killed run has left."""
        return self.root / HIDDEN / UNFINISHED / (self.part or self.group or "files")

    def refuse_others(self, *patterns: str) -> None:
        """Raise InputError where a file of these names is there that this command has not written, or that was changed.

        Called before long work, it saves the user from waiting for results that cannot be put in their place. Patterns
        are patterns of `Path.glob`; a folder in the place of a name is refused even with `force`.
        """
        refuse_blocked(self.path, (pattern for pattern in patterns if not has_magic(pattern)))
        if not self.force:
            matching = [path for pattern in patterns for path in sorted(self.path.glob(pattern))]
            found = (path for path in matching if path.is_symlink() or not path.is_dir())
            self._refuse(path.relative_to(self.path).as_posix() for path in found)

    def has_written(self, name: str) -> bool:
        """Return whether this command has written a file of that name, changed since or not."""
        return name in self.record.of(self._key)

    def refuse_unknown(self) -> None:
        """Raise InputError where the folder holds files, and none that this command has written."""
        if not self.force and not self.record.of(self._key) and _has_files(self.path):
            raise InputError(
                f"{self.path}: holds files that this command did not write, expected a new folder, or --force"
            )

    def refuse_changed(self) -> None:
        """Raise InputError where a file that this command has written was changed since."""
        if not self.force:
            self._refuse(sorted(self.record.of(self._key)))

    @contextmanager
    def staged(self, *, complete: bool = True, result: str = "") -> Iterator[Path]:
        """Yield an empty folder whose files are put in their places when the block ends well, as `adopt` says.

        They are also put there when the block ends with an error once the file `result` is finished: no picture or page
        that cannot be made takes a result with it.
        """
        self.discard()
        self.unfinished.mkdir(parents=True)
        ended = False
        try:
            yield self.unfinished
            ended = True
        finally:
            try:
                if ended or (result and (self.unfinished / result).exists()):
                    self.adopt(self.unfinished, complete=complete)
            finally:
                self.discard()

    def discard(self) -> None:
        """Remove the unfinished files."""
        if self.unfinished.parent.is_symlink():
            self.unfinished.parent.unlink()
        discard(self.unfinished)
        with suppress(OSError):
            self.unfinished.parent.rmdir()

    def adopt(self, staging: Path, *, complete: bool = True) -> None:
        """Put the files of a folder in `unfinished` in their places, as `FolderRecord.adopt` says."""
        self.record.adopt(self._key, staging, self.path, complete=complete, force=self.force)

    def _refuse(self, names: Iterable[str]) -> None:
        advice = ADVICE if self.force is None else FORCE_ADVICE
        self.record.refuse_others(self._key, self.path, names, advice=advice)

    @property
    def _key(self) -> str:
        return f"{self.command} {self.part or self.group}".rstrip()


def results_folder(folder: Path) -> Path:
    """Return the folder of the store of results in a folder of results."""
    return folder / HIDDEN / RESULTS


@contextmanager
def output_folder(path: Path, command: str, *, force: bool | None = None) -> Iterator[OutputFolder]:
    """Lock a folder for a command that writes into it, and make it where there is none.

    Raises InputError where another process holds the lock, and where the folder cannot be written. A folder in which
    the block leaves nothing is removed again, if it was made here.
    """
    hidden = path / HIDDEN
    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: is a file, expected a folder")
    if hidden.is_symlink() or (hidden.exists() and not hidden.is_dir()):
        raise InputError(f"{hidden}: is no folder of this program, expected none or a new --out")
    link = next((hidden / name for name in (RECORD, LOCK, HOLDER) if (hidden / name).is_symlink()), None)
    if link is not None:
        raise InputError(f"{link}: is a link, expected a file of this program, or a new --out")
    made = [parent for parent in (hidden, *hidden.parents) if not parent.exists()]
    lock = FileLock(hidden / LOCK, timeout=0)
    try:
        hidden.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        holder = read_record(Holder, hidden / HOLDER)
        raise InputError(f"{path}: in use by {holder or 'another mirrorcam'}, expected it to end first") from None
    except OSError as error:
        _remove_made(made)
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
    try:
        write_text(hidden / HOLDER, _this_process(command).model_dump_json() + "\n")
        yield OutputFolder(path, FolderRecord(hidden / RECORD), command, force=force)
    finally:
        # Removed while they are still locked: a process that has just opened them notices it and makes new ones.
        for name in (HOLDER, LOCK):
            with suppress(OSError):
                (hidden / name).unlink()
        lock.release()
        _remove_made(made)


def _this_process(command: str) -> Holder:
    now = datetime.now(UTC).replace(microsecond=0)
    return Holder(command=command, process=os.getpid(), host=socket.gethostname()[:255], since=now)


def _remove_made(folders: Iterable[Path]) -> None:
    """Remove the empty folders, inner ones first."""
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()


def _has_files(folder: Path) -> bool:
    return folder.is_dir() and any(path.name != HIDDEN for path in folder.iterdir())
