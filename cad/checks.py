"""Checks of the exported files, each read back and measured against the layout; a failure is a metric, not an error."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import manifold3d
import numpy as np
import trimesh
from build123d import Compound, Face, GeomType, import_step
from ezdxf.entities.lwpolyline import LWPolyline
from ezdxf.filemanagement import readfile
from shapely import Point, Polygon, STRtree, contains_xy, get_coordinates, unary_union

from cad.cutting import outline_from_back
from cad.hardware import Hardware
from cad.seats import back_height_mm, outline_at, seat_distance_mm, sheet, working_distance_mm
from optics.layout import Layout
from optics.mirror import Mirror
from optics.values import FloatArray, Metric

# A face this far from where a seat belongs (mm, and cosine of the angle) is not taken for that seat.
SEAT_SEARCH_MM = 5.0
SEAT_SEARCH_COSINE = 0.9
# A seat may lose this much of the mirror it bears to a neighbour's light and pocket, at its edge.
SEAT_COVER = 0.99
# Rays stop this far from a surface that they leave or reach: the rounding of the STL's 32-bit numbers is 1e-5 mm.
SURFACE_MM = 1e-3
# Two faces make a wall where they are parallel to 15 deg; the edge of a wedge is not a wall.
WALL_COSINE = np.cos(np.radians(15.0))
WALL_SAMPLE_MM2 = 1.0
WALL_DOT_MM2 = 0.5
RAY_STEP_MM = 1.0


def check_files(folder: Path, layout: Layout, hardware: Hardware) -> dict[str, Metric]:
    """All checks of `mirror_holder.step`, `mirror_holder.stl` and `mirrors.dxf` in a folder."""
    return {
        **check_step(folder / "mirror_holder.step", layout),
        **check_stl(folder / "mirror_holder.stl", layout, hardware),
        **check_dxf(folder / "mirrors.dxf", layout),
    }


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


def check_stl(path: Path, layout: Layout, hardware: Hardware) -> dict[str, Metric]:
    """Watertight (trimesh), manifold (manifold3d), in one piece, free of the light, and its thinnest wall.

    Rays are cast at the mesh by manifold3d, which knows nothing of how the part was made. At a mesh that is not
    manifold no ray proves anything: all count as blocked, and the wall as nothing.
    """
    mesh = trimesh.load_mesh(path)
    body = manifold3d.Manifold(manifold3d.Mesh64(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.uint64)))
    manifold = body.status() == manifold3d.Error.NoError and not body.is_empty()
    rays = np.concatenate(
        [light_rays(layout, index, hardware).reshape(-1, 2, 3) for index in range(len(layout.mirrors))]
    )
    blocked = int(sum(bool(body.ray_cast(*ray)) for ray in rays)) if manifold else len(rays)
    return {
        "mesh_watertight": Metric(value=bool(mesh.is_volume), unit="", limit=1, lower_is_better=False),
        "mesh_manifold": Metric(value=manifold, unit="", limit=1, lower_is_better=False),
        "mesh_pieces": Metric(value=len(body.decompose()) if manifold else mesh.body_count, unit="", limit=1),
        "mesh_triangles": Metric(value=len(mesh.faces), unit=""),
        "rays_blocked": Metric(value=blocked, unit="", limit=0),
        "rays_cast": Metric(value=len(rays), unit=""),
        "shade_of_sheets": Metric(value=shade_of_sheets(layout, hardware), unit=""),
        "wall_mm": Metric(
            value=round(thinnest_wall_mm(mesh, body), 3) if manifold else 0.0,
            unit="mm",
            limit=hardware.printer.wall_mm,
            lower_is_better=False,
        ),
    }


def light_rays(layout: Layout, index: int, hardware: Hardware, *, outline: bool = True) -> FloatArray:
    """Segments (2, n, 2, 3) in rig, mm, of one mirror, to the pupil and to the scene: from a grid and the outline.

    The reflection is the layout's own, not the cones that the part was cut with.
    """
    mirror = layout.mirrors[index]
    area = Polygon(mirror.outline_in_plane_mm)
    left, bottom, right, top = area.bounds
    columns, rows = (np.arange(low, high, RAY_STEP_MM) for low, high in ((left, right), (bottom, top)))
    flat = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    flat = flat[contains_xy(area, flat[:, 0], flat[:, 1])]
    if outline:
        flat = np.concatenate([flat, get_coordinates(area.exterior.segmentize(RAY_STEP_MM))])
    points = flat @ mirror.rig_from_plane[:3, :2].T + mirror.rig_from_plane[:3, 3]
    outgoing = points @ mirror.reflection.T
    forward = layout.view_from_rig[2]
    reach = (working_distance_mm(layout, hardware) - points @ forward) / (outgoing @ forward)
    far = np.stack([np.zeros_like(points), points + reach[:, None] * outgoing])
    direction = (far - points) / np.linalg.norm(far - points, axis=-1, keepdims=True)
    return np.stack([points + SURFACE_MM * direction, far], axis=-2)


def shade_of_sheets(layout: Layout, hardware: Hardware) -> float:
    """Share of the worst mirror's area whose light the *other* mirrors' sheets stand in: what thick sheets cost."""
    corners = [np.vstack([volume.base, volume.top]) for volume in (sheet(mirror) for mirror in layout.mirrors)]
    sheets = [manifold3d.Manifold.hull_points(points) for points in corners]
    worst = 0.0
    for index in range(len(sheets)):
        others = manifold3d.Manifold.compose([other for place, other in enumerate(sheets) if place != index])
        to_pupil, to_scene = light_rays(layout, index, hardware, outline=False)
        shaded = [
            bool(others.ray_cast(*a)) or bool(others.ray_cast(*b)) for a, b in zip(to_pupil, to_scene, strict=True)
        ]
        worst = max(worst, float(np.mean(shaded)))
    return worst


def thinnest_wall_mm(mesh: trimesh.Trimesh, body: manifold3d.Manifold) -> float:
    """Smallest distance, straight into the material, between two faces that are parallel to 15 deg.

    Dots that together cover less than `WALL_DOT_MM2` are no wall: no nozzle prints them, and nothing hangs on them.
    """
    points, normals, areas = _samples(np.array(mesh.triangles), np.array(mesh.face_normals))
    reach = float(np.linalg.norm(mesh.extents))
    walls = np.full(len(points), reach)
    for index, (point, normal) in enumerate(zip(points, normals, strict=True)):
        hits = body.ray_cast(point - SURFACE_MM * normal, point - reach * normal)
        if hits and -np.dot(hits[0].normal, normal) >= WALL_COSINE:
            walls[index] = SURFACE_MM + hits[0].distance * (reach - SURFACE_MM)
    thinnest_first = np.argsort(walls, kind="stable")
    return float(walls[thinnest_first][np.argmax(np.cumsum(areas[thinnest_first]) > WALL_DOT_MM2)])


def _samples(triangles: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points (m, 3) spread over triangles (n, 3, 3), their normals (m, 3), and the area (m,) that each stands for."""
    sizes = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1) / 2
    points, owners, areas = [], [], []
    for index in np.flatnonzero(sizes > 0.0):
        n = int(np.ceil(np.sqrt(sizes[index] / WALL_SAMPLE_MM2)))
        i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
        upright = np.stack([i, j], axis=-1)[i + j < n] + 1.0 / 3.0
        inverted = np.stack([i, j], axis=-1)[i + j < n - 1] + 2.0 / 3.0
        share = np.concatenate([upright, inverted]) / n
        a, b, c = triangles[index]
        points.append(a + share[:, :1] * (b - a) + share[:, 1:] * (c - a))
        owners.append(np.full(len(share), index))
        areas.append(np.full(len(share), sizes[index] / len(share)))
    return np.concatenate(points), normals[np.concatenate(owners)], np.concatenate(areas)


