"""The assembled device as GLB: a node for every piece, with its name, number, colour and displacement when exploded."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.exchange.gltf import export_glb
from trimesh.graph import smooth_shade
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from mirrorcam.cad.assembly.pieces import Kind, Piece
from mirrorcam.cad.plan.part_plan import LICENCE
from mirrorcam.cad.write.threemf import DESIGNER
from mirrorcam.core.disk.files import atomic
from mirrorcam.core.values import FloatArray

ROOT = "device"
GLTF_FROM_RIG: FloatArray = 0.001 * np.array(
    [[-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1000.0]]
)
"""glTF is in metres, +Y up, its front towards +Z: the device stands with the rig's z up and looks along the rig's y."""

# Metallic and roughness of what a piece is made of.
FINISH: dict[Kind, tuple[float, float]] = {
    "part": (0.0, 0.75),
    "mirror": (1.0, 0.04),
    "camera": (0.0, 0.45),
    "screw": (0.9, 0.35),
    "insert": (0.9, 0.35),
    "washer": (0.9, 0.35),
    "nut": (0.9, 0.35),
    "pin": (0.9, 0.35),
    "spring": (0.9, 0.35),
}
# What glTF calls ELEMENT_ARRAY_BUFFER and ARRAY_BUFFER.
INDICES, VERTICES = 34963, 34962
# Edges sharper than this stay edges; the facets of a round hole melt into each other.
CREASE_RAD = np.radians(30.0)


def write_glb(path: Path, pieces: Sequence[Piece]) -> None:
    """Write the pieces as binary glTF 2.0.

    The node `device` carries `GLTF_FROM_RIG`; the nodes below it, one per piece and named like it, are in rig, mm.
    Their `extras` are `kind`, `number`, `title` and `explode_mm` [x, y, z] in rig: to explode the device, move each
    node by a share of it.
    """
    scene = trimesh.Scene()
    scene.graph.update(ROOT, scene.graph.base_frame, matrix=GLTF_FROM_RIG)
    for piece in pieces:
        extras = {
            "kind": piece.kind,
            "number": piece.number,
            "title": piece.title,
            "explode_mm": [round(float(length), 4) for length in piece.explode_mm],
        }
        scene.add_geometry(
            _shaded(piece), node_name=piece.name, geom_name=piece.name, parent_node_name=ROOT, metadata=extras
        )
    colours = {piece.name: [*linear(np.array(piece.rgb)).round(6).tolist(), 1.0] for piece in pieces}

    def finish(tree: dict[str, Any]) -> None:
        tree["asset"]["copyright"] = f"{DESIGNER}, {LICENCE}"
        # trimesh keeps colours in steps of 1/255.
        for material in tree["materials"]:
            material["pbrMetallicRoughness"]["baseColorFactor"] = colours[material["name"]]
        for mesh in tree["meshes"]:
            for primitive in mesh["primitives"]:
                _set_target(tree, primitive["indices"], INDICES)
                for accessor in primitive["attributes"].values():
                    _set_target(tree, accessor, VERTICES)

    data = export_glb(scene, include_normals=True, tree_postprocessor=finish)
    with atomic(path) as temporary:
        temporary.write_bytes(data)


def _set_target(tree: dict[str, Any], accessor: int, target: int) -> None:
    """Set the target of an accessor's buffer view, which viewers use before they read it."""
    tree["bufferViews"][tree["accessors"][accessor]["bufferView"]]["target"] = target


def _shaded(piece: Piece) -> trimesh.Trimesh:
    """The mesh of a piece, its vertices doubled along sharp edges, with its material."""
    mesh = smooth_shade(piece.mesh, angle=CREASE_RAD, facet_minarea=None)
    metallic, roughness = FINISH[piece.kind]
    material = PBRMaterial(
        name=piece.name, baseColorFactor=[*piece.rgb, 1.0], metallicFactor=metallic, roughnessFactor=roughness
    )
    normals = np.array(mesh.vertex_normals)
    # The corners of a facet without area have none; nothing is seen of it, but glTF requires unit vectors.
    normals[np.linalg.norm(normals, axis=1) < 0.5] = (0.0, 0.0, 1.0)
    return trimesh.Trimesh(
        mesh.vertices,
        mesh.faces,
        vertex_normals=normals,
        visual=TextureVisuals(material=material),
        process=False,
    )


def linear(srgb: FloatArray) -> FloatArray:
    """Linear light of sRGB values 0 to 1 (IEC 61966-2-1): glTF's colours are linear."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
