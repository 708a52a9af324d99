"""Seats of the mirrors, read back from an exported STEP and measured against the layout."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from build123d import Compound, Face, GeomType, import_step
from shapely import Point, Polygon

from cad.seats import back_height_mm, outline_at, seat_distance_mm
from optics.layout import Layout
from optics.mirror import Mirror
from optics.values import FloatArray, Metric

# A face this far from where a seat belongs (mm, and cosine of the angle) is not taken for that seat.
SEAT_SEARCH_MM = 5.0
SEAT_SEARCH_COSINE = 0.9
# A seat may lose this much of the mirror it bears to a neighbour's light and pocket, at its edge.
SEAT_COVER = 0.99


def check_step(path: Path, layout: Layout) -> dict[str, Metric]:
    """One valid solid, and the worst seat: how far its plane is from the layout's, and how much of the mirror it bears.

    The offset is the largest distance of a corner of the mirror's back from the seat face.
    """
    shape = import_step(path)
    solids = shape.solids()
    found = [find_seat(shape, mirror) for mirror in layout.mirrors]
    seats = [(mirror, seat) for mirror, seat in zip(layout.mirrors, found, strict=True) if seat is not None]
    return {
        "solids": Metric(value=len(solids), unit="", limit=1),
        "invalid_solids": Metric(value=sum(not solid.is_valid for solid in solids) if solids else 1, unit="", limit=0),
        "seats_missing": Metric(value=len(found) - len(seats), unit="", limit=0),
        "seat_offset_um": Metric(value=max((s.offset_um(m) for m, s in seats), default=0.0), unit="um", limit=1.0),
        "seat_angle_deg": Metric(value=max((s.angle_deg(m) for m, s in seats), default=0.0), unit="deg", limit=0.001),
        "seat_cover": Metric(
            value=min((s.cover(m) for m, s in seats), default=0.0),
            unit="",
            limit=SEAT_COVER,
            lower_is_better=False,
        ),
        "volume_cm3": Metric(value=sum(solid.volume for solid in solids) / 1000.0, unit="cm3"),
    }


@dataclass(frozen=True)
class SeatFace:
    """A flat face of the part: a point (3,) and the outward unit normal (3,) of its plane, its area in mirror axes."""

    point: FloatArray
    normal: FloatArray
    area: Polygon

    def offset_um(self, mirror: Mirror) -> float:
        """Largest distance of the corners of the mirror's back from the face's plane."""
        corners = outline_at(mirror, back_height_mm(mirror))
        return float(np.abs((corners - self.point) @ self.normal).max()) * 1000.0

    def angle_deg(self, mirror: Mirror) -> float:
        """Angle between the face's normal and the mirror's."""
        across = np.linalg.norm(np.cross(self.normal, mirror.normal_in_rig))
        return float(np.degrees(np.arctan2(across, self.normal @ mirror.normal_in_rig)))

    def cover(self, mirror: Mirror) -> float:
        """Share of the mirror's outline that lies on the face."""
        outline = Polygon(mirror.outline_in_plane_mm)
        return float(self.area.intersection(outline).area / outline.area)


def find_seat(shape: Compound, mirror: Mirror) -> SeatFace | None:
    """The flat face behind the middle of a mirror that is nearest to where its seat belongs."""
    frame = mirror.rig_from_plane
    nearest: tuple[float, SeatFace] | None = None
    for face in shape.faces().filter_by(GeomType.PLANE):
        normal = np.array(tuple(face.normal_at()))
        if normal @ mirror.normal_in_rig < SEAT_SEARCH_COSINE:
            continue
        point = np.array(tuple(face.vertices()[0]))
        middle = frame[:3, 3] - (seat_distance_mm(mirror) - mirror.distance_mm) * mirror.normal_in_rig
        away = abs(float((middle - point) @ normal))
        if away > SEAT_SEARCH_MM or (nearest and away >= nearest[0]):
            continue
        area = _face_polygon(face, frame)
        if area.contains(Point(0.0, 0.0)):
            nearest = (away, SeatFace(point, normal, area))
    return nearest[1] if nearest else None


def _face_polygon(face: Face, frame: FloatArray) -> Polygon:
    """A face with straight edges, in the x and y of a frame (4, 4) and seen along its z."""

    def loop(wire: object) -> FloatArray:
        corners = np.array([tuple(edge @ 0) for edge in wire.order_edges()])  # type: ignore[attr-defined]
        return (corners - frame[:3, 3]) @ frame[:3, :2]

    return Polygon(loop(face.outer_wire()), [loop(wire) for wire in face.inner_wires()])
