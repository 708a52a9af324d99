"""The observations of a calibration: corners of a target, by frame and by view."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.values import FloatArray

DIRECT = -1
"""The view index of corners that the camera sees without a mirror."""

IntArray = NDArray[np.int64]


MIN_CORNERS = 6


@dataclass(frozen=True)
class Corners:
    """Corners of one target in one image: ids on the target (n,) and pixels (n, 2)."""

    ids: IntArray
    pixels: FloatArray

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True)
class Observations:
    """Observed corners, one row each, sorted by frame.

    Attributes
    ----------
    frame
        Frame number (n,).
    view
        Mirror index (n,), or DIRECT.
    corner
        Id on the target (n,).
    pixels
        Where the corner was found (n, 2).

    Raises
    ------
    ValueError
        Where shapes do not match, a pixel is not finite, or rows are not sorted by frame.
    """

    frame: IntArray
    view: IntArray
    corner: IntArray
    pixels: FloatArray

    def __post_init__(self) -> None:
        rows = len(self.frame)
        for field in fields(self):
            array = np.array(getattr(self, field.name), dtype=np.float64 if field.name == "pixels" else np.int64)
            expected = (rows, 2) if field.name == "pixels" else (rows,)
            if array.shape != expected:
                raise ValueError(f"{field.name} has shape {array.shape}, expected {expected}")
            array.flags.writeable = False
            object.__setattr__(self, field.name, array)
        if not np.isfinite(self.pixels).all():
            raise ValueError("pixels hold a value that is NaN or infinite, expected finite numbers")
        if (np.diff(self.frame) < 0).any():
            raise ValueError("observations are not sorted by frame")

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def both_ways(self) -> bool:
        """Whether a frame shows its board both directly and in a mirror; else frames without mirrors are separate."""
        direct = self.view == DIRECT
        return bool(np.isin(self.frame[direct], self.frame[~direct]).any())

    @classmethod
    def none(cls) -> Self:
        """No rows."""
        empty = np.empty(0, dtype=np.int64)
        return cls(empty, empty, empty, np.empty((0, 2)))

    @classmethod
    def of_view(cls, frame: int, view: int, corner: IntArray, pixels: FloatArray) -> Self:
        """The corners (n,) of one view in one frame at pixels (n, 2)."""
        return cls(np.full(len(corner), frame), np.full(len(corner), view), corner, pixels)

    @classmethod
    def join(cls, parts: list[Self]) -> Self:
        """All rows of several observations, sorted by frame (stable)."""
        if not parts:
            return cls.none()
        frame = np.concatenate([part.frame for part in parts])
        order = np.argsort(frame, kind="stable")
        return cls(
            frame[order],
            np.concatenate([part.view for part in parts])[order],
            np.concatenate([part.corner for part in parts])[order],
            np.concatenate([part.pixels for part in parts])[order],
        )

    def where(self, mask: NDArray[np.bool_]) -> Self:
        """The rows of a boolean mask (n,)."""
        return type(self)(self.frame[mask], self.view[mask], self.corner[mask], self.pixels[mask])

    def shifted(self, frames: int) -> Self:
        """The same rows with `frames` added to each frame number."""
        return type(self)(self.frame + frames, self.view, self.corner, self.pixels)
