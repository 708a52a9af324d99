"""Corners as a table, or as mrcal's corners.vnl, to exchange them with other detectors and solvers.

A table has one line per corner and view. A corners.vnl has the columns `filename x y`, and `level` or `weight` if the
detector states its confidence. It lists every corner of the board in each picture, in board order: "-" marks a corner
that was not detected, and a single line of "-" a picture without a board. Only the order numbers the corners, and no
column names a view (`mrcal.compute_chessboard_corners`), so corners.vnl can only hold pictures of the bare camera.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mirrorcam.core.disk.files import atomic, read_lines
from mirrorcam.core.errors import InputError
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.solver.observations import DIRECT, MIN_CORNERS, Observations
from mirrorcam.optics.geometry.layout import Layout

REQUIRED = ("picture", "view", "corner", "x_px", "y_px")
OPTIONAL = ("sigma_px", "used")
DIRECT_NAME = "direct"
HEADER = """\
# Corners of a calibration board: mirrorcam.corners/1
# picture: name of the picture; view: mirror as row-column from 0 (its number in a pattern), or direct
# corner: inner corners of the board, numbered row by row from 0 at the top left of the print
# x_px right, y_px down: pixel (0, 0) is the centre of the top-left pixel; frames as the camera gives them, not flipped
# sigma_px: standard deviation per axis; used: 1, or 0 where the corner was left out of the fit
"""
SUFFIX = ".vnl"
VNL_COLUMNS = ("filename", "x", "y")
MAX_LEVEL = 9
_VIEW = re.compile(r"view_\d+_\d+")


@dataclass(frozen=True)
class CornerTable:
    """Corners of a file, keyed by picture name in the order of the file.

    Attributes
    ----------
    mirrored, base
        The corners of each picture via the mirrors, and of each by the bare camera, all numbered frame 0.
    notes
        Notes on corners left out.
    """

    mirrored: dict[str, Observations]
    base: dict[str, Observations]
    notes: tuple[str, ...]


def save_corners(path: Path, calibration: Calibration) -> None:
    """Write the corners of a calibration atomically, with those rejected as outliers marked."""
    names = {DIRECT: DIRECT_NAME} | dict(enumerate(calibration.layout.mirror_names))
    pictures = [" ".join(name.splitlines()) for name in calibration.pictures]
    rows = calibration.observations
    columns = (rows.frame, rows.view, rows.corner, rows.pixels, calibration.corner_sigma_px, calibration.inliers)
    # File names may hold bytes that are not text.
    with atomic(path) as temporary, temporary.open("w", encoding="utf-8", errors="replace", newline="") as file:
        file.write(HEADER)
        table = csv.writer(file, lineterminator="\n")
        table.writerow((*REQUIRED, *OPTIONAL))
        for frame, view, corner, (x, y), sigma, used in zip(*(column.tolist() for column in columns), strict=True):
            table.writerow((pictures[frame], names[view], corner, f"{x:.6f}", f"{y:.6f}", f"{sigma:.6g}", int(used)))


def load_corners(path: Path, layout: Layout, corners: int) -> CornerTable:
    """Read a table of corners, without those marked 0 in the column `used`.

    Parameters
    ----------
    path
        A CSV file with the columns `REQUIRED`, and optionally those of `OPTIONAL`; lines that begin with # before the
        header are comments. Or mrcal's corners.vnl, for pictures of the bare camera.
    layout
        The layout whose mirrors name the views and whose camera took the pictures.
    corners
        Number of corners of the board.

    Raises
    ------
    InputError
        If the file cannot be read or a line is invalid; the message names the line.
    """
    reader, weighted = _Reader(path, layout, corners), False
    pictures: dict[str, _Picture] = {}
    for line, row in _rows(path, corners):
        parsed = reader.corner(line, row)
        weighted = (parsed.sigma_px is not None) if not pictures else weighted
        if weighted != (parsed.sigma_px is not None):
            raise reader.invalid(line, "sigma_px", row, "a number in every line, or in none")
        picture = pictures.setdefault(row["picture"], _Picture(parsed.view == DIRECT))
        if picture.direct != (parsed.view == DIRECT):
            raise reader.invalid(line, "view", row, "pictures that show the board in mirrors or directly, not both")
        if (parsed.view, parsed.corner) in picture.corners:
            raise reader.invalid(line, "corner", row, "each corner of a view once in a picture")
        picture.corners[parsed.view, parsed.corner] = parsed
    if not pictures:
        raise InputError(f"{path}: no corners, expected lines with the columns {', '.join(REQUIRED)}")
    tables = {name: picture.observations() for name, picture in pictures.items()}
    left_out = sum(len(picture.used()) - len(tables[name]) for name, picture in pictures.items())
    return CornerTable(
        mirrored={name: tables[name] for name, picture in pictures.items() if not picture.direct},
        base={name: tables[name] for name, picture in pictures.items() if picture.direct},
        notes=(f"{path.name}: {left_out} corners in views of fewer than {MIN_CORNERS}, not used",) if left_out else (),
    )


@dataclass(frozen=True)
class _Corner:
    """One line of a table."""

    view: int
    corner: int
    pixel: tuple[float, float]
    sigma_px: float | None
    used: bool


@dataclass(frozen=True)
class _Picture:
    """The lines of one picture, by view and corner."""

    direct: bool
    corners: dict[tuple[int, int], _Corner] = field(default_factory=dict)

    def used(self) -> list[_Corner]:
        return [corner for corner in self.corners.values() if corner.used]

    def observations(self) -> Observations:
        """The used corners of all views that have at least `MIN_CORNERS` of them."""
        parts = []
        used = self.used()
        for view in sorted({corner.view for corner in used}):
            rows = [corner for corner in used if corner.view == view]
            if len(rows) >= MIN_CORNERS:
                ids, sigmas = np.array([row.corner for row in rows]), np.array([row.sigma_px or 1.0 for row in rows])
                parts.append(Observations.of_view(0, view, ids, np.array([row.pixel for row in rows]), sigmas))
        return Observations.join(parts)


def _rows(path: Path, corners: int) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield line numbers, and cells by column."""
    try:
        lines = [line.decode("utf-8") for line in read_lines(path)]
        lines[0] = lines[0].removeprefix("\ufeff")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not text in UTF-8, expected a table of corners") from None
    if is_vnl(path, lines):
        yield from vnl_rows(path, lines, corners, DIRECT_NAME)
        return
    columns: Sequence[str] = ()
    for number, line in enumerate(lines, start=1):
        if not line.strip() or (not columns and line.startswith("#")):
            continue
        try:
            cells = [cell.strip() for cell in next(csv.reader([line.rstrip("\r")], strict=True))]
        except csv.Error as error:
            raise InputError(f"{path}, line {number}: {error}, expected cells between commas") from None
        if not columns:
            columns = _columns(path, number, cells)
        elif len(cells) != len(columns):
            raise InputError(
                f"{path}, line {number}: {len(cells)} cells, expected {len(columns)}: {', '.join(columns)}"
            )
        else:
            yield number, dict(zip(columns, cells, strict=True))


