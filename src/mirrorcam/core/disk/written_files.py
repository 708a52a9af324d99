"""Ownership of files: commands replace and delete only files that they wrote."""

from __future__ import annotations

import os
import shutil
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Literal

from pydantic import Field

from mirrorcam.core.disk.files import is_inside, json_of, model_from, read_lines, write_text
from mirrorcam.core.disk.fingerprint import file_digest, file_digests
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.interruption import deferred
from mirrorcam.core.values import Value

FORCE_ADVICE = "expected another --out, or --force to replace it"
ADVICE = "expected it removed, or another --out"
"""Advice on a file that blocks a command without --force."""


def is_written(folder: Path, name: str, checksums: Collection[str]) -> bool:
    """Return whether a regular file of this name in a folder has one of the checksums (sha256)."""
    path = folder / name
    return bool(checksums) and is_inside(folder, name) and _is_file(path) and file_digest(path) in checksums


def _is_file(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def refuse_blocked(folder: Path, names: Iterable[str]) -> None:
    """Raise InputError for a name that is a folder, or lies below a file or below a link out of the folder."""
    for name in names:
        path = folder / name
        if path.is_dir() and not path.is_symlink():
            raise InputError(f"{path}: is a folder, expected a file to write")
        for parent in path.relative_to(folder).parents[:-1]:
            above = folder / parent
            if os.path.lexists(above) and not (above.is_dir() and is_inside(folder, parent.as_posix())):
                raise InputError(f"{above}: is a file or a link out of {folder}, expected a folder")


def move_files(staging: Path, folder: Path, names: Iterable[str]) -> None:
    """Move files from a staging folder to the same names in another folder on the same file system."""
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (staging / name).replace(folder / name)


def discard(unfinished: Path) -> None:
    """Remove a folder of unfinished files, or a link with its name."""
    if unfinished.is_symlink():
        unfinished.unlink()
    elif unfinished.exists():
        shutil.rmtree(unfinished)


class _Line(Value):
    """A line of a record: the checksums, by file name, that files of a command may have from now on.

    A file that is being replaced has two, because an interruption may leave either; a deleted file has none.
    """

    schema_id: Literal["mirrorcam.written/2"] = Field(default="mirrorcam.written/2", alias="schema")
    command: str
    files: dict[str, tuple[str, ...]]


class FolderRecord:
    """The files that each command wrote into a folder, as an append-only file of JSON lines."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._written: dict[str, dict[str, tuple[str, ...]]] = {}
        lines = [line for line in read_lines(path) if line] if path.exists() else []
        for line in lines:
            try:
                self._note(model_from(_Line, path, json_of(path, line)))
            except InputError:
                continue  # incomplete or foreign: its files do not count as written
        if len(lines) > len(self._written):
            current = (_Line(command=name, files=files) for name, files in self._written.items())
            write_text(path, "".join(map(_text, current)))

    def of(self, command: str) -> Mapping[str, tuple[str, ...]]:
        """Return the checksums that each file of a command may have, by its name."""
        return self._written.get(command, {})

    def refuse_others(
        self, command: str, folder: Path, names: Iterable[str], new: Mapping[str, str] | None = None, *, advice: str
    ) -> None:
        """Raise InputError for the first file that exists and differs from what the command wrote.

        A file that already has its `new` checksum is accepted. The message ends with `advice`.
        """
        written = self.of(command)
        for name in names:
            allowed = (*written.get(name, ()), *([] if new is None else [new[name]]))
            if os.path.lexists(folder / name) and not is_written(folder, name, allowed):
                changed = "was changed since this command wrote it"
                reason = changed if name in written else "was not written by this command"
                raise InputError(f"{folder / name}: {reason}, {advice}")

    def adopt(self, command: str, staging: Path, folder: Path, *, complete: bool, force: bool | None) -> None:
        """Move every file of a staging folder into another, and record them as files of a command.

        Parameters
        ----------
        command
            Name of the command in this record.
        staging
            Folder on the same file system; its files are moved.
        folder
            Target folder; its other files stay.
        complete
            Whether to delete all earlier files of the command that are not staged again; otherwise, only those in
            rewritten subfolders. A file that was changed since is kept.
        force
            Whether to replace files that the command did not write, or that were changed since; None if the command
            has no such option.

        Raises
        ------
        InputError
            If such a file would be replaced without `force`, or a folder or a link out of the folder has the name of a
            file. Nothing is moved in this case.
        """
        staged, written = file_digests(staging), self.of(command)
        refuse_blocked(folder, staged)
        if not force:
            advice = ADVICE if force is None else FORCE_ADVICE
            self.refuse_others(command, folder, staged, staged, advice=advice)
        rewritten = {name.partition("/")[0] for name in staged if "/" in name}
        stale = [
            name
            for name in sorted(written.keys() - staged.keys())
            if complete or ("/" in name and name.partition("/")[0] in rewritten)
        ]
        next_files = {
            name: (*(now for now in written.get(name, ()) if is_written(folder, name, [now])), sha256)
            for name, sha256 in staged.items()
        }
        with deferred():
            self._append(command, next_files)
            for name in stale:
                if is_written(folder, name, written[name]):
                    (folder / name).unlink()
                    _remove_empty((folder / name).parent, folder)
            move_files(staging, folder, staged)
            self._append(command, dict.fromkeys(stale, ()) | {name: (sha256,) for name, sha256 in staged.items()})

    def _note(self, line: _Line) -> None:
        files = {**self.of(line.command), **line.files}
        self._written[line.command] = {name: checksums for name, checksums in files.items() if checksums}

    def _append(self, command: str, files: Mapping[str, tuple[str, ...]]) -> None:
        line = _Line(command=command, files=dict(files))
        with self._path.open("a", encoding="utf-8") as stream:
            stream.write(_text(line))
        self._note(line)


def _text(line: _Line) -> str:
    return line.model_dump_json(by_alias=True) + "\n"


def _remove_empty(path: Path, root: Path) -> None:
    """Remove a folder if it is empty, and then its parents, up to a root that stays."""
    while path != root and path.is_dir() and not any(path.iterdir()):
        path.rmdir()
        path = path.parent
