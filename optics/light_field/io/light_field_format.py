"""File formats of light fields, collected by `formats.registry`, and sequences of light fields read on access."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import overload

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mirrorcam.core.bounds import DEPTH_OR_INF_MM, FOCAL_PX, GRID, LENGTH_MM
from mirrorcam.core.disk.files import read_model
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import DepthOrInf, Value
from mirrorcam.optics.light_field.light_field import LightField

Depth = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class KnownDepth:
    """Depth (v, u) of the reference view from the pupil, mm; with sigma_mm and confidence (v, u) if estimated."""

    depth_mm: Depth
    sigma_mm: Depth | None = None
    confidence: Depth | None = None


def views_toml(path: Path) -> Path:
    """Return the file with the missing geometry: `views.toml` in a folder, `NAME.views.toml` next to a file."""
    return path / "views.toml" if path.is_dir() else path.with_name(f"{path.stem}.views.toml")


class Assumed(Value):
    """Assumed geometry for files that do not state it; stated values take precedence.

    Attributes
    ----------
    rows, cols
        Numbers of rows and columns of views.
    step_mm
        Distance between adjacent views.
    focal_px
        Focal length of the views.
    reference_depth_mm
        Distance of the plane of zero disparity from the views.
    """

    rows: int | None = GRID.field(None, "rows of views, where a file or folder does not state them")
    cols: int | None = GRID.field(None, "columns of views, likewise")
    step_mm: float | None = LENGTH_MM.field(None, "distance between adjacent views, likewise")
    focal_px: float | None = FOCAL_PX.field(None, "focal length of the views, likewise")
    reference_depth_mm: DepthOrInf | None = Field(
        default=None,
        description=f"distance of the plane of zero disparity from the views, likewise, {DEPTH_OR_INF_MM} (parallel)",
    )

    def complete(self, path: Path) -> Assumed:
        """Fill values that are None from the light field's `views_toml`, if it exists.

        Raises a one-line InputError if the file is invalid.
        """
        file = views_toml(path)
        return read_model(Assumed, file).replaced(**self.model_dump(exclude_none=True)) if file.exists() else self

    def need(self, path: Path, *names: str) -> tuple[float, ...]:
        """Return the named values; raises InputError for a light field at `path` if one is unknown."""
        missing = [name for name in names if getattr(self, name) is None]
        if missing:
            file = views_toml(path).relative_to(path.parent)
            options = ", ".join(f"--{name.replace('_', '-')}" for name in missing)
            raise InputError(f"{path}: does not state its {', '.join(missing)}: expected in {file}, or as {options}")
        return tuple(getattr(self, name) for name in names)


NOTHING = Assumed()


@dataclass(frozen=True, eq=False)
class Contents:
    """Content of a file or folder of light fields.

    Attributes
    ----------
    frames
        The light fields; in a recording, each is read on access.
    depth_mm
        True depth (v, u) of the central view of a single light field, from the pupil; None without one.
    depth_range_mm
        Nearest and farthest depth of the scene as stated by the file, or None.
    is_recording
        Whether the frames are a numbered stream, even of a single frame.
    times_s
        Times of the frames, or None.
    notes
        Notes on data that were read in a different order from the one that names and options state.
    """

    frames: Sequence[LightField]
    depth_mm: Depth | None = None
    depth_range_mm: tuple[float, float] | None = None
    is_recording: bool = False
    times_s: Sequence[float] | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Format:
    """A file format.

    Attributes
    ----------
    name
        Name of the format and of its module.
    ending
        Suffix of the names of its files, or of its folders if it has no dot.
    detect
        Whether a file or folder has this format, judged by name and folder contents.
    write
        Writer of a light field and, if supported, the depth of the central view.
    read
        Reader, given the assumed geometry; None for a write-only format.
    needs_grid
        Whether it can only hold views in rows and columns.
    has_points
        Whether it holds the points of the depth.
    """

    name: str
    ending: str
    detect: Callable[[Path], bool]
    write: Callable[[Path, LightField, KnownDepth | None], None]
    read: Callable[[Path, Assumed], Contents] | None
    needs_grid: bool = False
    has_points: bool = False

    @property
    def is_folder(self) -> bool:
        return "." not in self.ending


def single_reader(read: Callable[[Path, Assumed], LightField]) -> Callable[[Path, Assumed], Contents]:
    """Adapt the reader of a format with one light field and no depth."""
    return lambda path, assumed: Contents((read(path, assumed),))


def depthless_writer(
    write: Callable[[Path, LightField], None],
) -> Callable[[Path, LightField, KnownDepth | None], None]:
    """Adapt the writer of a format without depth."""
    return lambda path, light_field, depth: write(path, light_field)


class StoredFrames(Sequence[LightField]):
    """The light fields at a path, each read on access by its index.

    An index out of range raises IndexError, as for a list.
    """

    path: Path

    @overload
    def __getitem__(self, index: int) -> LightField: ...

    @overload
    def __getitem__(self, index: slice) -> list[LightField]: ...

    def __getitem__(self, index: int | slice) -> LightField | list[LightField]:
        if isinstance(index, slice):
            return [self._frame(i) for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"{self.path}: frame {index}, expected one of {len(self)}")
        return self._frame(index % len(self))

    @abstractmethod
    def _frame(self, index: int) -> LightField:
        """Read a frame by its index; raises InputError with a one-line message if it cannot be read."""
