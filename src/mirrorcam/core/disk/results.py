"""A store of results, reused for equal inputs, options, code and libraries."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pydantic import Field

from mirrorcam.core.disk.files import (
    LARGEST_FILE_BYTES,
    first_bytes,
    inside,
    json_of,
    model_from,
    read_bytes,
    write_bytes,
)
from mirrorcam.core.disk.fingerprint import differing_keys, digest
from mirrorcam.core.disk.program import NOT_INSTALLED
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Value

_BEGINNING = b'{"schema":"mirrorcam.result/1",'
_LONGEST_VERSION = 40


class _Header(Value):
    """The first line of a result's file: its inputs, and the length and sha256 of each of the contents that follow."""

    schema_id: Literal["mirrorcam.result/1"] = Field(default="mirrorcam.result/1", alias="schema")
    made_of: dict[str, str]
    contents: dict[str, tuple[int, str]]


class Results:
    """A folder of results, one file each, which any number of processes may use at the same time.

    A result has a name, such as a part's or the digest of a picture, and inputs: digests, versions and short values by
    name. The folder keeps the latest result of a name. A file that is damaged, or has other inputs, is replaced; a file
    that this class did not write is not touched.

    Raises InputError for a folder that is a link or a file.
    """

    def __init__(self, folder: Path) -> None:
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            kind = "link" if folder.is_symlink() else "file"
            raise InputError(f"{folder}: is a {kind}, expected a folder for results")
        self._folder = folder

    def get(self, name: str, made_of: Mapping[str, str]) -> dict[str, bytes] | None:
        """Return the contents of a result by name; None if it is missing or has other inputs."""
        header, contents = self._read(name)
        return contents if header is not None and header.made_of == made_of else None

    def put(self, name: str, made_of: Mapping[str, str], contents: Mapping[str, bytes]) -> None:
        """Store a result atomically, unless it is too large."""
        path = inside(self._folder, name)
        if os.path.lexists(path) and (path.is_symlink() or not path.is_file() or not _is_result(path)):
            return
        entries = {key: (len(content), digest(content)) for key, content in contents.items()}
        header = _Header(made_of=dict(made_of), contents=entries).model_dump(mode="json", by_alias=True)
        raw = b"\n".join([json.dumps(header, separators=(",", ":")).encode(), b"".join(contents.values())])
        if len(raw) <= LARGEST_FILE_BYTES:
            write_bytes(path, raw)

    def difference(self, name: str, made_of: Mapping[str, str]) -> str:
        """Describe the first difference between the inputs of a result and `made_of`; empty if there is none."""
        header, _ = self._read(name)
        if header is None:
            return "not made yet"
        for key in differing_keys(header.made_of, made_of):
            old, new = (inputs.get(key, NOT_INSTALLED) for inputs in (header.made_of, made_of))
            is_digest = max(len(old), len(new)) > _LONGEST_VERSION
            return f"{key} changed" if is_digest else f"{key} {old} → {new}"
        return ""

    def _read(self, name: str) -> tuple[_Header | None, dict[str, bytes]]:
        """Return the header and contents of a file; None and {} unless it is a complete result."""
        path, contents = inside(self._folder, name), {}
        try:
            raw = read_bytes(path)
            line, _, rest = raw.partition(b"\n")
            header = model_from(_Header, path, json_of(path, line))
        except InputError:
            return None, {}
        begin = 0
        for key, (length, sha256) in header.contents.items():
            contents[key] = rest[begin : begin + length]
            begin += length
            if length < 0 or digest(contents[key]) != sha256:
                return None, {}
        return header, contents


def _is_result(path: Path) -> bool:
    return first_bytes(path, len(_BEGINNING)) == _BEGINNING
