"""Files of a part for a CAD program and a printer, the same bytes for the same part, and what it weighs.

A STEP file names faces: each `ADVANCED_FACE` of a solid, in the order of the solid's faces.
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

# A face is of a plane where its normal and its distance agree with it to this.
PARALLEL, NEAR_MM = 1e-5, 0.01
# Both halves of a face that is divided by a groove are as near.
EQUALLY_NEAR_MM = 1.0
SHELL = re.compile(r"CLOSED_SHELL\('[^']*',\(([^)]*)\)")


def name_faces(text: str, solid: Shape[Any], faces: Sequence[NamedFace]) -> str:
    """The text of a solid's STEP file with the names of its faces; raises ValueError where it holds other faces.

    One of several faces of a name has its number behind it: "seat_0-0_2".
    """
    entities = [entity for shell in SHELL.findall(text) for entity in re.findall(r"#\d+", shell)]
    flat = _flat_faces(solid)
    if len(entities) != len(solid.faces()):
        raise ValueError(f"the STEP file holds {len(entities)} faces, expected {len(solid.faces())}")
    names: dict[str, str] = {}
    for wanted in faces:
        found = _of(flat, wanted)
        for number, index in enumerate(found, start=1):
            names[entities[index]] = wanted.name if len(found) == 1 else f"{wanted.name}_{number}"

    def named(match: re.Match[str]) -> str:
        return f"{match[1]} = ADVANCED_FACE('{names.get(match[1], '')}'"

    return re.sub(r"^(#\d+) = ADVANCED_FACE\('[^']*'", named, text, flags=re.MULTILINE)


@dataclass(frozen=True)
class _Flat:
    """The flat faces of a solid, their indices (n,) among all of its faces, normals (n, 3) and middles (n, 3)."""

    faces: Sequence[Face]
    indices: NDArray[np.int64]
    normals: FloatArray
    middles: FloatArray


def _flat_faces(solid: Shape[Any]) -> _Flat:
    indexed = [(index, face) for index, face in enumerate(solid.faces()) if face.geom_type == GeomType.PLANE]
    faces = [face for _, face in indexed]
    return _Flat(
        faces,
        np.array([index for index, _ in indexed]),
        np.array([tuple(face.normal_at()) for face in faces]),
        np.array([tuple(face.center()) for face in faces]),
    )


def _of(flat: _Flat, wanted: NamedFace) -> list[int]:
    """The indices of the faces that a name is for; none where the part has no face in its plane."""
    parallel = flat.normals @ wanted.normal > 1.0 - PARALLEL
    near = np.abs((flat.middles - wanted.point) @ wanted.normal) < NEAR_MM
    found = np.flatnonzero(parallel & near)
    if wanted.within is not None:
        axes = np.linalg.svd(wanted.normal[None])[2][1:]
        middles, outline = (points @ axes.T for points in (flat.middles[found], wanted.within))
        found = found[contains_xy(Polygon(outline), middles[:, 0], middles[:, 1])]
    elif len(found):
        point = Vertex(*wanted.point)
        distances = np.array([flat.faces[int(index)].distance_to(point) for index in found])
        found = found[distances < distances.min() + EQUALLY_NEAR_MM]
    return [int(index) for index in flat.indices[found]]


# A STEP file names a time; a fixed one keeps the bytes the same from day to day.
STEP_TIME = "2000-01-01T00:00:00"
STL_TOLERANCE_MM = 0.02
STL_ANGLE_RAD = 0.2


def write_step(path: Path, shape: Shape[Any], faces: Sequence[NamedFace] = ()) -> None:
    """Write a part or an assembly as STEP, in mm, named by its label; `faces` of a part have names in the file."""
    with atomic(path) as temporary:
        # Curves in the parameters of flat faces say nothing that the faces do not, and double the file.
        if not export_step(shape, temporary, write_pcurves=False, timestamp=STEP_TIME):
            raise OSError("the STEP writer failed")
        if faces:
            text = temporary.read_text(encoding="utf-8")
            temporary.write_text(name_faces(text, shape, faces), encoding="utf-8", newline="\n")


def write_stl(path: Path, shape: Shape[Any]) -> None:
    """Write a part as binary STL: no facet further than `STL_TOLERANCE_MM` from the part."""
    # build123d's own writer takes the tolerance for a share of each edge: on a ring of 63 mm it is missed by half.
    BRepTools.Clean_s(shape.wrapped)
    BRepMesh_IncrementalMesh(shape.wrapped, STL_TOLERANCE_MM, False, STL_ANGLE_RAD, True)
    writer = StlAPI_Writer()
    writer.ASCIIMode = False
    with atomic(path) as temporary:
        if not writer.Write(shape.wrapped, str(temporary)):
            raise OSError("the STL writer failed")


def mass_properties(solid: Shape[Any], density_g_per_cm3: float) -> MassProperties:
    """Volume, mass, centre and inertia of a solid in rig, filled with one material: integrals over its exact faces."""
    density_g_per_mm3 = density_g_per_cm3 / 1000.0
    return MassProperties(
        volume_mm3=solid.volume,
        mass_g=solid.volume * density_g_per_mm3,
        centre_in_rig_mm=np.array(tuple(solid.center(CenterOf.MASS))),
        inertia_g_mm2=np.array(solid.matrix_of_inertia) * density_g_per_mm3,
    )
