"""Seats and pockets of the mirrors, read back from exported STEP files and measured against the layout."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from build123d import Face, GeomType, Shape, Wire
from shapely import Polygon, get_parts, make_valid, maximum_inscribed_circle, unary_union
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from mirrorcam.cad.holder.pads import PADS, min_altitude_mm
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import outline_at
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror

# Tolerances within which a face belongs to a seat or its pads, not to what is behind the seat.
SEAT_SEARCH_MM = 0.25
SEAT_SEARCH_DEG = 0.5
# Tolerance of a seat's cover against its plan, since both the plan and the file have rounded lines.
COVER_ROUNDING = 1e-3
# Tolerances within which a wall belongs to a pocket: distance from the planned wall, and angle to the mirror's edge.
WALL_SEARCH_MM = 0.1
WALL_SEARCH_DEG = 0.1
CURVE_POINTS = 17
# Smaller areas, a third of the square of a printed line's width, are ignored. Obstacles of any size are found by the
# check that lowers the mirror into its seat.
MIN_AREA_MM2 = 0.05


@dataclass(frozen=True)
class FlatFace:
    """A flat face of a solid and its outward unit normal (3,)."""

    face: Face
    normal: FloatArray

    @cached_property
    def loops(self) -> tuple[FloatArray, ...]:
        """Loops of corners (n, 3) of its borders, the outer border first."""
        return (_loop(self.face.outer_wire()), *map(_loop, self.face.inner_wires()))

    def projected_area(self, frame: FloatArray) -> BaseGeometry:
        """Its area, projected to x and y of a frame (4, 4).

        Borders that touch in the solid but cross due to rounding are repaired.
        """
        outer, *holes = ((loop - frame[:3, 3]) @ frame[:3, :2] for loop in self.loops)
        return make_valid(Polygon(outer, holes), method="structure", keep_collapsed=False)

    def angle_deg(self, direction: FloatArray) -> float:
        """Angle between its normal and a unit vector (3,)."""
        sine = np.linalg.norm(np.cross(self.normal, direction))
        return float(np.degrees(np.arctan2(sine, self.normal @ direction)))


def flat_faces(shapes: Iterable[Shape[Any]]) -> list[FlatFace]:
    """All flat faces of solids."""
    return [
        FlatFace(face, np.array(tuple(face.normal_at())))
        for shape in shapes
        for face in shape.faces().filter_by(GeomType.PLANE)
    ]


def _loop(wire: Wire) -> FloatArray:
    """Corners (n, 3) of a closed wire, with sampled points of curved edges.

    Edges are chained by their nearest ends, since coincident corners in a file differ by more than build123d tolerates.
    """
    remaining = []
    for edge in wire.edges():
        count = 1 if edge.geom_type == GeomType.LINE else CURVE_POINTS
        remaining.append(np.array([tuple(edge @ (index / count)) for index in range(count + 1)]))
    points = [remaining.pop(0)]
    while remaining:
        ends = np.array([(line[0], line[-1]) for line in remaining])
        index, is_reversed = divmod(int(np.linalg.norm(ends - points[-1][-1], axis=2).argmin()), 2)
        line = remaining.pop(index)
        points.append(line[::-1] if is_reversed else line)
    return np.concatenate([line[:-1] for line in points])


def _facing(faces: Sequence[FlatFace], direction: FloatArray, max_deg: float) -> list[FlatFace]:
    """The faces whose normals are within an angle of a unit vector (3,)."""
    normals = np.array([face.normal for face in faces]).reshape(-1, 3)
    return [faces[index] for index in np.flatnonzero(normals @ direction > np.cos(np.radians(max_deg))).tolist()]


@dataclass(frozen=True)
class Seat:
    """A mirror's seat as read from the files: the pads that carry it, and the floor behind them, covered by glue.

    `offset_mm` is the largest distance of the pads' planes from the corners of the mirror's back, `bond_error_mm` the
    largest error of the floor's distance behind it, and `angle_deg` the largest tilt of pads and floor. `pads_in_plane`
    (n, 2) are the centres of the pads. `cover` is the fraction of the outline with floor behind it, `span_mm` the
    diameter of the largest circle on the mirror with neither pad nor floor behind it.
    """

    offset_mm: float
    bond_error_mm: float
    angle_deg: float
    pads_in_plane: FloatArray
    cover: float
    span_mm: float

    def carries(self, mirror: Mirror) -> bool:
        """Return whether there are three pads with the mirror's centroid inside their triangle."""
        centroid = Polygon(mirror.outline_in_plane_mm).centroid
        return len(self.pads_in_plane) == PADS and Polygon(self.pads_in_plane).contains(centroid)

    @property
    def base_mm(self) -> float:
        """Smallest altitude of the triangle of the pads; 0 unless there are three."""
        return float(min_altitude_mm(self.pads_in_plane[None])[0]) if len(self.pads_in_plane) == PADS else 0.0


