"""File formats of light fields, which `formats.registry` collects, and sequences of light fields read one by one."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import overload

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.bounds import FOCAL_PX, GRID, LENGTH_MM
from mirrorcam.core.disk.files import read_model
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import DepthOrInf, Value
from mirrorcam.optics.light_field.light_field import LightField

Depth = NDArray[np.float32]


def views_toml(path: Path) -> Path:
    """The file with the geometry that a light field lacks: `views.toml` in a folder, `NAME.views.toml` for a file."""
    return path / "views.toml" if path.is_dir() else path.with_name(f"{path.stem}.views.toml")


class Assumed(Value):
    """Geometry for files that do not state it; what a file states takes precedence.

    Attributes
    ----------
    rows, cols
        Number of views down and across.
    step_mm
        Distance of neighbouring views.
    focal_px
        Focal length of the views.
    reference_depth_mm
        Distance of the plane of zero disparity from the views.
    """

    rows: int | None = GRID.field(None)
    cols: int | None = GRID.field(None)
    step_mm: float | None = LENGTH_MM.field(None)
    focal_px: float | None = FOCAL_PX.field(None)
    reference_depth_mm: DepthOrInf | None = None

    def completed(self, path: Path) -> Assumed:
        """The same with what is None taken from the `views_toml` of a light field, where there is one.

        Raises InputError in one line for a file that is no such TOML.
        """
        file = views_toml(path)
        return read_model(Assumed, file).replaced(**self.model_dump(exclude_none=True)) if file.exists() else self

    def need(self, path: Path, *names: str) -> tuple[float, ...]:
        """The values of names; raises InputError for a light field at `path` where one is not known."""
        missing = [name for name in names if getattr(self, name) is None]
        if missing:
            file = views_toml(path).relative_to(path.parent)
            raise InputError(f"{path}: does not state its {', '.join(missing)}: expected in {file}")
        return tuple(getattr(self, name) for name in names)


NOTHING = Assumed()


@dataclass(frozen=True, eq=False)
class Contents:
    """Content of a file or folder of light fields.

    Attributes
    ----------
    frames
        The light fields; of a recording, each is read when it is asked for.
    depth_mm
        True depth (v, u) of the central view of a single light field, from the pupil; None without one.
    depth_range_mm
        Nearest and farthest depth that the file states of its scene; None without them.
    is_recording
        Whether the frames are numbered ones of a stream, even where there is only one.
    times_s
        Times of the frames; None without them.
    notes
        Lines about what was read in another order than names and options state.
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
        Text that names of its files, or of its folders where there is no point in it, end with.
    detect
        Whether a file or folder is in this format, by its name and by what a folder holds.
    write
        Writer of a light field and, in formats that have it, the depth (v, u) of the central view.
    read
        Reader, given what is assumed of the geometry; None for a format that is only written.
    needs_grid
        Whether it holds rows and columns of views only.
    """

    name: str
    ending: str
    detect: Callable[[Path], bool]
    write: Callable[[Path, LightField, Depth | None], None]
    read: Callable[[Path, Assumed], Contents] | None
    needs_grid: bool = False

    @property
    def is_folder(self) -> bool:
        return "." not in self.ending


def single(read: Callable[[Path, Assumed], LightField]) -> Callable[[Path, Assumed], Contents]:
    """The reader of a format whose files hold one light field and no depth."""
    return lambda path, assumed: Contents((read(path, assumed),))


def without_depth(write: Callable[[Path, LightField], None]) -> Callable[[Path, LightField, Depth | None], None]:
    """The writer of a format that has no place for a depth."""
    return lambda path, light_field, depth_mm: write(path, light_field)


class StoredFrames(Sequence[LightField]):
    """The light fields at a path; a format says how many there are, and reads one by its number.

    A frame that there is not raises IndexError, as in a list.
    """

    path: Path

    @overload
    def __getitem__(self, index: int) -> LightField: ...

    @overload
    def __getitem__(self, index: slice) -> list[LightField]: ...

    def __getitem__(self, index: int | slice) -> LightField | list[LightField]:
        if isinstance(index, slice):
            return [self._frame(each) for each in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"{self.path}: frame {index}, expected one of {len(self)}")
        return self._frame(index % len(self))

    @abstractmethod
    def _frame(self, number: int) -> LightField:
        """Read the frame of a number from 0; raises InputError in one line where it cannot be read."""