def check_dxf(path: Path, layout: Layout) -> dict[str, Metric]:
    """Every mirror is one closed outline on CUT, the same shape as in the layout seen from the back; its mark inside.

    Outlines are compared in the layout's order, moved and turned onto each other but never mirrored.
    """
    model = readfile(path).modelspace()
    lines = [line for line in model if isinstance(line, LWPolyline)]
    cuts = [line for line in lines if line.dxf.layer == "CUT"]
    outlines = [np.array(line.get_points("xy")) for line in cuts]
    marks = [np.array(line.get_points("xy")) for line in lines if line.dxf.layer == "ENGRAVE"]
    closed = [Polygon(outline) for line, outline in zip(cuts, outlines, strict=True) if line.closed]
    errors = [
        shape_error_mm(outline, outline_from_back(mirror)) * 1000.0
        for outline, mirror in zip(outlines, layout.mirrors, strict=False)
    ]
    tree = STRtree(closed)
    gaps = [
        closed[i].distance(closed[j]) for i in range(len(closed)) for j in tree.query(closed[i].buffer(10.0)) if j != i
    ]
    material = unary_union(closed)
    return {
        "outlines_missing": Metric(value=abs(len(layout.mirrors) - len(closed)), unit="", limit=0),
        "outlines_open": Metric(value=len(cuts) - len(closed), unit="", limit=0),
        "outline_error_um": Metric(value=max(errors, default=0.0), unit="um", limit=1.0),
        "outline_gap_mm": Metric(value=min(gaps, default=10.0), unit="mm", limit=0.5, lower_is_better=False),
        "marks_off_mirror": Metric(
            value=sum(not material.contains(Polygon(mark) if len(mark) > 3 else Point(mark[0])) for mark in marks),
            unit="",
            limit=0,
        ),
    }


def shape_error_mm(polygon: FloatArray, expected: FloatArray) -> float:
    """Largest distance between corners (n, 2) after the best move and turn, over where to start and which way round.

    Going the other way round the same corners is the same shape; a mirror image is not.
    """
    if len(polygon) != len(expected):
        return float(np.ptp(expected, axis=0).max())
    errors = []
    centred = expected - expected.mean(axis=0)
    for corners in (polygon, polygon[::-1]):
        for start in range(len(corners)):
            moved = np.roll(corners, start, axis=0)
            moved = moved - moved.mean(axis=0)
            # Closed form of the best turn in the plane.
            across = (moved[:, 0] * centred[:, 1] - moved[:, 1] * centred[:, 0]).sum()
            angle = np.arctan2(across, (moved * centred).sum())
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            errors.append(np.linalg.norm(moved @ turn.T - centred, axis=1).max())
    return float(min(errors))