def _columns(path: Path, line: int, cells: Sequence[str]) -> Sequence[str]:
    """Check the column names of the header and return them."""
    missing = [name for name in REQUIRED if name not in cells]
    unknown = [name for name in cells if name not in (*REQUIRED, *OPTIONAL)]
    if missing or unknown or len(set(cells)) != len(cells):
        raise InputError(
            f"{path}, line {line}: expected the columns {', '.join(REQUIRED)} and optionally {' and '.join(OPTIONAL)}"
        )
    return cells


@dataclass(frozen=True)
class _Reader:
    """Checks the cells of a file's lines."""

    path: Path
    layout: Layout
    corners: int

    def corner(self, line: int, row: Mapping[str, str]) -> _Corner:
        """Return the corner of a line."""
        views = {DIRECT_NAME: DIRECT} | {name: view for view, name in enumerate(self.layout.mirror_names)}
        if row["view"] not in views:
            names = self.layout.mirror_names
            raise self.invalid(line, "view", row, f"direct or a mirror from {names[0]} to {names[-1]}")
        if not row["picture"]:
            raise self.invalid(line, "picture", row, "a name")
        number = row["corner"]
        if not (number.isascii() and number.isdigit() and len(number) < 10 and int(number) < self.corners):
            raise self.invalid(line, "corner", row, f"a whole number from 0 to {self.corners - 1}, as the board has")
        camera = self.layout.camera
        pixel = tuple(
            self._number(line, name, row, -0.5, size - 0.5)
            for name, size in (("x_px", camera.width_px), ("y_px", camera.height_px))
        )
        sigma_px = self._number(line, "sigma_px", row, 1e-6, 1e3) if row.get("sigma_px") else None
        if row.get("used", "1") not in ("0", "1"):
            raise self.invalid(line, "used", row, "0 or 1")
        return _Corner(views[row["view"]], int(number), (pixel[0], pixel[1]), sigma_px, row.get("used") != "0")

    def _number(self, line: int, name: str, row: Mapping[str, str], minimum: float, maximum: float) -> float:
        try:
            value = float(row[name])
        except ValueError:
            value = math.nan
        if not minimum <= value <= maximum:
            raise self.invalid(line, name, row, f"a number from {minimum:g} to {maximum:g}")
        return value

    def invalid(self, line: int, name: str, row: Mapping[str, str], expected: str) -> InputError:
        """Return the error for an invalid cell."""
        return InputError(f"{self.path}, line {line}: {name} {row.get(name, '')[:40]!r}, expected {expected}")


