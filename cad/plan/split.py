"""Parts larger than the printer's bed, cut into pieces that pins and glue join again."""

from __future__ import annotations

import json
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import lru_cache, reduce
from itertools import pairwise, product
from typing import Any

import numpy as np
from build123d import Box as Block
from build123d import BuildPart, BuildSketch, Circle, Location, Locations, Mode, Part, Plane, Polygon, extrude, insert
from manifold3d import Manifold, Mesh64
from shapely import Polygon as Area
from shapely import box, get_coordinates, intersection_all
from shapely.geometry.base import BaseGeometry

from mirrorcam.cad.plan.fasteners import ROOF_DEG
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import BoughtItem, PartPlan, plain
from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.geometry.transforms import rigid, transform

# Two pins nearer than this many diameters leave the pieces free to turn.
PINS_APART = 4.0
# Where no place is asked for, cuts are tried at so many.
TRIED = 9
# Sections are looked at so far apart along a pin.
SLICE_MM = 1.0
FAR_MM = 1e4
# Two faces make a wall where they are parallel to 15 deg; the edge of a wedge is not a wall.
PARALLEL = float(np.cos(np.radians(15.0)))
MESH_MM = 0.05
# A triangle is level to the rounding of its corners.
LEVEL_MM = 1e-6
EXPLODE_MM = 25.0
# A cut that all but touches a corner or an edge leaves slivers that no mesh of finite precision shows: it keeps away so
# far, and is moved in such steps, at most so far, to do so.
CLEAR_MM = 0.005
STEP_MM = 0.01
MOVED_MM = 0.09

Span = tuple[float, float]


@dataclass(frozen=True)
class PiecePlan:
    """A piece of a part: `make(whole)` inside the spans of `low_mm` to `high_mm` (3,) along the bed's axes.

    What a cut leaves that is smaller than a cube of `crumb_mm` does not print and is left out.
    `rig_from_bed` (4, 4) is that of the whole part. `rig_from_pins` (n, 4, 4) are the pins' holes: origin in the cut,
    z into the piece, y up on the bed; `hole_mm` is their diameter and depth.
    """

    whole: Any
    make: Callable[[Any], Part]
    rig_from_bed: FloatArray
    low_mm: tuple[float, float, float]
    high_mm: tuple[float, float, float]
    rig_from_pins: FloatArray
    hole_mm: tuple[float, float]
    crumb_mm: float


@dataclass(frozen=True)
class _Whole:
    """A part before it is cut; the same numbers, the same part."""

    numbers: str
    plan: Any = field(compare=False)
    make: Callable[[Any], Part] = field(compare=False)


@dataclass(frozen=True)
class Pieces:
    """What a part is printed as, and the pins between the pieces."""

    parts: tuple[PartPlan, ...]
    pins: tuple[BoughtItem, ...]


def split(
    part: PartPlan,
    corners_in_rig: FloatArray,
    hardware: Hardware,
    cuts_mm: tuple[tuple[float, ...], tuple[float, ...]] | None = None,
) -> Pieces:
    """The part as it is where the box of its corners (n, 3), as it lies on the bed, fits; else its pieces.

    Cuts stand upright on the bed, so that every piece lies as the whole part would. `cuts_mm` are their places along
    the bed's x and y, to 0.1 mm; without them the place with the most room for pins is taken. Raises InputError with
    the measure that breaks: too high, no room for two pins in a cut, or a piece that falls apart.
    """
    bed_from_rig = part.print_from_rig
    corners = transform(bed_from_rig, corners_in_rig)
    low, high = corners.min(axis=0), corners.max(axis=0)
    name, bed = part.title.lower(), hardware.printer.bed_mm
    if high[2] - low[2] > bed[2]:
        raise InputError(f"{name} is {high[2] - low[2]:.1f} mm high, expected at most {bed[2]:g} mm (printer bed)")
    rooms = rooms_on_bed((float(high[0] - low[0]), float(high[1] - low[1])), hardware)
    if high[0] - low[0] <= rooms[0] and high[1] - low[1] <= rooms[1]:
        return Pieces((turned_onto_bed(part, float(high[0] - low[0]), rooms[0], hardware),), ())
    body = _mesh(_whole(part.plan, part.make)).transform(bed_from_rig[:3])
    if cuts_mm is None:
        spans = [(float(low[axis]), float(high[axis])) for axis in (0, 1)]
        cuts_mm = (
            _places(body, 0, spans, rooms[0], hardware),
            _places(body, 1, spans, rooms[1], hardware),
        )
    mesh = body.to_mesh64()
    triangles = np.asarray(mesh.vert_properties)[np.asarray(mesh.tri_verts, dtype=np.int64)]
    wall = hardware.printer.wall_mm
    cuts_mm = (_clear_of(triangles, 0, cuts_mm[0], wall), _clear_of(triangles, 1, cuts_mm[1], wall))
    return _pieces(part, body, (low, high), cuts_mm, rooms, hardware)


