"""Records of the files that commands have written into a folder, so that no other file there is replaced or deleted."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pydantic import Field

from mirrorcam.core.disk.files import is_inside, json_of, model_from, read_lines, write_text
from mirrorcam.core.disk.fingerprint import file_digest, file_digests
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.interruption import deferred
from mirrorcam.core.values import Value

Checksums = Mapping[str, str]
"""The sha256 of files by their path in a folder."""
FORCE_ADVICE = "expected another --out, or --force to replace it"
ADVICE = "expected it removed, or another --out"
"""What to do about a file of somebody else where a command has no --force."""


@dataclass(frozen=True)
class WrittenFiles:
    """What a command has written into a folder: `now`, the sha256 of each file by its path.

    While files take their places, `next` are those to be: each place then holds one of `now` or of `next`.
    """

    now: Checksums = field(default_factory=dict)
    next: Checksums = field(default_factory=dict)

    @property
    def names(self) -> set[str]:
        """Paths of all files."""
        return {*self.now, *self.next}

    def settled(self, folder: Path) -> WrittenFiles:
        """Return the record of a folder after an interrupted move of files into it: the files that are there now."""
        return WrittenFiles({**self.now, **{n: sha256 for n, sha256 in self.next.items() if _is(folder, n, sha256)}})

    def holds(self, folder: Path, name: str) -> bool:
        """Return whether a file of the folder is as it was written; a link never is."""
        return any(_is(folder, name, files[name]) for files in (self.now, self.next) if name in files)

    def refuse_others(
        self, folder: Path, names: Iterable[str], new: Checksums | None = None, *, advice: str = FORCE_ADVICE
    ) -> None:
        """Raise InputError for the first of the files that is in the folder, but not as it was written.

        A file that already has its checksum of `new` is not refused. The message ends with `advice`.
        """
        for name in names:
            path = folder / name
            if not os.path.lexists(path) or (new is not None and _is(folder, name, new[name])):
                continue
            if not self.holds(folder, name):
                what = (
                    "was changed since this command wrote it"
                    if name in self.names
                    else "was not written by this command"
                )
                raise InputError(f"{path}: {what}, {advice}")


def refuse_blocked(folder: Path, names: Iterable[str]) -> None:
    """Raise InputError where no file can be put: in the place of a folder, or below a file or a link that leads out."""
    for name in names:
        path = folder / name
        if path.is_dir() and not path.is_symlink():
            raise InputError(f"{path}: is a folder, expected a file to write")
        for parent in path.relative_to(folder).parents[:-1]:
            place = folder / parent
            if os.path.lexists(place) and not (place.is_dir() and is_inside(folder, parent.as_posix())):
                raise InputError(f"{place}: is a file or a link out of {folder}, expected a folder")


def _is(folder: Path, name: str, sha256: str) -> bool:
    """Return whether a name is of a file in a folder, not a link, with a checksum."""
    path = folder / name
    return is_inside(folder, name) and path.is_file() and not path.is_symlink() and file_digest(path) == sha256


class _Line(Value):
    """A line of the record of a folder: files of a command that are being moved into place, that were, or are gone."""

    schema_id: Literal["mirrorcam.written/1"] = Field(default="mirrorcam.written/1", alias="schema")
    command: str
    next: dict[str, str] = Field(default_factory=dict)
    now: dict[str, str] = Field(default_factory=dict)
    gone: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        return self.model_dump_json(by_alias=True) + "\n"


class FolderRecord:
    """What commands have written into a folder, by the command's name, in a file that grows by a line at a time."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._written: dict[str, WrittenFiles] = {}
        lines = [line for line in read_lines(path) if line] if path.exists() else []
        for line in lines:
            try:
                self._note(model_from(_Line, path, json_of(path, line)))
            except InputError:
                continue  # incomplete, or not written by this program: its files are not known to be ours
        if len(lines) > len(self._written):
            every = (_Line(command=name, next=dict(w.next), now=dict(w.now)) for name, w in self._written.items())
            write_text(path, "".join(line.text for line in every))

    def of(self, command: str) -> WrittenFiles:
        """Return what a command has written."""
        return self._written.get(command, WrittenFiles())

    def _note(self, line: _Line) -> None:
        now = {**self.of(line.command).now, **line.now}
        for name in line.gone:
            now.pop(name, None)
        self._written[line.command] = WrittenFiles(now, line.next)

    def _append(self, line: _Line) -> None:
        with self._path.open("a", encoding="utf-8") as stream:
            stream.write(line.text)
        self._note(line)

    def adopt(self, command: str, staging: Path, folder: Path, *, complete: bool, force: bool | None) -> None:
        """Put every file of a folder in its place in another, as files of a command.

        Parameters
        ----------
        command
            Name of the command in this record.
        staging
            Folder on the same file system; its files are moved.
        folder
            Folder for the files; others in it stay.
        complete
            Whether files that the command wrote before and that are not among these are deleted: all of them, else
            those in subfolders that are written again. One that was changed since stays.
        force
            Whether files may be replaced that the command did not write, or that were changed since; None where the
            command has no option for that.

        Raises
        ------
        InputError
            Where such a file would be replaced without `force`, or a folder or a link out of the folder is in the way;
            nothing is moved then.
        """
        staged, written = file_digests(staging), self.of(command)
        before = written.settled(folder)
        refuse_blocked(folder, staged)
        if not force:
            before.refuse_others(folder, staged, staged, advice=ADVICE if force is None else FORCE_ADVICE)
        rewritten = {name.partition("/")[0] for name in staged if "/" in name}
        stale = sorted(
            name
            for name in before.now.keys() - staged.keys()
            if complete or ("/" in name and name.partition("/")[0] in rewritten)
        )
        settled = {name: sha256 for name, sha256 in written.next.items() if before.now.get(name) == sha256}
        with deferred():
            self._append(_Line(command=command, now=settled, next=staged))
            for name in stale:
                if before.holds(folder, name):
                    (folder / name).unlink()
                    _remove_empty((folder / name).parent, folder)
            for name in staged:
                place = folder / name
                place.parent.mkdir(parents=True, exist_ok=True)
                (staging / name).replace(place)
            self._append(_Line(command=command, now=staged, gone=tuple(stale)))


def _remove_empty(path: Path, root: Path) -> None:
    """Remove a folder if it is empty, and then those it is in, up to a root that stays."""
    while path != root and path.is_dir() and not any(path.iterdir()):
        path.rmdir()
        path = path.parent
