"""Fingerprints of results: digests of files, sources and values, and versions of the distributions involved.

The same fingerprint means the same bytes, so that what was made once is not made again.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Collection, Mapping
from functools import cache
from importlib import import_module, metadata
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

from pydantic import Field

from mirrorcam.core.disk.files import inside
from mirrorcam.core.values import Value

OURS = "mirrorcam"
NOT_INSTALLED = "not installed"
_REQUIREMENT = re.compile(r"([\w.-]+)\s*(?:\[([^\]]*)\])?[^;]*(?:;(.*))?")
_EXTRA = re.compile(r"""extra\s*==\s*['"]([^'"]+)['"]""")


def digest(*parts: bytes | memoryview) -> str:
    """Return the sha256 of byte strings, one after the other, in hexadecimal."""
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


def file_digests(path: Path, *, without: str = "") -> dict[str, str]:
    """Return the sha256 of a file by its name, or of every file below a folder by its path in it, sorted.

    Files named `without` are left out. Raises InputError for a link that leads out of the folder.
    """
    if path.is_file():
        return {path.name: file_digest(path)}
    below = sorted(file for file in path.rglob("*") if file.is_file() and file.name != without)
    names = (file.relative_to(path).as_posix() for file in below)
    return {name: file_digest(inside(path, name)) for name in names}


@cache
def source_digest(module: str) -> str:
    """Return the sha256 over the files of a package (all below it, templates and tables too) or of a module.

    The module itself is not imported, only the packages it is in. Raises ModuleNotFoundError where there is none.
    """
    found = find_spec(module)
    if found is None or found.origin is None:
        raise ModuleNotFoundError(f"no module {module!r} to take the fingerprint of")
    origin = Path(found.origin)
    if not found.submodule_search_locations:
        return file_digest(origin)
    files = (path for path in sorted(origin.parent.rglob("*")) if path.is_file() and "__pycache__" not in path.parts)
    lines = (f"{path.relative_to(origin.parent).as_posix()} {file_digest(path)}\n".encode() for path in files)
    return digest(*lines)


def source_digests(package: str, *, without: Collection[str] = ()) -> dict[str, str]:
    """Return the `source_digest` of each module and package directly in a package, but those of the names `without`."""
    names = sorted(module.name for module in iter_modules(import_module(package).__path__))
    return {f"{package}.{name}": source_digest(f"{package}.{name}") for name in names if name not in without}


@cache
def distributions(*extras: str) -> tuple[str, ...]:
    """Return the distributions that MirrorCam needs, with these extras of it, by its installed metadata.

    These are the ones that it requires itself, and the compiled ones that those require in turn: they can change the
    results of an unchanged library.
    """
    direct = required(OURS, frozenset(extras))
    found, waiting = set(direct), list(direct)
    while waiting:
        for name in required(waiting.pop(), frozenset()):
            if name not in found:
                found.add(name)
                waiting.append(name)
    return tuple(sorted(name for name in found if name in direct or _is_compiled(name)))


def versions(*extras: str) -> dict[str, str]:
    """Return the installed version of each of `distributions(*extras)`."""
    return {name: _version(name) for name in distributions(*extras)}


def _version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return NOT_INSTALLED


def required(distribution: str, extras: frozenset[str]) -> set[str]:
    """Return what a distribution requires with some of its extras; conditions on the platform are taken as met."""
    try:
        lines = metadata.requires(distribution) or []
    except metadata.PackageNotFoundError:
        return set()
    found = set()
    for line in lines:
        match = _REQUIREMENT.match(line)
        assert match is not None, line
        name, inner, condition = match.groups()
        only_with = set(_EXTRA.findall(condition or ""))
        if only_with and not only_with & extras:
            continue
        if normalised(name) == normalised(distribution):  # an extra made of other extras
            found |= required(distribution, frozenset(each.strip() for each in inner.split(",")))
        else:
            found.add(normalised(name))
    return found


def normalised(name: str) -> str:
    """The one spelling of a distribution's name, for comparisons."""
    return re.sub(r"[-_.]+", "-", name).lower()


def _is_compiled(distribution: str) -> bool:
    try:
        wheel = metadata.distribution(distribution).read_text("WHEEL")
    except metadata.PackageNotFoundError:
        return False
    return wheel is not None and "root-is-purelib: false" in wheel.lower()


class Fingerprint(Value):
    """All inputs that a result depends on, part by part.

    Parameters
    ----------
    parameters : anything JSON can hold, by name
    reads : sha256 of each file read, by its path
    sources : sha256 of each module or package of ours that does the work, by its name
    versions : version of each distribution or program involved, by its name
    """

    parameters: dict[str, Any] = Field(default_factory=dict)
    reads: dict[str, str] = Field(default_factory=dict)
    sources: dict[str, str] = Field(default_factory=dict)
    versions: dict[str, str] = Field(default_factory=dict)

    @property
    def digest(self) -> str:
        """The whole as one sha256."""
        return value_digest(self.model_dump(mode="json"))

    def changed_since(self, before: Fingerprint) -> str:
        """Describe the first difference from an earlier fingerprint; empty where nothing differs."""
        if self.parameters != before.parameters:
            return "other parameters"
        for then, now in ((before.reads, self.reads), (before.sources, self.sources)):
            if names := differing(then, now):
                return f"{names[0]} changed"
        for name in differing(before.versions, self.versions):
            return f"{name} {before.versions.get(name, NOT_INSTALLED)} → {self.versions.get(name, NOT_INSTALLED)}"
        return ""


def differing(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return the sorted names under which two mappings hold different values, or only one holds any."""
    missing = object()
    return sorted(name for name in before.keys() | now.keys() if before.get(name, missing) != now.get(name, missing))