def rooms_on_bed(lengths_mm: Span, hardware: Hardware) -> Span:
    """The bed along x and y of a part so long and wide: its longer side lies along the bed's longer side."""
    short, long = sorted(hardware.printer.bed_mm[:2])
    return (long, short) if lengths_mm[0] >= lengths_mm[1] else (short, long)


def turned_onto_bed(part: PartPlan, length_mm: float, room_mm: float, hardware: Hardware) -> PartPlan:
    """The part, turned by a quarter where only that way its x fits the bed's."""
    if room_mm == hardware.printer.bed_mm[0] or length_mm <= hardware.printer.bed_mm[0]:
        return part
    quarter = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    return replace(part, print_from_rig=quarter @ part.print_from_rig)


def make_piece(plan: PiecePlan) -> Part:
    """Cut a piece out of its part, and drill its holes for pins: teardrops, since they lie when printed."""
    low, high = np.array(plan.low_mm), np.array(plan.high_mm)
    bed = Plane(
        origin=tuple(plan.rig_from_bed[:3, 3]),
        x_dir=tuple(plan.rig_from_bed[:3, 0]),
        z_dir=tuple(plan.rig_from_bed[:3, 2]),
    )
    radius, depth = plan.hole_mm[0] / 2.0, plan.hole_mm[1]
    steep = np.radians(ROOF_DEG)
    tangent = (radius * np.cos(steep), radius * np.sin(steep))
    with BuildPart() as piece:
        insert(_whole(plan.whole, plan.make))
        with Locations(bed), Locations(Location(tuple((low + high) / 2.0))):
            width, length, height = (high - low).tolist()
            Block(width, length, height, mode=Mode.INTERSECT)
        for frame in plan.rig_from_pins:
            with BuildSketch(Plane(origin=tuple(frame[:3, 3]), x_dir=tuple(frame[:3, 0]), z_dir=tuple(frame[:3, 2]))):
                Circle(radius)
                Polygon((-tangent[0], tangent[1]), tangent, (0.0, radius / np.sin(steep)), align=None)
            extrude(amount=depth, mode=Mode.SUBTRACT)
    solids = [solid for solid in piece.solids() if solid.volume > plan.crumb_mm**3]
    if len(solids) != 1:
        raise InputError(f"a piece cut for the printer's bed falls apart into {len(solids)}, expected one")
    return Part(solids)


def _whole(plan: Any, make: Callable[[Any], Part]) -> Part:
    """A part before it is cut, made once for all its pieces; each gets a copy, since booleans write into what they
    cut."""
    numbers = json.dumps([f"{make.__module__}.{make.__qualname__}", plain(plan)])
    return deepcopy(_make_whole(_Whole(numbers, plan, make)))


@lru_cache(maxsize=1)
def _make_whole(whole: _Whole) -> Part:
    return whole.make(whole.plan)


def _mesh(solid: Part) -> Manifold:
    """A solid's mesh, for sections and to see what falls apart."""
    points, triangles = solid.tessellate(MESH_MM)
    corners = np.array([tuple(point) for point in points])
    mesh = Mesh64(corners, np.array(triangles, dtype=np.uint64))
    mesh.merge()
    return Manifold(mesh)


