"""Each mirror as a separate camera: `python -m benchmarks.calibrators.opencv_per_view SET OUT`.

What a user of OpenCV tries first: the flipped frames are the pictures of nine cameras, and `cv2.calibrateCamera`
calibrates each alone, although its principal point is far outside its part of the picture. Relative poses are means
over the boards that two views share. Writes OUT, a FileStorage in YAML.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from benchmarks.calibrators.command_line import run
from benchmarks.calibrators.set_corners import DetectedBoard, SetCorners, corners_of_set
from benchmarks.calibrators.view_poses import OpencvCamera, view_from_reference, write_cameras
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid

MIN_BOARDS = 3
OUTLIER = 3.0
"""Corners with errors of more than this many times the root mean square are omitted from a second fit."""


def calibrate_per_view(corners: SetCorners) -> tuple[OpencvCamera, ...]:
    """Calibrate every view alone; raises InputError for one with too few boards."""
    poses: dict[tuple[int, int], FloatArray] = {}
    lenses = []
    for view, name in enumerate(corners.names):
        boards = {frame: board for (frame, number), board in corners.seen.items() if number == view}
        if len(boards) < MIN_BOARDS:
            raise InputError(f"{name}: {len(boards)} boards, expected at least {MIN_BOARDS}")
        matrix, distortion, board_poses = _calibrate(corners, boards)
        inliers = _without_outliers(corners, boards, matrix, distortion, board_poses)
        matrix, distortion, board_poses = _calibrate(corners, inliers)
        lenses.append((matrix, distortion))
        poses |= {(frame, view): pose for frame, pose in board_poses.items()}
    _, view_poses = view_from_reference(poses, len(corners.names))
    return tuple(
        OpencvCamera(name, *lens, pose) for name, lens, pose in zip(corners.names, lenses, view_poses, strict=True)
    )


def _calibrate(
    corners: SetCorners, boards: dict[int, DetectedBoard]
) -> tuple[FloatArray, FloatArray, dict[int, FloatArray]]:
    """Return the camera matrix, the distortion (5,), and the pose of the board in each frame."""
    objects = [corners.points_in_board[board.corner].astype(np.float32) for board in boards.values()]
    pixels = [board.pixels.astype(np.float32) for board in boards.values()]
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3
    _, matrix, distortion, rotations, shifts = cv2.calibrateCamera(
        objects, pixels, corners.size_px, corners.matrix.copy(), np.zeros(5), flags=flags
    )
    poses = {
        frame: rigid(cv2.Rodrigues(rotation)[0], np.ravel(shift))
        for frame, rotation, shift in zip(boards, rotations, shifts, strict=True)
    }
    return np.asarray(matrix, dtype=np.float64), np.ravel(distortion)[:5].astype(np.float64), poses


def _without_outliers(
    corners: SetCorners,
    boards: dict[int, DetectedBoard],
    matrix: FloatArray,
    distortion: FloatArray,
    poses: dict[int, FloatArray],
) -> dict[int, DetectedBoard]:
    errors = {}
    for frame, board in boards.items():
        rotation, shift = cv2.Rodrigues(poses[frame][:3, :3])[0], poses[frame][:3, 3]
        projected, _ = cv2.projectPoints(corners.points_in_board[board.corner], rotation, shift, matrix, distortion)
        errors[frame] = np.linalg.norm(np.reshape(projected, (-1, 2)) - board.pixels, axis=1)
    max_error = OUTLIER * np.sqrt(np.mean(np.concatenate(list(errors.values())) ** 2))
    is_inlier = {frame: error <= max_error for frame, error in errors.items()}
    return {
        frame: DetectedBoard(board.corner[is_inlier[frame]], board.pixels[is_inlier[frame]])
        for frame, board in boards.items()
        if is_inlier[frame].sum() >= 4
    }


def calibrate_set(folder: Path, out: Path) -> None:
    """Calibrate a set from its frames, nominal layout and board, and write the cameras."""
    corners = corners_of_set(folder)
    write_cameras(out, calibrate_per_view(corners), corners.size_px, corners.flip)


if __name__ == "__main__":
    sys.exit(run(__doc__, lambda options: calibrate_set(options.set, options.out)))
