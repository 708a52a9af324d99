"""Which board pictures show that do not show the stated one: another size, another dictionary, or a flipped picture.

Only a few pictures are looked at, so that this costs little. What is recognised is refused with its likely cause.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.calibration.detection.charuco import find_markers, linked_markers, marker_places
from mirrorcam.optics.calibration.detection.checkerboard import Grey, find_checkerboards
from mirrorcam.optics.calibration.solver.observations import IntArray
from mirrorcam.optics.geometry.targets import DICTIONARIES, Charuco, Checkerboard, Target

MOST_PICTURES = 2  # looked at of each kind
MOST_BOARDS = 3  # counted in a picture
MORE_BOARDS = 1.5  # of another size, relative to those of the stated one
MIN_LINKS = 8  # between neighbouring markers, by picture, to recognise a board
MORE_LINKS = 1.5  # of another board's, relative to those of the stated one
WIDTHS = 3  # columns more or fewer than stated


def refuse_other_board(pictures: Sequence[Grey], target: Target, *, mirrored: bool, found: bool) -> None:
    """Raise InputError where pictures show another board than the stated one, or are flipped.

    Parameters
    ----------
    pictures
        Some pictures (h, w).
    target
        The stated board.
    mirrored
        Whether they show it through mirrors.
    found
        Whether the stated board was found in any picture of this kind. Otherwise more is tried.
    """
    pictures = pictures[:MOST_PICTURES]
    if not pictures:
        return
    if isinstance(target, Charuco):
        _refuse_other_markers(pictures, target, mirrored=mirrored, found=found)
    elif not found:
        _refuse_other_checkerboard(pictures, target)


def _refuse_other_checkerboard(pictures: Sequence[Grey], target: Checkerboard) -> None:
    counts = {size: _count(pictures, target, size) for size in _neighbouring_sizes(target)}
    best = max(counts, key=lambda size: (counts[size], size[0] * size[1]))
    own = _count(pictures, target, (target.cols, target.rows))
    # Now and then part of a board is taken for a smaller one, and a board with its mirror image for a larger one.
    if counts[best] >= max(len(pictures), MORE_BOARDS * own):
        raise InputError(
            f"the pictures show a checkerboard of {best[0]} x {best[1]} squares, board.toml says {_size(target)}"
        )


def _neighbouring_sizes(target: Checkerboard) -> Iterator[tuple[int, int]]:
    """Numbers of columns and rows that one may have miscounted."""
    for cols, rows in ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, 1)):
        if target.cols + cols >= 3 and target.rows + rows >= 3:
            yield target.cols + cols, target.rows + rows


def _count(pictures: Sequence[Grey], target: Checkerboard, size: tuple[int, int]) -> int:
    board = target.replaced(cols=size[0], rows=size[1])
    return sum(len(find_checkerboards(picture, board, most=MOST_BOARDS)) for picture in pictures)


def _refuse_other_markers(pictures: Sequence[Grey], target: Charuco, *, mirrored: bool, found: bool) -> None:
    highest = target.replaced(rows=max(2 * _capacity(target.dictionary) // target.cols, target.rows))
    seen = [find_markers(picture, highest, mirrored=mirrored) for picture in pictures]
    own, least = _links(seen, target), MIN_LINKS * len(pictures)
    widths = {cols: _links(seen, _widened(target, cols)) for cols in _other_widths(target)}
    width = max(widths, key=lambda cols: widths[cols])
    if widths[width] >= max(least, MORE_LINKS * own):
        raise InputError(
            f"the pictures show a ChArUco board of {width} columns of squares, board.toml says {_size(target)} squares"
        )
    if _links(seen, highest) - own >= least:
        raise InputError(f"the pictures show a ChArUco board of more rows of squares, board.toml says {_size(target)}")
    if found or own >= least:
        return
    if _links([find_markers(picture, target, mirrored=not mirrored) for picture in pictures], target) >= least:
        raise InputError(
            "the markers of the board can be read only when the pictures are flipped: they are mirrored, as those of a "
            "selfie camera; switch that off, or flip them left to right"
        )
    for name in DICTIONARIES:
        if _capacity(name) < target.rows * target.cols // 2:
            continue
        other = target.replaced(dictionary=name)
        if _links([find_markers(picture, other, mirrored=mirrored) for picture in pictures], other) >= least:
            raise InputError(f"the pictures show markers of {name}, board.toml says dictionary {target.dictionary}")


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
