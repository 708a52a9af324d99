"""Corners of the boards in a set, from OpenCV's own detectors, in the flipped frame, view by view."""

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
from mirrorcam.optics.geometry.boards import CalibrationBoard, Charuco, Checkerboard, load_board
from mirrorcam.optics.geometry.layout import Layout

MIN_CORNERS = 8
"""Minimum number of corners for the pose of a board."""
EDGE_PX = 6.0
"""Corners nearer to the edge of a view are not used."""
BLANK = 127
"""Grey level that replaces the parts of other mirrors, whose boards have the same markers."""


@dataclass(frozen=True)
class DetectedBoard:
    """Corners of a board in one view of one frame: their numbers (n,) and pixels (n, 2) in the flipped frame."""

    corner: NDArray[np.int64]
    pixels: FloatArray


@dataclass(frozen=True)
class SetCorners:
    """The inputs of a calibrator with OpenCV.

    Attributes
    ----------
    names
        Names of the views.
    flip
        How frames were flipped.
    size_px
        Width and height of a frame.
    matrix
        Camera matrix (3, 3) of the flipped frame, from the data sheet.
    points_in_board
        Corners (m, 3) of the board, mm.
    seen
        Detected boards, by frame and view.
    """

    names: tuple[str, ...]
    flip: Flip
    size_px: tuple[int, int]
    matrix: FloatArray
    points_in_board: FloatArray
    seen: dict[tuple[int, int], DetectedBoard]


def corners_of_set(folder: Path) -> SetCorners:
    """Detect the corners in the `frames` of a rendered set; it reads only these, `layout.json` and `board.toml`.

    Raises InputError for a set without frames, and for a board for which OpenCV has no detector.
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
            detected = _in_view(flipped, view, board)
            if detected is not None:
                seen[frame, number] = detected
    return SetCorners(
        names=tuple(view.name for view in views),
        flip=views[0].flip,
        size_px=(layout.camera.width_px, layout.camera.height_px),
        matrix=views[0].camera.matrix,
        points_in_board=board.corners_in_board_mm,
        seen=seen,
    )


def _in_view(flipped: NDArray[np.uint8], view: VirtualCamera, board: CalibrationBoard) -> DetectedBoard | None:
    """Return the board in a mirror's part of the flipped frame (h, w); None if too few corners are detected."""
    part = view.sub_image
    in_mirror = view.mask[part.slices] > 0
    picture = np.where(in_mirror, flipped[part.slices], BLANK).astype(np.uint8)
    if isinstance(board, Charuco):
        detected, ids, _, _ = cv2.aruco.CharucoDetector(board.opencv_board).detectBoard(picture)
        if ids is None:
            return None
        corner, pixels = np.ravel(ids).astype(np.int64), np.reshape(detected, (-1, 2)).astype(np.float64)
    else:
        is_detected, detected = cv2.findChessboardCornersSB(picture, board.corner_counts)
        if not is_detected:
            return None
        pixels = np.reshape(detected, (-1, 2)).astype(np.float64)
        corner = np.arange(len(pixels))
    from_edge = cv2.distanceTransform(np.pad(in_mirror.astype(np.uint8), 1), cv2.DIST_L2, 5)[1:-1, 1:-1]
    column, row = np.clip(np.rint(pixels).astype(int), 0, [part.width - 1, part.height - 1]).T
    used = from_edge[row, column] > EDGE_PX
    if used.sum() < MIN_CORNERS:
        return None
    return DetectedBoard(corner[used], pixels[used] + [part.x, part.y])
