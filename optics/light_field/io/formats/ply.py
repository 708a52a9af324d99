"""Coloured point clouds as binary PLY, in mm in the rig frame, for MeshLab, CloudCompare, Blender and Open3D."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.files import write_bytes
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.io.light_field_format import Depth, Format
from mirrorcam.optics.light_field.io.view_images import rgb
from mirrorcam.optics.light_field.light_field import LightField

_POINT = np.dtype([("position", "<f4", 3), ("colour", "u1", 3)])
_HEADER = (
    "ply\nformat binary_little_endian 1.0\ncomment mm, rig frame: x right, y down, z along the optical axis\n"
    "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
    "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
)


def point_cloud(light_field: LightField, depth_mm: NDArray[np.floating]) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Return points (n, 3) in the rig frame, mm, and colours (n, 3) of the reference view, from its depth (v, u).


    The depth is measured from the pupil. Pixels without a sample, or without a finite depth in front of the view, are
    skipped.
    """
    view = tuple(np.argwhere((light_field.positions_mm == 0).all(axis=2))[0])
    if depth_mm.shape != light_field.weights.shape[2:]:
        height, width = light_field.weights.shape[2:]
        raise InputError(
            f"depth is {depth_mm.shape[-1]}x{depth_mm.shape[0]} px, expected {width}x{height} of the views"
        )
    distance_mm = depth_mm - light_field.reference_depth_mm + light_field.reference_distance_mm
    valid = light_field.valid[view] & np.isfinite(depth_mm) & (distance_mm > 0)
    if not valid.any():
        raise InputError("no pixel has both a sample and a depth in front of the view, expected at least one")
    pixels = light_field.pixel_grid()[valid]
    scale = distance_mm[valid].astype(np.float64)[:, None] / light_field.focal_px
    in_view = np.concatenate([(pixels - light_field.centre_px) * scale, scale * light_field.focal_px], axis=1)
    points = in_view @ light_field.view_from_rig + light_field.reference_view_in_rig_mm
    return points, rgb(light_field.samples[view])[valid]


def write_ply(path: Path, points: FloatArray, colours: NDArray[np.uint8]) -> None:
    """Write points (n, 3) with colours (n, 3), as float32."""
    cloud = np.empty(len(points), _POINT)
    cloud["position"], cloud["colour"] = points, colours
    write_bytes(path, _HEADER.format(len(points)).encode() + cloud.tobytes())


def _write(path: Path, light_field: LightField, depth_mm: Depth | None) -> None:
    if depth_mm is None:
        raise InputError(f"{path}: a point cloud needs the depth of the central view")
    write_ply(path, *point_cloud(light_field, depth_mm))


FORMAT = Format(
    name="ply",
    ending=".ply",
    detect=lambda path: path.suffix.lower() == ".ply" and not path.is_dir(),
    read=None,
    write=_write,
)
