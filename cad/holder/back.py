"""The flat back of the mirror holder: its direction, the cuts through it, and the holes for the mount's screws.

A hole ends in a blunt cone. A captive nut slides into it through a slot.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from manifold3d import Manifold
from shapely import LineString, MultiPoint, Point, Polygon, get_coordinates, unary_union
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from mirrorcam.cad.holder.rims import GROUND_MM, RELIEF_MM
from mirrorcam.cad.plan.cuts import Cuts, bed_lengths_mm, clearance_around_pin_mm, cut_slack_mm, thin_wall_mm2
from mirrorcam.cad.plan.fasteners import ROOF_DEG, head_space_mm
from mirrorcam.cad.plan.hardware import Fastening, Hardware
from mirrorcam.cad.plan.prisms import clip_loop
from mirrorcam.cad.plan.seats import Frustum, outline_at, seat_distance_mm, seat_height_mm
from mirrorcam.cad.splitting import falls_apart, triangles_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import transform

# Radius of the blunt end of a hole's cone: half a line of plastic.
BLUNT_RADIUS_MM = 0.2


def screw_depths_mm(hardware: Hardware) -> tuple[float, float, float]:
    """Depths from the back of the start and the end of the insert's or nut's thread, and of the hole."""
    screw = hardware.screw
    if screw.kind == "insert":
        return 0.0, screw.insert_mm, screw.insert_depth_mm
    begin = hardware.holder.floor_mm
    end = begin + screw.nut_height_mm + hardware.fit.slide_mm
    # The slot's roof rises at 45 deg over half the nut's width; the screw's tip has clearance below its ridge.
    return begin, end, end + slot_width_mm(hardware) / 2.0


def hole_mm(screw: Fastening) -> float:
    """Diameter of the holder's screw holes."""
    return screw.insert_hole_mm if screw.kind == "insert" else screw.clearance_hole_mm


def tip_mm(screw: Fastening, end_radius_mm: float = BLUNT_RADIUS_MM) -> float:
    """Height of the cone at the end of a screw hole: a flat ceiling would be a round bridge."""
    return float((hole_mm(screw) / 2.0 - end_radius_mm) / np.tan(np.deg2rad(ROOF_DEG)))


def slot_width_mm(hardware: Hardware) -> float:
    """Width of the slot through which a nut slides in."""
    return hardware.screw.nut_flats_mm + 2.0 * hardware.fit.slide_mm


def slot_direction(footprint: Polygon, hole: FloatArray) -> FloatArray:
    """The direction (2,) in which a nut's slot leaves a convex footprint: normal to the nearest edge.

    Over a slot oblique to the edge, the material would end in a tip that recedes faster than the slot's roof.
    """
    corners = get_coordinates(orient(footprint))
    sides = np.diff(corners, axis=0)
    outward = np.column_stack([sides[:, 1], -sides[:, 0]]) / np.linalg.norm(sides, axis=1)[:, None]
    return np.asarray(outward[int(np.argmin(((corners[:-1] - hole) * outward).sum(axis=1)))])


def nut_slots(
    holes_mm: FloatArray, footprint: Polygon, centre_mm: FloatArray, rig_from_mount: FloatArray, hardware: Hardware
) -> tuple[Frustum, ...]:
    """The slots for nuts, from each hole (n, 2) normal to the nearest edge. Their sides hold the nuts at two flats.

    A screw from the back pulls its nut against the slot's floor. The roof is a ridge of 45 deg.
    """
    begin, end, ridge = screw_depths_mm(hardware)
    half = slot_width_mm(hardware) / 2.0
    profile = np.array([(-half, -begin), (half, -begin), (half, -end), (0.0, -ridge - 0.05), (-half, -end)])
    corner = hardware.screw.nut_flats_mm / np.sqrt(3.0) + hardware.fit.slide_mm
    slots = []
    for hole in holes_mm:
        direction = slot_direction(footprint, centre_mm + hole)
        side = np.array([-direction[1], direction[0]])
        ends = [
            transform(rig_from_mount, np.column_stack([hole + end * direction + profile[:, :1] * side, profile[:, 1]]))
            for end in (-corner, 1e3)
        ]
        slots.append(Frustum(ends[0], ends[1]))
    return tuple(slots)


