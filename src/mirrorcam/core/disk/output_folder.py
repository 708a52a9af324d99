"""Output folders of commands: one command at a time, without loss of the user's files.

The hidden folder `.mirrorcam` in an output folder contains the record of the files that commands wrote, the store of
reusable results and, while a command runs, its lock and unfinished files.
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
    """A folder that a command has locked to write into; created by `output_folder`.

    Attributes
    ----------
    root
        The locked folder.
    record
        The files that commands wrote.
    command
        Name of the command; it replaces only files that it wrote itself, by their checksums in the record.
    part
        Subfolder to write, with a record of its own; empty for the root.
    group
        Name of a group of files that are replaced together, with a record of its own; empty for all other files.
    force
        Whether any file may be replaced; None if the command has no such option.
    """

    root: Path
    record: FolderRecord
    command: str
    part: str = ""
    group: str = ""
    force: bool | None = None

    @property
    def path(self) -> Path:
        """The folder to write."""
        return self.root / self.part

    def subfolder(self, name: str) -> OutputFolder:
        """Return a subfolder, with a record of its own; raises InputError for a link that leads out of the folder."""
        inside(self.root, name)
        return replace(self, part=name)

    def grouped(self, name: str) -> OutputFolder:
        """Return the same folder for a group of files that are replaced together."""
        return replace(self, group=name)

    @property
    def results(self) -> Results:
        """The store of results of all commands that write into the locked folder."""
        return Results(results_folder(self.root))

    @property
    def unfinished(self) -> Path:
        """Folder for unfinished files; it may contain files of a killed run."""
        return self.root / HIDDEN / UNFINISHED / (self.part or self.group or "files")

    def refuse_others(self, *patterns: str) -> None:
        """Raise InputError if a file of these names was not written by this command, or was changed since.

        Call it before long work, so that the user does not wait for results that cannot be written. `patterns` are
        glob patterns; a folder with the name of a file is refused even with `force`.
        """
        refuse_blocked(self.path, (pattern for pattern in patterns if not has_magic(pattern)))
        if not self.force:
            matching = [path for pattern in patterns for path in sorted(self.path.glob(pattern))]
            files = (path for path in matching if path.is_symlink() or not path.is_dir())
            self._refuse(path.relative_to(self.path).as_posix() for path in files)

    def has_written(self, name: str) -> bool:
        """Return whether this command wrote a file of that name, even if it was changed since."""
        return name in self.record.of(self._key)

    def refuse_unknown(self) -> None:
        """Raise InputError if the folder contains files, but none written by this command."""
        if not self.force and not self.record.of(self._key) and _has_files(self.path):
            raise InputError(
                f"{self.path}: holds files that this command did not write, expected a new folder, or --force"
            )

    def refuse_changed(self) -> None:
        """Raise InputError if a file that this command wrote was changed since."""
        if not self.force:
            self._refuse(sorted(self.record.of(self._key)))

    @contextmanager
    def staged(self, *, complete: bool = True, result: str = "") -> Iterator[Path]:
        """Yield an empty folder whose files are moved into place by `adopt` when the block succeeds.

        They are also moved if the block raises once the file `result` exists: a picture or page that fails does not
        discard the result.
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
        """Move the files of a staging folder into place, see `FolderRecord.adopt`."""
        self.record.adopt(self._key, staging, self.path, complete=complete, force=self.force)

    def _refuse(self, names: Iterable[str]) -> None:
        advice = ADVICE if self.force is None else FORCE_ADVICE
        self.record.refuse_others(self._key, self.path, names, advice=advice)

    @property
    def _key(self) -> str:
        return f"{self.command} {self.part or self.group}".rstrip()


def results_folder(folder: Path) -> Path:
    """Return the store of results in an output folder."""
    return folder / HIDDEN / RESULTS


@contextmanager
def output_folder(path: Path, command: str, *, force: bool | None = None) -> Iterator[OutputFolder]:
    """Lock a folder for a command, and create it if missing.

    Raises InputError if another process has locked it, or if it cannot be written. A folder that was created here and
    stays empty is removed.
    """
    hidden = path / HIDDEN
    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: is a file, expected a folder")
    if hidden.is_symlink() or (hidden.exists() and not hidden.is_dir()):
        raise InputError(f"{hidden}: is not a folder of this program, expected a new --out")
    link = next((hidden / name for name in (RECORD, LOCK, HOLDER) if (hidden / name).is_symlink()), None)
    if link is not None:
        raise InputError(f"{link}: is a link, expected a file of this program, or a new --out")
    created = [parent for parent in (hidden, *hidden.parents) if not parent.exists()]
    lock = FileLock(hidden / LOCK, timeout=0)
    try:
        hidden.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        holder = read_record(Holder, hidden / HOLDER)
        raise InputError(f"{path}: in use by {holder or 'another mirrorcam'}, expected it to end first") from None
    except OSError as error:
        _remove_empty(created)
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
    try:
        write_text(hidden / HOLDER, _this_process(command).model_dump_json() + "\n")
        yield OutputFolder(path, FolderRecord(hidden / RECORD), command, force=force)
    finally:
        # Removed while locked: a process that has just opened the lock file notices and creates a new one.
        for name in (HOLDER, LOCK):
            with suppress(OSError):
                (hidden / name).unlink()
        lock.release()
        _remove_empty(created)


def _this_process(command: str) -> Holder:
    now = datetime.now(UTC).replace(microsecond=0)
    return Holder(command=command, process=os.getpid(), host=socket.gethostname()[:255], since=now)


def _remove_empty(folders: Iterable[Path]) -> None:
    """Remove those folders that are empty, listed inner ones first."""
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()


def _has_files(folder: Path) -> bool:
    return folder.is_dir() and any(path.name != HIDDEN for path in folder.iterdir())
