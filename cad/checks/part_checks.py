"""Checks of a printed part: its STEP, STL and 3MF files, against each other and against the printer's limits.

Overhangs that need support, flat ceilings that bridge, and layers that start in the air are detected in meshes (mm) in
print orientation: z up, with the lowest point on the bed. Rays from a mesh's surface along the inward normal find the
thinnest wall and floor.
"""

from __future__ import annotations

from pathlib import Path

import manifold3d
import numpy as np
import trimesh
from build123d import GeomType, import_step
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely import (
    MultiPolygon,
    Polygon,
    get_coordinates,
    get_parts,
    intersection,
    intersects_xy,
    linestrings,
    prepare,
    unary_union,
)

from mirrorcam.cad.checks.exported_mesh import check_mesh, is_manifold, read_3mf, read_stl, solid_of
from mirrorcam.cad.plan.hardware import Printer
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.cad.write.part_export import STL_TOLERANCE_MM
from mirrorcam.cad.write.slicer import check_slicing
from mirrorcam.core.values import FloatArray, Metric

# Two faces form a wall if they are parallel to within 15 deg; the edge of a wedge is not a wall.
WALL_COSINE = np.cos(np.radians(15.0))
WALL_SAMPLE_MM2 = 1.0
MIN_WALL_MM2 = 0.5
# Upper limit of measured wall thickness.
MAX_WALL_MM = 12.0
# Depth below the surface at which rays start, above the rounding of 1e-5 mm in an STL file.
SURFACE_MM = 1e-3


def thinnest_wall_mm(mesh: trimesh.Trimesh, body: manifold3d.Manifold, up: FloatArray | None = None) -> float:
    """Smallest distance, along the inward normal, between faces parallel to within 15 deg; at most `MAX_WALL_MM`.

    The thinnest spots are ignored up to a total area of `MIN_WALL_MM2`, which no nozzle prints. With `up` (3,), a
    unit vector, faces that are level to within 15 deg are left to `thinnest_floor_mm`.
    """
    return _thinnest_mm(mesh, body, np.full(len(mesh.faces), True) if up is None else ~_level(mesh, up))


def thinnest_floor_mm(mesh: trimesh.Trimesh, body: manifold3d.Manifold, up: FloatArray) -> float:
    """As `thinnest_wall_mm`, for faces that are level on the bed: floors consist of layers, walls of lines."""
    return _thinnest_mm(mesh, body, _level(mesh, up))


def _level(mesh: trimesh.Trimesh, up: FloatArray) -> NDArray[np.bool_]:
    return np.abs(np.array(mesh.face_normals) @ up) >= WALL_COSINE


def _thinnest_mm(mesh: trimesh.Trimesh, body: manifold3d.Manifold, faces: NDArray[np.bool_]) -> float:
    """Smallest thickness of `body` under the selected faces (m,) of its mesh."""
    points, normals, areas = _samples(np.array(mesh.triangles)[faces], np.array(mesh.face_normals)[faces])
    walls = np.full(len(points), MAX_WALL_MM)
    for index, (point, normal) in enumerate(zip(points, normals, strict=True)):
        hits = body.ray_cast(point - SURFACE_MM * normal, point - MAX_WALL_MM * normal)
        if hits and -np.dot(hits[0].normal, normal) >= WALL_COSINE:
            walls[index] = SURFACE_MM + hits[0].distance * (MAX_WALL_MM - SURFACE_MM)
    thinnest_first = np.argsort(walls, kind="stable")
    large_enough = np.cumsum(areas[thinnest_first]) > MIN_WALL_MM2
    return float(walls[thinnest_first][np.argmax(large_enough)]) if large_enough.any() else MAX_WALL_MM


