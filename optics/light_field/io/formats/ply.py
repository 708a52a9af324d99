"""Coloured point clouds as binary PLY, in mm in the rig frame, for MeshLab, CloudCompare, Blender and Open3D.

Points of an estimated depth have the properties `confidence` and `sigma_mm`, the standard deviation along the axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.files import write_bytes
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.depth.parallax import reference_index
from mirrorcam.optics.light_field.io.light_field_format import Format, KnownDepth
from mirrorcam.optics.light_field.io.view_images import rgb
from mirrorcam.optics.light_field.light_field import LightField

COMMENT = "mm, rig frame: x right, y down, z along the optical axis"
_FIELDS = {"x": "<f4", "y": "<f4", "z": "<f4", "red": "u1", "green": "u1", "blue": "u1"}
_NAMES = {"<f4": "float", "u1": "uchar"}


def point_cloud(light_field: LightField, depth_mm: NDArray[np.floating]) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Return points (n, 3) in the rig frame, mm, and colours (n, 3) of the reference view, from its depth (v, u).

    The depth is measured from the pupil. Pixels without a sample, or without a finite depth in front of the view, are
    skipped.
    """
    view, shown = reference_index(light_field), shown_pixels(light_field, depth_mm)
    distance_mm = depth_mm - light_field.reference_view_depth_mm
    pixels = light_field.pixel_grid()[shown]
    scale = distance_mm[shown].astype(np.float64)[:, None] / light_field.focal_px
    in_view = np.concatenate([(pixels - light_field.centre_px) * scale, scale * light_field.focal_px], axis=1)
    points = in_view @ light_field.view_from_rig + light_field.reference_view_in_rig_mm
    return points, rgb(light_field.samples[view])[shown]


def shown_pixels(light_field: LightField, depth_mm: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Return the mask (v, u) of the pixels of `point_cloud`; raises InputError if there is none, or another size."""
    if depth_mm.shape != light_field.weights.shape[2:]:
        height, width = light_field.weights.shape[2:]
        raise InputError(
            f"depth is {depth_mm.shape[-1]}x{depth_mm.shape[0]} px, expected {width}x{height} of the views"
        )
    valid = light_field.valid[reference_index(light_field)]
    shown = valid & np.isfinite(depth_mm) & (depth_mm > light_field.reference_view_depth_mm)
    if not shown.any():
        raise InputError("no pixel has both a sample and a depth in front of the view, expected at least one")
    return np.asarray(shown)


def write_ply(
    path: Path,
    points: FloatArray,
    colours: NDArray[np.uint8],
    measures: Mapping[str, NDArray[np.float32]] = {},
    comment: str = COMMENT,
) -> None:
    """Write points (n, 3) with colours (n, 3) and further properties (n,), as float32."""
    fields = _FIELDS | dict.fromkeys(measures, "<f4")
    cloud = np.empty(len(points), np.dtype(list(fields.items())))
    for name, values in zip(_FIELDS, (*points.T, *colours.T), strict=True):
        cloud[name] = values
    for name, values in measures.items():
        cloud[name] = values
    properties = "".join(f"property {_NAMES[kind]} {name}\n" for name, kind in fields.items())
    header = f"ply\nformat binary_little_endian 1.0\ncomment {comment}\nelement vertex {len(points)}\n{properties}"
    write_bytes(path, f"{header}end_header\n".encode() + cloud.tobytes())


def _write(path: Path, light_field: LightField, depth: KnownDepth | None) -> None:
    if depth is None:
        raise InputError(f"{path}: a point cloud needs the depth of the central view")
    shown = shown_pixels(light_field, depth.depth_mm)
    given = {"confidence": depth.confidence, "sigma_mm": depth.sigma_mm}
    measures = {name: measure[shown] for name, measure in given.items() if measure is not None}
    write_ply(path, *point_cloud(light_field, depth.depth_mm), measures)


FORMAT = Format(
    name="ply",
    ending=".ply",
    detect=lambda path: path.suffix.lower() == ".ply" and not path.is_dir(),
    read=None,
    write=_write,
    has_points=True,
)
