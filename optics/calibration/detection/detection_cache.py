"""Cache of detections: a picture is searched again only after the detection code has changed."""

from __future__ import annotations

import io
import zipfile
import zlib

import numpy as np

from mirrorcam.core.disk.fingerprint import digest
from mirrorcam.core.disk.program import program_of
from mirrorcam.core.disk.results import Results
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detections import DetectedFrame, DetectedGrid
from mirrorcam.optics.calibration.solver.observations import DIRECT, Corners, IntArray, Observations
from mirrorcam.optics.geometry.boards import CalibrationBoard

FIELDS = ("view", "corner", "pixels", "sigma_px")
UNASSIGNED = "unassigned"
GRIDS = ("grid_mirror", "grid_of", "grid_places", "grid_pixels", "grid_sigma_px", "grid_limits")
MAX_BYTES = 10_000_000
"""Maximum size of a file; a corner takes 40 bytes."""


CODE = "mirrorcam.optics.calibration.detection.detect_boards"
_FRAME = "frame.npz"


def name_of(grey: Grey, board: CalibrationBoard, boards: int) -> str:
    """Return the cache key (64 hexadecimal digits) of a picture (h, w), a board and the number of boards to find."""
    request = f"{board.model_dump_json()} {boards} {grey.shape}\n"
    return digest(request.encode(), np.ascontiguousarray(grey).data)


def load(results: Results, name: str, *, views: int, corners: int) -> DetectedFrame | None:
    """Load the detections of a name, as frame 0; None if they are not cached or are invalid.

    `views` and `corners` are the numbers of views, and of corners on the board.
    """
    cached = results.get(name, program_of(CODE))
    try:
        content = io.BytesIO(b"" if cached is None else cached[_FRAME])
        if sum(member.file_size for member in zipfile.ZipFile(content).infolist()) > MAX_BYTES:
            return None
        with np.load(content, allow_pickle=False) as file:
            view, corner, pixels, sigma_px = (np.asarray(file[field]) for field in FIELDS)
            corners_found = Observations(np.zeros(view.size, dtype=np.int64), view, corner, pixels, sigma_px)
            frame = DetectedFrame(corners_found, file[UNASSIGNED], _grids(*(np.asarray(file[name]) for name in GRIDS)))
    except (OSError, ValueError, TypeError, KeyError, EOFError, MemoryError, zipfile.BadZipFile, zlib.error):
        return None  # not cached, or written by another program

    valid = (
        (corners_found.view >= DIRECT)
        & (corners_found.view < views)
        & (corners_found.corner >= 0)
        & (corners_found.corner < corners)
    )
    return frame if valid.all() and all(0 <= mirror < views for mirror, _ in frame.grids) else None


def _grids(
    mirrors: IntArray,
    grid_numbers: IntArray,
    grid_xy: IntArray,
    pixels: FloatArray,
    sigma_px: FloatArray,
    limits: FloatArray,
) -> tuple[tuple[int, DetectedGrid], ...]:
    """Build the grids (k), with corners (n) assigned by `grid_numbers` (n,); raises ValueError for wrong shapes."""
    count, rows = len(mirrors), len(grid_numbers)
    shapes = [grid_xy.shape, pixels.shape, sigma_px.shape, limits.shape]
    if shapes != [(rows, 2), (rows, 2), (rows,), (count, 2, 2)] or not (
        np.isfinite(pixels).all() and (sigma_px > 0).all()
    ):
        raise ValueError(f"grids of {count} mirrors and {rows} corners have arrays of shapes {shapes}")
    grids = []
    for number, mirror in enumerate(mirrors.tolist()):
        in_grid = grid_numbers == number
        corners = Corners(np.arange(in_grid.sum()), pixels[in_grid], sigma_px[in_grid])
        grids.append((int(mirror), DetectedGrid(grid_xy[in_grid].astype(np.int64), corners, limits[number])))
    return tuple(grids)


def save(results: Results, name: str, frame: DetectedFrame) -> None:
    """Save the detections of a picture."""
    content = io.BytesIO()
    arrays = {field: getattr(frame.corners, field) for field in FIELDS} | {UNASSIGNED: frame.unassigned_px}
    grids = [grid for _, grid in frame.grids]
    arrays |= {
        "grid_mirror": np.array([mirror for mirror, _ in frame.grids], dtype=np.int64),
        "grid_of": np.repeat(np.arange(len(grids)), [len(grid) for grid in grids]),
        "grid_places": np.concatenate([np.empty((0, 2), dtype=np.int64), *(grid.grid_xy for grid in grids)]),
        "grid_pixels": np.concatenate([np.empty((0, 2)), *(grid.corners.pixels for grid in grids)]),
        "grid_sigma_px": np.concatenate([np.empty(0), *(grid.corners.sigma_px for grid in grids)]),
        "grid_limits": np.array([grid.limits for grid in grids]).reshape(-1, 2, 2),
    }
    np.savez(content, **arrays)
    results.put(name, program_of(CODE), {_FRAME: content.getvalue()})