def _places(body: Manifold, axis: int, spans: list[Span], room_mm: float, hardware: Hardware) -> tuple[float, ...]:
    """Where to cut along an axis of the bed into pieces that fit: at each place tried, the most room for pins wins."""
    start, end = spans[axis]
    count = int(np.ceil((end - start) / room_mm))
    slack = cut_slack_mm(end - start, count, room_mm)
    places = []
    for i in range(1, count):
        middle = start + (end - start) * i / count
        tried = np.linspace(middle - slack, middle + slack, TRIED)
        room = [_room_for_pins(body, axis, float(place), (-FAR_MM, FAR_MM), hardware).area for place in tried]
        # Of places that are as good, the one nearest to the middle.
        best = max(range(TRIED), key=lambda k: (round(room[k], 3), -abs(tried[k] - middle)))
        places.append(float(tried[best]))
    return tuple(places)


def _clear_of(triangles_mm: FloatArray, axis: int, places_mm: tuple[float, ...], wall_mm: float) -> tuple[float, ...]:
    """Places across an axis moved off the corners of triangles (n, 3, 3), to the side that leaves less thin walls,
    each as little as may be."""
    count = round(MOVED_MM / STEP_MM)
    along = np.unique(triangles_mm[:, :, axis])
    clear = []
    for place in places_mm:
        tried = np.asarray(place + STEP_MM * np.arange(-count, count + 1), dtype=np.float64)
        touching = np.abs(along[:, None] - tried).min(axis=0) < CLEAR_MM
        # Of a square millimetre, tenths decide: a face that leans is nearer at one end.
        thin = np.round(thin_beside_mm2(triangles_mm, axis, tried, wall_mm), 1)
        best = min(range(len(tried)), key=lambda k: (touching[k], thin[k], abs(k - count)))
        clear.append(float(tried[best]))
    return tuple(clear)


def thin_beside_mm2(triangles_mm: FloatArray, axis: int, places_mm: FloatArray, wall_mm: float) -> FloatArray:
    """Area (m,) of the walls thinner than `wall_mm` that cuts at places (m,) across an axis leave beside them.

    Such a wall stands between the cut and a face that is parallel to it, to 15 deg, and looks away from it. Triangles
    (n, 3, 3) are counter-clockwise from outside.
    """
    first, second, third = np.moveaxis(triangles_mm, 1, 0)
    normals = np.cross(second - first, third - first)
    areas = np.linalg.norm(normals, axis=1) / 2.0
    total = np.zeros(len(places_mm))
    for side in (-1.0, 1.0):
        facing = side * normals[:, axis] > 2.0 * PARALLEL * areas
        corners = side * triangles_mm[facing, :, axis]
        ends = (_share_below(corners, side * places_mm + beyond) for beyond in (wall_mm, 0.0))
        total += np.subtract(*ends) @ areas[facing]
    return total


def _share_below(corners_mm: FloatArray, levels_mm: FloatArray) -> FloatArray:
    """Shares (m, n) of triangles, whose corners (n, 3) lie at these heights, that lie below levels (m,)."""
    low, middle, high = np.sort(corners_mm, axis=1).T[:, None, :]
    level = levels_mm[:, None]
    at = np.clip(level, low, high)
    rising = (at - low) ** 2 / np.maximum((middle - low) * (high - low), 1e-12)
    falling = 1.0 - (high - at) ** 2 / np.maximum((high - middle) * (high - low), 1e-12)
    return np.where(high - low < LEVEL_MM, level > low, np.where(at < middle, rising, falling))


def falls_apart(body: Manifold, axis: int, place_mm: float, crumb_mm: float) -> bool:
    """Whether a cut across an axis leaves more than two pieces that are larger than a cube of `crumb_mm`."""
    normal = np.eye(3)[axis]
    return any(len(fragments(half, crumb_mm)) != 1 for half in body.split_by_plane(normal, place_mm))


def fragments(body: Manifold, crumb_mm: float) -> list[Manifold]:
    """What a body falls apart into, less crumbs too small to print."""
    return [piece for piece in body.decompose() if piece.volume() > crumb_mm**3]


def cut_slack_mm(length_mm: float, count: int, room_mm: float) -> float:
    """How far cuts into equal pieces may be moved, each by itself, so that no piece outgrows its room."""
    spare = max(0.0, room_mm - length_mm / count - MOVED_MM)
    return spare if count == 2 else spare / 2.0


