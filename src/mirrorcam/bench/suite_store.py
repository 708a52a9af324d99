"""Suites in object storage, or any other file system of fsspec: copy sets there and back, and verify checksums.

A store is laid out as the folder of suites is: `sets/NAME-DIGEST/` and `NAME.suite.json`. A set is complete as soon as
its `dataset.json` is there, which is written last; it never changes, as its name follows from its content. The manifest
of a suite is replaced by the manifest of its next version. Nothing is deleted.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from mirrorcam.bench.suite_folder import SETS, SUFFIX, SuiteManifest, put_set
from mirrorcam.core.disk.files import LARGEST_FILE_BYTES, inside, json_of, model_from, read_bytes
from mirrorcam.core.disk.fingerprint import differing
from mirrorcam.core.errors import InputError
from mirrorcam.core.extras import require
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.render_scenes.sets.dataset import MANIFEST, Dataset
from mirrorcam.render_scenes.suites.recipe import SetRecipe

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem

LARGEST_STORED_BYTES = 2_000_000_000
"""Largest file to fetch, in bytes: more than the maps of any camera."""


class Store:
    """A location for fsspec: a bucket and a prefix, a folder, or a server.

    Attributes
    ----------
    url : str
        Its address, without a password, for people.

    Raises
    ------
    InputError
        From every method, in one line, where the place does not answer or refuses.
    """

    def __init__(self, url: str) -> None:
        require("remote")
        from fsspec.core import url_to_fs

        self.url = re.sub(r"//[^/@]+@", "//", url)
        with self._named():
            found: tuple[AbstractFileSystem, str] = url_to_fs(url)
        self._files, self._root = found[0], found[1].rstrip("/")

    def has(self, name: str) -> bool:
        """Return whether a file exists."""
        with self._named(name):
            return bool(self._files.isfile(self._path(name)))

    def read(self, name: str, most: int = LARGEST_FILE_BYTES) -> bytes:
        """Read a file of at most `most` bytes."""
        self._refuse_large(name, most)
        with self._named(name):
            return bytes(self._files.cat_file(self._path(name)))

    def get(self, name: str, path: Path) -> None:
        """Copy a file from the store."""
        self._refuse_large(name, LARGEST_STORED_BYTES)
        path.parent.mkdir(parents=True, exist_ok=True)
        with self._named(name):
            self._files.get_file(self._path(name), str(path))

    def put(self, path: Path, name: str) -> None:
        """Copy a file to the store, replacing one from an interrupted upload."""
        with self._named(name):
            self._files.makedirs(self._path(name).rpartition("/")[0], exist_ok=True)
            self._files.put_file(str(path), self._path(name))
            stored = self._files.size(self._path(name))
        if stored != path.stat().st_size:
            raise InputError(f"{self.url}: {name} has {stored} bytes there, expected {path.stat().st_size}")

    def write(self, name: str, content: bytes) -> None:
        """Write a file atomically."""
        with self._named(name):
            self._files.makedirs(self._path(name).rpartition("/")[0], exist_ok=True)
            with self._files.transaction, self._files.open(self._path(name), "wb") as stream:
                stream.write(content)

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}"

    def _refuse_large(self, name: str, most: int) -> None:
        with self._named(name):
            size = self._files.size(self._path(name))
        if size is None or size > most:
            raise InputError(f"{self.url}: {name} has {size} bytes, expected {most} or fewer")

    @contextmanager
    def _named(self, name: str = "") -> Iterator[None]:
        """Convert a backend's errors to an InputError that names the store."""
        what = f"{self.url}: {name}: " if name else f"{self.url}: "
        try:
            yield
        except FileNotFoundError:
            raise InputError(f"{what}is not there") from None
        except ImportError as error:
            raise InputError(f"{what}{error}") from None
        except Exception as error:  # each backend has errors of its own
            raise InputError(f"{what}{type(error).__name__}: {error}") from error


def is_stored(store: Store, folder: Path) -> bool:
    """Whether the set of a folder is complete in a store."""
    return store.has(_dataset_name(folder))


def publish(manifest: SuiteManifest, folder: Path, store: Store, progress: Progress = no_progress) -> int:
    """Copy the missing sets of a suite to a store, then its manifest if the suite is complete.

    Parameters
    ----------
    manifest, folder
        The manifest, and the folder that it is in.
    store
        Where they go to.
    progress
        Called with the numbers of sets that are there and of all.

    Returns
    -------
    int
        How many sets were copied.

    Raises
    ------
    InputError
        Where another set, or anything else, is in the place of one.
    """
    name = f"{manifest.name}{SUFFIX}"
    if store.has(name):
        _refuse_other(store, name, manifest)
    copied = 0
    for done, each in enumerate(manifest.sets):
        progress(done, len(manifest.sets))
        place = inside(folder, each.folder)
        copied += _publish_set(place, store)
    progress(len(manifest.sets), len(manifest.sets))
    if not manifest.missing:
        store.write(name, manifest.text.encode())
    return copied


def _refuse_other(store: Store, name: str, manifest: SuiteManifest) -> None:
    raw = store.read(name)
    try:
        there = model_from(SuiteManifest, name, json_of(name, raw))
    except InputError:
        raise InputError(f"{store.url}: {name} is no manifest of a suite, expected one, or nothing") from None
    if there.name != manifest.name:
        raise InputError(f"{store.url}: {name} is of the suite {there.name}, expected {manifest.name}")


def _publish_set(folder: Path, store: Store) -> bool:
    manifest = read_bytes(folder / MANIFEST)
    if is_stored(store, folder):
        if store.read(_dataset_name(folder)) != manifest:
            raise InputError(f"{store.url}: {_dataset_name(folder)} is of another set, expected the set of {folder}")
        return False
    for name in Dataset.load(folder).files:
        store.put(inside(folder, name), f"{SETS}/{folder.name}/{name}")
    store.write(_dataset_name(folder), manifest)
    return True


def fetch_set(store: Store, recipe: SetRecipe, folder: Path) -> None:
    """Copy the set of a recipe from a store into its folder.

    Raises InputError where the stored set has another recipe, names files that a set does not have, or does not
    match its checksums; the folder is left as it was then.
    """
    name = _dataset_name(folder)
    where = f"{store.url}: {name}"
    dataset = model_from(Dataset, where, json_of(where, store.read(name)))
    if other := differing(_asked(recipe), _told(dataset)):
        raise InputError(f"{store.url}: {name} has another {other[0]}, expected the one of the set {recipe.name}")

    def download(staging: Path) -> None:
        for file in dataset.files:
            store.get(f"{SETS}/{folder.name}/{file}", inside(staging, file))

    put_set(folder, dataset, download)


def _asked(recipe: SetRecipe) -> dict[str, object]:
    """Properties of a set, by its recipe and by its manifest."""
    camera = recipe.camera
    return {
        "frames": recipe.frames,
        "base_frames": recipe.base_frames,
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "target": recipe.board,
        "tolerances": recipe.tolerances,
        "settings": recipe.settings,
        "rate_hz": recipe.rate_hz,
    }


def _told(dataset: Dataset) -> dict[str, object]:
    names = ("frames", "base_frames", "width_px", "height_px", "target", "tolerances", "settings", "rate_hz")
    return {name: getattr(dataset, name) for name in names}


def _dataset_name(folder: Path) -> str:
    return f"{SETS}/{folder.name}/{MANIFEST}"
