"""A calibrator that `mirrorcam score suite` can evaluate: every view as a separate camera, by OpenCV alone.

It needs opencv-contrib-python-headless and NumPy. Of a set, it reads only what any user of the device
would have: `frames/`, `board.toml` and `views.json`. It writes `cameras.yaml`, an OpenCV FileStorage that
`mirrorcam score` reads.

    MIRRORCAM_SET=folder MIRRORCAM_RESULT=folder python calibrate.py

CORNER_STEP_PX=0.25 rounds corners to a quarter of a pixel: a mistake that an evaluation must detect.
"""

from __future__ import annotations

import json
import os
import sys
import tomllib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

MIN_CORNERS, MIN_BOARDS = 8, 3
GREY = 127
"""Grey level that covers the other mirrors of a frame: their boards have the same markers."""


def main() -> int:
    folder, result = Path(os.environ["MIRRORCAM_SET"]), Path(os.environ["MIRRORCAM_RESULT"])
    described = tomllib.loads((folder / "board.toml").read_text(encoding="utf-8"))
    if described["kind"] != "charuco":
        print(f"a board of kind {described['kind']}, expected charuco", file=sys.stderr)
        return 1
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, described["dictionary"]))
    size = described["cols"], described["rows"]
    ids = described.get("first_marker", 0) + np.arange(size[0] * size[1] // 2, dtype=np.int32)
    board = cv2.aruco.CharucoBoard(size, described["square_mm"], described["marker_mm"], dictionary, ids)
    board.setLegacyPattern(described.get("legacy", False))
    views_file = json.loads((folder / "views.json").read_text(encoding="utf-8"))
    views, size = views_file["views"], (views_file["width_px"], views_file["height_px"])
    pictures = (np.fromfile(path, dtype=np.uint8) for path in sorted((folder / "frames").iterdir()))
    frames = [np.asarray(cv2.imdecode(picture, cv2.IMREAD_GRAYSCALE), dtype=np.uint8) for picture in pictures]
    # Flipped, the picture in a mirror is that of a virtual camera behind it.
    frames = [np.flip(frame, axis=views_file["flip_code"]) for frame in frames]

    cameras, poses = [], []
    for view in views:
        boards = {
            number: grid for number, frame in enumerate(frames) if (grid := corners(frame, view, board)) is not None
        }
        if len(boards) < MIN_BOARDS:
            print(f"{view['name']}: {len(boards)} boards, expected at least {MIN_BOARDS}", file=sys.stderr)
            return 1
        guess = np.array(view["camera_matrix"])
        _, matrix, distortion, rotations, shifts = cv2.calibrateCamera(
            [np.array(board.getChessboardCorners())[ids] for ids, _ in boards.values()],
            [pixels for _, pixels in boards.values()],
            size,
            guess,
            np.zeros(5),
            flags=cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3,
        )
        cameras.append((matrix, distortion))
        poses.append({number: pose(r, t) for number, r, t in zip(boards, rotations, shifts, strict=True)})

    reference = max(range(len(views)), key=lambda number: len(poses[number]))
    file = cv2.FileStorage(str(result / "cameras.yaml"), cv2.FILE_STORAGE_WRITE)
    file.write("image_width", size[0])
    file.write("image_height", size[1])
    file.write("flip_code", views_file["flip_code"])
    file.write("unit", "mm")
    file.startWriteStruct("views", cv2.FILE_NODE_SEQ)
    for view, (matrix, distortion), view_poses in zip(views, cameras, poses, strict=True):
        shared = sorted(view_poses.keys() & poses[reference].keys())
        if not shared:
            print(f"{view['name']}: no board in common with {views[reference]['name']}", file=sys.stderr)
            return 1
        # The median pose relative to the reference, over the boards that both see.
        relative = [view_poses[number] @ np.linalg.inv(poses[reference][number]) for number in shared]
        rotation = np.median([cv2.Rodrigues(matrix[:3, :3])[0].ravel() for matrix in relative], axis=0)
        file.startWriteStruct("", cv2.FILE_NODE_MAP)
        file.write("name", view["name"])
        file.write("camera_matrix", matrix)
        file.write("distortion_coefficients", distortion.reshape(1, -1))
        file.write("R", cv2.Rodrigues(rotation)[0])
        file.write("T", np.median([matrix[:3, 3] for matrix in relative], axis=0)[:, None])
        file.endWriteStruct()
    file.endWriteStruct()
    file.release()
    return 0


def corners(
    frame: NDArray[np.uint8], view: dict[str, Any], board: cv2.aruco.CharucoBoard
) -> tuple[NDArray[np.int32], NDArray[np.float32]] | None:
    """Ids (n,) and pixels (n, 1, 2) of the corners in the part of a flipped frame that shows a mirror."""
    left, top = view["x"], view["y"]
    outline = np.round(np.array(view["outline_px"]) - [left, top]).astype(np.int32)
    part = frame[top : top + view["height"], left : left + view["width"]]
    mask = cv2.fillPoly(np.zeros(part.shape, np.uint8), [outline], 255)
    detected, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(np.where(mask > 0, part, GREY).astype(np.uint8))
    if ids is None or len(ids) < MIN_CORNERS:
        return None
    pixels = np.reshape(detected, (-1, 1, 2)).astype(np.float32) + np.array([left, top], dtype=np.float32)
    step_px = float(os.environ.get("CORNER_STEP_PX", "0"))
    return np.ravel(ids), np.float32(step_px) * np.round(pixels / step_px) if step_px else pixels


def pose(rotation: NDArray[Any], shift: NDArray[Any]) -> NDArray[np.float64]:
    """A pose (4, 4) from a rotation vector and a translation."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = cv2.Rodrigues(rotation)[0], np.ravel(shift)
    return matrix


if __name__ == "__main__":
    sys.exit(main())
