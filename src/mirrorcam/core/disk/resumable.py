"""Folders that an interrupted run resumes: a manifest lists the files written so far, and intact files are kept."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self

from mirrorcam.core.arguments import AnyPath, path_of
from mirrorcam.core.disk.files import LARGEST_FILE_BYTES, TEMPORARY, read_model, write_text
from mirrorcam.core.disk.fingerprint import differing_keys, file_digests, intact, is_intact
from mirrorcam.core.disk.written_files import discard, move_files, refuse_blocked
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.interruption import deferred
from mirrorcam.core.values import Value

UNFINISHED = f"{TEMPORARY}unfinished"
"""Hidden folder for unfinished files, which may hold files of a killed run."""


class FolderManifest(Value):
    """The manifest of a folder whose contents a request determines, so that an interrupted run can be resumed.

    A subclass has the fields `request`, a digest of everything that determines the contents, and `files`, the sha256 by
    name of the files written so far. All other fields describe the request.
    """

    FILE: ClassVar[str]
    """Name of the manifest file."""
    NOUN: ClassVar[str]
    """Noun for the contents of the folder in messages."""
    FILES: ClassVar[tuple[str, ...]] = ()
    """Other files that the folder may contain."""
    FOLDERS: ClassVar[tuple[str, ...]] = ()
    """Subfolders that the folder may contain."""
    DERIVED: ClassVar[frozenset[str]] = frozenset()
    """Fields derived from others, which do not describe the request."""

    if TYPE_CHECKING:  # subclasses declare these fields, in the order of their file
        request: str
        files: dict[str, str]

    def save(self, folder: Path) -> None:
        """Write the manifest atomically."""
        unfinished = folder / UNFINISHED
        write_text(unfinished / self.FILE, self.model_dump_json(indent=1, by_alias=True) + "\n")
        (unfinished / self.FILE).replace(folder / self.FILE)
        with suppress(OSError):  # it may contain files that are still to be moved
            unfinished.rmdir()

    @classmethod
    def load(cls, folder: AnyPath) -> Self:
        """Read the manifest of a folder, or raise a one-line InputError."""
        return read_model(cls, path_of("folder", folder) / cls.FILE, LARGEST_FILE_BYTES)

    def intact(self, folder: Path, name: str) -> bool:
        """Return whether a file of the folder exists with its checksum."""
        return name in self.files and is_intact(folder, name, self.files[name])

    def resumed(self, folder: Path, planned: Collection[str]) -> Self:
        """Return the manifest of an interrupted run of the same request, without missing files, or this one if none.

        `planned` are the names of all files to write. Raises InputError if the folder contains something else, a
        changed file, or a planned file that the manifest does not list.
        """
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{folder}: is a file, expected a folder for the {self.NOUN}")
        if not (folder / self.FILE).exists():
            foreign = [name for name in (*planned, *self.FOLDERS, *self.FILES) if os.path.lexists(folder / name)]
            if foreign:
                raise InputError(f"{folder}: has {foreign[0]!r} but no {self.FILE}, expected a new or empty folder")
            discard(folder / UNFINISHED)
            self.save(folder)
            return self
        saved = self.load(folder)
        if saved.request != self.request:
            described = set(type(self).model_fields) - {"schema_id", "request", "files"} - self.DERIVED
            other = differing_keys(*({name: getattr(item, name) for name in described} for item in (saved, self)))
            differs = " and ".join(other) or "seed (or by another version of this program)"
            raise InputError(
                f"{folder}: holds a {self.NOUN} that differs in {differs}, expected the same request or a new folder"
            )
        refuse_blocked(folder, planned)
        discard(folder / UNFINISHED)
        valid = intact(folder, saved.files)
        for name in sorted(saved.files.keys() - valid.keys()):
            if os.path.lexists(folder / name):
                raise InputError(f"{folder / name}: was changed since it was written, expected it unchanged or removed")
        saved = saved.replaced(files=valid)
        saved._refuse_others(folder, planned)
        return saved

    def _refuse_others(self, folder: Path, names: Collection[str], new: Mapping[str, str] | None = None) -> None:
        """Raise InputError for the first name that exists but is not listed, unless it has its `new` checksum."""
        for name in names:
            if name in self.files or not os.path.lexists(folder / name):
                continue
            if new is None or not is_intact(folder, name, new[name]):
                expected = f"expected it removed, or a new folder for the {self.NOUN}"
                raise InputError(f"{folder / name}: is not listed in {self.FILE}, {expected}")

    def added(self, folder: Path, write: Callable[[Path], None]) -> Self:
        """Call `write` with an empty staging folder, move its files into place, and return the manifest with them.

        The manifest is saved before the move, so that it lists every file that was moved. Raises InputError if another
        file would be replaced.
        """
        staging = folder / UNFINISHED
        discard(staging)
        staging.mkdir(parents=True)
        try:
            write(staging)
            new = file_digests(staging)
            refuse_blocked(folder, new)
            self._refuse_others(folder, new, new)
            # Sorted, because the order in which workers finish varies.
            manifest = self.replaced(files=dict(sorted((self.files | new).items())))
            with deferred():
                manifest.save(folder)
                move_files(staging, folder, new)
        finally:
            discard(staging)
        return manifest
