"""Assignment of pictures to views by the numbers in their names, verified by the pictures themselves.

`NAME_ROW_COLUMN_Y_X_.png` also holds the camera's position. Other names may have more numbers: row and column are the
two that take every combination once.

Numbers in names and options do not state whether the first number is the row, or whether rows run upwards or as a
snake. The pictures reveal it: along a row they move along x, along a column along y. A wrong order would give
meaningless depths, so every light field from a file that does not state its exact geometry is checked by `in_order`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.camera_array import central_view
from mirrorcam.optics.light_field.io.view_motion import ViewMotion, central_texture_repeats, measure_motion
from mirrorcam.optics.light_field.light_field import LightField

_MAX_ERROR, _CONTRADICTION = 0.35, 0.6
"""Maximum error of a motion, in steps, that an order explains, and minimum error that contradicts it."""
_ERROR_PER_STEP = 0.2
"""Additional tolerance, in steps, for each further step between two views: small steps are biased."""
_MIN_FRACTION = 0.75
"""Minimum fraction of the pairs of views that an order must explain."""
_MIN_COST_DIFFERENCE = 0.1
"""Minimum difference of mean errors for one order to be certainly better."""
_MIN_STEP = 0.2
"""Minimum ratio of the steps along the two axes."""
_EVEN_TOLERANCE = 1e-6
"""Maximum deviation from an even grid, in steps, that rounding explains."""
_NUMBER = r"(-?[0-9]{1,12}(?:\.[0-9]{1,20})?)"
_COUNT = r"([0-9]{1,9})"
# The shortest prefix matches: following numbers that could be a position are taken as one.
POSITIONED = re.compile(rf"(?:.*?_)?{_COUNT}_{_COUNT}_{_NUMBER}_{_NUMBER}_?", re.DOTALL)
UNPOSITIONED = re.compile(rf"(?:.*_)?{_COUNT}_{_COUNT}", re.DOTALL)
# As Blender's exporter of linusmossberg/light-field-renderer writes it: focal length and sensor width, mm, at the end.
_DECIMAL = r"(-?[0-9]{1,12}\.[0-9]{1,20})"
_LENS = r"([0-9]{1,6}(?:\.[0-9]{1,20})?)"
WITH_LENS = re.compile(rf"(?:.*?_)?{_COUNT}_{_COUNT}_{_DECIMAL}_{_DECIMAL}_{_LENS}_{_LENS}", re.DOTALL)
# Complete numbers only; a negative number's minus sign follows an underscore.
_WORD = re.compile(r"(?<![0-9])(?<!_-)[0-9]{1,9}(?![0-9])|(?<=_)-[0-9]{1,9}(?![0-9])")
_DIGITS = re.compile(r"[0-9]{1,18}")
_NO_WORD = -(10**10)
_MAX_WORDS = 8
"""Maximum count of numbers considered, from the end of a name."""


@dataclass(frozen=True, eq=False)
class _Order:
    """A possible order of pictures: name, rows and columns, and the column and row (n, 2) of each picture."""

    name: str
    grid: tuple[int, int]
    indices: FloatArray


@dataclass(frozen=True, eq=False)
class _Fit:
    """How an order explains the motion: px per step along x and y, displacements (n, 2), and errors (n,) in steps.

    Errors between views several steps apart have a larger tolerance.
    """

    steps_px: FloatArray
    displacement_px: FloatArray
    errors: FloatArray

    @classmethod
    def of(cls, motion: ViewMotion, indices: FloatArray) -> _Fit:
        """Fit the motion to grid indices (n, 2), x and y, of all views."""
        steps_between = indices[motion.pairs[:, 1]] - indices[motion.pairs[:, 0]]
        steps = np.full(2, np.nan)
        for axis in (0, 1):
            has_step = np.abs(steps_between[:, axis]) > 0.5
            if has_step.any():
                steps[axis] = np.median(motion.displacement_px[has_step, axis] / steps_between[has_step, axis])
        # For a single row or column, the other axis has no step.
        steps = np.where(np.isnan(steps), steps[::-1], steps)
        expected = steps_between * steps
        step_px = max(float(np.sqrt(np.mean(steps**2))), 1e-9)
        extra_steps = np.maximum(np.linalg.norm(expected, axis=1) / step_px - 1.0, 0.0)
        error = np.linalg.norm(motion.displacement_px - expected, axis=1) / step_px
        return cls(steps, expected, error / (1.0 + _ERROR_PER_STEP * extra_steps))

    @property
    def holds(self) -> bool:
        """Whether the order explains nearly all pairs."""
        smaller, larger = np.sort(np.abs(self.steps_px))
        return bool(np.mean(self.errors < _MAX_ERROR) >= _MIN_FRACTION and smaller > _MIN_STEP * larger)

    @property
    def cost(self) -> float:
        """Mean error of the pairs, each capped at one step."""
        return float(np.minimum(self.errors, 1.0).mean())

    @property
    def is_mirrored(self) -> bool:
        """Whether the picture's motions along rows and along columns have opposite directions."""
        return bool(self.steps_px[0] * self.steps_px[1] < 0)

    def beats(self, other: _Fit) -> bool:
        """Return whether this explains nearly all pairs for which the two differ, and the other less than half."""
        size = float(np.sqrt(np.mean(self.steps_px**2)))
        differ = np.linalg.norm(self.displacement_px - other.displacement_px, axis=1) > 0.5 * size
        if not self.holds or not differ.any():
            return False
        errors = [fit.errors[differ] * float(np.sqrt(np.mean(fit.steps_px**2))) / size for fit in (self, other)]
        return bool(np.mean(errors[0] < _MAX_ERROR) >= _MIN_FRACTION and np.median(errors[1]) > _CONTRADICTION)


