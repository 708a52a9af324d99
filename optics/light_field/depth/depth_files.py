"""Depth maps as NumPy's .npz, with a record of the light field and the search range."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.array_files import as_input_error, read_npz
from mirrorcam.core.disk.files import write_npz
from mirrorcam.core.disk.fingerprint import digest
from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.light_field import LightField

EXPECTED = "a depth map of mirrorcam depth"
MAX_IDENTITY_LENGTH = 64


@dataclass(frozen=True)
class DepthRecord:
    """Record of a depth map: `content_digest` of its light field, and the nearest and farthest depth searched, mm."""

    light_field_sha256: str
    searched_mm: tuple[float, float]

    def __post_init__(self) -> None:
        near, far = self.searched_mm
        if not 0.0 < near < far:
            raise ValueError(f"searched from {near} to {far} mm, expected a nearest depth below the farthest")


def content_digest(light_field: LightField) -> str:
    """Return the sha256 of samples, weights and geometry, which does not depend on the file they were read from."""
    parts = []
    for field in fields(LightField):
        value = getattr(light_field, field.name)
        array = np.ascontiguousarray(value) if isinstance(value, np.ndarray) else np.array(value)
        parts += [f"{field.name} {array.dtype.str} {array.shape}".encode(), array.tobytes()]
    return digest(*parts)


def save_depth(path: Path, depth: DepthMap, record: DepthRecord | None = None) -> None:
    """Write depth_mm, sigma_mm and confidence (v, u), and the record if given, to an .npz file, atomically."""
    arrays: dict[str, NDArray[Any]] = {
        "depth_mm": depth.depth_mm,
        "sigma_mm": depth.sigma_mm,
        "confidence": depth.confidence,
        "view": np.array(depth.view),
        "layout_identity": np.array(depth.views.layout_identity),
    }
    if record is not None:
        arrays["light_field_sha256"] = np.array(record.light_field_sha256)
        arrays["searched_mm"] = np.array(record.searched_mm, dtype=np.float64)
    write_npz(path, arrays)


def load_depth(path: Path, light_field: LightField) -> NDArray[np.float32]:
    """Return the depth (v, u) in mm that `save_depth` wrote for a light field; raises as `load_depth_map`."""
    return load_depth_map(path, light_field).depth_mm


def load_depth_map(path: Path, light_field: LightField) -> DepthMap:
    """Return the depth map that `save_depth` wrote for a light field.

    Without sigma or confidence in the file, sigma is NaN, and the confidence of every depth 1. Raises InputError for
    any other file, and for a depth map of another layout, view or size.
    """
    arrays = read_npz(path, ("depth_mm", "sigma_mm", "confidence", "layout_identity", "view"), EXPECTED)
    with as_input_error(path, EXPECTED):
        depth_mm, identity = arrays["depth_mm"], str(arrays["layout_identity"])[:MAX_IDENTITY_LENGTH]
        row, col = (int(number) for number in arrays["view"])
    if depth_mm.dtype.kind != "f":
        raise InputError(f"{path}: depth is {depth_mm.dtype}, expected floating point")
    if identity != light_field.layout_identity:
        raise InputError(f"{path}: layout {identity!r}, expected {light_field.layout_identity!r} of the light field")
    if not (0 <= row < light_field.rows and 0 <= col < light_field.cols) or light_field.positions_mm[row, col].any():
        raise InputError(f"{path}: depth of view {(row, col)}, expected the reference view")
    if depth_mm.shape != light_field.weights.shape[2:]:
        height, width = light_field.weights.shape[2:]
        raise InputError(f"{path}: depth of {depth_mm.shape} px, expected {(height, width)} of the views")
    measures = {"sigma_mm": np.full(depth_mm.shape, np.nan), "confidence": np.isfinite(depth_mm)}
    measures = {name: np.asarray(arrays.get(name, measure)) for name, measure in measures.items()}
    for name, measure in measures.items():
        if measure.shape != depth_mm.shape or measure.dtype.kind not in "fb":
            raise InputError(f"{path}: {name} is {measure.dtype} of {measure.shape}, expected numbers {depth_mm.shape}")
    return DepthMap(
        views=light_field,
        view=(row, col),
        depth_mm=depth_mm.astype(np.float32),
        sigma_mm=measures["sigma_mm"].astype(np.float32),
        confidence=measures["confidence"].astype(np.float32),
    )
