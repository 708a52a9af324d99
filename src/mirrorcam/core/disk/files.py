"""Read and write users' files: writes are atomic, and invalid files raise one-line errors."""

from __future__ import annotations

import json
import os
import stat
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from pathlib import Path, PureWindowsPath
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ValidationError

from mirrorcam.core.disk.nested_text import json_value, toml_value
from mirrorcam.core.errors import InputError
from mirrorcam.core.messages import one_line, shortened
from mirrorcam.core.values import InvalidValue, Metric

Model = TypeVar("Model", bound=BaseModel)
LARGEST_TEXT_BYTES = 1_000_000
"""Largest hand-written text, in bytes: boards, cameras, requests, dimensions."""
LARGEST_LAYOUT_BYTES = 50_000_000
"""Largest layout with a complete covariance, or table of results, in bytes."""
LARGEST_FILE_BYTES = 100_000_000
"""Largest file that is read at once, in bytes: manifests of sets and records of long runs are smaller."""
MAX_LINES = 1_000_000
"""Maximum number of lines of a record that is written line by line."""
TEMPORARY = ".mirrorcam-"
"""Prefix of the names of unfinished files."""
_MAX_FIELDS = 1000
"""No value has this many fields: a larger table is keyed by names, or has unknown keys."""
_LONGEST_NAME, _LONGEST_PATH = 255, 1000
_POINTER, _LARGEST_POINTER_BYTES = b"version https://git-lfs.github.com/spec/", 1024
"""First bytes of a Git LFS pointer, which replaces the file, and the size of the largest pointer."""


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Yield a temporary path next to `path`; rename it to `path` when the block succeeds, otherwise remove it."""
    _refuse_to_replace(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=TEMPORARY, suffix=path.suffix)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(path)
    except OSError as error:
        # Errors about another file pass; those of a full disk name no file.
        if error.filename not in (None, name):
            raise
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        temporary.unlink(missing_ok=True)


def _refuse_to_replace(path: Path) -> None:
    """Raise InputError for a folder, a device or a pipe, which must not be replaced, and for an invalid path."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return  # nothing to replace, or writing reports the reason
    except ValueError as error:  # a name with a null character
        raise InputError(f"{str(path)[:200]!r}: {error}") from None
    if stat.S_ISDIR(mode):
        raise InputError(f"{path}: is a folder, expected a file to write")
    if not stat.S_ISREG(mode):
        raise InputError(f"{path}: is a device or a pipe, expected a file to write")


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 text file atomically."""
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, value: object) -> None:
    """Write JSON atomically; NaN is refused rather than written."""
    write_text(path, json.dumps(value, indent=1, allow_nan=False) + "\n")


def write_metrics(path: Path, metrics: dict[str, Metric]) -> None:
    """Write `metrics.json`: value, unit and any limit by name; null and a reason for an unknown figure."""
    write_json(path, {name: metric.model_dump(exclude_none=True) for name, metric in metrics.items()})


def is_inside(folder: Path, name: str) -> bool:
    """Return whether a name in a manifest stays in its folder: not absolute, without .., not through a link out."""
    path = PureWindowsPath(name)  # the strictest interpretation of parts and drives
    if not path.parts or path.anchor or ".." in path.parts or "\x00" in name:
        return False
    try:
        sizes = [len(os.fsencode(part)) for part in path.parts]
        if max(sizes) > _LONGEST_NAME or sum(sizes) + len(sizes) > _LONGEST_PATH:
            return False
    except UnicodeEncodeError:
        return False
    return Path(os.path.realpath(folder / name)).is_relative_to(os.path.realpath(folder))


def inside(folder: Path, name: str) -> Path:
    """Return the path of a file by its name in a manifest; raises InputError for a name that leads out."""
    if not is_inside(folder, name):
        raise InputError(f"{folder}: lists {name[:80]!r}, expected the name of a file in this folder")
    return folder / name


def numbered(folder: Path, stem: str, suffix: str) -> Path:
    """Return the first unused path STEM_0001SUFFIX, STEM_0002SUFFIX, … in a folder, which need not exist."""
    number = 1
    while (path := folder / f"{stem}_{number:04d}{suffix}").exists():
        number += 1
    return path


def linked(folder: Path) -> Path | None:
    """Return the first link at any depth in a folder, or None."""
    for parent, folders, files in os.walk(folder):
        for name in sorted((*folders, *files)):
            if (path := Path(parent, name)).is_symlink():
                return path
    return None


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Convert OSError and ValueError about a path to a one-line InputError."""
    try:
        yield
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a name with a null character
        raise InputError(f"{str(path)[:200]!r}: {getattr(error, 'strerror', None) or error}") from None


def stored_bytes(path: Path) -> int:
    """Return the size of a regular file; raises a one-line InputError for anything else, which may block when opened.

    The error for a Git LFS pointer, which replaces a file until it is fetched, names the command that fetches the file.
    """
    with readable(path):
        status = path.stat()
    if stat.S_ISDIR(status.st_mode):
        raise InputError(f"{path}: is a folder, expected a file")
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: is not a regular file, expected one")
    if status.st_size < _LARGEST_POINTER_BYTES:
        refuse_pointer(path)
    return status.st_size


def refuse_pointer(path: Path) -> None:
    """Raise InputError for a Git LFS pointer; accept any other path."""
    if path.is_file() and first_bytes(path, len(_POINTER)) == _POINTER:
        raise InputError(f"{path}: is a Git LFS pointer, not the file itself: run `git lfs pull`")


def first_bytes(path: Path, count: int) -> bytes:
    """Return the first bytes of a regular file, or all of a shorter one."""
    with readable(path), path.open("rb") as stream:
        return stream.read(count)