def in_order(light_field: LightField, *, may_change: bool = True) -> tuple[LightField, str | None]:
    """Reorder views as their pictures show; also return a note on a change or doubt, or None.

    Views are reordered if exactly one other order explains the motion of the picture. Ambiguous pictures, such as those
    without texture, keep their order. Both orders for which the picture moves in the same direction along rows and
    columns are valid: one for a scene in front of the plane of zero disparity, the other for one behind it.

    Raises a one-line InputError for pictures that contradict their order, if the right one is uncertain or must not be
    adopted.
    """
    motion = measure_motion(light_field)
    if motion is None:
        return light_field, None
    indices, is_even = _given_indices(light_field)
    given = _Fit.of(motion, indices)
    if given.holds and not given.is_mirrored and (given.errors < _CONTRADICTION).all():
        return light_field, None
    grid = light_field.rows, light_field.cols
    orders = list(_orders(grid)) if is_even else [_Order("with x and y exchanged", grid, indices[:, ::-1])]
    fits = [(order, fit) for order in orders if (fit := _Fit.of(motion, order.indices)).beats(given)]
    fits.sort(key=lambda pair: pair[1].cost)
    likely = [(order, fit) for order, fit in fits if fit.cost < fits[0][1].cost + _MIN_COST_DIFFERENCE]
    upright = [order for order, fit in likely if not fit.is_mirrored]
    if may_change and len(likely) == len(upright) == 1 and is_even and upright[0].grid in (grid, grid[::-1]):
        return _rearrange(light_field, upright[0]), f"the pictures show that views are {upright[0].name}: reordered"
    expected = "expected row by row from the top left; rename or reorder the pictures"
    if upright:
        raise InputError(f"the pictures show that views are {upright[0].name}, {expected}")
    if given.holds and given.is_mirrored:
        if central_texture_repeats(light_field):
            return light_field, "rows may run upwards, or columns leftwards: the repeating texture is ambiguous"
        raise InputError(f"the pictures show that rows run upwards, or columns leftwards, {expected}")
    if fits:
        raise InputError(
            f"the pictures show that views are {fits[0][0].name}, and rows run upwards or columns leftwards, {expected}"
        )
    measured = _measured_indices(motion, grid) if is_even else None
    if measured is not None and _Fit.of(motion, measured).beats(given):
        wrong = int((np.abs(measured - indices).max(axis=1) > 0.5).sum())
        raise InputError(
            f"the pictures show {wrong} of {len(indices)} views at different positions in the grid, {expected}"
        )
    return light_field, None


