"""Names of faces in a STEP file: each `ADVANCED_FACE` of a solid, in the order of the solid's faces."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from build123d import Face, GeomType, Shape, Vertex
from numpy.typing import NDArray
from shapely import Polygon, contains_xy

from mirrorcam.cad.plan.part_plan import NamedFace
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
