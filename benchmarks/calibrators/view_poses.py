"""Relative poses of views from poses of boards, and cameras as OpenCV's YAML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.disk.files import write_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.write.virtual_cameras import Flip
from mirrorcam.optics.geometry.transforms import inverse, rigid

OUTLIER = 3.0
"""Poses farther from the median than this multiple of the median distance are omitted from the mean."""


@dataclass(frozen=True)
class OpencvCamera:
    """A view for `cv2.projectPoints`; camera_from_rig (4, 4), mm."""

    name: str
    matrix: FloatArray
    distortion: FloatArray
    camera_from_rig: FloatArray


def view_from_reference(
    view_from_board: Mapping[tuple[int, int], FloatArray], views: int
) -> tuple[int, tuple[FloatArray, ...]]:
    """Return the view with the most boards, and each view's pose (4, 4) relative to it, from poses by frame and view.

    Raises InputError for a view that has no frame in common with the reference view.
    """
    frames = [{frame for frame, number in view_from_board if number == view} for view in range(views)]
    reference = max(range(views), key=lambda view: len(frames[view]))
    poses = []
    for view in range(views):
        shared = sorted(frames[view] & frames[reference])
        if not shared:
            raise InputError(f"view {view} has no board in common with view {reference}")
        pairs = [view_from_board[frame, view] @ inverse(view_from_board[frame, reference]) for frame in shared]
        poses.append(mean_pose(np.array(pairs)))
    return reference, tuple(poses)


def mean_pose(poses: FloatArray) -> FloatArray:
    """Return the mean of poses (n, 4, 4), without those far from the median."""
    shift = np.median(poses[:, :3, 3], axis=0)
    rotations = Rotation.from_matrix(poses[:, :3, :3])
    angles_between = np.array([(rotations * rotation.inv()).magnitude() for rotation in rotations])
    median = rotations[int(np.median(angles_between, axis=1).argmin())]
    angles = (rotations * median.inv()).magnitude()
    lengths = np.linalg.norm(poses[:, :3, 3] - shift, axis=1)
    used = (angles <= OUTLIER * np.median(angles) + 1e-12) & (lengths <= OUTLIER * np.median(lengths) + 1e-12)
    if not used.any():
        used[angles.argmin()] = True
    return rigid(rotations[used].mean().as_matrix(), poses[used, :3, 3].mean(axis=0))


def write_cameras(path: Path, cameras: Sequence[OpencvCamera], size_px: tuple[int, int], flip: Flip) -> None:
    """Write cameras as `cv2.FileStorage` does, atomically."""
    file = cv2.FileStorage(".yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML)
    file.write("image_width", size_px[0])
    file.write("image_height", size_px[1])
    file.write("flip_code", 1 if flip == "left-right" else 0)
    file.write("unit", "mm")
    file.startWriteStruct("views", cv2.FILE_NODE_SEQ)
    for camera in cameras:
        file.startWriteStruct("", cv2.FILE_NODE_MAP)
        file.write("name", camera.name)
        file.write("camera_matrix", camera.matrix)
        file.write("distortion_coefficients", camera.distortion[None])
        file.write("R", camera.camera_from_rig[:3, :3])
        file.write("T", camera.camera_from_rig[:3, 3:])
        file.endWriteStruct()
    file.endWriteStruct()
    write_text(path, str(file.releaseAndGetString()))
