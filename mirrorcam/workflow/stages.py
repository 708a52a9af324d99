"""Stages: steps of work that are done once, and again only when something they depend on has changed.

A stage owns one folder. It works in a hidden folder beside it, which takes its place when the work has ended well,
together with a manifest of everything that decided about the result: parameters, contents of the files read, the
sources of the packages involved, versions of their tools, and the contents of the files written. Interrupted work
therefore leaves nothing behind that could be mistaken for a result.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError

from mirrorcam.optics.base.files import write_text
from mirrorcam.optics.base.progress import Progress, no_progress
from mirrorcam.optics.base.values import Value
from mirrorcam.workflow.folders import clear, replaced

MANIFEST = ".stage.json"


@dataclass(frozen=True)
class Stage:
    """One step of the pipeline; `work` writes its files into the (empty) folder it is given, and reports its progress.

    `name` is the name of the folder, `doing` what people read while it works, `unit` what its progress counts. `reads`
    are files or folders; `sources` are packages or modules of ours and `tools` are installed distributions whose change
    may change the result; `parameters` hold anything JSON can.
    Work that `resumes` finds what an interrupted run of it has left, and judges by itself what of that it can use.
    """

    name: str
    work: Callable[[Path, Progress], None]
    doing: str = ""
    unit: str = ""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    reads: tuple[Path, ...] = ()
    sources: tuple[str, ...] = ()
    tools: tuple[str, ...] = ()
    resumes: bool = False


class Manifest(Value):
    """What made a stage's folder, and what is in it: path -> sha256."""

    schema_id: Literal["mirrorcam.stage/1"] = Field(default="mirrorcam.stage/1", alias="schema")
    parameters: dict[str, Any]
    reads: dict[str, str]
    sources: dict[str, str]
    tools: dict[str, str]
    files: dict[str, str] = Field(default_factory=dict)


def digest(path: Path) -> str:
    """sha256 of a file, in hexadecimal."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def digests(path: Path) -> dict[str, str]:
    """sha256 of a file (under its name) or of every file below a folder (under its path in it), sorted."""
    if path.is_file():
        return {path.name: digest(path)}
    below = sorted(file for file in path.rglob("*") if file.is_file() and file.name != MANIFEST)
    return {file.relative_to(path).as_posix(): digest(file) for file in below}


@cache
def source_digest(module: str) -> str:
    """sha256 over the source files of a package (all below it) or of a module, found without importing it."""
    found = find_spec(module)
    if found is None or found.origin is None:
        raise ModuleNotFoundError(f"no module {module!r} to take the fingerprint of")
    origin = Path(found.origin)
    files = sorted(origin.parent.rglob("*.py")) if found.submodule_search_locations else [origin]
    total = hashlib.sha256()
    for file in files:
        total.update(f"{file.relative_to(origin.parent).as_posix()} {digest(file)}\n".encode())
    return total.hexdigest()


def _version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"


def _wanted(stage: Stage, root: Path) -> Manifest:
    reads: dict[str, str] = {}
    for path in stage.reads:
        place = path.relative_to(root).as_posix() if path.is_relative_to(root) else str(path)
        inside = digests(path)
        reads |= {place if path.is_file() else f"{place}/{name}": value for name, value in inside.items()}
    return Manifest(
        parameters=dict(stage.parameters),
        reads=reads,
        sources={module: source_digest(module) for module in stage.sources},
        tools={tool: _version(tool) for tool in stage.tools},
    )


def _read_manifest(folder: Path) -> Manifest | None:
    try:
        return Manifest.model_validate_json((folder / MANIFEST).read_bytes())
    except (FileNotFoundError, NotADirectoryError, ValidationError):
        return None


def _text(manifest: Manifest) -> str:
    return manifest.model_dump_json(indent=1, by_alias=True) + "\n"


def staleness(stage: Stage, root: Path) -> str:
    """Why the stage has to be done (again), in a few words; empty where its folder holds what it would make now."""
    folder = root / stage.name
    found = _read_manifest(folder)
    if found is None:
        return "not made yet"
    wanted = _wanted(stage, root)
    if found.parameters != wanted.parameters:
        return "other parameters"
    for before, now in ((found.reads, wanted.reads), (found.sources, wanted.sources), (found.tools, wanted.tools)):
        for name in sorted(before.keys() | now.keys()):
            if before.get(name) != now.get(name):
                return f"{name} changed"
    files = digests(folder)
    for name in sorted(found.files.keys() | files.keys()):
        if name not in files:
            return f"{name} is missing"
        if files[name] != found.files.get(name):
            return f"{name} is not what was written"
    return ""


def perform(stage: Stage, root: Path, progress: Progress = no_progress) -> None:
    """Do the stage's work and put the result in the place of an earlier one.

    Raises InputError where the folder holds files that no stage has made: those are not ours to replace.
    """
    wanted = _wanted(stage, root)
    with replaced(root / stage.name, marker=MANIFEST, keep_interrupted=stage.resumes) as folder:
        if _read_manifest(folder) != wanted:
            clear(folder)  # what is left there was interrupted while making something else
        write_text(folder / MANIFEST, _text(wanted))
        stage.work(folder, progress)
        made = wanted.replaced(files=digests(folder))
        write_text(folder / MANIFEST, _text(made))
