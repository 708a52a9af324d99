"""Suites in object storage, or any other file system of fsspec: upload and download sets, and verify checksums.

A store has the layout of the folder of suites: `sets/NAME-DIGEST/` and `NAME.suite.json`. A set is complete once it has
`dataset.json`, which is written last. It never changes, because its name is derived from its content. A new version of
a suite replaces the manifest. Nothing is deleted.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from mirrorcam.bench.suite_folder import SETS, SUFFIX, SuiteManifest, put_set
from mirrorcam.core.disk.files import LARGEST_FILE_BYTES, inside, json_of, model_from, read_bytes
from mirrorcam.core.disk.fingerprint import differing_keys
from mirrorcam.core.errors import InputError
from mirrorcam.core.extras import require
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.render_scenes.sets.dataset import MANIFEST, Dataset
from mirrorcam.render_scenes.suites.recipe import SetRecipe

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem

MAX_STORED_BYTES = 2_000_000_000
"""Maximum size of a file to download: more than the maps of any camera."""


class Store:
    """A location of fsspec: a bucket and a prefix, a folder, or a server.

    Attributes
    ----------
    url : str
        Its address without a password, for messages.

    Raises
    ------
    InputError
        From every method, if the store does not answer or refuses access.
    """

    def __init__(self, url: str) -> None:
        require("remote")
        from fsspec.core import url_to_fs

        self.url = re.sub(r"//[^/@]+@", "//", url)
        with self._naming_errors():
            location: tuple[AbstractFileSystem, str] = url_to_fs(url)
        self._files, self._root = location[0], location[1].rstrip("/")

    def has(self, name: str) -> bool:
        """Return whether a file exists."""
        with self._naming_errors(name):
            return bool(self._files.isfile(self._path(name)))

    def read(self, name: str, max_bytes: int = LARGEST_FILE_BYTES) -> bytes:
        """Read a file of at most `max_bytes` bytes."""
        self._refuse_large(name, max_bytes)
        with self._naming_errors(name):
            return bytes(self._files.cat_file(self._path(name)))

    def get(self, name: str, path: Path) -> None:
        """Copy a file from the store."""
        self._refuse_large(name, MAX_STORED_BYTES)
        path.parent.mkdir(parents=True, exist_ok=True)
        with self._naming_errors(name):
            self._files.get_file(self._path(name), str(path))

    def put(self, path: Path, name: str) -> None:
        """Copy a file to the store, replacing one from an interrupted upload."""
        with self._naming_errors(name):
            self._files.makedirs(self._path(name).rpartition("/")[0], exist_ok=True)
            self._files.put_file(str(path), self._path(name))
            stored = self._files.size(self._path(name))
        if stored != path.stat().st_size:
            raise InputError(f"{self.url}: {name} has {stored} bytes there, expected {path.stat().st_size}")

    def write(self, name: str, content: bytes) -> None:
        """Write a file atomically."""
        with self._naming_errors(name):
            self._files.makedirs(self._path(name).rpartition("/")[0], exist_ok=True)
            with self._files.transaction, self._files.open(self._path(name), "wb") as stream:
                stream.write(content)

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}"

    def _refuse_large(self, name: str, max_bytes: int) -> None:
        with self._naming_errors(name):
            size = self._files.size(self._path(name))
        if size is None or size > max_bytes:
            raise InputError(f"{self.url}: {name} has {size} bytes, expected {max_bytes} or fewer")

    @contextmanager
    def _naming_errors(self, name: str = "") -> Iterator[None]:
        """Convert a backend's errors to an InputError that names the store."""
        where = f"{self.url}: {name}: " if name else f"{self.url}: "
        try:
            yield
        except FileNotFoundError:
            raise InputError(f"{where}does not exist") from None
        except ImportError as error:
            raise InputError(f"{where}{error}") from None
        except Exception as error:  # each backend has errors of its own
            raise InputError(f"{where}{type(error).__name__}: {error}") from error


def is_stored(store: Store, folder: Path) -> bool:
    """Return whether the set of a folder is complete in a store."""
    return store.has(_dataset_name(folder))


def publish(manifest: SuiteManifest, folder: Path, store: Store, progress: Progress = no_progress) -> int:
    """Copy the missing sets of a suite to a store, then its manifest if the suite is complete.

    Parameters
    ----------
    manifest, folder
        The manifest, and its folder.
    store
        Target store.
    progress
        Called with the number of stored sets, and their total.

    Returns
    -------
    int
        Number of copied sets.

    Raises
    ------
    InputError
        If the store has something else under the name of the suite or of a set.
    """
    name = f"{manifest.name}{SUFFIX}"
    if store.has(name):
        _refuse_other(store, name, manifest)
    copied = 0
    for done, entry in enumerate(manifest.sets):
        progress(done, len(manifest.sets))
        copied += _publish_set(inside(folder, entry.folder), store)
    progress(len(manifest.sets), len(manifest.sets))
    if not manifest.missing:
        store.write(name, manifest.text.encode())
    return copied


def _refuse_other(store: Store, name: str, manifest: SuiteManifest) -> None:
    raw = store.read(name)
    try:
        stored = model_from(SuiteManifest, name, json_of(name, raw))
    except InputError:
        raise InputError(f"{store.url}: {name} is not a suite manifest, expected one, or nothing") from None
    if stored.name != manifest.name:
        raise InputError(f"{store.url}: {name} belongs to the suite {stored.name}, expected {manifest.name}")


def _publish_set(folder: Path, store: Store) -> bool:
    manifest = read_bytes(folder / MANIFEST)
    if is_stored(store, folder):
        if store.read(_dataset_name(folder)) != manifest:
            raise InputError(
                f"{store.url}: {_dataset_name(folder)} belongs to a different set, expected that of {folder}"
            )
        return False
    for name in Dataset.load(folder).files:
        store.put(inside(folder, name), f"{SETS}/{folder.name}/{name}")
    store.write(_dataset_name(folder), manifest)
    return True


def fetch_set(store: Store, recipe: SetRecipe, folder: Path) -> None:
    """Copy the set of a recipe from a store into its folder.

    Raises InputError, and leaves the folder unchanged, if the stored set has a different recipe, unknown files or wrong
    checksums.
    """
    name = _dataset_name(folder)
    where = f"{store.url}: {name}"
    dataset = model_from(Dataset, where, json_of(where, store.read(name)))
    if other := differing_keys(_requested_by(recipe), _stated_by(dataset)):
        raise InputError(f"{store.url}: {name} differs in {other[0]} from the set {recipe.name}")

    def download(staging: Path) -> None:
        for file in dataset.files:
            store.get(f"{SETS}/{folder.name}/{file}", inside(staging, file))

    put_set(folder, dataset, download)


def _requested_by(recipe: SetRecipe) -> dict[str, object]:
    """Return the properties of a recipe that a manifest also states."""
    camera = recipe.camera
    return {
        "frames": recipe.frames,
        "base_frames": recipe.base_frames,
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "board": recipe.board,
        "tolerances": recipe.tolerances,
        "settings": recipe.settings,
        "rate_hz": recipe.rate_hz,
    }


def _stated_by(dataset: Dataset) -> dict[str, object]:
    names = ("frames", "base_frames", "width_px", "height_px", "board", "tolerances", "settings", "rate_hz")
    return {name: getattr(dataset, name) for name in names}


def _dataset_name(folder: Path) -> str:
    return f"{SETS}/{folder.name}/{MANIFEST}"
