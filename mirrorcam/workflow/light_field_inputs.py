"""Light fields that commands work through, one after the other: from files, folders, recordings and frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mirrorcam.optics.base.files import is_picture, read_image
from mirrorcam.optics.base.progress import Progress, no_progress
from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.io.formats.hci import PARAMETERS, read_hci
from mirrorcam.optics.light_field.io.npz import load_npz
from mirrorcam.optics.light_field.io.zarr_store import StoredLightFields
from mirrorcam.optics.light_field.light_field import LightField


@dataclass(frozen=True)
class NamedLightField:
    """A light field, the name of its results, and the depths between which its file says the scene is."""

    name: str
    light_field: LightField
    depth_range_mm: tuple[float, float] | None = None

    def depths_to_search(self, near_mm: float | None, far_mm: float | None) -> tuple[float | None, float | None]:
        """The depths given, and where there are none, those that the file states."""
        near, far = self.depth_range_mm or (None, None)
        return near if near_mm is None else near_mm, far if far_mm is None else far_mm


@dataclass(frozen=True)
class LightFieldInputs:
    """Files and folders of light fields, whose names differ because results are called by them.

    `layout` is the `layout.json` of frames that are still to be decoded.
    """

    paths: tuple[Path, ...]
    layout: Path | None = None

    def __post_init__(self) -> None:
        names = [path.stem for path in self.paths]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise InputError(f"two light fields are called {twice!r}, expected different names: each names its results")

    def each(self, progress: Progress = no_progress) -> Iterator[NamedLightField]:
        """Open the light fields one after the other; `progress` is called after each file or folder.

        Raises InputError for a file that is no light field, and for a frame without a layout.
        """
        for done, path in enumerate(self.paths, start=1):
            yield from opened(path, self.layout)
            progress(done, len(self.paths))


def opened(path: Path, layout: Path | None) -> Iterator[NamedLightField]:
    """The light fields of a file or folder; a recording has one for each frame."""
    if is_picture(path):
        if layout is None:
            raise InputError(f"{path}: a frame, expected --layout to decode it with, or a light field")
        yield NamedLightField(path.stem, Decoder(Layout.load(layout)).decode(read_image(path)))
    elif (path / PARAMETERS).exists():
        scene = read_hci(path)
        yield NamedLightField(path.name, scene.light_field, scene.depth_range_mm)
    elif path.is_dir():
        stored = StoredLightFields(path)
        for frame in range(len(stored)):
            yield NamedLightField(f"{path.stem}_{frame:06d}", stored[frame])
    else:
        yield NamedLightField(path.stem, load_npz(path))
