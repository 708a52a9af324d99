"""Meshes of exported files, read back independently of the code that made the part."""

from __future__ import annotations

import zipfile
from pathlib import Path
from xml.etree import ElementTree

import manifold3d
import numpy as np
import trimesh

from mirrorcam.core.values import FloatArray, Metric

CORE_3MF = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
MODEL_3MF = "3D/3dmodel.model"


def read_stl(path: Path) -> trimesh.Trimesh:
    """The mesh of an STL file, with coincident vertices merged."""
    return trimesh.load_mesh(path)


def read_3mf(path: Path) -> trimesh.Trimesh:
    """Read a 3MF file, mm, as one mesh: the objects of its build items in their positions on the bed.

    Raises ValueError for content that this program never writes: a different unit, or an object composed of others.
    """
    with zipfile.ZipFile(path) as package:
        model = ElementTree.fromstring(package.read(MODEL_3MF))
    unit = model.get("unit", "millimeter")
    if unit != "millimeter":
        raise ValueError(f"{path}: unit {unit}, expected millimeter")
    objects = {entry.get("id"): entry for entry in model.iter(f"{CORE_3MF}object")}
    points, corners = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)]
    for item in model.iter(f"{CORE_3MF}item"):
        body = objects[item.get("objectid")].find(f"{CORE_3MF}mesh")
        if body is None:
            raise ValueError(f"{path}: object {item.get('objectid')} has no mesh of its own")
        vertices = np.array([[float(v.attrib[axis]) for axis in "xyz"] for v in body.iter(f"{CORE_3MF}vertex")])
        faces = [[int(t.attrib[corner]) for corner in ("v1", "v2", "v3")] for t in body.iter(f"{CORE_3MF}triangle")]
        # Twelve numbers, row by row, of the matrix (4, 3) by which a row vector (x, y, z, 1) is multiplied.
        bed_from_object = np.array(item.get("transform", "1 0 0 0 1 0 0 0 1 0 0 0").split(), dtype=np.float64).reshape(
            4, 3
        )
        corners.append(np.array(faces) + sum(map(len, points)))
        points.append(vertices @ bed_from_object[:3] + bed_from_object[3])
    return trimesh.Trimesh(np.concatenate(points), np.concatenate(corners))


def solid_of(mesh: trimesh.Trimesh) -> manifold3d.Manifold:
    """A mesh as a solid of manifold3d; it may be invalid, see `is_manifold`."""
    return manifold3d.Manifold(manifold3d.Mesh64(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.uint64)))


def is_manifold(solid: manifold3d.Manifold) -> bool:
    """Return whether manifold3d found an oriented closed surface that encloses a volume."""
    return bool(solid.status() == manifold3d.Error.NoError and not solid.is_empty())


def check_mesh(mesh: trimesh.Trimesh, solid: manifold3d.Manifold) -> dict[str, Metric]:
    """Check that a mesh is watertight (trimesh), manifold (manifold3d) and in one piece."""
    manifold = is_manifold(solid)
    return {
        "mesh_watertight": Metric(value=bool(mesh.is_volume), unit="", limit=1, lower_is_better=False),
        "mesh_manifold": Metric(value=manifold, unit="", limit=1, lower_is_better=False),
        "mesh_pieces": Metric(value=len(solid.decompose()) if manifold else mesh.body_count, unit="", limit=1),
        "mesh_triangles": Metric(value=len(mesh.faces), unit=""),
    }


def hits(solid: manifold3d.Manifold, segments: FloatArray) -> int:
    """Number of segments (n, 2, 3) that meet the surface of a solid."""
    return sum(bool(solid.ray_cast(*segment)) for segment in segments)
