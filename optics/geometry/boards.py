"""Calibration boards: the printed pattern and the positions of its corners.

The board frame has its origin at the top-left outer corner of the printed squares, x right, y down, z into the paper;
the printed side is seen from negative z. Corner ids run row by row from the top left. Detection measures lengths on a
print in units of the pitch, the mean distance between neighbouring corners (`pitch_mm`).
"""

from __future__ import annotations

import json
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, Self

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, RootModel, model_validator

from mirrorcam.core.arguments import AnyPath, path_of
from mirrorcam.core.bounds import PART_MM, Bounds
from mirrorcam.core.disk.files import LARGEST_TEXT_BYTES, keys_of, model_from, read_bytes, tables_of, write_text
from mirrorcam.core.disk.yaml_text import YAML_SUFFIXES, yaml_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, Value
from mirrorcam.optics.geometry import marker_dictionaries as dictionaries
from mirrorcam.optics.geometry.foreign_boards import SPACING, as_own_board

SQUARES = Bounds(3, 500)
MAX_MARKERS = 10000
TAGS = Bounds(2, 100)
TAG_FAMILY_NAME = "DICT_APRILTAG_36h11"
TAG_FAMILY = dictionaries.dictionary(TAG_FAMILY_NAME)
TAG_MODULES, TAG_BORDER = 10, 2  # modules along a side of a tag, including its black border; width of that border


def _is_default(value: float) -> bool:
    """Whether a value is the default, which is omitted so that files and digests of older boards do not change."""
    return not value


class _Grid(Value):
    """A board with squares in rows and columns."""

    cols: int = SQUARES.field(description="squares along x")
    rows: int = SQUARES.field(description="squares along y")
    square_mm: float = PART_MM.field(description="side of a square")
    inverted: bool = Field(
        default=False, exclude_if=_is_default, description="printed with black and white exchanged, markers as well"
    )

    @property
    def layout_text(self) -> str:
        """Number and size of the squares, for display."""
        return f"{self.cols} x {self.rows} squares of {self.square_mm:g} mm"

    @property
    def pitch_mm(self) -> float:
        """Mean distance between neighbouring corners."""
        return self.square_mm

    @property
    def longest_step(self) -> float:
        """Longest distance between neighbouring corners, in units of the pitch."""
        return 1.0

    @property
    def corner_counts(self) -> tuple[int, int]:
        """Number of corners along x and y."""
        return self.cols - 1, self.rows - 1

    @cached_property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the printed squares."""
        return self.cols * self.square_mm, self.rows * self.square_mm

    @cached_property
    def corners_in_board_mm(self) -> FloatArray:
        """Inner corners ((rows-1)*(cols-1), 3), row by row, z = 0."""
        y, x = np.mgrid[1 : self.rows, 1 : self.cols].reshape(2, -1) * self.square_mm
        return np.stack([x, y, np.zeros_like(x)], axis=1)


class Checkerboard(_Grid):
    """A plain checkerboard; its top-left square is black, or white if it is inverted.

    It looks different upside down if one side has an even and the other an odd number of squares. Otherwise it has a
    180 degree ambiguity that only a nominal layout resolves.
    """

    kind: Literal["checkerboard"] = "checkerboard"

    @property
    def name(self) -> str:
        """Name of this type of board."""
        return "checkerboard"

    @property
    def looks_same_upside_down(self) -> bool:
        return (self.rows + self.cols) % 2 == 0

    def image(self, px_per_square: int) -> NDArray[np.uint8]:
        """The printed squares (rows*p, cols*p), 0 black and 255 white."""
        row, col = np.mgrid[: self.rows, : self.cols]
        squares = np.where((row + col) % 2 == self.inverted, 0, 255).astype(np.uint8)
        return np.kron(squares, np.ones((px_per_square, px_per_square), dtype=np.uint8))


class Charuco(_Grid):
    """A checkerboard with an ArUco marker in each white square: any visible part identifies its corners.

    The top-left square is black, except in OpenCV's pattern before 4.6 with an even number of rows. Markers are
    numbered row by row. On an inverted board, black and white are exchanged, so that black squares hold the markers.
    """

    kind: Literal["charuco"] = "charuco"
    marker_mm: float = PART_MM.field(description="side of a marker, smaller than a square")
    dictionary: str = Field(default="DICT_4X4_250", description="OpenCV's name of the marker dictionary")
    legacy: bool = Field(
        default=False,
        exclude_if=_is_default,
        description="printed by OpenCV before 4.6 (setLegacyPattern): with an even number of rows, top-left is white",
    )
    first_marker: int = Field(
        default=0, ge=0, le=MAX_MARKERS, exclude_if=_is_default, description="id of the first marker"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.marker_mm >= self.square_mm:
            raise ValueError(f"marker_mm {self.marker_mm} is not smaller than square_mm {self.square_mm}")
        canonical = dictionaries.canonical_name(self.dictionary)
        if canonical is None:
            raise ValueError(
                f"dictionary {self.dictionary[:40]!r} is unknown, expected one of {', '.join(dictionaries.NAMES)}"
            )
        object.__setattr__(self, "dictionary", canonical)
        markers, available = self.first_marker + self.rows * self.cols // 2, dictionaries.count(canonical)
        if markers > available:
            from_first = f", starting at id {self.first_marker}" if self.first_marker else ""
            raise ValueError(
                f"{self.rows * self.cols // 2} markers are needed{from_first}, but {self.dictionary} has {available}"
            )
        return self

    @property
    def name(self) -> str:
        """Name of this type of board."""
        return "ChArUco"

    @property
    def marker_at_top_left(self) -> bool:
        """Whether the top-left square holds a marker."""
        return self.legacy and self.rows % 2 == 0

    @cached_property
    def black(self) -> NDArray[np.bool_]:
        """Mask (rows, cols) of the black squares."""
        row, col = np.mgrid[: self.rows, : self.cols]
        return np.asarray((row + col) % 2 == (self.marker_at_top_left != self.inverted))

    @cached_property
    def marker_squares(self) -> NDArray[np.int64]:
        """Row and column (m, 2) of each marker's square, by increasing id."""
        return np.argwhere(self.black == self.inverted)

    @cached_property
    def markers(self) -> NDArray[np.bool_]:
        """Masks (m, modules, modules) of the markers' white modules, including their borders."""
        white = dictionaries.white_modules(self.dictionary)
        return white[self.first_marker : self.first_marker + len(self.marker_squares)] != self.inverted

    @cached_property
    def opencv_board(self) -> cv2.aruco.CharucoBoard:
        """OpenCV's board with the same geometry and ids; OpenCV has no inverted ones."""
        dictionary = dictionaries.dictionary(self.dictionary)
        ids = self.first_marker + np.arange(len(self.marker_squares), dtype=np.int32)
        board = cv2.aruco.CharucoBoard((self.cols, self.rows), self.square_mm, self.marker_mm, dictionary, ids)
        board.setLegacyPattern(self.legacy)
        return board

    def image(self, px_per_square: int) -> NDArray[np.uint8]:
        """The printed squares and markers (rows*p, cols*p), 0 black and 255 white."""
        size = (self.cols * px_per_square, self.rows * px_per_square)
        image = np.asarray(self.opencv_board.generateImage(size, marginSize=0, borderBits=1), dtype=np.uint8)
        return 255 - image if self.inverted else image