# Fillers that recede into the slab end this far inside it.
IN_SLAB_MM = 0.5
# Additional thickness of a part that is cut, which leaves a choice of positions for its pins.
PIN_SLACK_MM = 0.5
# Largest shift of a cut from the cut into equal pieces, over the part's length: narrow pieces have no space for pins.
MAX_SHIFT_TO_LENGTH = 0.1
# Cost of a square millimetre of wall too thin to print, in units of the length of a cut through mirrors.
THIN_MM_PER_MM2 = 1000.0


@dataclass(frozen=True)
class MountFace:
    """The plane of the back, at `back_mm` from the pupil along the mount's z, and its holes.

    `centre_mm` (2,) is along the mount's x and y from the pupil, `holes_mm` (4, 2) from that centre.
    """

    back_mm: float
    centre_mm: FloatArray
    holes_mm: FloatArray


def mount_axes(layout: Layout) -> FloatArray:
    """Axes (3, 3; rows x, y, z) of the mount in the rig frame: z opposite the mirrors' mean normal, x along rig x.

    The mount is a prism along rig x, which lies on the back: z is at right angles to it, in asymmetric layouts too.
    """
    z_axis = -np.mean([mirror.normal_in_rig for mirror in layout.mirrors], axis=0)
    if np.linalg.norm(z_axis) < 0.5:
        raise InputError("the mirrors' normals must be within 60 deg of their mean, for one flat back of the holder")
    z_axis /= np.linalg.norm(z_axis)
    if np.linalg.norm(z_axis[1:]) < 0.1:
        x_axis = np.array([0.0, 0.0, 1.0]) - z_axis[2] * z_axis
        x_axis /= np.linalg.norm(x_axis)
    else:
        x_axis = np.array([1.0, 0.0, 0.0])
        z_axis[0] = 0.0
        z_axis /= np.linalg.norm(z_axis)
    return np.array([x_axis, np.cross(z_axis, x_axis), z_axis])


class Front(Protocol):
    """The material over a holder's back: its `footprint` in the mount's x and y, and its largest z, `deepest_mm`.

    Grooves for glue are `groove_mm` deep; 0 if there are none.
    """

    @property
    def groove_mm(self) -> float: ...

    @property
    def footprint(self) -> Polygon: ...

    @property
    def deepest_mm(self) -> float: ...

    def largest_z_mm(self, area: Polygon) -> float:
        """Largest z in the mount's axes of the front over an area of the back."""
        ...


@dataclass(frozen=True)
class LevelFront:
    """A front parallel to the back."""

    footprint: Polygon
    deepest_mm: float
    groove_mm: float = 0.0

    def largest_z_mm(self, area: Polygon) -> float:
        """The same z everywhere."""
        return self.deepest_mm


class FrontSurface:
    """The front of the holder as seen along the normal of its back: a seat behind every mirror, fillers in the gaps.

    A filler is a mirror's outline enlarged by `margin_mm`, in a plane parallel to the mirror's seat. It is set back
    behind the adjacent seats, and its corners are cut off, so that it forms no thin ridge or tip there.
    """

    def __init__(self, layout: Layout, axes: FloatArray, margin_mm: float, hardware: Hardware) -> None:
        self._axes = axes
        self.groove_mm = hardware.holder.groove_depth_mm if hardware.holder.mirrors == "glue" else 0.0
        self._planes = [(mirror.normal_in_rig, seat_distance_mm(mirror, hardware)) for mirror in layout.mirrors]
        levels = [(mirror, seat_height_mm(mirror, hardware)) for mirror in layout.mirrors]
        enlarged = [outline_at(mirror, level, margin_mm, bevelled=True) for mirror, level in levels]
        seats = [outline_at(mirror, level) for mirror, level in levels]
        self._cores = self._shadows(seats)
        self._fillers = self._shadows(enlarged)
        # Twice the margin: the side of a filler is oblique to the adjacent mirror, and must not form a ridge either.
        neighbours = self._shadows([outline_at(mirror, level, 2.0 * margin_mm) for mirror, level in levels])
        recesses = np.zeros(len(enlarged))
        for i, filler in enumerate(self._fillers):
            ring = filler.difference(self._cores[i])
            for j, neighbour in enumerate(neighbours):
                common = get_coordinates(ring.intersection(neighbour)) if j != i else np.zeros((0, 2))
                if len(common):
                    recesses[i] = max(recesses[i], float((self._seat_z(j, common) - self._seat_z(i, common)).max()))
        self._recesses_mm = recesses
        self.deepest_mm = max(float((seat @ axes[2]).max()) for seat in seats)
        # Fillers are clipped where they recede into the slab.
        recessed = (front + recess * axes[2] for front, recess in zip(enlarged, recesses, strict=True))
        clipped = (clip_loop(front, axes[2], self.deepest_mm + IN_SLAB_MM) for front in recessed)
        self.fillers = [front for front in clipped if len(front) >= 3]
        self._all_cores, self._all_fillers = unary_union(self._cores), unary_union(self._fillers)
        # The slab also supports the bases of rims, which are slightly wider and lower than fillers.
        rim_bases = [
            outline_at(mirror, level - RELIEF_MM, margin_mm + GROUND_MM, bevelled=True) for mirror, level in levels
        ]
        self.footprint = MultiPoint(np.vstack([*enlarged, *rim_bases]) @ axes[:2].T).convex_hull

    def _shadows(self, outlines: list[FloatArray]) -> list[Polygon]:
        return [Polygon(outline @ self._axes[:2].T) for outline in outlines]

    def _seat_z(self, index: int, points: FloatArray) -> FloatArray:
        """z (n,) in the mount's axes of a mirror's seat plane over points (n, 2) of the back."""
        normal, distance = self._planes[index]
        z: FloatArray = (-distance - (points @ self._axes[:2]) @ normal) / (self._axes[2] @ normal)
        return z

    def largest_z_mm(self, area: Polygon) -> float:
        """Largest z in the mount's axes of the front over an area of the back; outside the fillers, the slab's."""
        gap = area.difference(self._all_cores)
        # In shapely, no area contains an empty one.
        if not gap.is_empty and not self._all_fillers.contains(gap):
            return self.deepest_mm
        largest = -np.inf
        for index, recess in enumerate(self._recesses_mm):
            seat = get_coordinates(self._cores[index].intersection(area))
            filler = get_coordinates(self._fillers[index].intersection(gap))
            z = np.concatenate([self._seat_z(index, seat), self._seat_z(index, filler) + recess])
            largest = max(largest, float(z.max(initial=-np.inf)))
        return min(largest, self.deepest_mm)


