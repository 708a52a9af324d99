"""Digests of bytes, values and files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mirrorcam.core.disk.files import inside


def digest(*parts: bytes | memoryview) -> str:
    """Return the sha256 of concatenated byte strings, in hexadecimal."""
    total = hashlib.sha256()
    for part in parts:
        total.update(part)
    return total.hexdigest()


def value_digest(value: Any) -> str:
    """Return the sha256 of a JSON value, whatever the order of its keys."""
    return digest(json.dumps(value, sort_keys=True).encode())


def file_digest(path: Path) -> str:
    """Return the sha256 of a file, in hexadecimal."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def path_digest(path: Path) -> str:
    """Return the sha256 of a file, or of the names and contents of the files below a folder, in hexadecimal.

    Raises InputError for a link that leads out of the folder.
    """
    return file_digest(path) if path.is_file() else value_digest(file_digests(path))


def file_digests(path: Path) -> dict[str, str]:
    """Return the sha256 of a file by its name, or of every file below a folder by its path in it, sorted.

    Raises InputError for a link that leads out of the folder.
    """
    if path.is_file():
        return {path.name: file_digest(path)}
    files = sorted(file for file in path.rglob("*") if file.is_file())
    names = (file.relative_to(path).as_posix() for file in files)
    return {name: file_digest(inside(path, name)) for name in names}


def intact(folder: Path, files: Mapping[str, str]) -> dict[str, str]:
    """Return those files (sha256 by name in the folder) that are unchanged.

    Raises InputError for a name that leads out of the folder.
    """
    return {name: sha256 for name, sha256 in files.items() if is_intact(folder, name, sha256)}


def is_intact(folder: Path, name: str, sha256: str) -> bool:
    """Return whether a file of a folder has its checksum; raises InputError for a name that leads out of the folder."""
    path = inside(folder, name)
    return path.is_file() and file_digest(path) == sha256


def differing_keys(first: Mapping[str, Any], second: Mapping[str, Any]) -> list[str]:
    """Return the sorted keys whose values differ between two mappings, or that only one of them has."""
    missing = object()
    return sorted(key for key in first.keys() | second.keys() if first.get(key, missing) != second.get(key, missing))
