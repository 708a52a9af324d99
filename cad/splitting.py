"""Split a part larger than the printer's bed into pieces, and join them by pins.

The cuts are chosen on a mesh of the part, where they leave the most space for pins. Each piece is a B-rep solid
between cuts, with holes for its pins.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import lru_cache, reduce
from typing import Any

import numpy as np
import shapely
from build123d import (
    Box,
    BuildPart,
    BuildSketch,
    Circle,
    Location,
    Locations,
    Mode,
    Part,
    Plane,
    Polygon,
    extrude,
    insert,
)
from manifold3d import Manifold, Mesh64
from shapely import get_coordinates
from shapely.geometry.base import BaseGeometry

from mirrorcam.cad.plan.cuts import (
    FAR_MM,
    PAST_PART_MM,
    PIN_SPACING,
    Cell,
    Cuts,
    Joint,
    PiecePlan,
    Span,
    avoid_corners,
    bed_lengths_mm,
    cells_between,
    clearance_around_pin_mm,
    cut_slack_mm,
    depth_for_pin_mm,
    farthest_pair,
    hole_depth_mm,
    hole_frame,
    hole_mm,
    joints_between,
    require_height,
    rotated_onto_bed,
)
from mirrorcam.cad.plan.fasteners import ROOF_DEG
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import PartPlan, PurchasedItem, plain, recipe
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid, transform

# Number of candidate positions of each cut.
CANDIDATE_CUTS = 9
# Spacing of the sections tested along a pin.
SLICE_MM = 1.0
MESH_MM = 0.05


def mesh_of(solid: Part) -> Manifold:
    """Mesh of a solid, for sections and tests of connectivity."""
    points, triangles = solid.tessellate(MESH_MM)
    corners = np.array([tuple(point) for point in points])
    mesh = Mesh64(corners, np.array(triangles, dtype=np.uint64))
    mesh.merge()
    return Manifold(mesh)


def triangles_of(body: Manifold) -> FloatArray:
    """Triangles (n, 3, 3) of a body, counter-clockwise seen from outside."""
    mesh = body.to_mesh64()
    triangles: FloatArray = np.asarray(mesh.vert_properties)[np.asarray(mesh.tri_verts, dtype=np.int64)]
    return triangles


def falls_apart(body: Manifold, axis: int, cut_mm: float, crumb_mm: float) -> bool:
    """Return whether a cut normal to an axis leaves more than two pieces larger than a cube of side `crumb_mm`."""
    normal = np.eye(3)[axis]
    return any(len(fragments(half, crumb_mm)) != 1 for half in body.split_by_plane(normal, cut_mm))


def fragments(body: Manifold, crumb_mm: float) -> list[Manifold]:
    """Connected pieces of a body, without those too small to print."""
    return [piece for piece in body.decompose() if piece.volume() > crumb_mm**3]


def inside(body: Manifold, spans: tuple[Span, Span]) -> Manifold:
    """The part of a body within spans along x and y."""
    for normal, (low, high) in zip(np.eye(3), spans, strict=False):
        body = body.trim_by_plane(normal, low).trim_by_plane(-normal, -high)
    return body


def best_cuts_mm(body: Manifold, axis: int, span: Span, bed_mm: float, hardware: Hardware) -> tuple[float, ...]:
    """Coordinates of the cuts that divide a body, over a span along an axis, into nearly equal pieces that fit the bed.

    Each cut may shift by the slack of the pieces on the bed, to where it leaves the most space for pins.
    """
    start, end = span
    count = int(np.ceil((end - start) / bed_mm))
    slack = cut_slack_mm(end - start, count, bed_mm)
    cuts = []
    for i in range(1, count):
        nominal = start + (end - start) * i / count
        candidates = np.linspace(nominal - slack, nominal + slack, CANDIDATE_CUTS)
        areas = [area_for_pins(body, axis, float(cut), (-FAR_MM, FAR_MM), hardware).area for cut in candidates]
        # Among equally good cuts, the one nearest to its nominal position.
        best = max(range(CANDIDATE_CUTS), key=lambda k: (round(areas[k], 3), -abs(candidates[k] - nominal)))
        cuts.append(float(candidates[best]))
    return tuple(cuts)


def area_for_pins(body: Manifold, axis: int, cut_mm: float, span: Span, hardware: Hardware) -> BaseGeometry:
    """Area of a cut in which a pin's axis may lie, with at least the thinnest wall around the pin and beyond its ends.

    Parameters
    ----------
    body : Manifold
        The part in print orientation.
    axis, cut_mm : int, float
        Axis of the bed that is normal to the cut (0 or 1), and the cut's coordinate along that axis.
    span : (float, float)
        Range for pins along the bed's other axis.
    hardware : Hardware
        Pins, fits and the thinnest wall.

    Returns
    -------
    BaseGeometry
        An area with x along the bed's other axis and y up.
    """
    # Axes of the section: the bed's other axis, up, and the normal of the cut.
    section_frame = body.transform(np.column_stack([np.eye(3)[[1 - axis, 2, axis]], np.zeros(3)]))
    depth = depth_for_pin_mm(hardware)
    levels = np.linspace(cut_mm - depth, cut_mm + depth, int(np.ceil(2.0 * depth / SLICE_MM)) + 1)
    solid = shapely.intersection_all([_section(section_frame, float(level)) for level in levels])
    clearance = clearance_around_pin_mm(hardware)
    return solid.buffer(-clearance).intersection(shapely.box(span[0] + clearance, -FAR_MM, span[1] - clearance, FAR_MM))


def _section(body: Manifold, level: float) -> BaseGeometry:
    """Section of a body normal to z; loops inside loops are holes."""
    loops = (shapely.Polygon(loop) for loop in body.slice(level).to_polygons())
    return reduce(lambda a, b: a.symmetric_difference(b), loops, shapely.Polygon())


@dataclass(frozen=True)
class _UncutPart:
    """A part before it is cut, compared by its dimensions."""

    numbers: str
    plan: Any = field(compare=False)
    make: Callable[[Any], Part] = field(compare=False)


def uncut_part(plan: Any, make: Callable[[Any], Part]) -> Part:
    """The part before it is cut, made once for all its pieces. Returns a copy, since booleans change their operands."""
    numbers = json.dumps([f"{make.__module__}.{make.__qualname__}", plain(plan)])
    return deepcopy(_make_uncut(_UncutPart(numbers, plan, make)))


@lru_cache(maxsize=1)
def _make_uncut(part: _UncutPart) -> Part:
    return part.make(part.plan)


@recipe("cad.split.make_piece")
def make_piece(plan: PiecePlan) -> Part:
    """Cut a piece out of its part, and drill its holes for pins; raises InputError unless it is one solid."""
    low, high = np.array(plan.low_mm), np.array(plan.high_mm)
    with BuildPart() as piece:
        insert(uncut_part(plan.whole, plan.make))
        with Locations(_plane(plan.rig_from_bed)), Locations(Location(tuple((low + high) / 2.0))):
            width, length, height = (high - low).tolist()
            Box(width, length, height, mode=Mode.INTERSECT)
        for frame in plan.rig_from_pins:
            # A hole is horizontal on the bed: its ceiling is a roof that prints without support.
            with BuildSketch(_plane(frame)):
                Circle(plan.hole_mm[0] / 2.0)
                Polygon(*_roof(plan.hole_mm[0] / 2.0), align=None)
            extrude(amount=plan.hole_mm[1], mode=Mode.SUBTRACT)
    solids = [solid for solid in piece.solids() if solid.volume > plan.crumb_mm**3]
    if len(solids) != 1:
        raise InputError(f"a piece cut for the printer's bed falls apart into {len(solids)} pieces, expected one")
    return Part(solids)


def _plane(frame: FloatArray) -> Plane:
    """The plane z = 0 of a frame (4, 4)."""
    return Plane(origin=tuple(frame[:3, 3]), x_dir=tuple(frame[:3, 0]), z_dir=tuple(frame[:3, 2]))


def _roof(radius_mm: float) -> tuple[tuple[float, float], ...]:
    """The triangle on a circle with tangents as its upper sides, `ROOF_DEG` from upright."""
    angle = np.radians(ROOF_DEG)
    side, height = radius_mm * np.cos(angle), radius_mm * np.sin(angle)
    return (-side, height), (side, height), (0.0, radius_mm / np.sin(angle))


EXPLODE_MM = 25.0


@dataclass(frozen=True)
class Pieces:
    """The pieces that a part is split into, or the part itself, and the pins between them."""

    parts: tuple[PartPlan, ...]
    pins: tuple[PurchasedItem, ...]


@dataclass(frozen=True)
class _Pin:
    """A pin between two pieces; `rig_from_holes` (2, 4, 4) are the frames of its holes in them."""

    cells: tuple[Cell, Cell]
    rig_from_holes: FloatArray


def split(part: PartPlan, corners_in_rig: FloatArray, hardware: Hardware, cuts_mm: Cuts | None = None) -> Pieces:
    """Split a part that does not fit the printer's bed; return any other part unchanged.

    Parameters
    ----------
    part : PartPlan
        The uncut part. Its solid is made only if it has to be cut.
    corners_in_rig : (n, 3)
        Points in the rig frame, mm, whose bounding box on the bed contains the part.
    hardware : Hardware
        The printer's bed and thinnest wall, fits and pins.
    cuts_mm : pair of tuples of float, optional
        Coordinates of cuts along the bed's x and y, which may shift by up to `plan.cuts.MAX_SHIFT_MM`. Default: those
        with the most space for pins.

    Returns
    -------
    Pieces
        One part without pins, or pieces numbered along the bed's x and then y, with two pins in every joint. Cuts are
        upright on the bed, so that every piece prints in the same orientation as the uncut part.

    Raises
    ------
    InputError
        If the part is too high, a cut has no space for two pins, or a piece is not connected.
    """
    corners = transform(part.print_from_rig, corners_in_rig)
    low, high = corners.min(axis=0), corners.max(axis=0)
    require_height(part.title.lower(), float(high[2] - low[2]), hardware)
    lengths = (float(high[0] - low[0]), float(high[1] - low[1]))
    bed = bed_lengths_mm(lengths, hardware)
    if lengths[0] <= bed[0] and lengths[1] <= bed[1]:
        return Pieces((rotated_onto_bed(part, lengths[0], bed[0], hardware),), ())
    body = mesh_of(uncut_part(part.plan, part.make)).transform(part.print_from_rig[:3])
    if cuts_mm is None:
        spans = [(float(low[axis]), float(high[axis])) for axis in (0, 1)]
        cuts_mm = (best_cuts_mm(body, 0, spans[0], bed[0], hardware), best_cuts_mm(body, 1, spans[1], bed[1], hardware))
    triangles, wall = triangles_of(body), hardware.printer.wall_mm
    cuts_mm = (avoid_corners(triangles, 0, cuts_mm[0], wall), avoid_corners(triangles, 1, cuts_mm[1], wall))
    return _pieces(part, body, (low, high), cuts_mm, bed, hardware)


def _pieces(
    part: PartPlan,
    body: Manifold,
    box_on_bed: tuple[FloatArray, FloatArray],
    cuts_mm: Cuts,
    bed_mm: Span,
    hardware: Hardware,
) -> Pieces:
    """The pieces between the cuts, numbered along the bed's x and then y, with two pins in every joint."""
    low, high = box_on_bed
    rig_from_bed = np.asarray(np.linalg.inv(part.print_from_rig), dtype=np.float64)
    cells = cells_between(cuts_mm, low, high)
    pins = [
        pin
        for joint in joints_between(cells, hardware.holder.pin_mm[1])
        for pin in _two_pins(part, body, joint, rig_from_bed, hardware)
    ]
    pieces = {}
    for number, (cell, spans) in enumerate(cells.items(), start=1):
        bounds = _bounds_of_piece(part, number, inside(body, spans), bed_mm, hardware)
        holes = [
            hole
            for pin in pins
            for cell_of_hole, hole in zip(pin.cells, pin.rig_from_holes, strict=True)
            if cell_of_hole == cell
        ]
        plan = PiecePlan(
            whole=part.plan,
            make=part.make,
            rig_from_bed=rig_from_bed,
            low_mm=(spans[0][0], spans[1][0], float(low[2]) - PAST_PART_MM),
            high_mm=(spans[0][1], spans[1][1], float(high[2]) + PAST_PART_MM),
            rig_from_pins=np.array(holes).reshape(-1, 4, 4),
            hole_mm=(hole_mm(hardware), hole_depth_mm(hardware)),
            crumb_mm=hardware.printer.wall_mm,
        )
        piece = _piece(part, number, plan, bounds, bounds.mean(axis=0) - (low + high) / 2.0)
        pieces[cell] = rotated_onto_bed(piece, float(bounds[1, 0] - bounds[0, 0]), bed_mm[0], hardware)
    return Pieces(tuple(pieces.values()), tuple(_pin_item(pin, pieces, hardware) for pin in pins))


