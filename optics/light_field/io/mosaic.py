"""All views in one picture, for the formats `eslf` and `tiles`; weights are opacity, the geometry is in NAME.json.

Neither the picture nor its name states the number of views, nor always whether they are arranged side by side (tiles)
or as small pictures of the aperture at every pixel (lenslets, ESLF). The pixels reveal it: adjacent tiles are similar
with a seam between them, and lenslets have edges.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.io.light_field_format import NOTHING, Assumed, views_toml
from mirrorcam.optics.light_field.io.view_images import Bytes, light_field_of, read_rgba, rgb, weight_bytes, write_rgba
from mirrorcam.optics.light_field.io.view_motion import texture_repeats
from mirrorcam.optics.light_field.io.views_file import even_views, read_views, write_views
from mirrorcam.optics.light_field.light_field import LightField

Order = Literal["eslf", "tiles"]
Grid = tuple[int, int]
Grey = NDArray[np.float32]
AXES: dict[str, tuple[int, int, int, int]] = {"eslf": (2, 0, 3, 1), "tiles": (0, 2, 1, 3)}
"""Axes t, s, v, u of a picture, from slowest to fastest: rows, then columns."""
_SIDE_PX = 32
"""Side of the views for comparison; the middle half of a view is located in its neighbour."""
_PAIRS = 6
"""Number of adjacent pairs to compare along each axis."""
_SIMILAR, _DISSIMILAR = 0.85, 0.75
"""Correlations above which neighbours are views of one scene, and below which they are not."""
_SEAM, _NO_SEAM = 2.0, 1.5
"""Gradients at tile borders, relative to elsewhere, above which there is a seam, and below which there is none."""
_WEAK_SEAM = 0.5
"""Maximum gradient at borders without a seam, relative to borders with one."""
_LENS, _CERTAIN = 1.15, 1.5
"""Gradients at edges, relative to the inside, above which these may be lenslets, and are certainly not JPEG blocks."""
_WEAK_LENS = 0.9
"""Maximum gradient at the edges of a wrong lenslet size, relative to the right one."""
_NOISE = 0.5
"""Difference of adjacent pixels, relative to the standard deviation of all, above which a picture is noise."""
_BLOCK_PX = 8
_STRUCTURE = 0.7
"""Correlation of adjacent pixels of a reduced view above which it is not just noise."""
_MAX_VIEWS, _MIN_VIEW_PX = 32, 8
_LIKELY_VIEW_PX = 24
"""Minimum side of views in a suggested grid: smaller similar parts belong to a texture."""


def write_mosaic(path: Path, light_field: LightField, order: Order) -> None:
    """Write all views as one PNG."""
    rows, cols, height, width = light_field.weights.shape
    axes, size = AXES[order], (rows * height, cols * width)
    colours = rgb(light_field.samples).transpose(*axes, 4).reshape(*size, 3)
    opacity = weight_bytes(light_field.weights).transpose(axes).reshape(size)
    write_rgba(path, colours, None if light_field.weights.min() == 1.0 else opacity)
    channels = light_field.samples.shape[-1]
    write_views(path.with_suffix(".json"), light_field, order=order, channels=channels)


def read_mosaic(path: Path, order: Order, assumed: Assumed = NOTHING) -> LightField:
    """Read the light field of a picture of all views; NAME.json takes precedence over `order` and `assumed`.

    Raises a one-line InputError if the geometry is unknown, the picture does not divide into the views, or its pixels
    contradict the division.
    """
    colours, opacity = read_rgba(path)
    stated = read_views(path.with_suffix(".json"))
    stated_order: object = order
    if stated is not None:
        grid, stated_order = (stated[0].rows, stated[0].cols), stated[1].order
    elif assumed.rows is None or assumed.cols is None:
        raise InputError(
            f"{path}: no {path.stem}.json next to the picture: give --layout of the camera that took the frame, or "
            f"rows and cols of the views in {views_toml(path).name}"
        )
    else:
        grid = (assumed.rows, assumed.cols)
    if stated_order not in AXES:
        raise InputError(f"{path.with_suffix('.json')}: order is {stated_order!r}, expected 'eslf' or 'tiles'")
    height, width = (side // count for side, count in zip(opacity.shape, grid, strict=True))
    shape = (*grid, height, width)
    if (grid[0] * height, grid[1] * width) != opacity.shape or not height * width:
        raise InputError(
            f"{path}: {opacity.shape[1]}x{opacity.shape[0]} px do not divide into {grid[1]}x{grid[0]} views"
        )
    if stated is None:
        check_division(colours, grid, order)
    axes = AXES[str(stated_order)]
    parts, inverse = [shape[axis] for axis in axes], np.argsort(axes)
    views = even_views(path, assumed, grid, (width, height)) if stated is None else stated[0]
    if (views.width_px, views.height_px) != (width, height):
        raise InputError(f"{path}: views of {width}x{height} px, expected {views.width_px}x{views.height_px}")
    samples = colours.reshape(*parts, 3).transpose(*inverse, 4)
    channels = 3 if stated is None else stated[1].channels
    return light_field_of(views, np.ascontiguousarray(samples), opacity.reshape(parts).transpose(inverse), channels)


def check_division(colours: Bytes, grid: Grid, order: Order) -> None:
    """Raise a one-line InputError without a path, if the pixels contradict a division into views.

    Ambiguous pictures, such as those without texture, pass.
    """
    if min(side // count for side, count in zip(colours.shape, grid, strict=False)) < _MIN_VIEW_PX:
        return
    picture = _Picture(np.asarray(cv2.cvtColor(np.ascontiguousarray(colours), cv2.COLOR_RGB2GRAY), np.float32))
    if order == "eslf":
        _check_lenses(picture, grid)
    else:
        _check_tiles(picture, grid)


@dataclass(frozen=True, eq=False)
class _Picture:
    """A picture (h, w) in grey from 0 to 255."""

    grey: Grey

    @cached_property
    def gradients(self) -> tuple[Grey, Grey]:
        """Mean absolute difference from each row to the next, and from each column to the next."""
        rows, columns = (np.abs(np.diff(self.grey, axis=axis)).mean(axis=1 - axis) for axis in (0, 1))
        return np.asarray(rows, np.float32), np.asarray(columns, np.float32)

    def divides_into(self, grid: Grid) -> bool:
        """Return whether all views of a grid have the same, plausible size."""
        sides = zip(self.grey.shape, grid, strict=True)
        return all(side % count == 0 and side // count >= _LIKELY_VIEW_PX for side, count in sides)

    def views(self, grid: Grid, order: Order) -> Grey:
        """Divide the picture into views (t, s, v, u)."""
        height, width = (side // count for side, count in zip(self.grey.shape, grid, strict=True))
        shape, axes = (*grid, height, width), AXES[order]
        return self.grey.reshape([shape[axis] for axis in axes]).transpose(np.argsort(axes))

    def seams(self, grid: Grid, excluded: Grid = (1, 1)) -> float:
        """Return the minimum over the axes of the relative gradient at a grid's borders, except those of `excluded`."""
        values = []
        for gradient, side, count, excluded_count in zip(self.gradients, self.grey.shape, grid, excluded, strict=True):
            borders = [number * side // count - 1 for number in range(1, count) if (number * excluded_count) % count]
            if borders:
                values.append(float(np.median(gradient[borders]) / max(float(np.median(gradient)), 1e-6)))
        return min(values, default=1.0)

    def lens_gradient(self, count: int, axis: int) -> float:
        """Return the gradient between lenslets of `count` px along an axis, relative to the maximum inside them."""
        folded = self._folded(count, axis)
        return float(folded[-1] / max(float(folded[:-1].max()), 1e-6))

    def holds_lenses(self, count: int, size: int, axis: int) -> bool:
        """Return whether all edges of lenslets of `size` px stand out equally in each `count` px along an axis."""
        folded = self._folded(count, axis)
        inside = np.arange(1, count + 1) % size > 0
        edges = folded[~inside]
        return bool(edges.min() > max(float(folded[inside].max()), _WEAK_LENS * float(edges.max())))

    def _folded(self, count: int, axis: int) -> Grey:
        gradient = self.gradients[axis]
        return np.asarray(np.median(gradient[: len(gradient) // count * count].reshape(-1, count), axis=0))

    @cached_property
    def is_noisy(self) -> bool:
        """Whether adjacent pixels differ about as much as any others, so noise hides seams."""
        return bool(min(float(np.median(gradient)) for gradient in self.gradients) > _NOISE * float(self.grey.std()))

    def repeats(self, grid: Grid, order: Order) -> bool:
        """Return whether the texture of a view of a grid repeats, so parts of it look like views."""
        rows, cols = grid
        grey = self.views(grid, order)[rows // 2, cols // 2]
        return texture_repeats(np.ascontiguousarray(grey))

    def seamed_grids(self) -> Iterator[Grid]:
        """Yield grids with seams, of at most `_MAX_VIEWS` rows and columns."""
        for rows in range(1, _MAX_VIEWS + 1):
            for cols in range(1, _MAX_VIEWS + 1):
                if rows * cols > 1 and self.divides_into((rows, cols)) and self.seams((rows, cols)) > _SEAM:
                    yield rows, cols


def _check_tiles(picture: _Picture, grid: Grid) -> None:
    rows, cols = grid
    views = picture.views(grid, "tiles")
    similarity = _similarity(views)
    if np.isnan(similarity):
        return
    has_seams = picture.seams(grid) > _NO_SEAM
    if similarity > _DISSIMILAR and has_seams:
        _check_single(picture, grid)
    reason = f"tiles of {rows} rows and {cols} columns are not views of one scene"
    has_lenses = all(picture.lens_gradient(count, axis) > _LENS for axis, count in enumerate(grid) if count > 1)
    if similarity < _DISSIMILAR and has_lenses and _similarity(picture.views(grid, "eslf")) > _SIMILAR:
        raise InputError(f"{reason}: the picture shows lenslets of {cols}x{rows} px, expected a name with _eslf")
    if picture.is_noisy:
        return
    better = [candidate for candidate in picture.seamed_grids() if _fits_better(picture, candidate, grid, similarity)]
    # Tiles of several views each are similar as well: the finest grid is chosen.
    best_rows, best_cols = max(better, key=lambda candidate: candidate[0] * candidate[1], default=grid)
    if (best_rows, best_cols) != grid:
        raise InputError(f"{reason}: the picture looks like rows = {best_rows}, cols = {best_cols}")
    if similarity < _DISSIMILAR and not has_seams and _structure(views) > _STRUCTURE:
        raise InputError(f"{reason}, give rows and cols of the views in the picture")


def _fits_better(picture: _Picture, other: Grid, grid: Grid, similarity: float) -> bool:
    """Return whether a different grid divides a picture into similar views, and the given one does not.

    `similarity` belongs to the given grid's tiles. If the other grid only divides further, or the given tiles are
    similar as well, the given grid must not have seams.
    """
    divides_further = not any(count % divisor for count, divisor in zip(grid, other, strict=True))
    if similarity > _DISSIMILAR and divides_further:
        return False
    if _similarity(picture.views(other, "tiles")) < _SIMILAR or picture.repeats(other, "tiles"):
        return False
    no_seam = max(_NO_SEAM, _WEAK_SEAM * picture.seams(other))
    return (similarity < _DISSIMILAR and not divides_further) or picture.seams(grid, excluded=other) < no_seam


def _check_single(picture: _Picture, grid: Grid) -> None:
    """Raise InputError if each tile shows several views, with seams between them."""
    rows, cols = grid
    multiples = [(rows * i, cols * j) for i in range(1, 6) for j in range(1, 6) if i * j > 1]
    finer = [
        candidate
        for candidate in multiples
        if picture.divides_into(candidate)
        and picture.seams(candidate, excluded=grid) > _SEAM
        and _similarity(picture.views(candidate, "tiles")) > _SIMILAR
        and not picture.repeats(candidate, "tiles")
    ]
    if finer:
        best_rows, best_cols = max(finer, key=lambda candidate: candidate[0] * candidate[1])
        raise InputError(
            f"tiles of {rows} rows and {cols} columns show several views each: the picture looks like "
            f"rows = {best_rows}, cols = {best_cols}"
        )


def _check_lenses(picture: _Picture, grid: Grid) -> None:
    if picture.seams(grid) > _SEAM and _similarity(picture.views(grid, "tiles")) > _SIMILAR:
        raise InputError("the picture shows adjacent views, not lenslets, expected a name without _eslf")
    for axis, (count, key) in enumerate(zip(grid, ("rows", "cols"), strict=True)):
        if not 1 < count <= _MAX_VIEWS:
            continue
        side = picture.grey.shape[axis]
        counts = [n for n in range(2, _MAX_VIEWS + 1) if side % n == 0 and side // n >= _LIKELY_VIEW_PX]
        gradients = {candidate: picture.lens_gradient(candidate, axis) for candidate in sorted({*counts, count})}
        strongest = max(gradients.values())
        # Groups of several lenslets have the same gradient at their edges as one.
        size = next(candidate for candidate, gradient in gradients.items() if gradient >= _WEAK_LENS * strongest)
        is_block = 0 in (size % _BLOCK_PX, _BLOCK_PX % size) and strongest < _CERTAIN
        certain = picture.holds_lenses(count, size, axis) if count % size == 0 else not is_block
        certain = certain and not picture.repeats(grid, "eslf")
        if size != count and strongest > _LENS and gradients[count] < _WEAK_LENS * strongest and certain:
            raise InputError(f"the picture does not show lenslets with {key} = {count}: it looks like {key} = {size}")


def _reduced(view: Any) -> Grey:
    size = (_SIDE_PX, _SIDE_PX)
    return np.asarray(cv2.resize(np.ascontiguousarray(view), size, interpolation=cv2.INTER_AREA), np.float32)


def _similarity(views: Grey) -> float:
    """Return the median correlation of adjacent views along the axis where it is lower; NaN without texture."""
    rows, cols = views.shape[:2]
    row_pairs = [((t, s), (t, s + 1)) for t in range(rows) for s in range(cols - 1)]
    column_pairs = [((t, s), (t + 1, s)) for t in range(rows - 1) for s in range(cols)]
    medians = []
    for neighbours in (row_pairs, column_pairs):
        chosen = np.linspace(0, len(neighbours) - 1, min(_PAIRS, len(neighbours))).astype(int)
        correlations = []
        for first, second in (neighbours[number] for number in chosen):
            edge = _SIDE_PX // 4
            central = _reduced(views[first])[edge:-edge, edge:-edge]
            if central.std() >= 1.0:
                correlations.append(cv2.matchTemplate(_reduced(views[second]), central, cv2.TM_CCOEFF_NORMED).max())
        if correlations:
            medians.append(float(np.median(correlations)))
    return min(medians, default=float("nan"))


def _structure(views: Grey) -> float:
    """Return the median correlation of adjacent pixels in the first views, reduced; 0 for noise."""
    small = [_reduced(view) for view in views.reshape(-1, *views.shape[2:])[:_PAIRS]]
    values = [np.corrcoef(view[:, 1:].ravel(), view[:, :-1].ravel())[0, 1] for view in small if view.std() > 0]
    return float(np.median(values)) if values else 0.0