def _samples(triangles: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points (m, 3) spread over triangles (n, 3, 3), with their normals (m, 3) and the areas (m,) they represent."""
    triangle_areas = (
        np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1) / 2
    )
    if not (triangle_areas > 0.0).any():
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    points, faces, areas = [], [], []
    for index in np.flatnonzero(triangle_areas > 0.0):
        n = int(np.ceil(np.sqrt(triangle_areas[index] / WALL_SAMPLE_MM2)))
        i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
        upright = np.stack([i, j], axis=-1)[i + j < n] + 1.0 / 3.0
        inverted = np.stack([i, j], axis=-1)[i + j < n - 1] + 2.0 / 3.0
        barycentric = np.concatenate([upright, inverted]) / n
        a, b, c = triangles[index]
        points.append(a + barycentric[:, :1] * (b - a) + barycentric[:, 1:] * (c - a))
        faces.append(np.full(len(barycentric), index))
        areas.append(np.full(len(barycentric), triangle_areas[index] / len(barycentric)))
    return np.concatenate(points), normals[np.concatenate(faces)], np.concatenate(areas)


LAYER_MM = 0.2
# Tolerance of angles in a mesh, which has facets and rounded numbers.
ANGLE_DEG = 0.5
# A region no wider than this in plan needs no support: it overhangs the layer below no further than a face at the
# overhang limit does.
STRIP_MM = 0.2
# Largest angle of a flat ceiling, and largest horizontal gap between a bridge's end and the material below it.
FLAT_DEG = 1.0
TOUCH_MM = 0.05
ON_BED_MM = 0.01
# Spacing of the lines of a bridge, their tested directions, and the minimum supported fraction of their total length.
BRIDGE_STEP_MM = 0.2
BRIDGE_ANGLES_DEG = np.arange(0.0, 180.0, 5.0)
MIN_BRIDGED_FRACTION = 0.99


def check_overhangs(mesh: trimesh.Trimesh, solid: manifold3d.Manifold, printer: Printer) -> dict[str, Metric]:
    """Check the area beyond the overhang limit, the length of bridges, and the area that starts in the air."""
    hanging, bridged, longest = overhangs(mesh, solid, printer)
    return {
        "overhang_mm2": Metric(value=round(hanging, 3), unit="mm2", limit=0.0),
        "bridged_mm2": Metric(value=round(bridged, 3), unit="mm2"),
        "longest_bridge_mm": Metric(value=round(longest, 3), unit="mm", limit=printer.bridge_mm),
        "floating_mm2": Metric(value=round(floating_mm2(solid, printer.overhang_deg), 3), unit="mm2", limit=0.0),
    }


def overhangs(mesh: trimesh.Trimesh, solid: manifold3d.Manifold, printer: Printer) -> tuple[float, float, float]:
    """Area of faces that need support, area of faces that bridge, both in mm2, and the longest bridge in mm.

    Downward faces beyond the overhang limit are grouped into regions by shared edges. A flat region bridges if straight
    lines in some direction, at most as long as the printer bridges, cover it and are supported at both ends. Faces on
    the bed are excluded.
    """
    triangles, normals = np.array(mesh.triangles), np.array(mesh.face_normals)
    on_bed = triangles[..., 2].max(axis=1) < triangles[..., 2].min() + ON_BED_MM
    down = (-normals[:, 2] > np.sin(np.radians(printer.overhang_deg + ANGLE_DEG))) & ~on_bed
    flat = down & (-normals[:, 2] > np.cos(np.radians(FLAT_DEG)))
    hanging = bridged = longest = 0.0
    for faces in (*_regions(mesh, flat), *_regions(mesh, down & ~flat)):
        area = unary_union([Polygon(triangle[:, :2]) for triangle in triangles[faces]])
        if area.buffer(-STRIP_MM / 2.0).is_empty:
            continue
        size = float(mesh.area_faces[faces].sum())
        length = None
        if flat[faces[0]]:
            below = solid.slice(float(triangles[faces, :, 2].min()) - LAYER_MM / 2.0)
            length = bridge_mm(area, polygons(below), printer.bridge_mm)
        if length is None:
            hanging += size
        else:
            bridged, longest = bridged + size, max(longest, length)
    return hanging, bridged, longest


def _regions(mesh: trimesh.Trimesh, selected: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Indices (m,) of the faces of each region of selected faces, which are connected by edges."""
    indices = np.flatnonzero(selected)
    index_of = np.full(len(selected), -1)
    index_of[indices] = np.arange(len(indices))
    pairs = index_of[mesh.face_adjacency]
    first, second = pairs[(pairs >= 0).all(axis=1)].T
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(len(indices), len(indices)))
    count, labels = connected_components(graph, directed=False)
    return [indices[labels == label] for label in range(count)]


