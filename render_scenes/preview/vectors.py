"""Vectors as tuples of three floats, for loops in machine code, which so allocate nothing."""

from __future__ import annotations

from typing import Any

from mirrorcam.core.compiled import inlined


@inlined
def dot(a: Any, b: Any) -> Any:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def along(start: Any, length: Any, direction: Any) -> Any:
    """The point `start` + `length` * `direction`."""
    return (start[0] + length * direction[0], start[1] + length * direction[1], start[2] + length * direction[2])


@inlined
def minus(a: Any, b: Any) -> Any:
    """The difference a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@inlined
def times(a: Any, factor: Any) -> Any:
    """A vector times a number."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


@inlined
def at(table: Any, row: Any, column: Any) -> Any:
    """Three elements of a row of a table, from a column on. No slices are taken, whose counting of users costs time."""
    return (table[row, column], table[row, column + 1], table[row, column + 2])


@inlined
def mapped(table: Any, row: Any, column: Any, point: Any) -> Any:
    """A point by an affine map (3, 4), whose elements lie in a row of a table, row by row, from a column on."""
    x, y, z = point
    return (
        table[row, column] * x + table[row, column + 1] * y + table[row, column + 2] * z + table[row, column + 3],
        table[row, column + 4] * x + table[row, column + 5] * y + table[row, column + 6] * z + table[row, column + 7],
        table[row, column + 8] * x + table[row, column + 9] * y + table[row, column + 10] * z + table[row, column + 11],
    )


@inlined
def turned(table: Any, row: Any, column: Any, vector: Any) -> Any:
    """A vector by the linear part of such a map."""
    x, y, z = vector
    return (
        table[row, column] * x + table[row, column + 1] * y + table[row, column + 2] * z,
        table[row, column + 4] * x + table[row, column + 5] * y + table[row, column + 6] * z,
        table[row, column + 8] * x + table[row, column + 9] * y + table[row, column + 10] * z,
    )


@inlined
def turned_back(table: Any, row: Any, column: Any, vector: Any) -> Any:
    """A vector by the transposed linear part of such a map."""
    x, y, z = vector
    return (
        table[row, column] * x + table[row, column + 4] * y + table[row, column + 8] * z,
        table[row, column + 1] * x + table[row, column + 5] * y + table[row, column + 9] * z,
        table[row, column + 2] * x + table[row, column + 6] * y + table[row, column + 10] * z,
    )


@inlined
def cross(a: Any, b: Any) -> Any:
    """Vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@inlined
def unit(vector: Any) -> Any:
    """A vector of length 1."""
    return times(vector, 1.0 / dot(vector, vector) ** 0.5)
