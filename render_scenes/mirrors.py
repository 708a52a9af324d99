"""Mirrors as Mitsuba shapes: silvered on the front, or sheets that are coated behind. World = rig frame, mm."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from optics.mirror import Mirror
from optics.values import FloatArray


def mirror_shapes(mirror: Mirror, reflectance: float) -> dict[str, Any]:
    """A mirror exactly as its layout cuts it, by names of its faces.

    A first-surface mirror is a reflecting face, black behind. A second-surface one is a sheet: a front that light
    passes by Fresnel's formulas, cut like the coating behind it, which is black from behind, and black edges.
    """
    if mirror.surface == "first":
        return {"coating": _face(mirror, 0.0, _coating(reflectance))}
    glass = {"type": "dielectric", "int_ior": mirror.refractive_index, "ext_ior": 1.0}
    return {
        "coating": _face(mirror, 0.0, _coating(reflectance)),
        "front": _face(mirror, mirror.thickness_mm, glass),
        "edges": _edges(mirror),
    }


def _coating(reflectance: float) -> dict[str, Any]:
    return {
        "type": "conductor",
        "material": "none",
        "specular_reflectance": {"type": "uniform", "value": reflectance},
    }


def _fan(mirror: Mirror) -> NDArray[np.int64]:
    """Triangles (n - 2, 3) of the outline's corners, anticlockwise as seen from the reflecting side."""
    outline = mirror.outline_in_plane_mm
    edges = np.roll(outline, -1, axis=0) - outline
    turn = (outline[:, 0] * edges[:, 1] - outline[:, 1] * edges[:, 0]).sum()
    return np.array([[0, k, k + 1] if turn > 0 else [0, k + 1, k] for k in range(1, len(outline) - 1)])


def _face(mirror: Mirror, lift_mm: float, bsdf: dict[str, Any]) -> Any:
    """The outline, lifted towards the pupil, with the exact normal at every corner.

    The normals of the triangles themselves would carry the rounding of their corners.
    """
    corners = mirror.outline_in_rig_mm + lift_mm * mirror.normal_in_rig
    return mesh("face", corners, _fan(mirror), bsdf, np.tile(mirror.normal_in_rig, (len(corners), 1)))


def _edges(mirror: Mirror) -> Any:
    """The cut edges of a sheet: what they meet is lost."""
    back = mirror.outline_in_rig_mm
    count = len(back)
    corners = np.concatenate([back, back + mirror.thickness_mm * mirror.normal_in_rig])
    here = np.arange(count)
    after = (here + 1) % count
    faces = np.concatenate([np.stack([here, after, after + count]), np.stack([here, after + count, here + count])], 1)
    black = {"type": "diffuse", "reflectance": {"type": "uniform", "value": 0.0}}
    return mesh("edges", corners, faces.T, black)


def mesh(
    name: str,
    vertices_in_rig: FloatArray,
    faces: NDArray[np.int64],
    bsdf: dict[str, Any],
    normals_in_rig: FloatArray | None = None,
) -> Any:
    """Triangles (m, 3) of vertices (n, 3) with normals (n, 3), or flat ones, as a shape of the current variant."""
    import mitsuba as mi

    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf)
    smooth = normals_in_rig is not None
    shape = mi.Mesh(name, len(vertices_in_rig), len(faces), props=properties, has_vertex_normals=smooth)
    buffers = mi.traverse(shape)
    buffers["vertex_positions"] = np.float32(vertices_in_rig).ravel()
    if normals_in_rig is not None:
        buffers["vertex_normals"] = np.float32(normals_in_rig).ravel()
    buffers["faces"] = np.uint32(faces).ravel()
    buffers.update()
    return shape
