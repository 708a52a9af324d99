"""Recognition of boards other than the stated one: of a different size, kind or dictionary, or in a flipped picture.

To limit the cost, only a few pictures are examined: a sample of them before the stated board is searched in all, so
that a wrong one is named within seconds, and the first ones after that. A recognised board is refused with its likely
cause, and with how to describe it. Messages call the description `board`, as the argument and the option.

The markers' numbers reveal a board of a different size, with OpenCV's old pattern, or with a different first marker. If
they cannot be read, flipped pictures, inverted prints, other marker sizes and other dictionaries are tried, and what is
read then is compared with the stated board in turn. Finally, other kinds of boards are tried.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from mirrorcam.optics.calibration.detection.charuco import count_by_family, find_marked_boards, tag_spacing
from mirrorcam.optics.calibration.detection.checkerboard import Grey, find_checkerboards
from mirrorcam.optics.calibration.detection.detect_boards import find_boards
from mirrorcam.optics.calibration.detection.detections import DetectedGrid
from mirrorcam.optics.calibration.detection.marker_layout import (
    GriddedPicture,
    MarkerPairs,
    VerticalPairs,
    are_blank,
    marker_pairs,
    marker_side,
)
from mirrorcam.optics.geometry import marker_dictionaries as dictionaries
from mirrorcam.optics.geometry.boards import AprilGrid, CalibrationBoard, Charuco, Checkerboard

MAX_PICTURES = 2  # pictures examined of each kind
MIN_FILLED = 0.9  # fraction of a grid's bounding rectangle that has corners, for a completely visible board
MIN_FRACTION = 0.5  # of the boards, for a size to count: parts of a board look like smaller boards
MIN_BEYOND = 2  # pairs per picture with a marker that the stated board lacks
MIN_VERTICAL = 3  # pairs of markers per picture that give the same number of columns
MAX_SHORTFALL = 0.05  # of consistent pairs, relative to the best numbering, for a numbering that is still plausible
MAX_SIDE_DIFFERENCE = 0.035  # between the stated and the visible side of markers, in squares
MAX_SPACING_DIFFERENCE = 0.04  # between the stated and the visible gap of an AprilGrid, relative
MAX_DICTIONARIES = 3  # families of which the most markers were detected, whose layout is examined
FLIPPED = (
    "the markers of the board can be read only when the pictures are flipped: they are mirrored, like those of a "
    "selfie camera; switch that off, or flip them left to right"
)
ANY_CHARUCO = Charuco(cols=5, rows=4, square_mm=10.0, marker_mm=7.0)
ANY_APRILGRID = AprilGrid(cols=24, rows=24, tag_mm=10.0, spacing=0.3)


def other_board(
    pictures: Sequence[Grey], board: CalibrationBoard, *, mirrored: bool | None, found: bool, fits: bool = True
) -> str | None:
    """Describe how pictures show a board other than the stated one, or are flipped; None if they seem right.

    Parameters
    ----------
    pictures
        Some pictures (h, w).
    board
        The stated board.
    mirrored
        Whether they show the board in mirrors; None if both directly and in mirrors.
    found
        Whether the stated board was found in any picture, with or without mirrors. Otherwise, more checks are made.
    fits
        Whether it was found in such pictures and fits so far. Otherwise, the detected board may be part of a
        larger one.
    """
    pictures = pictures[:MAX_PICTURES]
    if not pictures:
        return None
    if not isinstance(board, Checkerboard):
        return other_markers(pictures, board, mirrored=mirrored, found=found and fits)
    if found and fits:
        return None
    other = _other_checkerboard(pictures, board, mirrored=mirrored, found=found)
    return other or (None if found else _other_kind(pictures, board, mirrored=bool(mirrored)))


def surely_other_board(pictures: Sequence[Grey], board: CalibrationBoard, *, mirrored: bool | None) -> str | None:
    """Describe how a sample of pictures (h, w) shows another board, without a search for the stated one in all.

    None in any doubt: `other_board` decides then. `mirrored` is as for it.
    """
    gridded = sorted(
        (GriddedPicture.of(picture, ANY_CHARUCO) for picture in pictures),
        key=lambda picture: -sum(map(len, picture.grids)),
    )[:MAX_PICTURES]
    clearest = [picture.grey for picture in gridded]
    if not gridded:
        return None
    if not isinstance(board, Checkerboard):
        if isinstance(board, AprilGrid):
            gridded = [GriddedPicture.of(picture, board) for picture in clearest]
        pairs = _pairs(gridded, board, mirrored=bool(mirrored))
        if len(pairs.vertical(board).majority[1].highest) >= MIN_VERTICAL * len(gridded):
            return _other_layout(pairs, board, len(gridded))
        other = _unreadable(gridded, board, mirrored=mirrored)
    elif all(are_blank(picture) for picture in gridded):
        return _surely_other_checkerboard(gridded, board)
    else:
        columns, other = _charuco(clearest, board, mirrored=bool(mirrored))
        if columns and columns not in (board.cols, board.rows):
            return other
        other = other or _aprilgrid(clearest, board, mirrored=bool(mirrored))
    flips = (False, True) if mirrored is None else (mirrored,)
    found = other and any(
        find_boards(picture, board, mirrored=flip, max_boards=1) for picture in clearest for flip in flips
    )
    return None if found else other


def _surely_other_checkerboard(gridded: Sequence[GriddedPicture], board: Checkerboard) -> str | None:
    """Name the size of checkerboards whose edges are in view, unless it is the stated one."""
    stated = (board.cols, board.rows)
    if stated in _complete_sizes([grid for picture in gridded for grid in picture.grids], board):
        return None
    grids = [grid for picture in gridded for grid in find_checkerboards(picture.grey, board)]
    sizes = _complete_sizes([grid for grid in grids if np.isfinite(grid.limits).all()], board)
    size, count = max(sizes.items(), key=lambda item: item[1], default=(stated, 0))
    return None if stated in sizes or count < len(gridded) else _named_size(size, board)


def _named_size(size: tuple[int, int], board: Checkerboard) -> str:
    return f"the pictures show a checkerboard of {size[0]} x {size[1]} squares, board says {_size(board)}"


def _other_checkerboard(
    pictures: Sequence[Grey], board: Checkerboard, *, mirrored: bool | None, found: bool
) -> str | None:
    grids = [grid for picture in pictures for grid in find_checkerboards(picture, board)]
    counts = _complete_sizes(grids, board)
    stated = counts.pop((board.cols, board.rows), 0)
    # Parts of a board look like smaller boards, so once the stated size is found, smaller ones do not count.
    if stated or found:
        counts = Counter({size: n for size, n in counts.items() if size[0] >= board.cols and size[1] >= board.rows})
    # Occasionally, a board and its mirror image together look like a larger board.
    min_count = max(len(pictures), MIN_FRACTION * max([*counts.values(), stated], default=0))
    frequent = [size for size, count in counts.items() if count >= min_count]
    if frequent:
        return _named_size(max(frequent, key=lambda size: size[0] * size[1]), board)
    if mirrored is None or found:
        return None
    complete = [grid for grid in grids if _size_like(board, grid) == (board.cols, board.rows)]
    if stated >= len(pictures) and not any(grid.numberings(board, mirrored=mirrored) for grid in complete):
        return (
            f"the {_size(board)} checkerboard in the pictures has black where it should be white: they are mirrored, "
            "like those of a selfie camera (switch that off, or flip them left to right), or cols and rows of "
            "board are exchanged"
        )
    return None


def _complete_sizes(grids: Sequence[DetectedGrid], board: CalibrationBoard) -> Counter[tuple[int, int]]:
    return Counter(_size_like(board, grid) for grid in grids if len(grid) >= MIN_FILLED * np.prod(grid.extent))


def _size_like(board: CalibrationBoard, grid: DetectedGrid) -> tuple[int, int]:
    """Columns and rows of squares of a board that ends where the grid does, in the order closer to that on `board`."""
    long, short = max(grid.extent) + 1, min(grid.extent) + 1
    sizes = [(long, short), (short, long)] if board.cols >= board.rows else [(short, long), (long, short)]
    return min(sizes, key=lambda size: abs(size[0] - board.cols) + abs(size[1] - board.rows))


def _size(board: CalibrationBoard) -> str:
    return f"{board.cols} x {board.rows}"


def other_markers(
    pictures: Sequence[Grey], board: Charuco | AprilGrid, *, mirrored: bool | None, found: bool
) -> str | None:
    """Describe how pictures (h, w) show a marked board other than the stated one; None if they seem right.

    For `mirrored` and `found`, see `other_board`.
    """
    if isinstance(board, AprilGrid) and (other := _other_spacing(pictures, board)):
        return other
    gridded = [GriddedPicture.of(picture, board) for picture in pictures]
    return _differences(gridded, board, mirrored=mirrored, found=found)


def _differences(
    gridded: Sequence[GriddedPicture], board: Charuco | AprilGrid, *, mirrored: bool | None, found: bool
) -> str | None:
    pictures = [picture.grey for picture in gridded]
    min_pairs = MIN_VERTICAL * len(gridded)
    pairs = _pairs(gridded, board, mirrored=bool(mirrored))
    columns, vertical = pairs.vertical(board).majority
    if len(vertical.highest) < min_pairs:
        if not found:
            return _unreadable(gridded, board, mirrored=mirrored)
        if not isinstance(board, Charuco):
            return None
        # Markers of a different size are rarely readable.
        other = _pattern_with_more_corners(pictures, board, mirrored=mirrored)
        return other or _other_marker_side(gridded, board, mirrored=mirrored)
    if other := _other_layout(pairs, board, len(gridded)):
        return other
    if not isinstance(board, Charuco):
        return None
    white = board.marker_at_top_left
    stated_pairs, other_pairs = (
        pairs.count_consistent(columns, board.first_marker, white_first=bool(first)) for first in (white, not white)
    )
    unclear = stated_pairs - other_pairs < min_pairs
    other = _pattern_with_more_corners(pictures, board, mirrored=mirrored) if unclear else None
    return other or _other_marker_side(gridded, board, mirrored=mirrored)


def _other_layout(pairs: MarkerPairs, board: Charuco | AprilGrid, pictures: int) -> str | None:
    """Describe how pairs of markers in some pictures contradict the columns, rows or numbers of a board."""
    columns, vertical = pairs.vertical(board).majority
    tags = isinstance(board, AprilGrid)
    kind, cells = ("an AprilGrid", "tags") if tags else ("a ChArUco board", "squares")
    size = f"{board.cols} x {board.rows}"
    highest = vertical.highest - (board.first_marker if isinstance(board, Charuco) else 0)
    rows = (highest if tags else 2 * highest + 1) // columns + 1 + vertical.has_next_row  # at least
    if columns != board.cols:
        sentence = f"the pictures show {kind} of {columns} columns of {cells}, board says {size} {cells}"
        exchanged = columns == board.rows and rows.max() <= board.cols
        return sentence + (": are cols and rows exchanged?" if exchanged else "")
    if isinstance(board, Charuco) and (other := _other_numbers(pairs, vertical, board, pictures)):
        return other
    if (rows > board.rows).sum() >= MIN_BEYOND * pictures:
        return f"the pictures show {kind} of more rows of {cells}, board says {size} {cells}"
    return None


def _other_numbers(
    pairs: MarkerPairs, vertical: VerticalPairs, board: Charuco, pictures: int, *, any_pattern: bool = True
) -> str | None:
    """Describe how markers are arranged or numbered differently from the board; None if they are not.

    `any_pattern` states whether the board's pattern may be wrong.
    """
    first, count = board.first_marker, len(board.markers)
    white = board.marker_at_top_left
    votes = [pairs.count_consistent(board.cols, phase, white_first=white) for phase in range(first, first + board.cols)]
    lowest, highest = int(vertical.highest.min()) - board.cols, int(vertical.highest.max())
    pairs_beyond = int(((vertical.highest >= first + count) | (vertical.highest - board.cols < first)).sum())
    # With an odd number of columns, a wrong numbering fails only at the sides of the board.
    min_votes = max(votes) - max(MIN_VERTICAL * pictures, MAX_SHORTFALL * max(votes))
    if min_votes < 0:
        return None
    as_stated, few_beyond = votes[0] > min_votes, pairs_beyond < MIN_BEYOND * pictures
    if (as_stated and few_beyond) or _inner_rows(vertical, board.cols) + 2 > board.rows:
        return None
    other_pattern = not as_stated and pairs.count_consistent(board.cols, first, white_first=not white) > min_votes
    phase = 0 if as_stated else int(np.argmax(votes))
    # The numbers of complete pairs of rows, from the pair that holds the lowest number.
    begin = first + phase + (lowest - first - phase) // board.cols * board.cols
    fits = begin != first and begin >= 0 and highest < begin + count
    is_other_pattern = other_pattern and (few_beyond or not fits)
    if any_pattern and (is_other_pattern or (not fits and board.rows % 2 == 0)):
        toggled = board.replaced(legacy=not board.legacy)
        numbers = _other_numbers(pairs, vertical, toggled, pictures, any_pattern=False) if board.rows % 2 == 0 else None
        if is_other_pattern or numbers:
            return "; ".join(filter(None, [_other_pattern(board), numbers]))
    # With the other pattern, the first and last rows must be visible: otherwise, more rows are likelier.
    all_rows = lowest < begin + board.cols // 2 and highest >= begin + count - board.cols
    if not fits or not (any_pattern or all_rows):
        return None
    # If neither the left nor the right side of the board is visible, several numberings are equally likely.
    first_id = str(begin) if votes.count(votes[phase]) == 1 else "the id of the board's first marker"
    return (
        f"the pictures show markers {lowest} to {highest}, board says {board.cols} x {board.rows} squares with "
        f"{first} to {first + count - 1}: set first_marker = {first_id} there, unless the board has more rows"
    )


def _inner_rows(vertical: VerticalPairs, columns: int) -> int:
    """Number of rows, at least, with markers among inner corners: the board has one more above and below."""
    highest = vertical.highest[vertical.has_next_row > 0]
    return 2 * int(np.ptp(highest) + columns) // columns + 1 if len(highest) else 0


def _pattern_with_more_corners(pictures: Sequence[Grey], board: Charuco, *, mirrored: bool | None) -> str | None:
    """Name the other pattern if it gives more corners: the wrong pattern lacks the corners along a side of the board.

    With an odd number of columns, the patterns differ by a shift, so only the corners at the sides differ.
    """
    if board.rows % 2:
        return None
    other = board.replaced(legacy=not board.legacy)
    more = []
    for picture, flipped in itertools.product(pictures, (False, True) if mirrored is None else (mirrored,)):
        corners_stated, corners_other = (
            max(map(len, find_marked_boards(picture, candidate, mirrored=flipped, max_boards=1)), default=0)
            for candidate in (board, other)
        )
        if corners_stated and corners_other:
            more.append(corners_other - corners_stated)
    if not more or min(more) < 0 or sum(more) < max(MIN_VERTICAL, board.rows // 2) * len(pictures):
        return None
    return _other_pattern(board)


def _other_pattern(board: Charuco) -> str:
    if board.rows % 2:
        return (
            f"the ChArUco board in the pictures has a white square at its top left, which no board of {board.rows} "
            "rows has: are cols and rows of board right?"
        )
    sentence = "the markers of the ChArUco board in the pictures are arranged as OpenCV"
    if board.legacy:
        return f"{sentence} 4.6 and later print them, board says legacy = true: remove that"
    return f"{sentence} before 4.6 printed them (its old pattern): set legacy = true in board"


def _other_marker_side(gridded: Sequence[GriddedPicture], board: Charuco, *, mirrored: bool | None) -> str | None:
    side = marker_side(gridded, board, mirrored=mirrored)
    if side is None or abs(side - board.marker_mm / board.square_mm) < MAX_SIDE_DIFFERENCE:
        return None
    if not _readable(gridded, board.replaced(marker_mm=side * board.square_mm), mirrored=bool(mirrored)):
        return None
    return (
        f"the markers in the pictures look like {side * board.square_mm:.2g} mm on squares of {board.square_mm:g} "
        f"mm, board says marker_mm = {board.marker_mm:g}"
    )


def _unreadable(gridded: Sequence[GriddedPicture], board: Charuco | AprilGrid, *, mirrored: bool | None) -> str | None:
    """Explain why the markers cannot be read."""
    flipped = bool(mirrored)
    if other := _plain_checkerboard([picture.grey for picture in gridded], board):
        return other
    if mirrored is not None and _readable(gridded, board, mirrored=not flipped):
        return FLIPPED
    if isinstance(board, Charuco):
        inverted = board.replaced(inverted=not board.inverted)
        if _readable(gridded, inverted, mirrored=flipped):
            return _with_others(_other_polarity(board), gridded, inverted, mirrored=mirrored)
        if other := _other_marker_side(gridded, board, mirrored=mirrored):
            return other
        for polarity in (board.inverted, inverted.inverted):
            if other := _other_dictionary(gridded, board, inverted=polarity, mirrored=mirrored):
                return other
    return _other_kind([picture.grey for picture in gridded], board, mirrored=flipped)


def _with_others(cause: str, gridded: Sequence[GriddedPicture], corrected: Charuco, *, mirrored: bool | None) -> str:
    """Join a cause and how the pictures differ from the board without it."""
    others = _differences(gridded, corrected, mirrored=mirrored, found=True)
    return f"{cause}; {others}" if others else cause


def _other_polarity(board: Charuco) -> str:
    subject = "the ChArUco board in the pictures is printed"
    if board.inverted:
        return f"{subject} black on white, board says inverted = true: remove that"
    return f"{subject} white on black: set inverted = true in board"


def _other_dictionary(
    gridded: Sequence[GriddedPicture], board: Charuco, *, inverted: bool, mirrored: bool | None
) -> str | None:
    """Name the dictionary of the markers if they are of another one, and printed `inverted`."""
    pictures = [picture.grey for picture in gridded]
    stated = dictionaries.family(board.dictionary)
    families = [name for name in dictionaries.FAMILIES if name != stated]
    for name in _likely_families(pictures, families, inverted=inverted, mirrored=bool(mirrored)):
        if dictionaries.count(name) < len(board.markers):
            continue
        other = board.replaced(dictionary=name, first_marker=0, inverted=inverted)
        vertical = _pairs(gridded, other, mirrored=bool(mirrored)).vertical(other).majority[1]
        if len(vertical.highest) >= MIN_VERTICAL * len(gridded):
            shown = dictionaries.smallest(name, max(len(board.markers), int(vertical.highest.max()) + 1))
            cause = (
                f"the pictures show markers of {shown}, board says dictionary {board.dictionary}: "
                f'set dictionary = "{shown}" there'
            )
            if inverted != board.inverted:
                cause = f"{_other_polarity(board)}; {cause}"
            return _with_others(cause, gridded, other.replaced(dictionary=shown), mirrored=mirrored)
    return None


def _likely_families(
    pictures: Sequence[Grey], families: Sequence[str], *, inverted: bool, mirrored: bool
) -> Iterator[str]:
    """Yield the dictionaries of which pictures show most markers."""
    if inverted:
        pictures = [np.asarray(255 - picture, dtype=np.uint8) for picture in pictures]
    counts = np.sum([count_by_family(picture, families, mirrored=mirrored) for picture in pictures], axis=0)
    for number in np.argsort(-counts, kind="stable")[:MAX_DICTIONARIES].tolist():
        if counts[number] >= MIN_VERTICAL * len(pictures):
            yield families[number]


def _other_kind(pictures: Sequence[Grey], board: CalibrationBoard, *, mirrored: bool) -> str | None:
    """Name the kind of board in the pictures if it is one with markers other than the stated kind."""
    other = None if isinstance(board, AprilGrid) else _aprilgrid(pictures, board, mirrored=mirrored)
    if other or isinstance(board, Charuco):
        return other
    return _charuco(pictures, board, mirrored=mirrored)[1]


def _aprilgrid(pictures: Sequence[Grey], board: CalibrationBoard, *, mirrored: bool) -> str | None:
    """Name the AprilGrid in the pictures, if any."""
    spacings = [spacing for picture in pictures if (spacing := tag_spacing(picture)) is not None]
    if not spacings:
        return None
    grid = ANY_APRILGRID.replaced(spacing=float(np.median(spacings)))
    columns, _ = _columns(pictures, grid, mirrored=mirrored)
    if not columns:
        return None
    return (
        f"the pictures show an AprilGrid of {columns} columns of tags, {_stated_kind(board)}: "
        f'set kind = "aprilgrid" there, spacing = {grid.spacing:.3g}, and cols, rows and tag_mm of its tags'
    )


def _charuco(pictures: Sequence[Grey], board: CalibrationBoard, *, mirrored: bool) -> tuple[int, str | None]:
    """Number of columns of the ChArUco board in the pictures, and its name; 0, None without one."""
    for inverted in (False, True):
        for name in _likely_families(pictures, dictionaries.FAMILIES, inverted=inverted, mirrored=mirrored):
            assumed = ANY_CHARUCO.replaced(dictionary=name, inverted=inverted)
            columns, highest = _columns(pictures, assumed, mirrored=mirrored)
            if columns:
                shown = dictionaries.smallest(name, highest + 1)
                return columns, (
                    f"the pictures show a ChArUco board of {columns} columns of squares, {_stated_kind(board)}: "
                    f'set kind = "charuco" there, dictionary = "{shown}", marker_mm'
                    f"{' and inverted = true' if inverted else ''}"
                )
    return 0, None


def _plain_checkerboard(pictures: Sequence[Grey], board: Charuco | AprilGrid) -> str | None:
    if not all(are_blank(GriddedPicture.of(picture, ANY_CHARUCO)) for picture in pictures):
        return None
    plain = Checkerboard(cols=board.cols, rows=board.rows, square_mm=1.0)
    sizes = _complete_sizes([grid for picture in pictures for grid in find_checkerboards(picture, plain)], plain)
    count = max(sizes.values(), default=0)
    if count < len(pictures):
        return None
    cols, rows = max(size for size in sizes if sizes[size] == count)
    return (
        f"the pictures show a plain checkerboard of {cols} x {rows} squares, {_stated_kind(board)}: "
        'set kind = "checkerboard" there'
    )


def _stated_kind(board: CalibrationBoard) -> str:
    return f'board says kind = "{board.kind}"'


def _columns(pictures: Sequence[Grey], board: Charuco | AprilGrid, *, mirrored: bool) -> tuple[int, int]:
    """Number of columns and highest marker of a board of markers of a kind; 0, 0 if the pictures show none."""
    gridded = [GriddedPicture.of(picture, board) for picture in pictures]
    columns, vertical = _pairs(gridded, board, mirrored=mirrored).vertical(board).majority
    if len(vertical.highest) < MIN_VERTICAL * len(gridded):
        return 0, 0
    return columns, int(vertical.highest.max())


def _other_spacing(pictures: Sequence[Grey], board: AprilGrid) -> str | None:
    spacings = [spacing for picture in pictures if (spacing := tag_spacing(picture)) is not None]
    if not spacings or abs((spacing := float(np.median(spacings))) - board.spacing) < (
        MAX_SPACING_DIFFERENCE * board.spacing
    ):
        return None
    return (
        f"the gaps between the tags in the pictures look like {spacing:.3g} sides of a tag, board says spacing = "
        f"{board.spacing:g} (Kalibr's tagSpacing): set spacing = {spacing:.3g} there if that is what you measure"
    )


def _readable(gridded: Sequence[GriddedPicture], board: Charuco | AprilGrid, *, mirrored: bool) -> bool:
    vertical = _pairs(gridded, board, mirrored=mirrored).vertical(board).majority[1]
    return len(vertical.highest) >= MIN_VERTICAL * len(gridded)


def _pairs(gridded: Sequence[GriddedPicture], board: Charuco | AprilGrid, *, mirrored: bool) -> MarkerPairs:
    return MarkerPairs.join([marker_pairs(picture, board, mirrored=mirrored) for picture in gridded])