def fits_bed(border: Polygon, hardware: Hardware) -> bool:
    """Return whether a part with this outline fits the bed in one piece."""
    left, bottom, right, top = border.bounds
    bed = bed_lengths_mm((right - left, top - bottom), hardware)
    return bool(right - left <= bed[0] and top - bottom <= bed[1])


def place_cuts(layout: Layout, axes: FloatArray, border: Polygon, body: Manifold, hardware: Hardware) -> Cuts:
    """Coordinates, along the mount's x and y, of cuts through a body in the rig frame; every piece fits the bed.

    Each cut leaves connected pieces and no thin wall next to it, and has the smallest length through mirrors. The
    longer side of the part lies along the longer side of the bed.
    """
    left, bottom, right, top = border.bounds
    lengths = (right - left, top - bottom)
    bed = bed_lengths_mm(lengths, hardware)
    seats = [Polygon(outline_at(mirror, seat_height_mm(mirror, hardware)) @ axes[:2].T) for mirror in layout.mirrors]
    in_mount = body.transform(np.column_stack([axes, np.zeros(3)]))
    triangles, wall = triangles_of(in_mount), hardware.printer.wall_mm
    cuts = []
    for axis, (start, length, longest) in enumerate(zip((left, bottom), lengths, bed, strict=True)):
        pieces = int(np.ceil(length / longest))
        positions = []
        for i in range(1, pieces):
            nominal = start + length * i / pieces
            slack = min(cut_slack_mm(length, pieces, longest), MAX_SHIFT_TO_LENGTH * length)
            candidates = np.linspace(nominal - slack, nominal + slack, 61)
            costs = THIN_MM_PER_MM2 * thin_wall_mm2(triangles, axis, candidates, wall)
            costs += [
                _length_in_seats(seats, axis, position) + 0.02 * abs(position - nominal) for position in candidates
            ]
            by_cost = [float(position) for position in candidates[np.argsort(costs, kind="stable")]]
            connected = (position for position in by_cost if not falls_apart(in_mount, axis, position, wall))
            positions.append(next(connected, by_cost[0]))
        cuts.append(tuple(positions))
    return cuts[0], cuts[1]


def _length_in_seats(seats: list[Polygon], axis: int, position: float) -> float:
    """Length, through seats, of a cut normal to an axis."""
    far = 1e4
    line = LineString([(position, -far), (position, far)] if axis == 0 else [(-far, position), (far, position)])
    return float(sum(seat.intersection(line).length for seat in seats))