def bridge_mm(ceiling: Polygon, below: MultiPolygon, limit_mm: float) -> float | None:
    """The longest line across a flat ceiling in the best direction for a bridge; None if it does not bridge.

    Lines must be at most `limit_mm` long and end on `below`, the section of the material right under the ceiling.
    """
    supports = below.buffer(LAYER_MM / 2.0 + TOUCH_MM)
    prepare(supports)
    longest = []
    for angle_deg in BRIDGE_ANGLES_DEG:
        ends = _spans(ceiling, float(angle_deg))
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        bridging = intersects_xy(supports, ends[..., 0], ends[..., 1]).all(axis=1) & (lengths <= limit_mm)
        if lengths[bridging].sum() >= MIN_BRIDGED_FRACTION * lengths.sum() > 0.0:
            longest.append(float(lengths[bridging].max()))
    return min(longest, default=None)


def _spans(area: Polygon, angle_deg: float) -> FloatArray:
    """Ends (n, 2, 2) of parallel lines across an area, `BRIDGE_STEP_MM` apart, at an angle to x."""
    angle = np.radians(angle_deg)
    direction, normal = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    corners = get_coordinates(area)
    low, high = (corners @ normal).min(), (corners @ normal).max()
    count = max(1, int(np.ceil((high - low) / BRIDGE_STEP_MM)))
    levels = low + (np.arange(count) + 0.5) * (high - low) / count
    extent = np.array([(corners @ direction).min() - 1.0, (corners @ direction).max() + 1.0])
    lines = linestrings(levels[:, None, None] * normal + extent[None, :, None] * direction)
    chords = get_parts(intersection(lines, area))
    return np.array([chord.coords[:] for chord in chords if chord.length > 0.0]).reshape(-1, 2, 2)


def polygons(section: manifold3d.CrossSection) -> MultiPolygon:
    """A section of manifold3d as polygons with holes."""
    pieces = [sorted(piece.to_polygons(), key=lambda loop: -abs(Polygon(loop).area)) for piece in section.decompose()]
    return MultiPolygon([(loops[0], loops[1:]) for loops in pieces if loops])


def floating_mm2(solid: manifold3d.Manifold, overhang_deg: float) -> float:
    """The area of the largest piece of a layer that is not supported down to the bed."""
    _, _, bed_mm, _, _, top_mm = solid.bounding_box()
    max_overhang = LAYER_MM * np.tan(np.radians(overhang_deg))
    supported_below: manifold3d.CrossSection | None = None
    largest = 0.0
    for height in np.arange(bed_mm + LAYER_MM / 2.0, top_mm, LAYER_MM):
        pieces = solid.slice(height).decompose()
        if supported_below is None:
            supported = pieces
        else:
            supportable = supported_below.offset(max_overhang, manifold3d.JoinType.Round)
            supported = [piece for piece in pieces if not (piece ^ supportable).is_empty()]
            largest = max([largest, *(piece.area() for piece in pieces if (piece ^ supportable).is_empty())])
        supported_below = manifold3d.CrossSection.compose(supported)
    return largest


# Tolerance between a 3MF file, with decimal numbers, and an STL file, with 32-bit numbers.
SAME_MESH_UM = 5.0
SAME_VOLUME = 1e-6
# Shift of faces due to rounding in files, which is up to 4e-6 mm for corners at 100 mm.
ROUNDED_MM = 1e-6