def _given_indices(light_field: LightField) -> tuple[FloatArray, bool]:
    """Return the positions (n, 2) of views in steps, and whether they form an even grid of rows and columns."""
    rows, cols = light_field.rows, light_field.cols
    t, s = np.indices((rows, cols))
    index = np.stack([s, t], axis=-1).reshape(-1, 2).astype(np.float64)
    positions = light_field.positions_mm[..., :2].reshape(-1, 2)
    design = np.column_stack([index, np.ones(len(index))])
    fitted = np.linalg.lstsq(design, positions, rcond=None)[0]
    steps = np.diag(fitted[:2])
    step = float(np.abs(steps).max())
    is_even = bool(np.abs(design @ fitted - positions).max() < _EVEN_TOLERANCE * step and (steps >= 0).all())
    is_even &= bool(np.abs(fitted[[0, 1], [1, 0]]).max() < _EVEN_TOLERANCE * step)
    return (index, True) if is_even else (positions / max(_spacing(positions), 1e-9), False)


def _spacing(positions: FloatArray) -> float:
    """Return the median distance of positions (n, 2) to their nearest neighbours."""
    distances = np.linalg.norm(positions[:, None] - positions, axis=-1)
    np.fill_diagonal(distances, np.inf)
    return float(np.median(distances.min(axis=1)))