def read_bytes(path: Path, max_bytes: int = LARGEST_FILE_BYTES) -> bytes:
    """Return the content of a regular file; raises a one-line InputError above `max_bytes`."""
    if (stored := stored_bytes(path)) <= max_bytes:
        with readable(path), path.open("rb") as stream:
            content = stream.read(stored + 1)
            if len(content) > stored:  # it is growing, or its size is unknown
                content += stream.read(max_bytes + 1 - len(content))
        if len(content) <= max_bytes:
            return content
    raise InputError(f"{path}: is larger than {max_bytes / 1e6:g} MB, expected a smaller file")


def read_lines(path: Path) -> list[bytes]:
    """Read the lines of a record, without line ends; raises a one-line InputError for an invalid file."""
    raw = read_bytes(path)
    if raw.count(b"\n") > MAX_LINES:
        raise InputError(f"{path}: has more than {MAX_LINES} lines, expected fewer")
    return raw.split(b"\n")


def read_json(path: Path, max_bytes: int = LARGEST_TEXT_BYTES) -> Any:
    """Read the value of a JSON file (UTF-8); raises a one-line InputError, also for a duplicate key."""
    return json_of(path, read_bytes(path, max_bytes))


def json_of(where: Path | str, raw: bytes) -> Any:
    """Parse a JSON text; raises a one-line InputError, which names `where`."""
    try:
        return json_value(raw)
    except InputError as error:
        raise InputError(shortened(f"{where}: {error}")) from None


def toml_of(where: Path | str, raw: bytes) -> dict[str, Any]:
    """Parse a TOML text; raises a one-line InputError, which names `where`."""
    try:
        return toml_value(raw)
    except InputError as error:
        raise InputError(shortened(f"{where}: {error}")) from None


def read_model(model: type[Model], path: Path, max_bytes: int = LARGEST_TEXT_BYTES) -> Model:
    """Read a JSON or (by its suffix) TOML file into a pydantic model, or raise a one-line InputError.

    Types are strict: strings and booleans are not accepted as numbers. A file of more than `max_bytes` is refused; the
    default suits hand-written files.
    """
    return model_of(model, path, read_bytes(path, max_bytes))


def read_record(model: type[Model], path: Path) -> Model | None:
    """Read a record as JSON; None if it is absent, damaged or of another version.

    Raises InputError if the path is not a file, or is too large for a record.
    """
    if not path.exists():
        return None
    raw = read_bytes(path)
    try:
        return model_of(model, path, raw)
    except InputError:
        return None


def model_of(model: type[Model], path: Path, raw: bytes) -> Model:
    """Parse the content of a file into a pydantic model, see `read_model`; the file itself is not read."""
    return model_from(model, path, tables_of(path, raw))


def tables_of(path: Path, raw: bytes) -> Any:
    """Parse the content of a JSON or (by its suffix) TOML file, unchecked; the file itself is not read."""
    return toml_of(path, raw) if path.suffix.lower() == ".toml" else json_of(path, raw)


def keys_of(path: Path, raw: bytes) -> frozenset[str]:
    """Return the outermost keys in the content of a JSON or TOML file; empty unless it is a table."""
    tables = tables_of(path, raw)
    return frozenset(tables) if isinstance(tables, dict) else frozenset()


def model_from(model: type[Model], where: Path | str, data: Any) -> Model:
    """Validate a file's values as a pydantic model, see `model_of`; errors name `where`."""
    try:
        return validated(model, data)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def validated(model: type[Model], data: Any) -> Model:
    """Validate plain values as a pydantic model; raises a one-line InputError if they are invalid."""
    try:
        if any(len(table) > _MAX_FIELDS for table in _tables(data)):
            _check_keys(model, data)
        return model.model_validate_json(json.dumps(data), strict=True)
    except InvalidValue as error:
        raise InputError(str(error)) from None
    except ValidationError as error:  # for a model that is not a Value, such as a table of values
        raise InputError(one_line(error, model)) from None
    except TypeError as error:  # a date or a time of TOML
        raise InputError(f"{error}, expected numbers, strings and tables") from None


def _check_keys(model: type[Model], data: Any) -> None:
    """Raise InvalidValue for unknown keys, searched in a part of each large table: all findings take gigabytes."""
    part = json.dumps(_shortened_tables(data))
    try:
        model.model_validate_json(part, strict=True)
    except InvalidValue as error:
        if error.has_unknown_key:
            raise
    except ValidationError:
        return  # the model is not a Value; its validation comes next


def _tables(data: Any) -> Iterator[dict[str, Any]]:
    """Yield all tables in plain values, but skip lists of numbers, which may be long."""
    pending = [data]
    while pending:
        value = pending.pop()
        if isinstance(value, dict):
            yield value
            pending += value.values()
        elif isinstance(value, list) and value and isinstance(value[0], dict | list):
            pending += value


def _shortened_tables(data: Any) -> Any:
    """Return plain values with only the first keys of each table."""
    if isinstance(data, dict):
        return {key: _shortened_tables(value) for key, value in islice(data.items(), _MAX_FIELDS)}
    if isinstance(data, list) and data and isinstance(data[0], dict | list):
        return [_shortened_tables(item) for item in data]
    return data


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically."""
    with atomic(path) as temporary:
        temporary.write_bytes(content)


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files by their names in a folder, each atomically."""
    for name, content in files.items():
        write_bytes(folder / name, content)


def write_npz(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays by name to a compressed .npz file, atomically; the same arrays give the same bytes."""
    # NumPy would append .npz to a path.
    with atomic(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **dict[str, Any](arrays))
