"""Files of a part for a CAD program and for a printer: the same part gives the same bytes; and what it weighs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from build123d import CenterOf, Shape, export_step
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepTools import BRepTools
from OCP.StlAPI import StlAPI_Writer

from mirrorcam.cad.plan.part_plan import MassProperties, NamedFace
from mirrorcam.cad.write.face_names import name_faces
from mirrorcam.core.disk.files import atomic

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
