"""Overhangs that need support, flat ceilings that bridge, and layers that begin in the air.

Meshes (mm) lie here as they print: z up, the bed under their lowest point.
"""

from __future__ import annotations

import manifold3d
import numpy as np
import trimesh
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

from mirrorcam.cad.plan.hardware import Printer
from mirrorcam.core.values import FloatArray, Metric

LAYER_MM = 0.2
# An angle is read from a mesh: round shapes are facets, and numbers of a file are rounded.
ANGLE_DEG = 0.5
# What stands out by no more than a layer of a face at the printer's angle does is supported by the layer below: a
# region that is nowhere wider than this, seen from above, does not hang.
STRIP_MM = 0.2
# A ceiling is flat where it lies within this angle; a bridge's end is supported this near to what stands below it.
FLAT_DEG = 1.0
TOUCH_MM = 0.05
ON_BED_MM = 0.01
# Lines of plastic over a gap, and the directions that are tried for them.
BRIDGE_STEP_MM = 0.2
BRIDGE_TURNS_DEG = np.arange(0.0, 180.0, 5.0)
BRIDGE_SHARE = 0.99


def check_overhangs(mesh: trimesh.Trimesh, solid: manifold3d.Manifold, printer: Printer) -> dict[str, Metric]:
    """Area that hangs steeper than the printer can, area and length of bridges, and area that starts in the air."""
    hanging, bridged, longest = overhangs(mesh, solid, printer)
    return {
        "overhang_mm2": Metric(value=round(hanging, 3), unit="mm2", limit=0.0),
        "bridged_mm2": Metric(value=round(bridged, 3), unit="mm2"),
        "longest_bridge_mm": Metric(value=round(longest, 3), unit="mm", limit=printer.bridge_mm),
        "floating_mm2": Metric(value=round(floating_mm2(solid, printer.overhang_deg), 3), unit="mm2", limit=0.0),
    }


def overhangs(mesh: trimesh.Trimesh, solid: manifold3d.Manifold, printer: Printer) -> tuple[float, float, float]:
    """Area that needs support, area that bridges (both of the faces, mm2), and the longest bridge in mm.

    Faces that look down steeper than the printer can are taken together where they share an edge. A flat ceiling among
    them bridges if straight lines in some direction, no longer than the printer can, cover it and are supported at both
    ends. What lies on the bed is none of this.
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


def _regions(mesh: trimesh.Trimesh, chosen: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Indices (m,) of the chosen faces of each region that hangs together by edges."""
    places = np.flatnonzero(chosen)
    number = np.full(len(chosen), -1)
    number[places] = np.arange(len(places))
    pairs = number[mesh.face_adjacency]
    first, second = pairs[(pairs >= 0).all(axis=1)].T
    joined = coo_array((np.ones(len(first)), (first, second)), shape=(len(places), len(places)))
    count, labels = connected_components(joined, directed=False)
    return [places[labels == label] for label in range(count)]


def bridge_mm(ceiling: Polygon, below: MultiPolygon, most_mm: float) -> float | None:
    """The longest line over a flat ceiling, in the direction where that is shortest; None where it is no bridge.

    `below` is what stands right under it. Lines must be at most `most_mm` long and end at what stands below.
    """
    bearing = below.buffer(LAYER_MM / 2.0 + TOUCH_MM)
    prepare(bearing)
    lengths_of_turns = []
    for turn in BRIDGE_TURNS_DEG:
        ends = _spans(ceiling, float(turn))
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        held = intersects_xy(bearing, ends[..., 0], ends[..., 1]).all(axis=1) & (lengths <= most_mm)
        if lengths[held].sum() >= BRIDGE_SHARE * lengths.sum() > 0.0:
            lengths_of_turns.append(float(lengths[held].max()))
    return min(lengths_of_turns, default=None)


def _spans(area: Polygon, turn_deg: float) -> FloatArray:
    """Parallel lines over an area, `BRIDGE_STEP_MM` apart and turned from x: their ends (n, 2, 2)."""
    turn = np.radians(turn_deg)
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    corners = get_coordinates(area)
    low, high = (corners @ across).min(), (corners @ across).max()
    count = max(1, int(np.ceil((high - low) / BRIDGE_STEP_MM)))
    levels = low + (np.arange(count) + 0.5) * (high - low) / count
    reach = np.array([(corners @ along).min() - 1.0, (corners @ along).max() + 1.0])
    lines = linestrings(levels[:, None, None] * across + reach[None, :, None] * along)
    pieces = get_parts(intersection(lines, area))
    return np.array([line_ends.coords[:] for line_ends in pieces if line_ends.length > 0.0]).reshape(-1, 2, 2)


def polygons(section: manifold3d.CrossSection) -> MultiPolygon:
    """A section of manifold3d as polygons with holes."""
    pieces = [sorted(piece.to_polygons(), key=lambda loop: -abs(Polygon(loop).area)) for piece in section.decompose()]
    return MultiPolygon([(loops[0], loops[1:]) for loops in pieces if loops])


def floating_mm2(solid: manifold3d.Manifold, overhang_deg: float) -> float:
    """The largest unsupported piece of a layer: its layers below end in the air, not on the bed."""
    _, _, bed_mm, _, _, top_mm = solid.bounding_box()
    reach = LAYER_MM * np.tan(np.radians(overhang_deg))
    borne: manifold3d.CrossSection | None = None
    largest = 0.0
    for height in np.arange(bed_mm + LAYER_MM / 2.0, top_mm, LAYER_MM):
        pieces = solid.slice(height).decompose()
        if borne is None:
            standing = pieces
        else:
            grown = borne.offset(reach, manifold3d.JoinType.Round)
            standing = [piece for piece in pieces if not (piece ^ grown).is_empty()]
            largest = max([largest, *(piece.area() for piece in pieces if (piece ^ grown).is_empty())])
        borne = manifold3d.CrossSection.compose(standing)
    return largest
