"""Folders that are written file by file, with a record of what has been written: what is intact is not made again."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self

from pydantic import ValidationError

from mirrorcam.optics.base.files import TEMPORARY, Model, inside, linked, read_bytes, read_model, write_text
from mirrorcam.optics.base.fingerprint import differing, file_digest
from mirrorcam.optics.base.values import InputError, Value


def intact(folder: Path, files: Mapping[str, str]) -> dict[str, str]:
    """Return those of the files, sha256 by name in the folder, that are there as they were written."""
    return {name: sha256 for name, sha256 in files.items() if _is_intact(inside(folder, name), sha256)}


def _is_intact(path: Path, sha256: str) -> bool:
    return path.is_file() and file_digest(path) == sha256


def read_record(model: type[Model], path: Path) -> Model | None:
    """Read a record as JSON; None where there is none, or none that is whole and of this version.

    Raises InputError where something else is in its place, or more than a record can be.
    """
    if not path.exists():
        return None
    try:
        return model.model_validate_json(read_bytes(path))
    except ValidationError:
        return None


class FolderManifest(Value):
    """The manifest of a folder that follows from a request: the same request is resumed where it was interrupted.

    A subclass has the fields `request`, a digest of everything that the bytes of the folder follow from, and `files`,
    the sha256 of each file written so far by its name in the folder; all others say what was asked for.
    """

    FILE: ClassVar[str]
    """The manifest's own file."""
    WHAT: ClassVar[str]
    """What the folder holds, as messages name it."""
    FILES: ClassVar[tuple[str, ...]] = ()
    """Other files beside the manifest."""
    FOLDERS: ClassVar[tuple[str, ...]] = ()
    """Folders beside the manifest."""
    FOLLOWS: ClassVar[frozenset[str]] = frozenset()
    """Fields that follow from others, and are not part of the request."""

    if TYPE_CHECKING:  # fields of the subclasses, which say in which order they are written
        request: str
        files: dict[str, str]

    def save(self, folder: Path) -> None:
        """Write the manifest atomically."""
        write_text(folder / self.FILE, self.model_dump_json(indent=1, by_alias=True) + "\n")

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Read the manifest of a folder, or raise InputError in one line."""
        return read_model(cls, folder / cls.FILE)

    def intact(self, folder: Path, name: str) -> bool:
        """Return whether a file of the folder exists with the checksum of what was written."""
        return name in self.files and _is_intact(inside(folder, name), self.files[name])

    def continued(self, folder: Path) -> Self:
        """Return the manifest to go on with: that of an interrupted run of the same request, less what is not intact.

        Raises InputError where the folder holds something else, or a file that was changed since: it is not replaced.
        """
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{folder}: is a file, expected a folder for the {self.WHAT}")
        if not (folder / self.FILE).exists():
            foreign = [name for name in (*self.FOLDERS, *self.FILES) if os.path.lexists(folder / name)]
            if foreign:
                raise InputError(f"{folder}: has {foreign[0]!r} but no {self.FILE}, expected a new or empty folder")
            _remove_temporaries(folder, ())
            self.save(folder)
            return self
        before = self.load(folder)
        if before.request != self.request:
            asked = set(type(self).model_fields) - {"schema_id", "request", "files"} - self.FOLLOWS
            other = differing(*({name: getattr(each, name) for name in asked} for each in (before, self)))
            differs = " and ".join(other) or "seed (or of another version of this program)"
            raise InputError(
                f"{folder}: holds a {self.WHAT} of another {differs}, expected the same request or a new folder"
            )
        for name in self.FOLDERS:
            link = folder / name if (folder / name).is_symlink() else linked(folder / name)
            if link is not None:
                raise InputError(f"{link}: is a link, expected only files and folders in a {self.WHAT}")
        _remove_temporaries(folder, self.FOLDERS)
        whole = intact(folder, before.files)
        for name in before.files.keys() - whole.keys():
            if os.path.lexists(folder / name):
                raise InputError(f"{folder / name}: was changed since it was written, expected it unchanged or removed")
        return before.replaced(files=whole)

    def recorded(self, folder: Path, *names: str) -> Self:
        """Return the manifest with the checksums of files just written, saved."""
        written = self.files | {name: file_digest(folder / name) for name in names}
        # In the order of their names, not of the workers that made them.
        manifest = self.replaced(files=dict(sorted(written.items())))
        manifest.save(folder)
        return manifest


def _remove_temporaries(folder: Path, folders: tuple[str, ...]) -> None:
    """Remove what a killed run could not: the temporary files of `optics.base.files.atomic`."""
    for pattern in (f"{TEMPORARY}*", *(f"{name}/**/{TEMPORARY}*" for name in folders)):
        for leftover in list(folder.glob(pattern)):
            leftover.unlink(missing_ok=True)
