"""Stages: steps of work that are done once, and again only when something they depend on has changed.

A stage owns one subfolder of the run's folder. It works in a hidden folder, whose files take their places when the work
has ended well. Among them is a manifest of everything that decided about the result: parameters, contents of the files
read, the sources of the packages involved, versions of what is installed, and the contents of the files written.
Interrupted work therefore leaves nothing behind that could be mistaken for a result.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from mirrorcam.core.disk import fingerprint
from mirrorcam.core.disk.files import inside, write_text
from mirrorcam.core.disk.fingerprint import Fingerprint, file_digest, file_digests, source_digest
from mirrorcam.core.disk.output_folder import OutputFolder
from mirrorcam.core.disk.resumable import read_record
from mirrorcam.core.processes import interruption
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import Value

MANIFEST = ".stage.json"


@dataclass(frozen=True)
class Stage:
    """One step of the pipeline; `work` writes its files into the (empty) folder it is given, and reports its progress.

    `name` is the name of the folder, `doing` what people read while it works, `unit` what its progress counts. `reads`
    are files or folders, `sources` packages or modules of ours, `extras` the optional parts of the installation that it
    needs, `programs` the versions of programs that it runs: what may change the result. `parameters` hold anything JSON
    can. Work that `resumes` finds what an interrupted run of it has left, and judges by itself what it can use.
    """

    name: str
    work: Callable[[Path, Progress], None]
    doing: str = ""
    unit: str = ""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    reads: tuple[Path, ...] = ()
    sources: tuple[str, ...] = ()
    extras: tuple[str, ...] = ()
    programs: Mapping[str, str] = field(default_factory=dict)
    resumes: bool = False


class Manifest(Value):
    """Inputs that a stage's folder was made from, and its files: path -> sha256."""

    schema_id: Literal["mirrorcam.stage/2"] = Field(default="mirrorcam.stage/2", alias="schema")
    made_of: Fingerprint
    files: dict[str, str] = Field(default_factory=dict)


def fingerprint_of(stage: Stage, root: Path) -> Fingerprint:
    """Return what decides about the result of a stage now."""
    reads: dict[str, str] = {}
    for path in stage.reads:
        place = path.relative_to(root).as_posix() if path.is_relative_to(root) else str(path)
        inside = file_digests(path, without=MANIFEST)
        reads |= {place if path.is_file() else f"{place}/{name}": value for name, value in inside.items()}
    return Fingerprint(
        parameters=dict(stage.parameters),
        reads=reads,
        sources={module: source_digest(module) for module in stage.sources},
        versions=fingerprint.versions(*stage.extras) | dict(stage.programs),
    )


def _write_manifest(folder: Path, manifest: Manifest) -> None:
    write_text(folder / MANIFEST, manifest.model_dump_json(indent=1, by_alias=True) + "\n")


def staleness(stage: Stage, root: Path) -> str:
    """Say why the stage has to be done (again), in a few words; empty where its folder holds what it would make now."""
    folder = root / stage.name
    found = read_record(Manifest, folder / MANIFEST)
    if found is None:
        return "not made yet"
    return fingerprint_of(stage, root).changed_since(found.made_of) or _altered(folder, found.files)


def _altered(folder: Path, written: Mapping[str, str]) -> str:
    for name, sha256 in written.items():
        path = inside(folder, name)
        if not path.is_file():
            return f"{name} is missing"
        if file_digest(path) != sha256:
            return f"{name} is not what was written"
    return ""


def perform(stage: Stage, output: OutputFolder, progress: Progress = no_progress) -> None:
    """Do the stage's work, and replace an earlier result in the stage's subfolder by its result.

    Raises InputError, before any work, where the subfolder holds files that no stage has made, or that were changed
    since: those are not replaced.
    """
    begun = Manifest(made_of=fingerprint_of(stage, output.root))
    place = output.subfolder(stage.name)
    place.refuse_unknown()
    place.refuse_changed()
    place.refuse_others(MANIFEST)
    folder, keep = place.unfinished, False
    if not stage.resumes or read_record(Manifest, folder / MANIFEST) != begun:
        place.discard()  # what is left there was interrupted while making something else
    folder.mkdir(parents=True, exist_ok=True)
    _write_manifest(folder, begun)
    try:
        stage.work(folder, progress)
        _write_manifest(folder, begun.replaced(files=file_digests(folder, without=MANIFEST)))
        place.adopt()
    except BaseException as error:
        keep = stage.resumes and interruption.ended(error)
        raise
    finally:
        if not keep:
            place.discard()