def place_mount(front: Front, hardware: Hardware, cuts_mm: Cuts = ((), ())) -> MountFace:
    """The rectangle of four holes with which the part is thinnest; among equals, the largest.

    Its width is between half of `holder.mount_of_width` and all of it. The insert's wall separates every hole from the
    edge of the footprint, from adjacent holes and, with half a pin's length, from the cuts; the thinnest wall separates
    the hole and its nut's slot from the front, and the thinnest floor from a groove there. Raises InputError if no
    rectangle fits.
    """
    return next(iter(mount_positions(front, hardware, cuts_mm)))


def mount_positions(front: Front, hardware: Hardware, cuts_mm: Cuts = ((), ())) -> list[MountFace]:
    """All rectangles from which `place_mount` chooses, the best first; raises InputError if there is none."""
    left, bottom, right, top = front.footprint.bounds
    centre = np.array([(left + right) / 2.0, (bottom + top) / 2.0])
    boss_mm = hardware.screw.insert_hole_mm / 2.0 + hardware.screw.insert_wall_mm
    allowed = front.footprint.buffer(-boss_mm)
    # Half the minimum distance between two holes: in the mount, a wall separates the spaces for their screws' heads.
    half_gap = head_space_mm(hardware) + hardware.printer.wall_mm / 2.0
    margin = boss_mm + hardware.holder.pin_mm[1] / 2.0
    cover = max(hardware.printer.wall_mm, front.groove_mm + hardware.printer.floor_mm)
    depth = screw_depths_mm(hardware)[2] + cover
    # A part that is cut is thick enough for the pins everywhere.
    min_thickness = 2.0 * clearance_around_pin_mm(hardware) + PIN_SLACK_MM if any(cuts_mm) else 0.0
    min_thickness = max(hardware.holder.floor_mm, min_thickness)
    candidates: list[tuple[float, float, FloatArray]] = []
    max_half = max(boss_mm + 0.1, hardware.holder.mount_of_width * (right - left) / 2.0)
    for a in np.arange(boss_mm, max_half, hardware.holder.mount_step_mm):
        if a < min(max_half / 2.0, max_half - hardware.holder.mount_step_mm):
            continue
        for b in np.arange(boss_mm, (top - bottom) / 2.0, hardware.holder.mount_step_mm):
            if min(a, b) < half_gap:
                continue
            holes = np.array([(-a, -b), (a, -b), (a, b), (-a, b)])
            near_cut = any(
                np.abs(centre[axis] + holes[:, axis] - cut).min() < margin for axis in (0, 1) for cut in cuts_mm[axis]
            )
            if near_cut or not allowed.contains(MultiPoint(centre + holes)):
                continue
            bosses = mount_areas(holes, front.footprint, centre, hardware)
            bosses_z = max(front.largest_z_mm(boss) for boss in bosses)
            tips_z = max(front.largest_z_mm(Point(centre + hole).buffer(hardware.printer.wall_mm)) for hole in holes)
            back = max(front.deepest_mm + min_thickness, bosses_z + depth, tips_z + tip_mm(hardware.screw) + depth)
            candidates.append((back, -a * b, holes))
    if not candidates:
        raise InputError(
            f"mirror holder's back is {right - left:.1f} x {top - bottom:.1f} mm, expected space for four "
            f"{hardware.screw.thread} inserts with {boss_mm:g} mm of material around their centres, at least "
            f"{2.0 * half_gap:.1f} mm from each other"
        )
    return [MountFace(back, centre, holes) for back, _, holes in sorted(candidates, key=lambda item: item[:2])]


def mount_areas(
    holes_mm: FloatArray, footprint: Polygon, centre_mm: FloatArray, hardware: Hardware
) -> list[BaseGeometry]:
    """Areas of a back for the mount's holes (n, 2; about a centre): discs with the insert's wall, slots for nuts."""
    boss_radius = hardware.screw.insert_hole_mm / 2.0 + hardware.screw.insert_wall_mm
    areas: list[BaseGeometry] = [Point(centre_mm + hole).buffer(boss_radius) for hole in holes_mm]
    if hardware.screw.kind == "nut":
        half = slot_width_mm(hardware) / 2.0 + hardware.printer.wall_mm
        left, bottom, right, top = footprint.bounds
        far = right - left + top - bottom
        areas += [
            LineString([centre_mm + hole, centre_mm + hole + far * slot_direction(footprint, centre_mm + hole)])
            .buffer(half, cap_style="flat")
            .intersection(footprint)
            for hole in holes_mm
        ]
    return areas
