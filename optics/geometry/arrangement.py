"""How the views of a layout are arranged: as a rectangular grid, or in another pattern of positions."""

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

MOST_VIEWS = 144
RINGS = Bounds(1, 6)
"""Rings of views round the middle of a hexagonal pattern."""
RING_VIEWS = Bounds(3, MOST_VIEWS)
CLOSEST = 1e-3
"""Smallest distance of two positions of a pattern, relative to its size."""
SAME_DISTANCE = 1e-6
NEIGHBOURS = 1.2
"""Distance of neighbours, in steps, at most."""


class Pattern(Value):
    """Positions of views that are no rectangular grid, in any unit: only their shape matters.

    Designs keep the shape but for one factor each across and down, as the two spacings of a grid.

    Attributes
    ----------
    name : str
        Name for people.
    positions : ndarray
        Positions (n, 2) of the views: x right, y down, as the views look. Mirrors are listed in this order.
    """

    name: Name = Field(default="pattern", min_length=1)
    positions: Annotated[FloatArray, Shaped((None, 2), largest=1e6)]

    @model_validator(mode="after")
    def _check(self) -> Self:
        count = len(self.positions)
        if not 2 <= count <= MOST_VIEWS:
            raise ValueError(f"pattern {self.name} has {count} positions, expected 2 to {MOST_VIEWS}")
        apart = _distances(self.positions)
        i, j = np.unravel_index(int(apart.argmin()), apart.shape)
        if apart[i, j] <= CLOSEST * np.ptp(self.positions, axis=0).max():
            raise ValueError(f"pattern {self.name} has positions {i} and {j} at one place, expected them apart")
        return self

    @classmethod
    def hexagonal(cls, rings: int) -> Self:
        """Rings of hexagons round a middle, row by row: 7 views with one ring, 19 with two."""
        rows = range(-rings, rings + 1)
        places = [
            (column - (2 * rings - abs(row)) / 2.0, row * np.sqrt(0.75))
            for row in rows
            for column in range(2 * rings + 1 - abs(row))
        ]
        return cls(name=f"hex{len(places)}", positions=np.array(places))

    @classmethod
    def ring(cls, count: int) -> Self:
        """Views evenly on a circle, clockwise from the highest."""
        angle = 2.0 * np.pi * np.arange(count) / count
        return cls(name=f"ring{count}", positions=np.column_stack([np.sin(angle), -np.cos(angle)]).round(15) + 0.0)

    @classmethod
    def named(cls, name: str) -> Self | None:
        """The pattern that a name like hex7 or ring8 stands for; None where it is of neither form.

        Raises InputError for a count that such a pattern cannot have.
        """
        found = re.fullmatch(r"(hex|ring)(\d{1,6})", name)
        if found is None:
            return None
        count = int(found[2])
        if found[1] == "ring":
            if not RING_VIEWS.least <= count <= RING_VIEWS.most:
                raise InputError(f"pattern {name}: expected a ring of {RING_VIEWS} views")
            return cls.ring(count)
        sizes = {1 + 3 * rings * (rings + 1): rings for rings in range(int(RINGS.least), int(RINGS.most) + 1)}
        if count not in sizes:
            raise InputError(f"pattern {name}: expected hex with one of {', '.join(map(str, sizes))} views")
        return cls.hexagonal(sizes[count])


def _distances(positions: FloatArray) -> FloatArray:
    """Distances (n, n) between positions (n, 2), infinite of each to itself."""
    apart = np.linalg.norm(positions[:, None] - positions, axis=-1)
    np.fill_diagonal(apart, np.inf)
    return apart


@dataclass(frozen=True)
class Arrangement:
    """The order and the places of views: `rows` x `cols` of a grid or, with a pattern, one row of its views."""

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
        """What people call it: "3 x 3" or "hex7"."""
        return f"{self.rows} x {self.cols}" if self.pattern is None else self.pattern.name

    @property
    def names(self) -> tuple[str, ...]:
        """What people call each mirror: by row and column, "0-2", in a grid, else by its number, "2"."""
        if self.pattern is None:
            return tuple(f"{t}-{s}" for t in range(self.rows) for s in range(self.cols))
        return tuple(str(number) for number in range(self.cols))

    @cached_property
    def steps(self) -> FloatArray:
        """Places (n, 2) of the views from the middle of all: x right, y down, in mean distances to the nearest other.

        Those of a grid are 1 apart along its rows and columns.
        """
        if self.pattern is None:
            across = np.tile(np.arange(self.cols) - (self.cols - 1) / 2.0, self.rows)
            down = np.repeat(np.arange(self.rows) - (self.rows - 1) / 2.0, self.cols)
            return np.column_stack([across, down])
        places = self.pattern.positions - self.pattern.positions.mean(axis=0)
        return np.asarray((places / _distances(places).min(axis=1).mean()).round(12) + 0.0)

    @property
    def neighbours(self) -> list[tuple[int, int]]:
        """Pairs of views that lie one step apart, or nearly: those beside and above each other in a grid."""
        near = np.triu(_distances(self.steps) <= NEIGHBOURS)
        return [(int(i), int(j)) for i, j in np.argwhere(near)]

    @cached_property
    def extent(self) -> FloatArray:
        """Size (2,) of the whole, in steps across and down."""
        return np.asarray(np.ptp(self.steps, axis=0))

    @property
    def central_index(self) -> int:
        """Index of the central mirror: in a grid of even count the one after the centre, of equals the first."""
        if self.pattern is None:
            return (self.rows // 2) * self.cols + self.cols // 2
        return self._innermost[0]

    @property
    def _innermost(self) -> list[int]:
        from_middle = np.hypot(*self.steps.T)
        return [int(index) for index in np.flatnonzero(from_middle <= from_middle.min() + SAME_DISTANCE)]

    @property
    def inner(self) -> list[int]:
        """Indices of the mirrors nearest to the middle of all; all of them where those do not balance about it."""
        nearest = self._innermost
        balanced = np.abs(self.steps[nearest].mean(axis=0)).max() <= SAME_DISTANCE
        return nearest if balanced else list(range(len(self.steps)))

    def fitted(self, centres: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The places nearest to virtual centres (..., n, 3), view axes, that keep the arrangement, and its spacings.

        They lie across the views; their origin and one spacing along x and one along y are those of least squares.

        Returns
        -------
        tuple of ndarray
            Places (..., n, 3) and spacings (..., 2) of one step along x and y, 0 along an axis that has no steps.
        """
        middle = centres.mean(axis=-2, keepdims=True)
        places = np.broadcast_to(middle, centres.shape).copy()
        spacings = np.zeros((*centres.shape[:-2], 2))
        for axis, steps in enumerate(self.steps.T):
            if steps.any():
                # Line by line, so that a grid's lines weigh exactly 1.
                lines, members, counts = np.unique(steps, return_inverse=True, return_counts=True)
                along = np.stack(
                    [centres[..., members == line, axis].mean(axis=-1) for line in range(len(lines))], axis=-1
                )
                weighted = lines * (counts / counts.max())
                spacings[..., axis] = along @ weighted / (weighted @ lines)
                places[..., axis] += spacings[..., axis, None] * steps
        return places, spacings
