"""First- and second-surface mirrors as Mitsuba shapes in the rig frame, mm."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.render_scenes.mirror_finish import MirrorFinish, radius_mm

# Number of cells of a bent mirror per ripple wavelength and per radius: slopes are accurate to a factor of 1e-3.
CELLS_PER_WAVE, CELLS_PER_RADIUS = 40, 12


def mirror_shapes(mirror: Mirror, finish: MirrorFinish, *, edges: bool = False) -> dict[str, Any]:
    """Return the faces of a mirror, with its outline in the layout.

    A first-surface mirror is a reflecting face with a black back; `edges` adds the black edges of its substrate. A
    second-surface mirror is a plate: a dielectric front (Fresnel), a coating with the same outline and a black back,
    and black edges. Both faces of a bent plate have the same shape.

    Returns
    -------
    dict
        Shapes for the current variant, by face name.
    """
    if not mirror.is_second_surface:
        coating = {"coating": _face(mirror, finish, 0.0, _coating(finish))}
        return coating | ({"edges": _edges(mirror, -mirror.thickness_mm)} if edges else {})
    glass = {"type": "dielectric", "int_ior": mirror.refractive_index, "ext_ior": 1.0}
    return {
        "coating": _face(mirror, finish, 0.0, _coating(finish)),
        "front": _face(mirror, finish, mirror.thickness_mm, glass),
        "edges": _edges(mirror, mirror.thickness_mm),
    }


def _coating(finish: MirrorFinish) -> dict[str, Any]:
    is_neutral = len(set(finish.reflectance)) == 1
    reflectance = (
        {"type": "uniform", "value": finish.reflectance[0]}
        if is_neutral
        else {"type": "rgb", "value": list(finish.reflectance)}
    )
    bsdf = {"type": "conductor", "material": "none", "specular_reflectance": reflectance}
    if finish.roughness == 0.0:
        return bsdf
    return bsdf | {"type": "roughconductor", "distribution": "beckmann", "alpha": finish.roughness}


def _fan(mirror: Mirror) -> NDArray[np.int64]:
    """Return triangles (n - 2, 3) of the outline's corners, anticlockwise from the reflecting side."""
    count = len(mirror.outline_in_plane_mm)
    return np.array([[0, k, k + 1] if _anticlockwise(mirror) else [0, k + 1, k] for k in range(1, count - 1)])


def _anticlockwise(mirror: Mirror) -> bool:
    outline = mirror.outline_in_plane_mm
    edges = np.roll(outline, -1, axis=0) - outline
    return bool((outline[:, 0] * edges[:, 1] - outline[:, 1] * edges[:, 0]).sum() > 0)


def _face(mirror: Mirror, finish: MirrorFinish, offset_mm: float, bsdf: dict[str, Any]) -> Any:
    """Return the surface, offset towards the pupil, with the exact normal at every vertex.

    Normals computed from the triangles would suffer from the rounding of their corners.
    """
    if finish.flat:
        corners = mirror.outline_in_rig_mm + offset_mm * mirror.normal_in_rig
        return mesh("face", corners, _fan(mirror), bsdf, np.tile(mirror.normal_in_rig, (len(corners), 1)))
    points, faces = _cells(mirror, finish)
    height, slopes = finish.shape(radius_mm(mirror), points)
    frame = mirror.rig_from_plane
    corners = points @ frame[:3, :2].T + (height + offset_mm)[:, None] * mirror.normal_in_rig + frame[:3, 3]
    normals = mirror.normal_in_rig - slopes @ frame[:3, :2].T
    return mesh("face", corners, faces, bsdf, normals / np.linalg.norm(normals, axis=1, keepdims=True))


def _cells(mirror: Mirror, finish: MirrorFinish) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return points (n, 2) of the plane and triangles (m, 3) of a subdivided fan from the centre to each edge."""
    outline = mirror.outline_in_plane_mm if _anticlockwise(mirror) else mirror.outline_in_plane_mm[::-1]
    size = radius_mm(mirror) / CELLS_PER_RADIUS
    if finish.ripple_mm > 0.0:
        size = min(size, finish.ripple_wavelength_mm / CELLS_PER_WAVE)
    sides = np.linalg.norm(np.concatenate([outline, np.roll(outline, -1, axis=0) - outline]), axis=1)
    count = int(np.ceil(sides.max() / size))
    # Row r of a triangle, counted from the centre, has r + 1 points.
    rows = np.repeat(np.arange(count + 1), np.arange(1, count + 2))
    columns = np.arange(len(rows)) - rows * (rows + 1) // 2
    barycentric = np.stack([rows - columns, columns], axis=1) / count
    has_below = rows < count
    first = np.flatnonzero(has_below)
    below = first + rows[has_below] + 1
    upright = np.column_stack([first, below, below + 1])
    has_next = has_below & (columns < rows)
    first = np.flatnonzero(has_next)
    below = first + rows[has_next] + 1
    triangles = np.concatenate([upright, np.column_stack([first, below + 1, first + 1])])
    corners = np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)
    points = (barycentric @ corners).reshape(-1, 2)
    faces = (triangles + np.arange(len(outline))[:, None, None] * len(rows)).reshape(-1, 3)
    return points, faces


def _edges(mirror: Mirror, height_mm: float) -> Any:
    """Return the absorbing edges of a plate, from its coating towards the pupil."""
    outline = mirror.outline_in_rig_mm
    count = len(outline)
    corners = np.concatenate([outline, outline + height_mm * mirror.normal_in_rig])
    start = np.arange(count)
    end = (start + 1) % count
    faces = np.concatenate([np.stack([start, end, end + count]), np.stack([start, end + count, start + count])], 1)
    black = {"type": "diffuse", "reflectance": {"type": "uniform", "value": 0.0}}
    return mesh("edges", corners, faces.T, black)


def mesh(
    name: str,
    vertices_in_rig: FloatArray,
    faces: NDArray[np.int64],
    bsdf: dict[str, Any],
    normals_in_rig: FloatArray | None = None,
    texture_uv: FloatArray | None = None,
) -> Any:
    """Return triangles (m, 3) of vertices (n, 3) as a shape for the current variant.

    Without normals (n, 3), triangles are shaded flat. `texture_uv` (n, 2) are the vertices' texture coordinates.
    """
    import mitsuba as mi

    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf)
    smooth = normals_in_rig is not None
    shape = mi.Mesh(
        name,
        len(vertices_in_rig),
        len(faces),
        props=properties,
        has_vertex_normals=smooth,
        has_vertex_texcoords=texture_uv is not None,
    )
    buffers = mi.traverse(shape)
    buffers["vertex_positions"] = np.float32(vertices_in_rig).ravel()
    if normals_in_rig is not None:
        buffers["vertex_normals"] = np.float32(normals_in_rig).ravel()
    if texture_uv is not None:
        buffers["vertex_texcoords"] = np.float32(texture_uv).ravel()
    buffers["faces"] = np.uint32(faces).ravel()
    buffers.update()
    return shape
