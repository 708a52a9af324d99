"""Depth maps as NumPy's .npz."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.array_files import read_npz, refusing
from mirrorcam.optics.base.files import write_npz
from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.light_field import LightField

WHAT = "a depth map of mirrorcam depth"
LONGEST_IDENTITY = 64


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
    arrays = read_npz(path, ("depth_mm", "layout_identity", "view"), WHAT)
    with refusing(path, WHAT):
        depth_mm, identity = arrays["depth_mm"], str(arrays["layout_identity"])[:LONGEST_IDENTITY]
        row, col = (int(number) for number in arrays["view"])
    if depth_mm.dtype.kind != "f":
        raise InputError(f"{path}: depth is {depth_mm.dtype}, expected floating point")
    if identity != light_field.layout_identity:
        raise InputError(f"{path}: of layout {identity!r}, but the light field is of {light_field.layout_identity!r}")
    if not (0 <= row < light_field.rows and 0 <= col < light_field.cols) or light_field.positions_mm[row, col].any():
        raise InputError(f"{path}: depth of view {(row, col)}, expected that of the reference view")
    if depth_mm.shape != light_field.weights.shape[2:]:
        height, width = light_field.weights.shape[2:]
        raise InputError(f"{path}: depth of {depth_mm.shape} px, expected {(height, width)} of the views")
    return np.asarray(depth_mm, dtype=np.float32)
