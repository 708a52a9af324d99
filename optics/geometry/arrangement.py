"""The arrangement of a layout's views: a rectangular grid, or another pattern of positions."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from mirrorcam.core.bounds import Bounds
from mirrorcam.core.errors import InputError
from mirrorcam.core.names import Name
from mirrorcam.core.values import FloatArray, Shaped, Value

MAX_VIEWS = 144
RINGS = Bounds(1, 6)
"""Rings of views around the centre of a hexagonal pattern."""
RING_VIEWS = Bounds(3, MAX_VIEWS)
MIN_SEPARATION = 1e-3
"""Smallest distance between two positions of a pattern, relative to its size."""
DISTANCE_TOLERANCE = 1e-6
"""Difference, in steps, up to which two distances count as equal."""
MAX_NEIGHBOUR_STEPS = 1.2
"""Largest distance between neighbours, in steps."""


class Pattern(Value):
    """Positions of views that do not form a rectangular grid, in any unit: only their shape matters.

    Designs keep the shape, but scale it independently along x and y, as with the two spacings of a grid.

    Attributes
    ----------
    name : str
        Name for display.
    positions : ndarray
        Positions (n, 2) of the views in view axes: x right, y down. Mirrors are listed in this order.
    """

    name: Name = Field(default="pattern", min_length=1)
    positions: Annotated[FloatArray, Shaped((None, 2), largest=1e6)]

    @model_validator(mode="after")
    def _check(self) -> Self:
        count = len(self.positions)
        if not 2 <= count <= MAX_VIEWS:
            raise ValueError(f"pattern {self.name} has {count} positions, expected 2 to {MAX_VIEWS}")
        distances = _distances(self.positions)
        i, j = np.unravel_index(int(distances.argmin()), distances.shape)
        if distances[i, j] <= MIN_SEPARATION * np.ptp(self.positions, axis=0).max():
            raise ValueError(f"pattern {self.name} has coincident positions {i} and {j}, expected distinct ones")
        return self

    @classmethod
    def hexagonal(cls, rings: int) -> Self:
        """Hexagonal rings around a centre, row by row: 7 views with one ring, 19 with two."""
        rows = range(-rings, rings + 1)
        positions = [
            (column - (2 * rings - abs(row)) / 2.0, row * np.sqrt(0.75))
            for row in rows
            for column in range(2 * rings + 1 - abs(row))
        ]
        return cls(name=f"hex{len(positions)}", positions=np.array(positions))

    @classmethod
    def ring(cls, count: int) -> Self:
        """Views evenly spaced on a circle, clockwise from the top."""
        angle = 2.0 * np.pi * np.arange(count) / count
        return cls(name=f"ring{count}", positions=np.column_stack([np.sin(angle), -np.cos(angle)]).round(15) + 0.0)

    @classmethod
    def named(cls, name: str) -> Self | None:
        """The pattern with a name like hex7 or ring8; None for any other name.

        Raises InputError for a number of views that the pattern cannot have.
        """
        match = re.fullmatch(r"(hex|ring)(\d{1,6})", name)
        if match is None:
            return None
        count = int(match[2])
        if match[1] == "ring":
            if not RING_VIEWS.min <= count <= RING_VIEWS.max:
                raise InputError(f"pattern {name}: expected a ring of {RING_VIEWS} views")
            return cls.ring(count)
        sizes = {1 + 3 * rings * (rings + 1): rings for rings in range(int(RINGS.min), int(RINGS.max) + 1)}
        if count not in sizes:
            raise InputError(f"pattern {name}: expected hex with one of {', '.join(map(str, sizes))} views")
        return cls.hexagonal(sizes[count])


def _distances(positions: FloatArray) -> FloatArray:
    """Distances (n, n) between positions (n, 2); infinite on the diagonal."""
    distances = np.linalg.norm(positions[:, None] - positions, axis=-1)
    np.fill_diagonal(distances, np.inf)
    return distances


@dataclass(frozen=True)
class Arrangement:
    """Order and positions of views: a grid of `rows` x `cols` or, with a pattern, a single row of its views."""

    rows: int
    cols: int
    pattern: Pattern | None = None

    def __post_init__(self) -> None:
        if self.pattern is not None and (self.rows, self.cols) != (1, len(self.pattern.positions)):
            raise ValueError(
                f"{self.rows} x {self.cols} mirrors, expected 1 x {len(self.pattern.positions)} of pattern "
                f"{self.pattern.name}"
            )

    @property
    def text(self) -> str:
        """Name for display: "3 x 3" or "hex7"."""
        return f"{self.rows} x {self.cols}" if self.pattern is None else self.pattern.name

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each mirror for display: row and column ("0-2") in a grid, else its number ("2")."""
        if self.pattern is None:
            return tuple(f"{t}-{s}" for t in range(self.rows) for s in range(self.cols))
        return tuple(str(number) for number in range(self.cols))

    @cached_property
    def steps(self) -> FloatArray:
        """Positions (n, 2) of the views about their mean: x right, y down, in steps.

        A step is the mean distance to the nearest view: adjacent views of a grid are 1 apart.
        """
        if self.pattern is None:
            x = np.tile(np.arange(self.cols) - (self.cols - 1) / 2.0, self.rows)
            y = np.repeat(np.arange(self.rows) - (self.rows - 1) / 2.0, self.cols)
            return np.column_stack([x, y])
        centred = self.pattern.positions - self.pattern.positions.mean(axis=0)
        return np.asarray((centred / _distances(centred).min(axis=1).mean()).round(12) + 0.0)

    @property
    def neighbours(self) -> list[tuple[int, int]]:
        """Pairs of views that lie about one step apart: horizontal and vertical neighbours in a grid."""
        near = np.triu(_distances(self.steps) <= MAX_NEIGHBOUR_STEPS)
        return [(int(i), int(j)) for i, j in np.argwhere(near)]

    @cached_property
    def extent(self) -> FloatArray:
        """Size (2,) of the arrangement along x and y, in steps."""
        return np.asarray(np.ptp(self.steps, axis=0))

    @property
    def central_index(self) -> int:
        """Index of the mirror nearest to the centre; of several, the last in a grid, the first in a pattern."""
        if self.pattern is None:
            return (self.rows // 2) * self.cols + self.cols // 2
        return self._innermost[0]

    @property
    def _innermost(self) -> list[int]:
        from_centre = np.hypot(*self.steps.T)
        return [int(index) for index in np.flatnonzero(from_centre <= from_centre.min() + DISTANCE_TOLERANCE)]

    @property
    def inner(self) -> list[int]:
        """Indices of the mirrors nearest to the centre; all mirrors if their mean is not the centre."""
        nearest = self._innermost
        balanced = np.abs(self.steps[nearest].mean(axis=0)).max() <= DISTANCE_TOLERANCE
        return nearest if balanced else list(range(len(self.steps)))

    def fitted(self, centres: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fit the arrangement to virtual centres (..., n, 3), in view axes, by least squares.

        The fitted positions lie in a plane normal to the view axis. Their origin and the two spacings along
        x and y are fitted.

        Returns
        -------
        tuple of ndarray
            Positions (..., n, 3) and spacings (..., 2) of one step along x and y; 0 along an axis without steps.
        """
        mean = centres.mean(axis=-2, keepdims=True)
        positions = np.broadcast_to(mean, centres.shape).copy()
        spacings = np.zeros((*centres.shape[:-2], 2))
        for axis, steps in enumerate(self.steps.T):
            if steps.any():
                # Sum line by line: then all lines of a grid have a weight of exactly 1.
                lines, members, counts = np.unique(steps, return_inverse=True, return_counts=True)
                line_means = np.stack(
                    [centres[..., members == line, axis].mean(axis=-1) for line in range(len(lines))], axis=-1
                )
                weighted = lines * (counts / counts.max())
                spacings[..., axis] = line_means @ weighted / (weighted @ lines)
                positions[..., axis] += spacings[..., axis, None] * steps
        return positions, spacings