def is_vnl(path: Path, lines: list[str]) -> bool:
    """Return whether a file is a corners.vnl, by its suffix or by its column names."""
    return path.suffix.lower() == SUFFIX or _legend(lines)[:3] == VNL_COLUMNS


def vnl_rows(path: Path, lines: list[str], corners: int, view: str) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield line numbers and cells of the detected corners, in the columns of a table, all with one view name.

    Raises InputError, with a one-line message that names the format, if mrcal would not accept the file for this board.
    """
    legend = _legend(lines)
    if legend and (legend[:3] != VNL_COLUMNS or len(legend) > 4):
        raise _invalid(path, f"columns {' '.join(legend)[:60]!r}, expected {' '.join(VNL_COLUMNS)} and level or weight")
    weighted, listed = legend[3:] == ("weight",), dict[str, int]()
    earlier, picture = set[str](), ""
    for number, line in enumerate(lines, start=1):
        cells = line.split()
        if not cells or line.lstrip().startswith("#"):
            continue
        if not 3 <= len(cells) <= 4:
            raise _invalid(path, f"line {number}: {len(cells)} values, expected a file name, x, y and level or weight")
        if cells[0] != picture:
            _refuse_short(path, picture, listed.get(picture, corners), corners)
            if cells[0] in earlier:
                raise _invalid(
                    path, f"line {number}: {cells[0][:40]!r} again, expected all lines of a picture together"
                )
            if _VIEW.search(cells[0]):
                raise _invalid(
                    path, f"{cells[0][:40]!r} is a mirror's view, expected a table like corners.csv, with a column view"
                )
            picture = cells[0]
            earlier.add(picture)
        listed[picture] = listed.get(picture, 0) + 1
        sigma = _sigma_px(path, number, cells[3:], weighted=weighted)
        if sigma and not any(cell.startswith("-") for cell in cells[1:3]):  # mrcal also ignores negative pixels
            row = {"picture": picture, "view": view, "corner": f"{listed[picture] - 1}"}
            yield number, row | {"x_px": cells[1], "y_px": cells[2], "sigma_px": sigma}
    _refuse_short(path, picture, listed.get(picture, corners), corners)


def _legend(lines: list[str]) -> tuple[str, ...]:
    """The column names: the first line that begins with a single #, as vnlog defines it."""
    first = next((line for line in lines if re.match(r"\s*#(?![#!])", line)), "")
    return tuple(first.strip().removeprefix("#").split())


def _sigma_px(path: Path, number: int, cells: list[str], *, weighted: bool) -> str:
    """Relative standard deviation, 2 ** level or 1 / weight; empty for a corner that is ignored."""
    if not cells:
        return "1"
    if cells[0] == "-":
        return ""
    try:
        value = float(cells[0])
        sigma = (1.0 / value if value > 0.0 else 0.0) if weighted else 2.0**value if value >= 0.0 else 0.0
    except (ValueError, OverflowError):
        sigma = -1.0
    if not 0.0 <= sigma <= 2.0**MAX_LEVEL:
        raise _invalid(path, f"line {number}: {cells[0][:40]!r}, expected a level up to {MAX_LEVEL}, a weight, or -")
    return f"{sigma!r}" if sigma else ""


def _refuse_short(path: Path, picture: str, lines: int, corners: int) -> None:
    """Raise InputError unless a picture lists all corners, or has a single line, which means no board."""
    if lines not in (1, corners):
        raise _invalid(
            path, f"{picture[:60]!r} has {lines} lines, expected {corners}, one for each corner of the board"
        )


def _invalid(path: Path, problem: str) -> InputError:
    return InputError(f"{path}: an mrcal .vnl: {problem}")
