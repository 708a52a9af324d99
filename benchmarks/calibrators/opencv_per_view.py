"""Each mirror as a camera of its own: `python -m benchmarks.calibrators.opencv_per_view SET OUT`.

What a user of OpenCV does first: the flipped frames are the pictures of nine cameras, and `cv2.calibrateCamera`
calibrates each alone, its principal point far outside its part of the picture. Poses against each other are means
over the boards that two views share. Writes OUT, a FileStorage in YAML.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from benchmarks.calibrators.command_line import run
from benchmarks.calibrators.set_corners import SeenBoard, SetCorners, corners_of_set
from benchmarks.calibrators.view_poses import OpencvCamera, view_from_reference, write_cameras
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid

FEWEST_BOARDS = 3
OUTLIER = 3.0
"""Corners whose error is more than this many times the root mean square are left out of a second fit."""


def calibrate_per_view(corners: SetCorners) -> tuple[OpencvCamera, ...]:
    """Calibrate every view alone; raises InputError for one with too few boards."""
    poses: dict[tuple[int, int], FloatArray] = {}
    lenses = []
    for view, name in enumerate(corners.names):
        seen = {frame: board for (frame, number), board in corners.seen.items() if number == view}
        if len(seen) < FEWEST_BOARDS:
            raise InputError(f"{name}: {len(seen)} boards, expected {FEWEST_BOARDS} at least")
        matrix, distortion, found = _calibrated(corners, seen)
        matrix, distortion, found = _calibrated(corners, _without_outliers(corners, seen, matrix, distortion, found))
        lenses.append((matrix, distortion))
        poses |= {(frame, view): pose for frame, pose in found.items()}
    _, after = view_from_reference(poses, len(corners.names))
    return tuple(OpencvCamera(name, *lens, pose) for name, lens, pose in zip(corners.names, lenses, after, strict=True))


def _calibrated(
    corners: SetCorners, seen: dict[int, SeenBoard]
) -> tuple[FloatArray, FloatArray, dict[int, FloatArray]]:
    """Camera matrix, distortion (5,), and the pose of the board in each frame."""
    objects = [corners.points_in_board[board.corner].astype(np.float32) for board in seen.values()]
    pixels = [board.pixels.astype(np.float32) for board in seen.values()]
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3
    _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
        objects, pixels, corners.size_px, corners.matrix.copy(), np.zeros(5), flags=flags
    )
    poses = {
        frame: rigid(cv2.Rodrigues(turn)[0], np.ravel(shift))
        for frame, turn, shift in zip(seen, turns, shifts, strict=True)
    }
    return np.asarray(matrix, dtype=np.float64), np.ravel(distortion)[:5].astype(np.float64), poses


def _without_outliers(
    corners: SetCorners,
    seen: dict[int, SeenBoard],
    matrix: FloatArray,
    distortion: FloatArray,
    poses: dict[int, FloatArray],
) -> dict[int, SeenBoard]:
    errors = {}
    for frame, board in seen.items():
        turn, shift = cv2.Rodrigues(poses[frame][:3, :3])[0], poses[frame][:3, 3]
        shown, _ = cv2.projectPoints(corners.points_in_board[board.corner], turn, shift, matrix, distortion)
        errors[frame] = np.linalg.norm(np.reshape(shown, (-1, 2)) - board.pixels, axis=1)
    most = OUTLIER * np.sqrt(np.mean(np.concatenate(list(errors.values())) ** 2))
    kept = {frame: error <= most for frame, error in errors.items()}
    return {
        frame: SeenBoard(board.corner[kept[frame]], board.pixels[kept[frame]])
        for frame, board in seen.items()
        if kept[frame].sum() >= 4
    }


def calibrate_set(folder: Path, out: Path) -> None:
    """Calibrate a set from its frames, nominal layout and board, and write the cameras."""
    corners = corners_of_set(folder)
    write_cameras(out, calibrate_per_view(corners), corners.size_px, corners.flip)


if __name__ == "__main__":
    sys.exit(run(__doc__, lambda given: calibrate_set(given.set, given.out)))
