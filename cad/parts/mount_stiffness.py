"""Stiffness of the mount: skins, webs and the foot's plate as folded plates, softened by their openings."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from shapely import LineString, Point

from mirrorcam.cad.parts.foot import FOOT_X_MM, FOOT_Y_MM, foot_plate_mm
from mirrorcam.cad.parts.truss import webs_between
from mirrorcam.cad.plan.beam import POISSON, Section
from mirrorcam.cad.plan.fasteners import Bore, Hexagon
from mirrorcam.cad.plan.folded_plates import FoldedPlates
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.perforations import softening
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.values import FloatArray

# A screw of the head holds its skin this far to either side, about as far as its head reaches.
SCREW_REACH_MM = 3.0
# A screw of the foot holds the plastic on a disc of this radius, about as far as its pressure spreads in the back.
DISC_MM = 6.0
# Finite elements of solids tilt up to 1.28 times as far about x as these plates do, and .96 to 1.05 times about the
# other axes, over mounts of 1 x 2 to 5 x 5 mirrors (docs/cad.md). What plates have not: openings that act on each
# other, and webs cut where they meet a skin. With both factors no mount of these is softer than stated.
KNOCK_DOWN_ABOUT_X, KNOCK_DOWN = 1.18, 1.1


def mount_compliance(
    inner: FloatArray,
    outer: FloatArray,
    section: Section,
    screws: FloatArray,
    cuts: Sequence[Frustum | Bore | Hexagon],
    load: FloatArray,
    hardware: Hardware,
) -> FloatArray:
    """How the mirror holder moves on a mount whose foot is screwed to what does not move.

    Parameters
    ----------
    inner, outer
        The lines (n, 2; y and z) that the mount's profile lies between.
    section
        Its skins and webs.
    screws : (4, 3) array
        Points in rig, mm, where the screws of the head meet its face, two in each of two rows.
    cuts
        Openings of the mount.
    load : (3,) array
        Point in rig, mm, where forces act on the holder.
    hardware
        Dimensions of the foot.

    Returns
    -------
    (6, 6) array
        Column j: shift of the point in mm and turn in rad for a unit force (j < 3, N) or moment (N mm) on the holder,
        which is rigid beside the mount. Safely large, by the knock-downs.
    """
    webs = webs_between(inner, outer, section, hardware)
    plate = foot_plate_mm(section.depth_mm, hardware)
    # The skins leave the foot's plate at its top.
    level = float(inner[0, 1]) + plate
    feet = [np.array([line[0, 0], level]) for line in (webs.inner, webs.outer)]
    footed = np.array([(inner[0, 0] - y, level) for y in FOOT_Y_MM])
    head = LineString(webs.inner)
    rows = [
        np.array(head.interpolate(head.project(Point(row)) + side * SCREW_REACH_MM).coords[0])
        for row in screws[[0, 2], 1:]
        for side in (-1.0, 1.0)
    ]
    edges = _Edges()
    strips = [
        *_along([feet[0], *webs.inner], [*webs.webs.reshape(-1, 2), *rows], section.skin_mm),
        *_along([feet[1], *webs.outer], webs.webs.reshape(-1, 2), section.skin_mm),
        *((start, end, plate) for start, end in pairwise([feet[0], *footed, feet[1]])),
        *((start, end, section.web_mm) for start, end in webs.webs),
    ]
    half_width = section.width_mm / 2.0
    soft = np.array([softening(start, end, half_width, cuts) for start, end, _ in strips])
    plates = FoldedPlates(
        strips=np.array([(edges.at(start), edges.at(end)) for start, end, _ in strips]),
        edges=np.array(edges.points),
        thickness_mm=np.array([thickness for *_, thickness in strips]),
        modulus_mpa=section.plastic_mpa / soft,
        poisson=POISSON,
        half_width_mm=half_width,
    )
    foot_edges = np.repeat([edges.at(point) for point in footed], 2)
    head_edges = np.repeat([edges.at(row) for row in rows], 2)
    compliance = plates.compliance(
        bed=disc_on_solid(DISC_MM, section.plastic_mpa),
        ground=(foot_edges, np.tile([-FOOT_X_MM, FOOT_X_MM], len(footed))),
        held=(head_edges, np.concatenate([screws[[0, 1, 0, 1], 0], screws[[2, 3, 2, 3], 0]])),
        at=load,
    )
    # Forces along y and z, and moments about x, work together: those in the plane of the profile.
    in_plane = np.sqrt(KNOCK_DOWN_ABOUT_X) ** np.array([0, 1, 1, 1, 0, 0])
    return np.asarray(KNOCK_DOWN * compliance * np.outer(in_plane, in_plane))


def disc_on_solid(radius_mm: float, modulus_mpa: float) -> FloatArray:
    """Stiffness (4,) of a rigid disc bonded to a half-space: along x, y and z in N/mm, about x in N mm/rad.

    Its own plane is that of x and y. Johnson, Contact Mechanics (1985), sections 3.7 and 3.8 for frictionless discs.
    """
    shear = modulus_mpa / (2.0 * (1.0 + POISSON))
    sideways = 8.0 * shear * radius_mm / (2.0 - POISSON)
    down = 4.0 * shear * radius_mm / (1.0 - POISSON)
    return np.array([sideways, sideways, down, 8.0 * shear * radius_mm**3 / (3.0 * (1.0 - POISSON))])


class _Edges:
    """Points of y and z, each once."""

    def __init__(self) -> None:
        self.points: list[FloatArray] = []
        self._index: dict[tuple[float, ...], int] = {}

    def at(self, point: FloatArray) -> int:
        key = tuple(float(value) for value in np.round(point, 3))
        if key not in self._index:
            self._index[key] = len(self.points)
            self.points.append(point)
        return self._index[key]


def _along(
    line: Sequence[FloatArray], points: Sequence[FloatArray] | FloatArray, thickness_mm: float
) -> list[tuple[FloatArray, FloatArray, float]]:
    """Strips from corner to corner of a line, and from point to point of those that lie on it."""
    path = LineString(line)
    on_path = [point for point in points if path.distance(Point(point)) < 1e-6]
    ordered = sorted([*line, *on_path], key=lambda point: path.project(Point(point)))
    return [(start, end, thickness_mm) for start, end in pairwise(ordered) if float(np.linalg.norm(end - start)) > 1e-3]