def _room_for_pins(body: Manifold, axis: int, place: float, span: Span, hardware: Hardware) -> BaseGeometry:
    """Where the middle of a pin may be in a cut: along the bed's other axis (within a span) and up, as x and y.

    It keeps the thinnest wall to the outside all along the pin and beyond its ends.
    """
    # The bed's other axis, up, and the axis that is cut across.
    turned = body.transform(np.column_stack([np.eye(3)[[1 - axis, 2, axis]], np.zeros(3)]))
    half = reach_of_pin_mm(hardware)
    levels = np.linspace(place - half, place + half, int(np.ceil(2.0 * half / SLICE_MM)) + 1)
    solid = intersection_all([_section(turned, float(level)) for level in levels])
    around = room_round_pin_mm(hardware)
    return solid.buffer(-around).intersection(box(span[0] + around, -FAR_MM, span[1] - around, FAR_MM))


def room_round_pin_mm(hardware: Hardware) -> float:
    """Distance from a pin's middle to the outside: the roof of its hole reaches higher than its radius."""
    radius = hardware.holder.pin_mm[0] / 2.0 + hardware.fit.press_mm
    return radius / float(np.sin(np.radians(ROOF_DEG))) + hardware.printer.wall_mm


def reach_of_pin_mm(hardware: Hardware) -> float:
    """How far from a cut solid material reaches along a pin: its hole, and the thinnest wall behind that."""
    return hole_depth_mm(hardware) + hardware.printer.wall_mm


def hole_depth_mm(hardware: Hardware) -> float:
    """Depth of a pin's hole in either piece: the pin does not reach its end."""
    return hardware.holder.pin_mm[1] / 2.0 + hardware.fit.slide_mm


def _section(body: Manifold, level: float) -> BaseGeometry:
    """A section across z; loops inside loops are holes."""
    loops = (Area(loop) for loop in body.slice(level).to_polygons())
    return reduce(lambda one, other: one.symmetric_difference(other), loops, Area())


def _pieces(
    part: PartPlan,
    body: Manifold,
    box_on_bed: tuple[FloatArray, FloatArray],
    cuts_mm: tuple[tuple[float, ...], tuple[float, ...]],
    rooms_mm: Span,
    hardware: Hardware,
) -> Pieces:
    """The pieces between the cuts, numbered along the bed's x and then y, with two pins in every cut between two."""
    low, high = box_on_bed
    rig_from_bed = np.asarray(np.linalg.inv(part.print_from_rig), dtype=np.float64)
    edges = [[float(low[axis]) - 1.0, *cuts_mm[axis], float(high[axis]) + 1.0] for axis in (0, 1)]
    spans = [list(pairwise(edges[axis])) for axis in (0, 1)]
    holes: dict[tuple[int, int], list[FloatArray]] = {
        place: [] for place in product(range(len(spans[0])), range(len(spans[1])))
    }
    pins = []
    for place in holes:
        for axis in (0, 1):
            following = (place[0] + 1, place[1]) if axis == 0 else (place[0], place[1] + 1)
            if following not in holes:
                continue
            # Pins of cuts that cross each other keep out of each other's way.
            other = 1 - axis
            cut, (first, last) = spans[axis][place[axis]][1], spans[other][place[other]]
            across = (
                first + hardware.holder.pin_mm[1] if place[other] > 0 else -FAR_MM,
                last - hardware.holder.pin_mm[1] if place[other] < len(spans[other]) - 1 else FAR_MM,
            )
            for middle in _two_pins(part, body, axis, cut, across, hardware):
                frames = [rig_from_bed @ _hole(middle, axis, side) for side in (-1.0, 1.0)]
                holes[place].append(frames[0])
                holes[following].append(frames[1])
                pins.append((frames[1], place, following))
    plans = {}
    centre = (low + high) / 2.0
    for number, (place, frames) in enumerate(holes.items(), start=1):
        across, along = spans[0][place[0]], spans[1][place[1]]
        piece_low = (across[0], along[0], float(low[2]) - 1.0)
        piece_high = (across[1], along[1], float(high[2]) + 1.0)
        rest = body.trim_by_plane([1.0, 0.0, 0.0], across[0]).trim_by_plane([-1.0, 0.0, 0.0], -across[1])
        rest = rest.trim_by_plane([0.0, 1.0, 0.0], along[0]).trim_by_plane([0.0, -1.0, 0.0], -along[1])
        rest = _one_piece(part, number, rest, rooms_mm, hardware)
        bounds = np.array(rest.bounding_box()).reshape(2, 3)
        lowered = rigid(np.eye(3), [0.0, 0.0, -bounds[0, 2]])
        middle = bounds.mean(axis=0) - centre
        middle[2] = 0.0
        apart = rig_from_bed[:3, :3] @ middle
        piece = replace(
            part,
            name=f"{part.name}_{number}",
            title=f"{part.title}, piece {number}",
            number=f"{part.number}-{number}",
            plan=PiecePlan(
                whole=part.plan,
                make=part.make,
                rig_from_bed=rig_from_bed,
                low_mm=piece_low,
                high_mm=piece_high,
                rig_from_pins=np.array(frames).reshape(-1, 4, 4),
                hole_mm=(hardware.holder.pin_mm[0] + 2.0 * hardware.fit.press_mm, hole_depth_mm(hardware)),
                crumb_mm=hardware.printer.wall_mm,
            ),
            make=make_piece,
            print_from_rig=lowered @ part.print_from_rig,
            explode_mm=part.explode_mm + EXPLODE_MM * apart / max(float(np.linalg.norm(apart)), 1e-9),
        )
        plans[place] = turned_onto_bed(piece, float(bounds[1, 0] - bounds[0, 0]), rooms_mm[0], hardware)
    return Pieces(
        tuple(plans.values()),
        tuple(
            BoughtItem(
                kind="pin",
                size=f"{hardware.holder.pin_mm[0]:g}",
                length_mm=hardware.holder.pin_mm[1],
                rig_from_item=frame @ rigid(np.eye(3), [0.0, 0.0, hardware.holder.pin_mm[1] / 2.0]),
                explode_mm=(plans[first].explode_mm + plans[second].explode_mm) / 2.0,
                joins=(plans[first].name, plans[second].name),
            )
            for frame, first, second in pins
        ),
    )


