"""Corners of the boards in a set by OpenCV's own detectors, in the flipped frame, a view at a time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.write.virtual_cameras import Flip, VirtualCamera, virtual_cameras
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Charuco, Checkerboard, Target, load_board

FEWEST = 8
"""Corners of a board that are worth a pose."""
EDGE_PX = 6.0
"""Corners nearer to the edge of a view are not used."""
BLANK = 127
"""Grey level of what belongs to other mirrors, whose boards have the same markers."""


@dataclass(frozen=True)
class SeenBoard:
    """Corners of one board in one picture of one view: their numbers (n,) and pixels (n, 2) of the flipped frame."""

    corner: NDArray[np.int64]
    pixels: FloatArray


@dataclass(frozen=True)
class SetCorners:
    """What a calibrator with OpenCV knows of a set.

    Attributes
    ----------
    names
        Names of the views.
    flip
        How frames were flipped.
    size_px
        Width and height of a frame.
    matrix
        Camera matrix (3, 3) of the flipped frame by the data sheet.
    points_in_board
        Corners (m, 3) of the board, mm.
    seen
        Boards by frame and view.
    """

    names: tuple[str, ...]
    flip: Flip
    size_px: tuple[int, int]
    matrix: FloatArray
    points_in_board: FloatArray
    seen: dict[tuple[int, int], SeenBoard]


def corners_of_set(folder: Path) -> SetCorners:
    """Find the corners in the `frames` of a rendered set, of which nothing but `layout.json` and `board.toml` is read.

    Raises InputError for a set without frames, and for a board that OpenCV has no detector of.
    """
    layout = Layout.load(folder / "layout.json")
    frames = sorted((folder / "frames").glob("*"))
    if not frames:
        raise InputError(f"{folder}: no frames, expected pictures in the folder frames")
    board = load_board(folder / "board.toml")
    if not isinstance(board, Charuco | Checkerboard):
        raise InputError(f"{folder}: an AprilGrid, expected a ChArUco board or a checkerboard")
    views = virtual_cameras(layout)
    seen = {}
    for frame, path in enumerate(frames):
        flipped = np.ascontiguousarray(views[0].flipped(read_image(path, grey=True)))
        for number, view in enumerate(views):
            found = _in_view(flipped, view, board)
            if found is not None:
                seen[frame, number] = found
    return SetCorners(
        names=tuple(view.name for view in views),
        flip=views[0].flip,
        size_px=(layout.camera.width_px, layout.camera.height_px),
        matrix=views[0].camera.matrix,
        points_in_board=board.corners_in_board_mm,
        seen=seen,
    )


def _in_view(flipped: NDArray[np.uint8], view: VirtualCamera, board: Target) -> SeenBoard | None:
    """The board in the part of the flipped frame (h, w) that a mirror is to show; None where too little is found."""
    part = view.sub_image
    shown_by_mirror = view.mask[part.slices] > 0
    picture = np.where(shown_by_mirror, flipped[part.slices], BLANK).astype(np.uint8)
    if isinstance(board, Charuco):
        found, ids, _, _ = cv2.aruco.CharucoDetector(board.opencv_board).detectBoard(picture)
        if ids is None:
            return None
        corner, pixels = np.ravel(ids).astype(np.int64), np.reshape(found, (-1, 2)).astype(np.float64)
    else:
        shown, found = cv2.findChessboardCornersSB(picture, board.corner_counts)
        if not shown:
            return None
        pixels = np.reshape(found, (-1, 2)).astype(np.float64)
        corner = np.arange(len(pixels))
    from_edge = cv2.distanceTransform(np.pad(shown_by_mirror.astype(np.uint8), 1), cv2.DIST_L2, 5)[1:-1, 1:-1]
    column, row = np.clip(np.rint(pixels).astype(int), 0, [part.width - 1, part.height - 1]).T
    kept = from_edge[row, column] > EDGE_PX
    if kept.sum() < FEWEST:
        return None
    return SeenBoard(corner[kept], pixels[kept] + [part.x, part.y])
