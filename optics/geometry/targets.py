"""Calibration targets: the printed pattern and the positions of its corners.

The board frame has its origin at the top-left outer corner of the printed squares, x right, y down, z into the paper:
the printed side is seen from negative z. Corner ids run row by row from the top left.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, Self

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, RootModel, model_validator

from mirrorcam.optics.base.bounds import PART_MM, Bounds
from mirrorcam.optics.base.files import read_model, write_text
from mirrorcam.optics.base.values import FloatArray, Value

# Modules along one side of a marker of each dictionary, with its black border.
DICTIONARIES = {
    "DICT_4X4_50": (cv2.aruco.DICT_4X4_50, 6),
    "DICT_4X4_100": (cv2.aruco.DICT_4X4_100, 6),
    "DICT_4X4_250": (cv2.aruco.DICT_4X4_250, 6),
    "DICT_4X4_1000": (cv2.aruco.DICT_4X4_1000, 6),
    "DICT_5X5_100": (cv2.aruco.DICT_5X5_100, 7),
    "DICT_5X5_250": (cv2.aruco.DICT_5X5_250, 7),
    "DICT_5X5_1000": (cv2.aruco.DICT_5X5_1000, 7),
}

SQUARES = Bounds(3, 500)


class _Grid(Value):
    """A target of squares."""

    cols: int = SQUARES.field(description="squares along x")
    rows: int = SQUARES.field(description="squares along y")
    square_mm: float = PART_MM.field(description="side of a square")

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
    """A plain checkerboard; its top-left square is black.

    An even number of squares along one side and an odd number along the other make it look different upside down;
    otherwise it has a 180 degree ambiguity that only a nominal layout resolves.
    """

    kind: Literal["checkerboard"] = "checkerboard"

    @property
    def looks_same_upside_down(self) -> bool:
        return (self.rows + self.cols) % 2 == 0

    def image(self, px_per_square: int) -> NDArray[np.uint8]:
        """The squares (rows*p, cols*p) as they are printed, 0 black and 255 white."""
        row, col = np.mgrid[: self.rows, : self.cols]
        squares = np.where((row + col) % 2 == 0, 0, 255).astype(np.uint8)
        return np.kron(squares, np.ones((px_per_square, px_per_square), dtype=np.uint8))


class Charuco(_Grid):
    """A checkerboard with an ArUco marker in each white square: any part of it identifies its corners."""

    kind: Literal["charuco"] = "charuco"
    marker_mm: float = PART_MM.field(description="side of a marker, smaller than a square")
    dictionary: str = Field(default="DICT_4X4_250", description="OpenCV's name of the marker dictionary")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.marker_mm >= self.square_mm:
            raise ValueError(f"marker_mm {self.marker_mm} is not smaller than square_mm {self.square_mm}")
        if self.dictionary not in DICTIONARIES:
            raise ValueError(f"dictionary {self.dictionary!r} is unknown, expected one of {', '.join(DICTIONARIES)}")
        markers, available = self.rows * self.cols // 2, int(self.dictionary.rsplit("_", 1)[1])
        if markers > available:
            raise ValueError(f"{markers} markers are needed, {self.dictionary} has {available}")
        return self

    @cached_property
    def opencv(self) -> cv2.aruco.CharucoBoard:
        """OpenCV's board with the same geometry and ids."""
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARIES[self.dictionary][0])
        return cv2.aruco.CharucoBoard((self.cols, self.rows), self.square_mm, self.marker_mm, dictionary)

    def image(self, px_per_square: int) -> NDArray[np.uint8]:
        """The squares with their markers (rows*p, cols*p) as they are printed, 0 black and 255 white."""
        size = (self.cols * px_per_square, self.rows * px_per_square)
        return np.asarray(self.opencv.generateImage(size, marginSize=0, borderBits=1), dtype=np.uint8)


# Any board; read from a file, its `kind` says which.
Target = Annotated[Checkerboard | Charuco, Field(discriminator="kind")]


class _BoardFile(RootModel[Target]):
    """The content of `board.toml`."""


def default_board() -> Charuco:
    """The default board of rendered sets, which fills the common field of the default layout at 300 to 500 mm."""
    return Charuco(cols=20, rows=14, square_mm=12.0, marker_mm=8.4)


def load_board(path: Path) -> Target:
    """Read `board.toml`, or raise InputError in one line."""
    return read_model(_BoardFile, path).root


def save_board(path: Path, target: Target) -> None:
    """Write `board.toml` atomically."""
    lines = (
        f"{name} = {value!r}" if not isinstance(value, str) else f'{name} = "{value}"'
        for name, value in target.model_dump().items()
    )
    write_text(path, "\n".join(lines) + "\n")