def _orders(grid: tuple[int, int]) -> Iterator[_Order]:
    """Yield orders other than row by row, for any number of rows; those with the given number of rows first."""
    count = grid[0] * grid[1]
    number = np.arange(count)
    shapes = [grid, grid[::-1], *((rows, count // rows) for rows in range(1, count + 1) if count % rows == 0)]
    for rows, cols in dict.fromkeys(shapes):
        if (rows, cols) != grid:
            line = "in one row" if rows == 1 else "in one column"
            name = f"row by row in {rows} rows of {cols}" if min(rows, cols) > 1 else line
            yield _Order(name, (rows, cols), _line_indices(number, cols))
        if min(rows, cols) > 1:
            columns = _line_indices(number, rows)[:, ::-1]
            yield _Order(f"column by column in {cols} columns of {rows}", (rows, cols), columns)
            snake = f"in a snake along {rows} rows of {cols}"
            yield _Order(snake, (rows, cols), _line_indices(number, cols, snake=True))
            snake = f"in a snake along {cols} columns of {rows}"
            yield _Order(snake, (rows, cols), _line_indices(number, rows, snake=True)[:, ::-1])


def _line_indices(number: NDArray[np.int_], length: int, *, snake: bool = False) -> FloatArray:
    """Return index in the line and line (n, 2) of numbers in lines of a length; a snake reverses every second line."""
    line, position = number // length, number % length
    return np.stack([np.where(snake & (line % 2 == 1), length - 1 - position, position), line], axis=1).astype(
        np.float64
    )


def _measured_indices(motion: ViewMotion, grid: tuple[int, int]) -> FloatArray | None:
    """Return column and row (n, 2) of each view from its measured position; None if the views are not connected."""
    count = grid[0] * grid[1]
    graph = np.zeros((len(motion.pairs), count))
    index = np.arange(len(motion.pairs))
    graph[index, motion.pairs[:, 0]], graph[index, motion.pairs[:, 1]] = -1.0, 1.0
    if np.linalg.matrix_rank(graph) < count - 1:
        return None
    positions = np.linalg.lstsq(graph, motion.displacement_px, rcond=None)[0]
    t, s = np.indices(grid)
    if float(np.sum(positions * np.stack([s, t], axis=-1).reshape(-1, 2))) < 0:
        positions = -positions  # the scene may be in front of or behind the plane of zero disparity
    indices = np.empty((count, 2))
    for column, members in enumerate(np.argsort(positions[:, 0], kind="stable").reshape(grid[1], grid[0])):
        indices[members[np.argsort(positions[members, 1], kind="stable")]] = [[column, row] for row in range(grid[0])]
    return indices


def _rearrange(light_field: LightField, order: _Order) -> LightField:
    """Move the views, given row by row, to the grid positions of an order, on an even grid with the same steps."""
    rows, cols = order.grid
    count = rows * cols
    source = np.empty(count, np.intp)
    source[(order.indices[:, 1] * cols + order.indices[:, 0]).astype(np.intp)] = np.arange(count)
    positions = light_field.positions_mm[..., :2].reshape(-1, 2)
    steps = np.ptp(positions, axis=0) / np.maximum([light_field.cols - 1, light_field.rows - 1], 1)
    steps = np.where(steps > 0, steps, steps[::-1])
    t, s = np.indices((rows, cols))
    central_row, central_col = central_view(rows, cols)
    positions_mm = np.stack([(s - central_col) * steps[0], (t - central_row) * steps[1], 0.0 * s], axis=-1)
    samples: Any = light_field.samples.reshape(count, *light_field.samples.shape[2:])[source]
    weights = light_field.weights.reshape(count, *light_field.weights.shape[2:])[source]
    return replace(
        light_field,
        positions_mm=positions_mm,
        samples=samples.reshape(rows, cols, *samples.shape[1:]),
        weights=weights.reshape(rows, cols, *weights.shape[1:]),
    )


@dataclass(frozen=True, eq=False)
class NamedViews:
    """Pictures row by row, their positions (t, s, 2), x and y, if named, and the numbers of rows and columns.

    `focal_widths` is the focal length as a fraction of the width of the picture, if named.
    """

    files: tuple[Path, ...]
    positions: FloatArray | None
    grid: tuple[int, int]
    focal_widths: float | None = None


@dataclass(frozen=True)
class _Named:
    """Row and column of a picture by its name, and its position (x, y) and lens if named."""

    file: Path
    row: int
    col: int
    position: tuple[float, float] | None = None
    focal_widths: float | None = None


def named_views(folder: Path, files: Sequence[Path], grid: tuple[int | None, int | None] = (None, None)) -> NamedViews:
    """Return the views among the pictures of a folder.

    A grid of rows and columns is preferred to a single row, and names with positions to names without. Given rows or
    columns (`grid`), names that form another grid or none are taken row by row in natural order, in which view10
    follows view9. Raises a one-line InputError for names that do not form a grid.
    """
    positioned = [_positioned(file) for file in files]
    unpositioned = [
        _Named(file, int(match[1]), int(match[2])) for file in files if (match := UNPOSITIONED.fullmatch(file.stem))
    ]
    grids, reasons = [], []
    for names in ([name for name in positioned if name is not None], unpositioned):
        views = _named_grid(names) if names else "has no pictures NAME_ROW_COLUMN_Y_X"
        if isinstance(views, str):
            reasons += [views] if names else []
        else:
            grids.append(views)
    grids += _named_grids(files)
    if any(grid):
        fitting = [views for views in grids if all(a in (None, b) for a, b in zip(grid, views.grid, strict=True))]
        grids = [views for views in fitting if 2 * len(views.files) >= len(files)] or [
            _in_natural_order(folder, files, grid)
        ]
    if not grids:
        raise InputError(
            f"{folder}: {reasons[0] if reasons else 'has no pictures NAME_ROW_COLUMN_Y_X'}; for pictures row by row in "
            "the order of their names, give rows or cols in views.toml, or --rows or --cols"
        )
    planes = [views for views in grids if _is_plane(views)]
    views = max(planes, key=lambda views: len(views.files)) if planes else grids[0]
    if 2 * len(views.files) < len(files) and not any(grid):
        raise InputError(
            f"{folder}: only {len(views.files)} of {len(files)} pictures form a grid by the numbers in their names, "
            f"such as {views.files[0].name}, expected NAME_ROW_COLUMN pictures of all views"
        )
    return views


def _positioned(file: Path) -> _Named | None:
    """Return a picture named with its position, with or without its lens."""
    if match := WITH_LENS.fullmatch(file.stem):
        width = float(match[6])
        return _Named(
            file,
            int(match[1]),
            int(match[2]),
            (float(match[4]), float(match[3])),
            float(match[5]) / width if width > 0 else None,
        )
    if match := POSITIONED.fullmatch(file.stem):
        return _Named(file, int(match[1]), int(match[2]), (float(match[4]), float(match[3])))
    return None


def _in_natural_order(folder: Path, files: Sequence[Path], grid: tuple[int | None, int | None]) -> NamedViews:
    """Return the pictures of a folder row by row in natural order.

    If there are more, those whose names differ only in their numbers are the views.
    """
    alike: dict[str, list[Path]] = {}
    for file in files:
        alike.setdefault(_DIGITS.sub("0", file.name.lower()), []).append(file)
    groups = sorted([list(files), *alike.values()], key=len, reverse=True)
    rows, cols = grid
    for group in groups:
        count = len(group)
        across = cols or (count // rows if rows and count % rows == 0 else 0)
        down = rows or (count // across if across and count % across == 0 else 0)
        if down * across == count > 0 and ((rows and cols) or group is max(alike.values(), key=len)):
            return NamedViews(tuple(sorted(group, key=_natural)), None, (down, across))
    expected = " and ".join(f"{number} {name}" for number, name in ((rows, "rows"), (cols, "columns")) if number)
    raise InputError(f"{folder}: {len(files)} pictures, of which none or several kinds form {expected} of views")


def _natural(file: Path) -> list[tuple[int, str]]:
    """Return a key that sorts numbers in names by value."""
    words = _DIGITS.split(file.name.lower())
    numbers = _DIGITS.findall(file.name.lower())
    key = [(-1, words[0])]
    for number, word in zip(numbers, words[1:], strict=True):
        key += [(int(number), ""), (-1, word)]
    return key


def _is_plane(views: NamedViews) -> bool:
    """Return whether views have several rows and several columns."""
    return min(views.grid) > 1


def _named_grids(files: Sequence[Path]) -> Iterator[NamedViews]:
    """Yield grids of several rows and columns formed by two numbers of the names, those nearest to the end first."""
    words = [[int(word) for word in reversed(_WORD.findall(file.stem))][:_MAX_WORDS] for file in files]
    numbers = np.array([row + [_NO_WORD] * (_MAX_WORDS - len(row)) for row in words]).reshape(-1, _MAX_WORDS)
    for col in range(_MAX_WORDS):
        for row in range(col + 1, _MAX_WORDS):
            named = np.flatnonzero(numbers[:, row] > _NO_WORD)
            pairs = numbers[named][:, [row, col]]
            # A quick test for folders of many pictures: a grid has as many pictures as its rows and columns.
            if len(pairs) < 4 or len(np.unique(pairs[:, 0])) * len(np.unique(pairs[:, 1])) != len(pairs):
                continue
            views = _named_grid(
                [_Named(files[index], *pair) for index, pair in zip(named.tolist(), pairs.tolist(), strict=True)]
            )
            if not isinstance(views, str) and _is_plane(views):
                yield views


def _named_grid(names: Sequence[_Named]) -> NamedViews | str:
    """Return views at evenly spaced rows and columns, or why they do not form a grid.

    Rows and columns count from any number, in any steps: a block of a larger grid, or every second view of it. Names
    with a lens have x right and y down: positions that run upwards or leftwards turn the grid around.
    """
    numbers = np.array([(name.row, name.col) for name in names])
    first, last = (tuple(ends.tolist()) for ends in (numbers.min(axis=0), numbers.max(axis=0)))
    # Numbers relative to a central view are partly negative; if all are, the minus sign is a hyphen.
    if any(begin < 0 and end <= 0 for begin, end in zip(first, last, strict=True)):
        return f"its first view is {first}, expected rows and columns from 0 or from 1"
    pictures: dict[tuple[int, int], _Named] = {}
    for name in names:
        if (name.row, name.col) in pictures:
            other = pictures[name.row, name.col].file.name
            return f"{other} and {name.file.name} show the same view, expected one picture per view"
        pictures[name.row, name.col] = name
    rows, cols = (np.unique(numbers[:, axis]).tolist() for axis in (0, 1))
    if len(pictures) != len(rows) * len(cols):
        missing = next((row, col) for row in rows for col in cols if (row, col) not in pictures)
        return f"lacks view {missing}, expected NAME_ROW_COLUMN pictures of all {len(rows)}x{len(cols)}"
    has_positions = all(name.position is not None for name in names)
    for axis, kept in (("rows", rows), ("columns", cols)):
        if not has_positions and len(set(np.diff(kept).tolist())) > 1:
            listed = ", ".join(map(str, kept[:8]))
            return f"{axis} {listed} are not evenly spaced, expected pictures of all {axis}"
    positions = None
    if has_positions:
        positions = np.array([pictures[row, col].position for row in rows for col in cols])
        positions = positions.reshape(len(rows), len(cols), 2)
    order = [[pictures[row, col] for col in cols] for row in rows]
    lenses = {name.focal_widths for name in names}
    focal_widths = lenses.pop() if len(lenses) == 1 else None
    if positions is not None and focal_widths is not None:
        if (positions[-1, :, 1] < positions[0, :, 1]).all():
            positions, order = positions[::-1], order[::-1]
        if (positions[:, -1, 0] < positions[:, 0, 0]).all():
            positions, order = positions[:, ::-1], [row[::-1] for row in order]
    files = tuple(name.file for row in order for name in row)
    return NamedViews(files, positions, (len(rows), len(cols)), focal_widths)
