"""Which board pictures show that do not show the stated one: another size, another dictionary, or a flipped picture.

Only a few pictures are looked at, so that this costs little. What is recognised is refused with its likely cause.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from mirrorcam.optics.calibration.detection.checkerboard import Grey, find_checkerboards
from mirrorcam.optics.calibration.detection.other_markers import other_markers
from mirrorcam.optics.calibration.detection.seen_grid import SeenGrid
from mirrorcam.optics.geometry.targets import Checkerboard, Target

MOST_PICTURES = 2  # looked at of each kind
FILLED = 0.9  # of the corners of a grid's rectangle, for a board that is wholly visible
PARTS = 0.5  # of the boards of any size, for the largest size that counts: parts of a board look like smaller ones


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
        return other_markers(pictures, target, mirrored=mirrored, found=found and fits)
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


def _size(target: Target) -> str:
    return f"{target.cols} x {target.rows}"
