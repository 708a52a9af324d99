"""mrcal's corners.vnl: a line for each corner of the board in each picture, in the order of the corners.

The columns are `filename x y`, and `level` or `weight` where the detector states how sure it is. "-" stands for a
corner that was not seen, and a single line of them for a picture without a board. A corner has no number but its place,
and a picture no view (`mrcal.compute_chessboard_corners`): such files can only hold pictures of the bare camera.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from mirrorcam.core.values import InputError

SUFFIX = ".vnl"
COLUMNS = ("filename", "x", "y")
SURE = ("level", "weight")
HIGHEST_LEVEL = 9
_VIEW = re.compile(r"view_\d+_\d+")


def is_vnl(path: Path, lines: list[str]) -> bool:
    """Whether a file is one by its name, or by the names of columns that begin it."""
    return path.suffix.lower() == SUFFIX or _legend(lines)[:3] == COLUMNS


def vnl_rows(path: Path, lines: list[str], corners: int, view: str) -> Iterator[tuple[int, dict[str, str]]]:
    """Line numbers and cells of the corners that are seen, as a table of our own has them, all of one view.

    Raises InputError in one line, which names the format, where the file is not what mrcal reads for this board.
    """
    legend = _legend(lines)
    if legend and (legend[:3] != COLUMNS or len(legend) > 4):
        raise _wrong(path, f"columns {' '.join(legend)[:60]!r}, expected {' '.join(COLUMNS)} and level or weight")
    weighted, listed = legend[3:] == ("weight",), dict[str, int]()
    ended, picture = set[str](), ""
    for number, line in enumerate(lines, start=1):
        cells = line.split()
        if not cells or line.lstrip().startswith("#"):
            continue
        if not 3 <= len(cells) <= 4:
            raise _wrong(path, f"line {number}: {len(cells)} values, expected a file name, x, y and level or weight")
        if cells[0] != picture:
            _refuse_short(path, picture, listed.get(picture, corners), corners)
            if cells[0] in ended:
                raise _wrong(path, f"line {number}: {cells[0][:40]!r} again, expected the lines of a picture together")
            if _VIEW.search(cells[0]):
                raise _wrong(
                    path, f"{cells[0][:40]!r} is of a mirror, expected a table like corners.csv, with its view"
                )
            picture = cells[0]
            ended.add(picture)
        listed[picture] = listed.get(picture, 0) + 1
        sigma = _sigma_px(path, number, cells[3:], weighted=weighted)
        if sigma and not any(cell.startswith("-") for cell in cells[1:3]):  # negative pixels do not count, as in mrcal
            row = {"picture": picture, "view": view, "corner": f"{listed[picture] - 1}"}
            yield number, row | {"x_px": cells[1], "y_px": cells[2], "sigma_px": sigma}
    _refuse_short(path, picture, listed.get(picture, corners), corners)


def _legend(lines: list[str]) -> tuple[str, ...]:
    """The names of columns: the first line that begins with one #, as vnlog has it."""
    first = next((line for line in lines if re.match(r"\s*#(?![#!])", line)), "")
    return tuple(first.strip().removeprefix("#").split())


def _sigma_px(path: Path, number: int, cells: list[str], *, weighted: bool) -> str:
    """The standard deviation up to a factor, 2 ** level or 1 / weight; empty of a corner that does not count."""
    if not cells:
        return "1"
    if cells[0] == "-":
        return ""
    try:
        value = float(cells[0])
        sigma = (1.0 / value if value > 0.0 else 0.0) if weighted else 2.0**value if value >= 0.0 else 0.0
    except (ValueError, OverflowError):
        sigma = -1.0
    if not 0.0 <= sigma <= 2.0**HIGHEST_LEVEL:
        raise _wrong(path, f"line {number}: {cells[0][:40]!r}, expected a level up to {HIGHEST_LEVEL}, a weight, or -")
    return f"{sigma!r}" if sigma else ""


def _refuse_short(path: Path, picture: str, lines: int, corners: int) -> None:
    """Raise InputError for a picture that lists some corners and not all; a single line is of one without a board."""
    if lines not in (1, corners):
        raise _wrong(path, f"{picture[:60]!r} has {lines} lines, expected {corners}, one for each corner of the board")


def _wrong(path: Path, what: str) -> InputError:
    return InputError(f"{path}: an mrcal .vnl: {what}")
