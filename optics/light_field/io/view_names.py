"""Pictures of views by the numbers in their names: which two of them are the row and the column.

`NAME_ROW_COLUMN_Y_X_.png` has the place of the camera, too. Other names may have more numbers:
row and column are the two that take every combination once.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirrorcam.core.values import FloatArray, InputError

_NUMBER = r"(-?[0-9]{1,12}(?:\.[0-9]{1,20})?)"
_COUNT = r"([0-9]{1,9})"
# The shortest beginning counts: where numbers follow that could be a place, they are one.
PLACED = re.compile(rf"(?:.*?_)?{_COUNT}_{_COUNT}_{_NUMBER}_{_NUMBER}_?", re.DOTALL)
UNPLACED = re.compile(rf"(?:.*_)?{_COUNT}_{_COUNT}", re.DOTALL)
# No parts of longer numbers; the minus sign of a negative one stands after an underscore.
_WORD = re.compile(r"(?<![0-9])(?<!_-)[0-9]{1,9}(?![0-9])|(?<=_)-[0-9]{1,9}(?![0-9])")
_NO_WORD = -(10**10)
_MOST_WORDS = 8
"""Numbers of a name, counted from its end, that are looked at."""


@dataclass(frozen=True, eq=False)
class NamedViews:
    """Pictures row by row, the places (t, s, 2) of x and y that they name or None, and how many rows and columns."""

    files: tuple[Path, ...]
    places: FloatArray | None
    grid: tuple[int, int]


@dataclass(frozen=True)
class _Named:
    """What a name says of a picture: the numbers of its row and column, and its place (x, y) or None."""

    file: Path
    row: int
    col: int
    place: tuple[float, float] | None = None


def has_named_views(files: Sequence[Path]) -> bool:
    """Return whether pictures have names of views: as NAME_ROW_COLUMN, or with numbers that make a grid."""
    if any(PLACED.fullmatch(file.stem) or UNPLACED.fullmatch(file.stem) for file in files):
        return True
    return any(_is_plane(views) for views in _grids(files))


def named_views(folder: Path, files: Sequence[Path]) -> NamedViews:
    """The views of pictures of a folder.

    A grid of rows and columns goes before a single row, and places before none. Raises InputError in one line for names
    that make no grid.
    """
    placed = [
        _Named(file, int(match[1]), int(match[2]), (float(match[4]), float(match[3])))
        for file in files
        if (match := PLACED.fullmatch(file.stem))
    ]
    unplaced = [
        _Named(file, int(match[1]), int(match[2])) for file in files if (match := UNPLACED.fullmatch(file.stem))
    ]
    found, complaints = [], []
    for names in (placed, unplaced):
        views = _grid(names) if names else "has no pictures NAME_ROW_COLUMN_Y_X"
        if isinstance(views, str):
            complaints += [views] if names else []
        else:
            found.append(views)
    found += _grids(files)
    if not found:
        raise InputError(f"{folder}: {complaints[0] if complaints else 'has no pictures NAME_ROW_COLUMN_Y_X'}")
    planes = [views for views in found if _is_plane(views)]
    views = max(planes, key=lambda views: len(views.files)) if planes else found[0]
    if 2 * len(views.files) < len(files):
        raise InputError(
            f"{folder}: only {len(views.files)} of {len(files)} pictures make a grid by the numbers in their names, as "
            f"{views.files[0].name} does, expected NAME_ROW_COLUMN pictures of all views"
        )
    return views


def _is_plane(views: NamedViews) -> bool:
    """Whether views have several rows and several columns."""
    return min(views.grid) > 1


def _grids(files: Sequence[Path]) -> Iterator[NamedViews]:
    """Grids of several rows and columns that two numbers of the names make, those nearest to the end first."""
    words = [[int(word) for word in reversed(_WORD.findall(file.stem))][:_MOST_WORDS] for file in files]
    numbers = np.array([each + [_NO_WORD] * (_MOST_WORDS - len(each)) for each in words]).reshape(-1, _MOST_WORDS)
    for col in range(_MOST_WORDS):
        for row in range(col + 1, _MOST_WORDS):
            having = np.flatnonzero(numbers[:, row] > _NO_WORD)
            pairs = numbers[having][:, [row, col]]
            # Cheap for folders of many pictures: a grid has as many as its numbers span.
            if len(pairs) < 4 or np.prod(np.ptp(pairs, axis=0) + 1.0) != len(pairs):
                continue
            views = _grid([_Named(files[at], *pair) for at, pair in zip(having.tolist(), pairs.tolist(), strict=True)])
            if not isinstance(views, str) and _is_plane(views):
                yield views


def _grid(names: Sequence[_Named]) -> NamedViews | str:
    """Views at all rows and columns from the first, 0, 1 or a negative one, or why they are no grid."""
    numbers = np.array([(name.row, name.col) for name in names])
    first, last = (tuple(ends.tolist()) for ends in (numbers.min(axis=0), numbers.max(axis=0)))
    # Of numbers about a middle view, some are negative; where all are, the minus sign is a hyphen.
    if max(first) > 1 or any(begin < 0 and end <= 0 for begin, end in zip(first, last, strict=True)):
        return f"its first view is {first}, expected rows and columns from 0 or from 1"
    found: dict[tuple[int, int], _Named] = {}
    for name in names:
        index = name.row - first[0], name.col - first[1]
        if index in found:
            return f"{found[index].file.name} and {name.file.name} show the same view, expected one picture per view"
        found[index] = name
    rows, cols = (1 + max(index[axis] for index in found) for axis in (0, 1))
    if len(found) != rows * cols:
        missing = next((row, col) for row in range(rows) for col in range(cols) if (row, col) not in found)
        at = missing[0] + first[0], missing[1] + first[1]
        return f"lacks view {at}, expected NAME_ROW_COLUMN pictures of all {rows}x{cols}"
    order = [found[index] for index in np.ndindex(rows, cols)]
    places = [name.place for name in order if name.place is not None]
    return NamedViews(
        tuple(name.file for name in order),
        np.array(places).reshape(rows, cols, 2) if places else None,
        (rows, cols),
    )
