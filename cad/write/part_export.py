"""Reproducible files of a part for a CAD program and a printer, and its mass properties.

A STEP file has named faces: each `ADVANCED_FACE` of a solid, in the order of the solid's faces.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from build123d import CenterOf, Face, GeomType, Shape, Vertex, export_step
from numpy.typing import NDArray
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepTools import BRepTools
from OCP.StlAPI import StlAPI_Writer
from shapely import Polygon, contains_xy

from mirrorcam.cad.plan.part_plan import MassProperties, NamedFace
from mirrorcam.core.disk.files import atomic
from mirrorcam.core.values import FloatArray

# Tolerances (1 - cosine, and distance) within which a face lies in a plane.
PARALLEL_TOLERANCE, IN_PLANE_MM = 1e-5, 0.01
# Difference in distance within which two faces are equally near, such as the halves of a face divided by a groove.
EQUALLY_NEAR_MM = 1.0
SHELL = re.compile(r"CLOSED_SHELL\('[^']*',\(([^)]*)\)")


def name_faces(text: str, solid: Shape[Any], faces: Sequence[NamedFace]) -> str:
    """The text of a solid's STEP file with the names of its faces; raises ValueError if the faces do not match.

    Several faces of one name are numbered: "seat_0-0_2".
    """
    entities = [entity for shell in SHELL.findall(text) for entity in re.findall(r"#\d+", shell)]
    flat = _flat_faces(solid)
    if len(entities) != len(solid.faces()):
        raise ValueError(f"the STEP file has {len(entities)} faces, expected {len(solid.faces())}")
    names: dict[str, str] = {}
    for named_face in faces:
        indices = _indices_of(flat, named_face)
        for number, index in enumerate(indices, start=1):
            names[entities[index]] = named_face.name if len(indices) == 1 else f"{named_face.name}_{number}"

    def with_name(match: re.Match[str]) -> str:
        return f"{match[1]} = ADVANCED_FACE('{names.get(match[1], '')}'"

    return re.sub(r"^(#\d+) = ADVANCED_FACE\('[^']*'", with_name, text, flags=re.MULTILINE)


@dataclass(frozen=True)
class _Flat:
    """The flat faces of a solid, with their indices (n,) among all faces, normals (n, 3) and centres (n, 3)."""

    faces: Sequence[Face]
    indices: NDArray[np.int64]
    normals: FloatArray
    centres: FloatArray


def _flat_faces(solid: Shape[Any]) -> _Flat:
    indexed = [(index, face) for index, face in enumerate(solid.faces()) if face.geom_type == GeomType.PLANE]
    faces = [face for _, face in indexed]
    return _Flat(
        faces,
        np.array([index for index, _ in indexed]),
        np.array([tuple(face.normal_at()) for face in faces]),
        np.array([tuple(face.center()) for face in faces]),
    )


def _indices_of(flat: _Flat, named_face: NamedFace) -> list[int]:
    """The indices of the faces with a name; empty if the part has no face in that plane."""
    parallel = flat.normals @ named_face.normal > 1.0 - PARALLEL_TOLERANCE
    in_plane = np.abs((flat.centres - named_face.point) @ named_face.normal) < IN_PLANE_MM
    indices = np.flatnonzero(parallel & in_plane)
    if named_face.within is not None:
        axes = np.linalg.svd(named_face.normal[None])[2][1:]
        centres, outline = (points @ axes.T for points in (flat.centres[indices], named_face.within))
        indices = indices[contains_xy(Polygon(outline), centres[:, 0], centres[:, 1])]
    elif len(indices):
        point = Vertex(*named_face.point)
        distances = np.array([flat.faces[int(index)].distance_to(point) for index in indices])
        indices = indices[distances < distances.min() + EQUALLY_NEAR_MM]
    return [int(index) for index in flat.indices[indices]]


# A STEP file contains a time stamp; a fixed one makes the bytes reproducible.
STEP_TIME = "2000-01-01T00:00:00"
STL_TOLERANCE_MM = 0.02
STL_ANGLE_RAD = 0.2


def write_step(path: Path, shape: Shape[Any], faces: Sequence[NamedFace] = ()) -> None:
    """Write a part or an assembly as STEP, in mm, named by its label, with named `faces` of a part."""
    with atomic(path) as temporary:
        # Parametric curves of flat faces are redundant and double the size of the file.
        if not export_step(shape, temporary, write_pcurves=False, timestamp=STEP_TIME):
            raise OSError("the STEP writer failed")
        if faces:
            text = temporary.read_text(encoding="utf-8")
            temporary.write_text(name_faces(text, shape, faces), encoding="utf-8", newline="\n")


def write_stl(path: Path, shape: Shape[Any]) -> None:
    """Write a part as binary STL, with facets within `STL_TOLERANCE_MM` of the part."""
    # build123d's writer scales the tolerance by each edge: on a ring of 63 mm, the error is 1.5 times larger.
    BRepTools.Clean_s(shape.wrapped)
    BRepMesh_IncrementalMesh(shape.wrapped, STL_TOLERANCE_MM, False, STL_ANGLE_RAD, True)
    writer = StlAPI_Writer()
    writer.ASCIIMode = False
    with atomic(path) as temporary:
        if not writer.Write(shape.wrapped, str(temporary)):
            raise OSError("the STL writer failed")


def mass_properties(solid: Shape[Any], density_g_per_cm3: float) -> MassProperties:
    """Volume, mass, centre and inertia in the rig frame of a solid of one material, integrated over its exact faces."""
    density_g_per_mm3 = density_g_per_cm3 / 1000.0
    return MassProperties(
        volume_mm3=solid.volume,
        mass_g=solid.volume * density_g_per_mm3,
        centre_in_rig_mm=np.array(tuple(solid.center(CenterOf.MASS))),
        inertia_g_mm2=np.array(solid.matrix_of_inertia) * density_g_per_mm3,
    )