class AprilGrid(Value):
    """Kalibr's grid of AprilTags of the family 36h11, with black squares where the gaps between the tags cross.

    It is drawn as by `kalibr_create_target_pdf` of github.com/ethz-asl/kalibr: tags have a border of two modules, ids
    run row by row from the *lower* left, and tags are rotated by 180 degrees relative to OpenCV's. Each corner of a tag
    touches the corner of a black square, also around the outer tags. The print is therefore a checkerboard of
    (2 cols + 1) x (2 rows + 1) squares, whose columns and rows are alternately a gap and a tag wide.

    Frame and corner ids follow the other boards here: from the top left, y down. Kalibr
    (`GridCalibrationTargetAprilgrid`) has its origin at the lower left corner of tag 0, y up, and numbers corners row
    by row from there: its corner `r * 2 cols + c` is `(2 rows - 1 - r) * 2 cols + c` here. It lists the corners of a
    tag as lower left, lower right, upper right, upper left.
    """

    kind: Literal["aprilgrid"] = "aprilgrid"
    cols: int = TAGS.field(description="tags along x")
    rows: int = TAGS.field(description="tags along y")
    tag_mm: float = PART_MM.field(description="side of a tag with its black border")
    spacing: float = SPACING.field(description="gap between tags, in sides of a tag: Kalibr's tagSpacing")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.cols * self.rows > len(TAG_FAMILY.bytesList):
            raise ValueError(f"{self.cols * self.rows} tags are needed but 36h11 has only {len(TAG_FAMILY.bytesList)}")
        return self

    @property
    def name(self) -> str:
        """Name of this type of board."""
        return "AprilGrid"

    @property
    def layout_text(self) -> str:
        """Number and size of the tags, for display."""
        return f"{self.cols} x {self.rows} tags of {self.tag_mm:g} mm"

    @property
    def gap_mm(self) -> float:
        """Gap between neighbouring tags; also the side of the black squares."""
        return self.spacing * self.tag_mm

    @property
    def pitch_mm(self) -> float:
        """Mean distance between neighbouring corners: half the pitch of the tags."""
        return (1.0 + self.spacing) * self.tag_mm / 2.0

    @property
    def longest_step(self) -> float:
        """Longest distance between neighbouring corners, in units of the pitch."""
        return 2.0 / (1.0 + self.spacing)

    @property
    def corner_counts(self) -> tuple[int, int]:
        """Number of corners along x and y."""
        return 2 * self.cols, 2 * self.rows

    @cached_property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the printed squares."""
        width, height = (n * self.tag_mm + (n + 1) * self.gap_mm for n in (self.cols, self.rows))
        return width, height

    @cached_property
    def corners_in_board_mm(self) -> FloatArray:
        """Corners of the tags (4*rows*cols, 3), row by row, z = 0."""
        row, col = np.mgrid[: 2 * self.rows, : 2 * self.cols].reshape(2, -1)
        x, y = self.line_mm(col), self.line_mm(row)
        return np.stack([x, y, np.zeros_like(x)], axis=1)

    def line_mm(self, index: NDArray[np.int64]) -> FloatArray:
        """Coordinates along x or y of the lines of corners with given indices, extrapolated beyond the print."""
        return np.asarray(self.gap_mm + index // 2 * 2.0 * self.pitch_mm + index % 2 * self.tag_mm)

    def tag(self, number: int) -> NDArray[np.bool_]:
        """Mask (10, 10) of the black modules of a printed tag."""
        image = TAG_FAMILY.generateImageMarker(number, TAG_MODULES, borderBits=TAG_BORDER)
        return np.asarray(np.rot90(image, 2) == 0)

    @cached_property
    def tag_numbers(self) -> NDArray[np.int64]:
        """The ids (rows, cols) of the tags."""
        return np.arange(self.rows * self.cols).reshape(self.rows, self.cols)[::-1]

    @cached_property
    def black(self) -> NDArray[np.bool_]:
        """Mask (11 rows + 1, 11 cols + 1) of the black cells of the print: gaps are one cell, tags one per module."""
        step = TAG_MODULES + 1
        cells = np.zeros((step * self.rows + 1, step * self.cols + 1), dtype=bool)
        cells[::step, ::step] = True
        for (row, col), number in np.ndenumerate(self.tag_numbers.astype(object)):
            cells[step * row + 1 : step * row + step, step * col + 1 : step * col + step] = self.tag(number)
        return cells

    def cell_edges(self, tags: int, *, tag: float, gap: float) -> FloatArray:
        """Borders (11 tags + 2,) of the cells along x or y, for given sides of a tag and a gap."""
        sides = [gap, *([tag / TAG_MODULES] * TAG_MODULES)] * tags
        return np.cumsum([0.0, *sides, gap])

    def image(self, px_per_tag: int) -> NDArray[np.uint8]:
        """The print with gaps rounded to pixels, 0 black and 255 white; `px_per_tag` is a multiple of 10."""
        gap = round(self.spacing * px_per_tag)
        x, y = (
            np.diff(self.cell_edges(tags, tag=px_per_tag, gap=gap)).round().astype(int)
            for tags in (self.cols, self.rows)
        )
        return np.where(np.repeat(np.repeat(self.black, y, axis=0), x, axis=1), 0, 255).astype(np.uint8)


# Any board; in a file, `kind` selects the class.
CalibrationBoard = Annotated[Checkerboard | Charuco | AprilGrid, Field(discriminator="kind")]


class _BoardFile(RootModel[CalibrationBoard]):
    """The content of `board.toml`."""


def default_board() -> Charuco:
    """The default board of rendered sets, which fills the common field of the default layout at 300 to 500 mm."""
    return Charuco(cols=20, rows=14, square_mm=12.0, marker_mm=8.4)


def load_board(path: AnyPath) -> CalibrationBoard:
    """Read `board.toml`, or a board as anipose, caliscope or Kalibr describe it.

    Parameters
    ----------
    path
        TOML file, or YAML file of Kalibr; lengths of other programs are converted to mm.

    Returns
    -------
    Checkerboard, Charuco or AprilGrid
        The board.

    Raises
    ------
    InputError
        If the file is missing or describes no board that can be detected.
    """
    path = path_of("path", path)
    raw = read_bytes(path, LARGEST_TEXT_BYTES)
    values = yaml_of(path, raw) if path.suffix.lower() in YAML_SUFFIXES else tables_of(path, raw)
    try:
        own = as_own_board(values)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return model_from(_BoardFile, path, own).root


def is_own_board(path: Path) -> bool:
    """Return whether a file is a `board.toml`, not another program's description of a board."""
    return path.suffix.lower() not in YAML_SUFFIXES and "kind" in keys_of(path, read_bytes(path, LARGEST_TEXT_BYTES))


def save_board(path: Path, board: CalibrationBoard) -> None:
    """Write `board.toml` atomically."""
    lines = (f"{name} = {json.dumps(value)}" for name, value in board.model_dump().items())
    write_text(path, "\n".join(lines) + "\n")