def _piece(part: PartPlan, number: int, plan: PiecePlan, bounds: FloatArray, offset: FloatArray) -> PartPlan:
    """Plan a piece as a part, from its bounds (2, 3) on the bed and the offset (3,) from the uncut part's centre."""
    lowered = rigid(np.eye(3), [0.0, 0.0, -bounds[0, 2]])
    displacement = plan.rig_from_bed[:3, :3] @ (offset * [1.0, 1.0, 0.0])
    return replace(
        part,
        name=f"{part.name}_{number}",
        title=f"{part.title}, piece {number}",
        number=f"{part.number}-{number}",
        plan=plan,
        make=make_piece,
        print_from_rig=lowered @ part.print_from_rig,
        explode_mm=part.explode_mm + EXPLODE_MM * displacement / max(float(np.linalg.norm(displacement)), 1e-9),
    )


def _pin_item(pin: _Pin, pieces: dict[Cell, PartPlan], hardware: Hardware) -> PurchasedItem:
    """A pin as a purchased item, half of it in each piece."""
    diameter, length = hardware.holder.pin_mm
    first, second = (pieces[cell] for cell in pin.cells)
    return PurchasedItem(
        kind="pin",
        size=f"{diameter:g}",
        length_mm=length,
        rig_from_item=pin.rig_from_holes[1] @ rigid(np.eye(3), [0.0, 0.0, length / 2.0]),
        explode_mm=(first.explode_mm + second.explode_mm) / 2.0,
        joins=(first.name, second.name),
    )


