"""Boards that were found, kept by the content of the picture: finding them again costs nothing.

A file is named by the SHA-256 of the picture's pixels and of all else that decides what is found, so that it is never
out of date; one that cannot be read is found again.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from pathlib import Path

import cv2
import numpy as np

from optics.calibration.detection.corners import Corners, Grey
from optics.files import write_bytes
from optics.targets import Charuco, Checkerboard

VERSION = 1
"""Of what is found in a picture: another number wherever detection changes, or old files would be believed."""

Boards = list[tuple[Corners, ...]]


def key(grey: Grey, target: Charuco | Checkerboard, *, mirrored: bool, most: int) -> str:
    """Sixty-four hexadecimal digits of what decides which boards are found."""
    asked = f"{VERSION} {cv2.__version__} {target.model_dump_json()} {mirrored} {most} {grey.shape}\n"
    digest = hashlib.sha256(asked.encode())
    digest.update(np.ascontiguousarray(grey).data)
    return digest.hexdigest()


def load(folder: Path, name: str) -> Boards | None:
    """The boards of a key, or None where there is no file that holds them whole."""
    try:
        with np.load(folder / f"{name}.npz", allow_pickle=False) as file:
            sizes, ids, pixels = (np.asarray(file[field]) for field in ("sizes", "ids", "pixels"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None  # cut short or written by something else: found again, and written anew
    if sizes.ndim != 2 or ids.ndim != 1 or pixels.shape != (len(ids), 2) or sizes[:, 1].sum() != len(ids):
        return None
    boards: Boards = []
    ends = np.cumsum(sizes[:, 1])
    for (board, count), end in zip(sizes.tolist(), ends.tolist(), strict=True):
        corners = Corners(ids[end - count : end].astype(np.int64), pixels[end - count : end].astype(np.float64))
        boards = [*boards, (corners,)] if board == len(boards) else [*boards[:-1], (*boards[-1], corners)]
    return boards


def save(folder: Path, name: str, boards: Boards) -> None:
    """Keep boards under a key; written whole or not at all."""
    numberings = [(number, corners) for number, board in enumerate(boards) for corners in board]
    content = io.BytesIO()
    np.savez(
        content,
        sizes=np.array([(number, len(corners)) for number, corners in numberings], dtype=np.int64).reshape(-1, 2),
        ids=np.concatenate([corners.ids for _, corners in numberings] or [np.empty(0, dtype=np.int64)]),
        pixels=np.concatenate([corners.pixels for _, corners in numberings] or [np.empty((0, 2))]),
    )
    write_bytes(folder / f"{name}.npz", content.getvalue())
