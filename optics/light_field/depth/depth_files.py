"""Depth maps as NumPy's .npz."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.files import read_bytes, write_npz
from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.light_field import LightField


def save_depth(path: Path, depth: DepthMap) -> None:
    """Write depth_mm, sigma_mm and confidence (v, u) of a view to an .npz file, atomically."""
    arrays = {
        "depth_mm": depth.depth_mm,
        "sigma_mm": depth.sigma_mm,
        "confidence": depth.confidence,
        "view": np.array(depth.view),
        "layout_identity": np.array(depth.views.layout_identity),
    }
    write_npz(path, arrays)


def load_depth(path: Path, light_field: LightField) -> NDArray[np.float32]:
    """The depth (v, u) in mm that `save_depth` wrote for a light field.

    Raises InputError for another file, and for a depth map of another layout, view or size.
    """
    read_bytes(path)
    try:
        with np.load(path, allow_pickle=False) as archive:
            depth_mm, identity = archive["depth_mm"], str(archive["layout_identity"])
            row, col = archive["view"].tolist()
    except (ValueError, KeyError, OSError, EOFError, TypeError) as error:
        raise InputError(f"{path}: not a depth map of mirrorcam depth: {' '.join(str(error).split())}") from None
    if identity != light_field.layout_identity:
        raise InputError(f"{path}: of layout {identity!r}, but the light field is of {light_field.layout_identity!r}")
    if not (row < light_field.rows and col < light_field.cols) or light_field.positions_mm[row, col].any():
        raise InputError(f"{path}: depth of view {(row, col)}, expected that of the reference view")
    if depth_mm.shape != light_field.weights.shape[2:]:
        height, width = light_field.weights.shape[2:]
        raise InputError(f"{path}: depth of {depth_mm.shape} px, expected {(height, width)} of the views")
    return np.asarray(depth_mm, dtype=np.float32)
