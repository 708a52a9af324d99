"""Cache of detections, keyed by the content of the picture.

A file is named by the SHA-256 of the picture's pixels and of all else that decides what is found, the programs that
find it among them, so that it is never out of date. Where one cannot be read, the corners are found again each time: it
may be somebody else's, and is not replaced.
"""

from __future__ import annotations

import io
import os
import zipfile
import zlib
from functools import cache
from pathlib import Path

import numpy as np

from mirrorcam.core.disk.files import read_bytes, write_bytes
from mirrorcam.core.disk.fingerprint import Fingerprint, digest, source_digest, versions
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detections import DetectedFrame, SeenGrid
from mirrorcam.optics.calibration.solver.observations import DIRECT, Corners, IntArray, Observations
from mirrorcam.optics.geometry.targets import Target

FIELDS = ("view", "corner", "pixels", "sigma_px")
UNASSIGNED = "unassigned"
GRIDS = ("grid_mirror", "grid_of", "grid_places", "grid_pixels", "grid_sigma_px", "grid_limits")
MOST_BYTES = 10_000_000
"""Bytes of the largest file: a corner takes 40."""


@cache
def version() -> str:
    """Return 64 hexadecimal digits of the programs that decide what is found: optics and what it is built on."""
    return Fingerprint(sources={"mirrorcam.optics": source_digest("mirrorcam.optics")}, versions=versions()).digest


def key(grey: Grey, target: Target, mirrors: str) -> str:
    """Return 64 hexadecimal digits of what decides which corners are found; `mirrors` identifies the mirrors."""
    asked = f"{version()} {target.model_dump_json()} {mirrors} {grey.shape}\n"
    return digest(asked.encode(), np.ascontiguousarray(grey).data)


def load(folder: Path, name: str, *, views: int, corners: int) -> DetectedFrame | None:
    """Load the detections under a key, as frame 0; None where no file holds them whole.

    `views` and `corners` are the numbers of mirrors and of corners on the target that they may be of.
    """
    try:
        content = io.BytesIO(read_bytes(folder / f"{name}.npz", MOST_BYTES))
        if sum(each.file_size for each in zipfile.ZipFile(content).infolist()) > MOST_BYTES:
            return None
        with np.load(content, allow_pickle=False) as file:
            view, corner, pixels, sigma_px = (np.asarray(file[field]) for field in FIELDS)
            seen = Observations(np.zeros(view.size, dtype=np.int64), view, corner, pixels, sigma_px)
            frame = DetectedFrame(seen, file[UNASSIGNED], _grids(*(np.asarray(file[name]) for name in GRIDS)))
    except (OSError, ValueError, TypeError, KeyError, EOFError, MemoryError, zipfile.BadZipFile, zlib.error):
        return None  # incomplete, or of another program: detected again

    known = (seen.view >= DIRECT) & (seen.view < views) & (seen.corner >= 0) & (seen.corner < corners)
    return frame if known.all() and all(0 <= mirror < views for mirror, _ in frame.grids) else None


def _grids(
    mirrors: IntArray, of: IntArray, places: IntArray, pixels: FloatArray, sigma_px: FloatArray, limits: FloatArray
) -> tuple[tuple[int, SeenGrid], ...]:
    """The grids (k), whose corners (n) are of those with the numbers `of` (n,); ValueError for other shapes."""
    count, rows = len(mirrors), len(of)
    shapes = [places.shape, pixels.shape, sigma_px.shape, limits.shape]
    if shapes != [(rows, 2), (rows, 2), (rows,), (count, 2, 2)] or not (
        np.isfinite(pixels).all() and (sigma_px > 0).all()
    ):
        raise ValueError(f"grids of {count} mirrors and {rows} corners have arrays of shapes {shapes}")
    found = []
    for number, mirror in enumerate(mirrors.tolist()):
        own = of == number
        corners = Corners(np.arange(own.sum()), pixels[own], sigma_px[own])
        found.append((int(mirror), SeenGrid(places[own].astype(np.int64), corners, limits[number])))
    return tuple(found)


def check_folder(folder: Path) -> None:
    """Raise InputError where nothing can be kept in a folder: it is a link or a file."""
    if folder.is_symlink():
        raise InputError(f"{folder}: is a link, expected a folder for found corners, or nothing")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file, expected a folder for found corners, or nothing")


def save(folder: Path, name: str, frame: DetectedFrame) -> None:
    """Keep what was found in a picture under a key, written whole or not at all; what is there already stays."""
    check_folder(folder)
    if os.path.lexists(folder / f"{name}.npz"):
        return
    content = io.BytesIO()
    arrays = {field: getattr(frame.corners, field) for field in FIELDS} | {UNASSIGNED: frame.unassigned_px}
    grids = [grid for _, grid in frame.grids]
    arrays |= {
        "grid_mirror": np.array([mirror for mirror, _ in frame.grids], dtype=np.int64),
        "grid_of": np.repeat(np.arange(len(grids)), [len(grid) for grid in grids]),
        "grid_places": np.concatenate([np.empty((0, 2), dtype=np.int64), *(grid.places for grid in grids)]),
        "grid_pixels": np.concatenate([np.empty((0, 2)), *(grid.corners.pixels for grid in grids)]),
        "grid_sigma_px": np.concatenate([np.empty(0), *(grid.corners.sigma_px for grid in grids)]),
        "grid_limits": np.array([grid.limits for grid in grids]).reshape(-1, 2, 2),
    }
    np.savez(content, **arrays)
    write_bytes(folder / f"{name}.npz", content.getvalue())
