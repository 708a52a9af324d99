"""Which board pictures show that do not show the stated one: another size, another dictionary, or a flipped picture.

Only a few pictures are looked at, so that this costs little. What is recognised is refused with its likely cause.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.detection.charuco import find_markers, linked_markers, marker_places
from mirrorcam.optics.calibration.detection.checkerboard import Grey, find_checkerboards
from mirrorcam.optics.calibration.detection.seen_grid import SeenGrid
from mirrorcam.optics.calibration.solver.observations import IntArray
from mirrorcam.optics.geometry.targets import DICTIONARIES, AprilGrid, Charuco, Checkerboard, Target

MOST_PICTURES = 2  # looked at of each kind
FILLED = 0.9  # of the corners of a grid's rectangle, for a board that is wholly visible
PARTS = 0.5  # of the boards of any size, for the largest size that counts: parts of a board look like smaller ones
MIN_LINKS = 8  # between neighbouring markers, by picture, to recognise a board
MIN_LINKS_BEYOND = 3  # of markers that the stated board lacks, by picture: no misread marker has any
MORE_LINKS = 1.5  # of another board's, relative to those of the stated one
WIDTHS = 3  # columns more or fewer than stated


def other_board(
    pictures: Sequence[Grey], target: Target, *, mirrored: bool | None, found: bool, fits: bool = True
) -> str | None:
    """Say that pictures show another board than the stated one, or are flipped; None where they seem to be right.

    Parameters
    ----------
    pictures
        Some pictures (h, w).
    target
        The stated board.
    mirrored
        Whether they show it through mirrors; None: directly and through mirrors.
    found
        Whether the stated board was found in any picture, of whatever kind. Otherwise more is tried.
    fits
        Whether it was found in pictures of this kind, and fits as far as is known. Otherwise what was found may be part
        of a larger board.
    """
    pictures = pictures[:MOST_PICTURES]
    if not pictures:
        return None
    if isinstance(target, AprilGrid):
        return None
    if isinstance(target, Charuco):
        return _other_markers(pictures, target, mirrored=bool(mirrored), found=found and fits)
    return None if found and fits else _other_checkerboard(pictures, target, mirrored=mirrored, found=found)


def _other_checkerboard(
    pictures: Sequence[Grey], target: Checkerboard, *, mirrored: bool | None, found: bool
) -> str | None:
    grids = [grid for picture in pictures for grid in find_checkerboards(picture, target)]
    counts = Counter(_size_like(target, grid) for grid in grids if len(grid) >= FILLED * np.prod(grid.extent))
    own = counts.pop((target.cols, target.rows), 0)
    # Parts of a board look like smaller ones, so that one as large as the stated one is none smaller.
    if own or found:
        counts = Counter({size: count for size, count in counts.items() if _at_least(size, target)})
    # Now and then a board with its mirror image is taken for a larger one.
    least = max(len(pictures), PARTS * max([*counts.values(), own], default=0))
    often = [size for size, count in counts.items() if count >= least]
    if often:
        cols, rows = max(often, key=lambda size: size[0] * size[1])
        return f"the pictures show a checkerboard of {cols} x {rows} squares, board.toml says {_size(target)}"
    if mirrored is None or found:
        return None
    whole = [grid for grid in grids if _size_like(target, grid) == (target.cols, target.rows)]
    if own >= len(pictures) and not any(grid.numberings(target, mirrored=mirrored) for grid in whole):
        return (
            f"the {_size(target)} checkerboard in the pictures has black where it should be white: they are mirrored, "
            "as those of a selfie camera (switch that off, or flip them left to right), or cols and rows are exchanged "
            "in board.toml"
        )
    return None


def _size_like(target: Checkerboard, grid: SeenGrid) -> tuple[int, int]:
    """Numbers of columns and rows of squares of a board that ends where a grid does, in the order nearer the target."""
    long, short = max(grid.extent) + 1, min(grid.extent) + 1
    sizes = [(long, short), (short, long)] if target.cols >= target.rows else [(short, long), (long, short)]
    return min(sizes, key=lambda size: abs(size[0] - target.cols) + abs(size[1] - target.rows))


def _at_least(size: tuple[int, int], target: Checkerboard) -> bool:
    return size[0] >= target.cols and size[1] >= target.rows


def _other_markers(pictures: Sequence[Grey], target: Charuco, *, mirrored: bool, found: bool) -> str | None:
    highest = target.replaced(rows=max(2 * _capacity(target.dictionary) // target.cols, target.rows))
    seen = [find_markers(picture, highest, mirrored=mirrored) for picture in pictures]
    own, least = _links(seen, target), MIN_LINKS * len(pictures)
    widths = {cols: _links(seen, _widened(target, cols)) for cols in _other_widths(target)}
    width = max(widths, key=lambda cols: widths[cols])
    if widths[width] >= max(least, MORE_LINKS * own):
        return (
            f"the pictures show a ChArUco board of {width} columns of squares, board.toml says {_size(target)} squares"
        )
    if _links(seen, highest) - own >= MIN_LINKS_BEYOND * len(pictures):
        return f"the pictures show a ChArUco board of more rows of squares, board.toml says {_size(target)}"
    if found or own >= least:
        return None
    if _links([find_markers(picture, target, mirrored=not mirrored) for picture in pictures], target) >= least:
        return (
            "the markers of the board can be read only when the pictures are flipped: they are mirrored, as those of a "
            "selfie camera; switch that off, or flip them left to right"
        )
    for name in DICTIONARIES:
        if _capacity(name) < target.rows * target.cols // 2:
            continue
        other = target.replaced(dictionary=name)
        if _links([find_markers(picture, other, mirrored=mirrored) for picture in pictures], other) >= least:
            return f"the pictures show markers of {name}, board.toml says dictionary {target.dictionary}"
    return None


def _capacity(dictionary: str) -> int:
    """Number of markers in a dictionary."""
    return int(dictionary.rsplit("_", 1)[1])


def _other_widths(target: Charuco) -> list[int]:
    return [cols for cols in range(target.cols - WIDTHS, target.cols + WIDTHS + 1) if cols >= 3 and cols != target.cols]


def _widened(target: Charuco, cols: int) -> Charuco:
    """A board like a stated one with `cols` columns, and with as many rows, or as its dictionary has markers for."""
    return target.replaced(cols=cols, rows=min(target.rows, 2 * _capacity(target.dictionary) // cols))


def _links(seen: Sequence[tuple[IntArray, FloatArray]], target: Charuco) -> int:
    """Number of pairs of neighbouring markers that lie to each other as a board has them; markers by picture."""
    places, count = marker_places(target), 0
    for ids, quads in seen:
        known = ids < len(places)
        if known.any():
            count += linked_markers(places[ids[known]], quads[known]).nnz // 2
    return count


def _size(target: Target) -> str:
    return f"{target.cols} x {target.rows}"