def _two_pins(
    part: PartPlan, body: Manifold, axis: int, cut: float, across: Span, hardware: Hardware
) -> tuple[FloatArray, FloatArray]:
    """Middles (3,) on the bed of the two pins in a cut, as far apart as they can be."""
    room = _room_for_pins(body, axis, cut, across, hardware)
    corners = get_coordinates(room)
    needed = PINS_APART * hardware.holder.pin_mm[0]
    distances = np.linalg.norm(corners[:, None] - corners[None, :], axis=-1)
    apart = float(distances.max(initial=0.0))
    if apart < needed:
        raise InputError(
            f"{part.title.lower()} is larger than the printer's bed, and a cut at {'xy'[axis]} = {cut:.1f} mm has room "
            f"for two pins {apart:.1f} mm apart, expected {needed:g} mm"
        )
    first, second = np.unravel_index(int(np.argmax(distances)), distances.shape)
    middles = []
    for corner in (corners[first], corners[second]):
        middle = np.zeros(3)
        middle[[1 - axis, 2]], middle[axis] = corner, cut
        middles.append(middle)
    return middles[0], middles[1]


def _hole(middle: FloatArray, axis: int, side: float) -> FloatArray:
    """Frame (4, 4) on the bed of a hole that begins at a point of a cut: z into the piece, y up."""
    inwards, upwards = side * np.eye(3)[axis], np.array([0.0, 0.0, 1.0])
    return rigid(np.column_stack([np.cross(upwards, inwards), upwards, inwards]), middle)


def _one_piece(part: PartPlan, number: int, body: Manifold, rooms_mm: Span, hardware: Hardware) -> Manifold:
    title = f"piece {number} of the {part.title.lower()}"
    whole = fragments(body, hardware.printer.wall_mm)
    if len(whole) != 1:
        raise InputError(f"{title} falls apart into {len(whole)}, expected one")
    low, high = np.array(whole[0].bounding_box()).reshape(2, 3)
    for axis in (0, 1):
        if high[axis] - low[axis] > rooms_mm[axis] + 1e-6:
            raise InputError(
                f"{title} is {high[axis] - low[axis]:.1f} mm along the bed, expected at most {rooms_mm[axis]:g} mm"
            )
    return whole[0]
