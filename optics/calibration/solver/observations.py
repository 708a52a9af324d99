"""The observations of a calibration: corners of a board, by frame and by view."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray

DIRECT = -1
"""View index of corners observed without a mirror."""

IntArray = NDArray[np.int64]

MIN_CORNERS = 6
"""Minimum number of corners per view."""


def _unknown_sigma() -> FloatArray:
    return np.empty(0)


@dataclass(frozen=True)
class Corners:
    """Corners of one board in one picture.

    Attributes
    ----------
    ids
        Corner numbers on the board (n,).
    pixels
        Detected positions (n, 2).
    sigma_px
        Standard deviations of the pixels (n,), per axis, up to a common factor. Default: equal, 1.
    """

    ids: IntArray
    pixels: FloatArray
    sigma_px: FloatArray = field(default_factory=_unknown_sigma)

    def __post_init__(self) -> None:
        if self.sigma_px.size == 0:
            object.__setattr__(self, "sigma_px", np.ones(len(self.ids)))

    @classmethod
    def empty(cls) -> Self:
        """Return an empty set of corners."""
        return cls(np.empty(0, dtype=np.int64), np.empty((0, 2)))

    def __len__(self) -> int:
        return len(self.ids)

    def where(self, mask: NDArray[np.bool_]) -> Self:
        """Select the corners of a boolean mask (n,)."""
        return type(self)(self.ids[mask], self.pixels[mask], self.sigma_px[mask])


@dataclass(frozen=True)
class Observations:
    """Observed corners, one row each, sorted by frame.

    Attributes
    ----------
    frame
        Frame numbers (n,).
    view
        Mirror indices (n,), or DIRECT.
    corner
        Corner numbers on the board (n,).
    pixels
        Detected positions (n, 2).
    sigma_px
        Standard deviations of the pixels (n,), per axis, up to a factor common to all rows. Default: equal, 1.

    Raises
    ------
    ValueError
        If shapes do not match, a pixel is not finite, a standard deviation is not positive, or rows are not sorted by
        frame.
    """

    frame: IntArray
    view: IntArray
    corner: IntArray
    pixels: FloatArray
    sigma_px: FloatArray = field(default_factory=_unknown_sigma)

    def __post_init__(self) -> None:
        rows = len(self.frame)
        if self.sigma_px.size == 0:
            object.__setattr__(self, "sigma_px", np.ones(rows))
        for name in (column.name for column in fields(self)):
            array = np.array(getattr(self, name), dtype=np.float64 if name in {"pixels", "sigma_px"} else np.int64)
            expected = (rows, 2) if name == "pixels" else (rows,)
            if array.shape != expected:
                raise ValueError(f"{name} has shape {array.shape}, expected {expected}")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if not np.isfinite(self.pixels).all():
            raise ValueError("pixels hold a value that is NaN or infinite, expected finite numbers")
        if not (np.isfinite(self.sigma_px) & (self.sigma_px > 0.0)).all():
            raise ValueError("sigma_px holds a value that is not positive and finite")
        if (np.diff(self.frame) < 0).any():
            raise ValueError("observations are not sorted by frame")

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def direct_and_mirrored(self) -> bool:
        """Whether any frame shows its board both directly and in a mirror; otherwise, direct frames are separate."""
        direct = self.view == DIRECT
        return bool(np.isin(self.frame[direct], self.frame[~direct]).any())

    @classmethod
    def empty(cls) -> Self:
        """Return observations without rows."""
        empty = np.empty(0, dtype=np.int64)
        return cls(empty, empty, empty, np.empty((0, 2)))

    @classmethod
    def of_view(
        cls, frame: int, view: int, corner: IntArray, pixels: FloatArray, sigma_px: FloatArray | None = None
    ) -> Self:
        """Build the rows of corners (n,) of one view in one frame, at pixels (n, 2) with standard deviations (n,)."""
        sigmas = np.ones(len(corner)) if sigma_px is None else sigma_px
        return cls(np.full(len(corner), frame), np.full(len(corner), view), corner, pixels, sigmas)

    @classmethod
    def join(cls, parts: list[Self]) -> Self:
        """Join the rows of several observations, sorted by frame (stable)."""
        if not parts:
            return cls.empty()
        frame = np.concatenate([part.frame for part in parts])
        order = np.argsort(frame, kind="stable")
        return cls(
            frame[order],
            np.concatenate([part.view for part in parts])[order],
            np.concatenate([part.corner for part in parts])[order],
            np.concatenate([part.pixels for part in parts])[order],
            np.concatenate([part.sigma_px for part in parts])[order],
        )

    def where(self, mask: NDArray[np.bool_]) -> Self:
        """Select the rows of a boolean mask (n,)."""
        return type(self)(self.frame[mask], self.view[mask], self.corner[mask], self.pixels[mask], self.sigma_px[mask])

    def with_frame_offset(self, frames: int) -> Self:
        """Add `frames` to each frame number."""
        return replace(self, frame=self.frame + frames)

    def renumbered(self) -> Self:
        """Renumber the frames from 0 without gaps."""
        _, frame = np.unique(self.frame, return_inverse=True)
        return replace(self, frame=frame)

    @property
    def has_sigmas(self) -> bool:
        """Whether any standard deviation differs from the default."""
        return bool((self.sigma_px != 1.0).any())

    def standardised(self, residuals_px: FloatArray) -> FloatArray:
        """Divide residuals (n, 2) by the standard deviations of their pixels."""
        return residuals_px / self.sigma_px[:, None]
