"""Which board pictures show that do not show the stated one: another size, another dictionary, or a flipped picture.

Only a few pictures are looked at, so that this costs little. What is recognised is refused with its likely cause.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import cv2
import numpy as np

from mirrorcam.optics.calibration.detection.checkerboard import Grey, find_checkerboards
from mirrorcam.optics.calibration.detection.marker_steps import Steps, marker_steps
from mirrorcam.optics.calibration.detection.seen_grid import SeenGrid
from mirrorcam.optics.geometry.targets import DICTIONARIES, AprilGrid, Charuco, Checkerboard, Target

MOST_PICTURES = 2  # looked at of each kind
FILLED = 0.9  # of the corners of a grid's rectangle, for a board that is wholly visible
PARTS = 0.5  # of the boards of any size, for the largest size that counts: parts of a board look like smaller ones
MIN_BEYOND = 2  # pairs with a marker that the stated board lacks, by picture
MIN_STEPS = 3  # pairs of markers that say the same number of columns, by picture


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
    if not isinstance(target, Checkerboard):
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


def _other_markers(pictures: Sequence[Grey], target: Charuco | AprilGrid, *, mirrored: bool, found: bool) -> str | None:
    tags = isinstance(target, AprilGrid)
    board, cells = ("an AprilGrid", "tags") if tags else ("a ChArUco board", "squares")
    least = MIN_STEPS * len(pictures)
    columns, steps = _steps(pictures, target, mirrored=mirrored)
    if len(steps.highest) < least:
        return None if found else _unreadable_markers(pictures, target, mirrored=mirrored)
    rows = (steps.highest if tags else 2 * steps.highest + 1) // columns + 1 + steps.follows  # at least
    if columns != target.cols:
        said = f"the pictures show {board} of {columns} columns of {cells}, board.toml says {_size(target)} {cells}"
        exchanged = columns == target.rows and rows.max() <= target.cols
        return said + (": are cols and rows exchanged?" if exchanged else "")
    if (rows > target.rows).sum() >= MIN_BEYOND * len(pictures):
        return f"the pictures show {board} of more rows of {cells}, board.toml says {_size(target)} {cells}"
    return None


def _unreadable_markers(pictures: Sequence[Grey], target: Charuco | AprilGrid, *, mirrored: bool) -> str | None:
    least = MIN_STEPS * len(pictures)
    if len(_steps(pictures, target, mirrored=not mirrored)[1].highest) >= least:
        return (
            "the markers of the board can be read only when the pictures are flipped: they are mirrored, as those of a "
            "selfie camera; switch that off, or flip them left to right"
        )
    if isinstance(target, Charuco):
        for name in DICTIONARIES:
            if _capacity(name) < target.rows * target.cols // 2 or _same_markers(name, target.dictionary):
                continue
            other = target.replaced(dictionary=name)
            if len(_steps(pictures, other, mirrored=mirrored)[1].highest) >= least:
                return f"the pictures show markers of {name}, board.toml says dictionary {target.dictionary}"
    return None


def _capacity(dictionary: str) -> int:
    """Number of markers in a dictionary."""
    return int(dictionary.rsplit("_", 1)[1])


def _same_markers(one: str, other: str) -> bool:
    """Whether the smaller of two dictionaries begins the larger, so that the same board is printed from either."""
    markers = [cv2.aruco.getPredefinedDictionary(DICTIONARIES[name][0]).bytesList for name in (one, other)]
    count = min(map(len, markers))
    return np.array_equal(markers[0][:count], markers[1][:count])


def _steps(pictures: Sequence[Grey], target: Charuco | AprilGrid, *, mirrored: bool) -> tuple[int, Steps]:
    return Steps.together([marker_steps(picture, target, mirrored=mirrored) for picture in pictures]).likely


def _size(target: Target) -> str:
    return f"{target.cols} x {target.rows}"