def _two_pins(part: PartPlan, body: Manifold, joint: Joint, rig_from_bed: FloatArray, hardware: Hardware) -> list[_Pin]:
    """The two pins of a joint, as far apart as the cut allows."""
    axis, cut = joint.axis, joint.cut_mm
    area = area_for_pins(body, axis, cut, joint.span_mm, hardware)
    corners, distance = farthest_pair(get_coordinates(area))
    needed = PIN_SPACING * hardware.holder.pin_mm[0]
    if distance < needed:
        raise InputError(
            f"{part.title.lower()} is larger than the printer's bed, and a cut at {'xy'[axis]} = {cut:.1f} mm has "
            f"space for two pins {distance:.1f} mm apart, expected {needed:g} mm"
        )
    pins = []
    for corner in corners:
        start = np.zeros(3)
        start[[1 - axis, 2]], start[axis] = corner, cut
        holes = [rig_from_bed @ hole_frame(start, axis, side) for side in (-1.0, 1.0)]
        pins.append(_Pin(joint.cells, np.array(holes)))
    return pins


def _bounds_of_piece(part: PartPlan, number: int, body: Manifold, bed_mm: Span, hardware: Hardware) -> FloatArray:
    """Bounds (2, 3) of a piece on the bed; raises InputError if it falls apart or does not fit the bed."""
    title = f"piece {number} of the {part.title.lower()}"
    pieces = fragments(body, hardware.printer.wall_mm)
    if len(pieces) != 1:
        raise InputError(f"{title} falls apart into {len(pieces)} pieces, expected one")
    bounds: FloatArray = np.array(pieces[0].bounding_box()).reshape(2, 3)
    for length, longest in zip(np.ptp(bounds, axis=0), bed_mm, strict=False):
        if length > longest + 1e-6:
            raise InputError(f"{title} is {length:.1f} mm along the bed, expected at most {longest:g} mm")
    return bounds
