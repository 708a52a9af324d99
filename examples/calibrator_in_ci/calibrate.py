"""A calibrator that `mirrorcam score suite` tries: every view as a camera of its own, by OpenCV alone.

It needs opencv-contrib-python-headless and NumPy. Of a set it reads what anyone with the device would have: `frames/`,
`board.toml` and `views.json`. It writes `cameras.yaml`, a FileStorage of OpenCV, which `mirrorcam score` reads.

    MIRRORCAM_SET=folder MIRRORCAM_RESULT=folder python calibrate.py

CORNER_STEP_PX=0.25 rounds corners to a quarter of a pixel: a mistake that an evaluation has to tell.
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

FEWEST_CORNERS, FEWEST_BOARDS = 8, 3
GREY = 127
"""What covers the other mirrors of a frame: their boards have the same markers."""


def main() -> int:
    folder, result = Path(os.environ["MIRRORCAM_SET"]), Path(os.environ["MIRRORCAM_RESULT"])
    board = tomllib.loads((folder / "board.toml").read_text(encoding="utf-8"))
    if board["kind"] != "charuco":
        print(f"a board of the kind {board['kind']}, expected charuco", file=sys.stderr)
        return 1
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board["dictionary"]))
    size = board["cols"], board["rows"]
    ids = board.get("first_marker", 0) + np.arange(size[0] * size[1] // 2, dtype=np.int32)
    target = cv2.aruco.CharucoBoard(size, board["square_mm"], board["marker_mm"], dictionary, ids)
    target.setLegacyPattern(board.get("legacy", False))
    described = json.loads((folder / "views.json").read_text(encoding="utf-8"))
    views, size = described["views"], (described["width_px"], described["height_px"])
    pictures = (np.fromfile(path, dtype=np.uint8) for path in sorted((folder / "frames").iterdir()))
    frames = [np.asarray(cv2.imdecode(picture, cv2.IMREAD_GRAYSCALE), dtype=np.uint8) for picture in pictures]
    # Mirrored, the picture of a mirror is that of a camera behind it.
    frames = [np.flip(frame, axis=described["flip_code"]) for frame in frames]

    cameras, poses = [], []
    for view in views:
        seen = {
            number: found for number, frame in enumerate(frames) if (found := corners(frame, view, target)) is not None
        }
        if len(seen) < FEWEST_BOARDS:
            print(f"{view['name']}: {len(seen)} boards, expected {FEWEST_BOARDS} at least", file=sys.stderr)
            return 1
        guess = np.array(view["camera_matrix"])
        _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
            [np.array(target.getChessboardCorners())[ids] for ids, _ in seen.values()],
            [pixels for _, pixels in seen.values()],
            size,
            guess,
            np.zeros(5),
            flags=cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3,
        )
        cameras.append((matrix, distortion))
        poses.append({number: pose(turn, shift) for number, turn, shift in zip(seen, turns, shifts, strict=True)})

    reference = max(range(len(views)), key=lambda number: len(poses[number]))
    file = cv2.FileStorage(str(result / "cameras.yaml"), cv2.FILE_STORAGE_WRITE)
    file.write("image_width", size[0])
    file.write("image_height", size[1])
    file.write("flip_code", described["flip_code"])
    file.write("unit", "mm")
    file.startWriteStruct("views", cv2.FILE_NODE_SEQ)
    for view, (matrix, distortion), of_view in zip(views, cameras, poses, strict=True):
        shared = sorted(of_view.keys() & poses[reference].keys())
        if not shared:
            print(f"{view['name']}: no board in common with {views[reference]['name']}", file=sys.stderr)
            return 1
        # The median of the pose against the reference over the boards that both see.
        relative = [of_view[number] @ np.linalg.inv(poses[reference][number]) for number in shared]
        turn = np.median([cv2.Rodrigues(each[:3, :3])[0].ravel() for each in relative], axis=0)
        file.startWriteStruct("", cv2.FILE_NODE_MAP)
        file.write("name", view["name"])
        file.write("camera_matrix", matrix)
        file.write("distortion_coefficients", distortion.reshape(1, -1))
        file.write("R", cv2.Rodrigues(turn)[0])
        file.write("T", np.median([each[:3, 3] for each in relative], axis=0)[:, None])
        file.endWriteStruct()
    file.endWriteStruct()
    file.release()
    return 0


def corners(
    frame: NDArray[np.uint8], view: dict[str, Any], target: cv2.aruco.CharucoBoard
) -> tuple[NDArray[np.int32], NDArray[np.float32]] | None:
    """Numbers (n,) and pixels (n, 1, 2) of the corners in the part of the flipped frame that a mirror shows."""
    left, top = view["x"], view["y"]
    outline = np.round(np.array(view["outline_px"]) - [left, top]).astype(np.int32)
    part = frame[top : top + view["height"], left : left + view["width"]]
    mask = cv2.fillPoly(np.zeros(part.shape, np.uint8), [outline], 255)
    found, ids, _, _ = cv2.aruco.CharucoDetector(target).detectBoard(np.where(mask > 0, part, GREY).astype(np.uint8))
    if ids is None or len(ids) < FEWEST_CORNERS:
        return None
    pixels = np.reshape(found, (-1, 1, 2)).astype(np.float32) + np.array([left, top], dtype=np.float32)
    step_px = float(os.environ.get("CORNER_STEP_PX", "0"))
    return np.ravel(ids), np.float32(step_px) * np.round(pixels / step_px) if step_px else pixels


def pose(turn: NDArray[Any], shift: NDArray[Any]) -> NDArray[np.float64]:
    """A pose (4, 4) from a rotation vector and a shift."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = cv2.Rodrigues(turn)[0], np.ravel(shift)
    return matrix


if __name__ == "__main__":
    sys.exit(main())
