"""The folder of suites: rendered sets, named by their content and shared by suites, and a manifest per suite."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from pydantic import Field

from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, TEMPORARY, inside, model_of, read_model, write_files
from mirrorcam.core.disk.fingerprint import file_digest
from mirrorcam.core.disk.written_files import discard, move_files
from mirrorcam.core.errors import InputError
from mirrorcam.core.names import Line
from mirrorcam.core.values import Value
from mirrorcam.render_scenes.sets.dataset import MANIFEST, Dataset
from mirrorcam.render_scenes.suites.recipe import Slug
from mirrorcam.render_scenes.suites.suite import VERSION
from mirrorcam.simulation.rendering import check_set

SETS, DESIGNS = "sets", "designs"
SUFFIX = ".suite.json"
State = Literal["finished", "begun", "missing", "stored"]


class SuiteSet(Value):
    """A finished set: its folder, relative to the manifest's, and the SHA-256 of its `dataset.json`.

    `dataset.json` states the SHA-256 of every other file of the set.
    """

    name: Slug
    folder: str = Field(max_length=200, pattern=rf"^{SETS}/[a-z0-9-]+$")
    dataset_sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    why: Line = ""


class SuiteManifest(Value):
    """`NAME.suite.json`: the sets of a suite, in its order.

    Attributes
    ----------
    renderer : str
        Variant of Mitsuba, on which the bytes depend.
    made_with : dict of str to str
        Digest of the code, and versions of the libraries, that made the sets.
    sets : tuple of SuiteSet
        Finished sets.
    missing : tuple of str
        Names of sets that could not be rendered.
    """

    schema_id: Literal["mirrorcam.suite/1"] = Field(default="mirrorcam.suite/1", alias="schema")
    name: Slug
    version: int = VERSION.field()
    description: Line = ""
    renderer: str
    made_with: dict[str, str]
    sets: tuple[SuiteSet, ...]
    missing: tuple[Slug, ...] = ()

    @property
    def text(self) -> str:
        """The content of the manifest's file."""
        return self.model_dump_json(indent=1, by_alias=True) + "\n"


@dataclass(frozen=True)
class FinishedSuite:
    """A suite's manifest, and the folders of its sets in their order, as absolute paths."""

    manifest: SuiteManifest
    folders: tuple[Path, ...]


def read_finished(path: Path) -> FinishedSuite:
    """Read a suite's manifest by its path, or by a folder with only one.

    Raises InputError for no or several manifests, and for a set that is missing or differs.
    """
    if path.is_dir():
        manifests = sorted(path.glob(f"*{SUFFIX}"))
        if len(manifests) != 1:
            names = ", ".join(manifest.name for manifest in manifests) or "none"
            raise InputError(f"{path}: expected the manifest of one suite (NAME{SUFFIX}), found {names}")
        path = manifests[0]
    manifest = read_model(SuiteManifest, path, LARGEST_LAYOUT_BYTES)
    folders = tuple(inside(path.parent, entry.folder) for entry in manifest.sets)
    for folder, entry in zip(folders, manifest.sets, strict=True):
        dataset = folder / MANIFEST
        if not dataset.is_file() or file_digest(dataset) != entry.dataset_sha256:
            raise InputError(f"{dataset}: is not the set {entry.name} of {path.name}, expected the file as rendered")
    return FinishedSuite(manifest, tuple(folder.absolute() for folder in folders))


def state_of(folder: Path) -> State:
    """Return the state of a set: finished, begun or missing; raises InputError if it is foreign or altered."""
    if os.path.lexists(folder) and (folder.is_symlink() or not folder.is_dir()):
        raise InputError(f"{folder}: is not a folder, expected that of a set, or nothing")
    if not (folder / MANIFEST).is_file():
        foreign = (
            next((path for path in folder.iterdir() if not path.name.startswith(".")), None)
            if folder.exists()
            else None
        )
        if foreign is not None:
            raise InputError(
                f"{folder}: has {foreign.name!r} but no {MANIFEST}, expected a set of this suite, or nothing"
            )
        return "missing"
    check = check_set(folder)
    if check.altered:
        raise InputError(
            f"{folder / check.altered[0]}: was changed since it was written, expected it unchanged or removed"
        )
    return "finished" if check.passed else "begun"


def put_set(folder: Path, dataset: Dataset, write: Callable[[Path], None]) -> None:
    """Move the files of a set that was rendered elsewhere into place; `write` writes them into an empty folder.

    Raises InputError if the set is incomplete, a file differs from `dataset`, or the folder contains other files.
    """
    if unknown := sorted(dataset.files.keys() - set(dataset.planned_names)):
        raise InputError(f"{folder.name}: lists {unknown[0][:80]!r}, expected only the files of a set")
    if not dataset.complete:
        raise InputError(f"{folder.name}: lacks {dataset.missing[0]}, expected a complete set")

    staged = folder.with_name(f"{TEMPORARY}{folder.name}")
    discard(staged)  # left by a killed run
    staged.mkdir(parents=True)
    try:
        write(staged)
        damaged = [name for name in dataset.files if not dataset.intact(staged, name)]
        if damaged:
            raise InputError(f"{folder.name}: {damaged[0]} does not match its checksum, expected the rendered file")
        begun = dataset.replaced(files={}).resumed(folder, dataset.planned_names)
        begun.added(folder, lambda staging: move_files(staged, staging, dataset.files))
    finally:
        discard(staged)


def put_files(folder: Path, files: dict[str, bytes]) -> None:
    """Call `put_set` with the files of a set, including its manifest, by name."""
    dataset = model_of(Dataset, Path(folder.name, MANIFEST), files[MANIFEST])
    others = {name: content for name, content in files.items() if name in dataset.files}
    put_set(folder, dataset, partial(write_files, files=others))
