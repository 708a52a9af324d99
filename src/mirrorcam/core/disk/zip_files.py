"""ZIP files whose bytes depend only on the names and contents of their members."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

from mirrorcam.core.disk.files import atomic, is_inside, linked, read_bytes
from mirrorcam.core.errors import InputError

_UNIX, _FILE_MODE = 3, 0o100644 << 16


def files_to_zip(folder: Path) -> dict[str, Path]:
    """All files below a folder by relative path, sorted, without hidden files and folders.

    Raises InputError if a link is among them.
    """
    link = folder if folder.is_symlink() else linked(folder)
    if link is not None:
        raise InputError(f"{link.name}: is a link, expected only files and folders")
    names = ((path.relative_to(folder), path) for path in sorted(folder.rglob("*")) if path.is_file())
    return {name.as_posix(): path for name, path in names if not any(part.startswith(".") for part in name.parts)}


def write_zip(path: Path, files: Mapping[str, Path | bytes]) -> None:
    """Write a compressed ZIP file atomically from files, or their contents, by member name.

    All are dated 1980-01-01, the first day that the format can state, and sorted by name, so that the
    same contents give the same bytes (of the same zlib).

    Raises InputError for a name that would lead out of the folder that the ZIP file is unpacked into.
    """
    for name in files:
        if not is_inside(path.parent, name):
            raise InputError(f"{name[:100]!r}: expected the name of a file in a folder")
    with atomic(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, content in sorted(files.items()):
            entry = zipfile.ZipInfo(name)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system, entry.external_attr = _UNIX, _FILE_MODE
            archive.writestr(entry, content if isinstance(content, bytes) else read_bytes(content))