def check_part(part: PartPlan, folder: Path, printer: Printer) -> dict[str, Metric]:
    """Check the files of a part.

    Parameters
    ----------
    part : PartPlan
        The part's plan.
    folder : Path
        Folder with NAME.step, NAME.stl (both in the rig frame, mm) and NAME.3mf (as printed).
    printer : Printer
        Limits of the printer.

    Returns
    -------
    dict of str to Metric
        Checks (with a limit) and figures by name. A mesh that is not manifold cannot be measured, and is reported with
        walls of 0 mm and support everywhere. Slicing is checked only with a slicer.
    """
    shape = import_step(folder / f"{part.name}.step")
    solids = shape.solids()
    volume = sum(solid.volume for solid in solids)
    # A mesh deviates from curved faces by at most its tolerance; flat ones are exact.
    curved = sum(face.area for face in shape.faces() if face.geom_type != GeomType.PLANE)
    volume_limit = STL_TOLERANCE_MM * curved + SAME_VOLUME * volume + ROUNDED_MM * shape.area
    mesh, printed = read_stl(folder / f"{part.name}.stl"), read_3mf(folder / f"{part.name}.3mf")
    body, printed_solid = solid_of(mesh), solid_of(printed)
    up, valid = part.print_from_rig[2, :3], is_manifold(body)
    wall, floor = (thinnest_wall_mm(mesh, body, up), thinnest_floor_mm(mesh, body, up)) if valid else (0.0, 0.0)
    return {
        "solids": Metric(value=len(solids), unit="", limit=1),
        "invalid_solids": Metric(value=sum(not solid.is_valid for solid in solids) if solids else 1, unit="", limit=0),
        "volume_cm3": Metric(value=round(volume / 1000.0, 4), unit="cm3"),
        **check_mesh(mesh, body),
        "stl_volume_error_mm3": Metric(value=round(abs(mesh.volume - volume), 3), unit="mm3", limit=volume_limit),
        "3mf_volume_error_mm3": Metric(value=round(abs(printed.volume - volume), 3), unit="mm3", limit=volume_limit),
        "wall_mm": Metric(value=round(wall, 3), unit="mm", limit=printer.wall_mm, lower_is_better=False),
        "floor_mm": Metric(value=round(floor, 3), unit="mm", limit=printer.floor_mm, lower_is_better=False),
        **check_bed(mesh, printed, part, printer),
        **(
            check_overhangs(printed, printed_solid, printer)
            if is_manifold(printed_solid)
            else {"overhang_mm2": Metric(value=float(printed.area), unit="mm2", limit=0.0)}
        ),
        **check_slicing(folder / f"{part.name}.3mf", printer),
    }


def check_bed(mesh: trimesh.Trimesh, printed: trimesh.Trimesh, part: PartPlan, printer: Printer) -> dict[str, Metric]:
    """Check that the part in the 3MF file is on the bed, fits it, and has the planned orientation.

    `lie_error_um` is the largest difference in height from the corners of the STL file in the planned orientation.
    """
    low, high = printed.bounds
    overrun = np.maximum(np.maximum(-low, high - np.array(printer.bed_mm)), 0.0).max()
    bed = (*sorted(printer.bed_mm[:2], reverse=True), printer.bed_mm[2])
    size = (*sorted((high - low)[:2], reverse=True), (high - low)[2])
    planned = np.sort(np.array(mesh.vertices) @ part.print_from_rig[2, :3] + part.print_from_rig[2, 3])
    heights = np.sort(np.array(printed.vertices)[:, 2])
    error = np.abs(heights - planned).max() if len(heights) == len(planned) else float(np.ptp(planned))
    return {
        **{
            f"print_{name}_mm": Metric(value=round(float(length), 3), unit="mm", limit=limit)
            for name, length, limit in zip(("length", "width", "height"), size, bed, strict=True)
        },
        "off_bed_um": Metric(value=round(float(overrun) * 1000.0, 2), unit="um", limit=SAME_MESH_UM),
        "above_bed_um": Metric(value=round(max(float(low[2]), 0.0) * 1000.0, 2), unit="um", limit=SAME_MESH_UM),
        "lie_error_um": Metric(value=round(float(error) * 1000.0, 2), unit="um", limit=SAME_MESH_UM),
    }
