"""Light fields of a recording as a sequence that reads each from disk when it is asked for."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import overload

from mirrorcam.optics.light_field.light_field import LightField


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
