"""Meshes of exported files, read by libraries that know nothing of how the part was made."""

from __future__ import annotations

from pathlib import Path

import manifold3d
import numpy as np
import trimesh

from optics.values import FloatArray, Metric

# Volumes of a file and of the solid may differ by what a mesh of `STL_TOLERANCE_MM` cuts off round holes and arcs.
VOLUME_SHARE = 2e-3


def read_mesh(path: Path) -> trimesh.Trimesh:
    """The one mesh of an STL or 3MF file, as it lies in the file; vertices at the same place are one."""
    return trimesh.load_mesh(path)


def solid_of(mesh: trimesh.Trimesh) -> manifold3d.Manifold:
    """A mesh as manifold3d takes it; its `status()` says whether it is one."""
    return manifold3d.Manifold(manifold3d.Mesh64(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.uint64)))


def is_manifold(solid: manifold3d.Manifold) -> bool:
    """Whether manifold3d found an oriented surface without holes that encloses something."""
    return bool(solid.status() == manifold3d.Error.NoError and not solid.is_empty())


def check_mesh(mesh: trimesh.Trimesh, solid: manifold3d.Manifold) -> dict[str, Metric]:
    """Watertight (trimesh), manifold (manifold3d), in one piece."""
    manifold = is_manifold(solid)
    return {
        "mesh_watertight": Metric(value=bool(mesh.is_volume), unit="", limit=1, lower_is_better=False),
        "mesh_manifold": Metric(value=manifold, unit="", limit=1, lower_is_better=False),
        "mesh_pieces": Metric(value=len(solid.decompose()) if manifold else mesh.body_count, unit="", limit=1),
        "mesh_triangles": Metric(value=len(mesh.faces), unit=""),
    }


def hits(solid: manifold3d.Manifold, segments: FloatArray) -> int:
    """How many of the segments (n, 2, 3) meet the surface of a solid."""
    return sum(bool(solid.ray_cast(*segment)) for segment in segments)