def find_seat(faces: Sequence[FlatFace], mirror: Mirror, bond_mm: float, on_pads_mm: float = 0.0) -> Seat | None:
    """The seat of a mirror: pads about `on_pads_mm` behind the plane of its back, and a floor `bond_mm` behind them.

    Only areas behind its outline count; None if there is no floor.
    """
    outline = Polygon(mirror.outline_in_plane_mm)
    depths_mm = (on_pads_mm, on_pads_mm + bond_mm)
    corners = {depth: outline_at(mirror, mirror.back_mm - depth) for depth in depths_mm}
    candidates: dict[float, list[tuple[FlatFace, BaseGeometry]]] = {depth: [] for depth in corners}
    for face in _facing(faces, mirror.normal_in_rig, SEAT_SEARCH_DEG):
        depths = mirror.back_mm - mirror.distance_mm - face.loops[0] @ mirror.normal_in_rig
        depth = min(corners, key=lambda plane: abs(float(depths.mean()) - plane))
        if np.abs(depths - depth).min() > SEAT_SEARCH_MM:
            continue
        area = face.projected_area(mirror.rig_from_plane).intersection(outline)
        if area.area > MIN_AREA_MM2:
            candidates[depth].append((face, area))
    pads, floors = candidates.values()
    if not floors:
        return None
    floor = unary_union([area for _, area in floors])
    pad_areas = get_parts(unary_union([area for _, area in pads]))
    free = [
        area for area in get_parts(outline.difference(unary_union([floor, *pad_areas]))) if area.area > MIN_AREA_MM2
    ]
    errors = {
        depth: max(
            (float(np.abs((corners[depth] - face.loops[0][0]) @ face.normal).max()) for face, _ in members), default=0.0
        )
        for depth, members in candidates.items()
    }
    return Seat(
        offset_mm=errors[depths_mm[0]],
        bond_error_mm=errors[depths_mm[1]],
        angle_deg=max(face.angle_deg(mirror.normal_in_rig) for face, _ in (*pads, *floors)),
        pads_in_plane=np.array([area.centroid.coords[0] for area in pad_areas]).reshape(-1, 2),
        cover=float(floor.area / outline.area),
        span_mm=max((2.0 * maximum_inscribed_circle(area, tolerance=0.01).length for area in free), default=0.0),
    )


def pocket_gaps_mm(faces: Sequence[FlatFace], mirror: Mirror, fit_mm: float) -> list[float]:
    """Distances between a mirror's edges and the walls of its pocket: flat faces next to and parallel to an edge."""
    frame, back = mirror.rig_from_plane, mirror.back_mm
    corners = np.array(orient(Polygon(mirror.outline_in_plane_mm)).exterior.coords)
    gaps = []
    for start, end in pairwise(corners):
        length = float(np.linalg.norm(end - start))
        direction = (end - start) / length
        outward = np.array([direction[1], -direction[0]])
        for face in _facing(faces, -frame[:3, :2] @ outward, WALL_SEARCH_DEG):
            local = (face.loops[0] - frame[:3, 3]) @ frame[:3, :3]
            distances = (local[:, :2] - start) @ outward
            if np.abs(distances - fit_mm).max() > WALL_SEARCH_MM:
                continue
            positions = (local[:, :2] - start) @ direction
            # Exclude walls of adjacent pockets that are collinear with this edge.
            inside = positions.max() > 0.0 and positions.min() < length
            if inside and local[:, 2].max() > back + SEAT_SEARCH_MM and local[:, 2].min() < back + mirror.thickness_mm:
                gaps += [float(distances.min()), float(distances.max())]
    return gaps


def check_seats(
    faces: Sequence[FlatFace], layout: Layout, hardware: Hardware, planned_cover: Sequence[float]
) -> dict[str, Metric]:
    """Check seats and pockets against the layout.

    Parameters
    ----------
    faces : sequence of FlatFace
        Flat faces of all pieces of the holder, as read from STEP files, in the rig frame, mm.
    layout : Layout
        The mirrors of the seats.
    hardware : Hardware
        The fit of a mirror in its pocket, and the thickness of the glue behind it.
    planned_cover : sequence of float
        Planned fraction of every mirror's back that its seat covers.

    Returns
    -------
    dict of str to Metric
        The largest errors of seats, pads, floors and pocket walls.
    """
    fit = hardware.fit.free_mm
    holder = hardware.holder
    seats = [find_seat(faces, mirror, holder.bond_mm, holder.on_pads_mm) for mirror in layout.mirrors]
    existing = [seat for seat in seats if seat is not None]
    carried = [bool(seat and seat.carries(mirror)) for seat, mirror in zip(seats, layout.mirrors, strict=True)]
    covers = [seat.cover if seat else 0.0 for seat in seats]
    gaps = [gap for mirror in layout.mirrors for gap in pocket_gaps_mm(faces, mirror, fit)]
    return {
        "seats_missing": Metric(value=len(seats) - len(existing), unit="", limit=0),
        "seat_offset_um": Metric(
            value=max((seat.offset_mm for seat in existing), default=0.0) * 1000.0, unit="um", limit=1.0
        ),
        "seats_without_three_pads": Metric(value=len(carried) - sum(carried), unit="", limit=0),
        "seat_base_mm": Metric(value=min((seat.base_mm for seat in existing), default=0.0), unit="mm"),
        "bond_error_um": Metric(
            value=max((seat.bond_error_mm for seat in existing), default=0.0) * 1000.0, unit="um", limit=1.0
        ),
        "seat_angle_deg": Metric(
            value=max((seat.angle_deg for seat in existing), default=0.0), unit="deg", limit=0.001
        ),
        "seat_cover": Metric(value=min(covers), unit=""),
        "seat_cover_lost": Metric(
            value=max(planned - cover for planned, cover in zip(planned_cover, covers, strict=True)),
            unit="",
            limit=COVER_ROUNDING,
        ),
        "seat_span_mm": Metric(value=max((seat.span_mm for seat in existing), default=0.0), unit="mm"),
        "pocket_walls": Metric(value=len(gaps) // 2, unit=""),
        "pocket_error_um": Metric(
            value=max((abs(gap - fit) for gap in gaps), default=0.0) * 1000.0, unit="um", limit=1.0
        ),
    }
