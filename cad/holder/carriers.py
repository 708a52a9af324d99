"""Carriers: a wedge behind every mirror, glued to it, which three screws draw towards the holder.

Since there is no space between mirrors, a carrier ends within its mirror's outline as seen along the normal of the
holder's back. Its back is parallel to the holder's. Its front is the mirror's seat, with pads and grooves as in a
holder. Its area on the back and the axes of its screws are chosen together.

A carrier has three degrees of freedom, the displacements along its screws. It tilts as a rigid body about axes in its
back, and the centre of its screws moves along their direction only. A clockwise turn of a screw, seen from behind the
device, draws its corner towards the holder by the pitch of the thread.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation
from shapely import Point, Polygon, box, get_coordinates
from shapely.affinity import rotate, translate
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from mirrorcam.cad.holder.adjuster import UNDER_NUT_MM, Adjuster, boss_mm, recess_diameter_mm
from mirrorcam.cad.holder.back import tip_mm
from mirrorcam.cad.holder.glue import glue_mm3, groove_solid, grooves_of, planned_cover
from mirrorcam.cad.holder.pads import min_altitude_mm, pad_shapes, pad_solid, plan_pads, widest_triangle
from mirrorcam.cad.plan.dimension import Hole, holes
from mirrorcam.cad.plan.fasteners import OUTSIDE_MM, Bore, Countersink
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import Frustum, outline_at, seat_distance_mm, seat_height_mm
from mirrorcam.cad.plan.threads import thread_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import rigid

FAR_MM = 1e4
# Tolerance of the simplified borders on which screws are placed.
SIMPLIFICATION_MM = 0.03
# Candidate scales of a mirror, for the advice in an error message.
CANDIDATE_SCALES = np.arange(1.05, 4.0, 0.05)


@dataclass(frozen=True)
class CarrierArea:
    """A carrier as seen from the holder's back, in the mount's x and y from the pupil, mm.

    `corners` (n, 2) are a convex polygon, counter-clockwise; `screws` (3, 2) are the axes of its screws.
    """

    corners: FloatArray
    screws: FloatArray

    @property
    def centre(self) -> FloatArray:
        """The centre (2,) of the screws, about which the carrier tilts."""
        return np.asarray(self.screws.mean(axis=0))

    @property
    def radii_mm(self) -> tuple[float, float]:
        """Largest distances of the screws and of the corners from the centre."""
        screws, corners = (
            float(np.linalg.norm(points - self.centre, axis=1).max()) for points in (self.screws, self.corners)
        )
        return screws, corners


def plan_areas(
    layout: Layout, axes: FloatArray, blocked_areas: Iterable[BaseGeometry], hardware: Hardware
) -> tuple[int, tuple[CarrierArea, ...]]:
    """Choose the areas of all carriers, and the first position of the mount's screws that leaves space for theirs.

    Parameters
    ----------
    layout : Layout
        The mirrors.
    axes : (3, 3)
        Axes of the mount in the rig frame: rows x, y and z.
    blocked_areas : iterable of BaseGeometry
        For each candidate position of the mount's screws, the area in which no axis of a carrier's screw may be.
    hardware : Hardware
        Screws, springs and range of tilt.

    Returns
    -------
    int, tuple of CarrierArea
        Index of the chosen position, and the carriers in the order of the mirrors.

    Raises
    ------
    InputError
        If a mirror has no space for three screws about its centre.
    """
    projections = [_projection(mirror, axes, 0.0, hardware) for mirror in layout.mirrors]
    areas = [_free_area(index, layout, projections, axes, hardware) for index in range(len(layout.mirrors))]
    unrestricted = [_screws_in(area, Polygon(), hardware) for area in areas]
    for index, screws in enumerate(unrestricted):
        if screws is None:
            raise InputError(_no_space(layout, index, f"{_fitting_size(areas[index], hardware)}, or ", hardware))
    failed = 0
    for candidate, blocked in enumerate(blocked_areas):
        carriers: list[CarrierArea] = []
        for index, (area, screws) in enumerate(zip(areas, unrestricted, strict=True)):
            free = screws is not None and not any(blocked.contains(Point(axis)) for axis in screws)
            axes_of_screws = screws if free else _screws_in(area, blocked, hardware)
            if axes_of_screws is None:
                failed = index
                break
            carriers.append(CarrierArea(get_coordinates(orient(area))[:-1], axes_of_screws))
        if len(carriers) == len(areas):
            return candidate, tuple(carriers)
    raise InputError(_no_space(layout, failed, "more space next to the mount's screws, or ", hardware))


def _no_space(layout: Layout, index: int, expected: str, hardware: Hardware) -> str:
    width, height = np.ptp(layout.mirrors[index].outline_in_plane_mm, axis=0)
    return (
        f"mirror {layout.mirror_names[index]} of {width:.1f} x {height:.1f} mm has no space behind it for three "
        f"{hardware.screw.thread} screws with {boss_mm(hardware):.1f} mm of plastic round their axes, expected "
        f'{expected}holder.mirrors = "glue"'
    )


def _projection(mirror: Mirror, axes: FloatArray, inset_mm: float, hardware: Hardware) -> Polygon:
    """A mirror's outline, inset, projected along the mount's z."""
    flat = Polygon(mirror.outline_in_plane_mm).buffer(-inset_mm, join_style="mitre")
    if flat.is_empty:
        return Polygon()
    corners = get_coordinates(orient(flat))[:-1]
    in_plane = np.column_stack([corners, np.full(len(corners), seat_height_mm(mirror, hardware))])
    frame = mirror.rig_from_plane
    return orient(Polygon((in_plane @ frame[:3, :3].T + frame[:3, 3]) @ axes[:2].T))


def _free_area(
    index: int, layout: Layout, outlines: Sequence[Polygon], axes: FloatArray, hardware: Hardware
) -> Polygon:
    """The area for a carrier: the projection of its mirror, cut straight so as to clear tilted adjacent mirrors."""
    area = _projection(layout.mirrors[index], axes, hardware.holder.carrier_inset_mm, hardware)
    for other, outline in enumerate(outlines):
        if other == index or area.is_empty:
            continue
        swept = outline.buffer(_tilt_gap_mm(layout.mirrors[other], axes, hardware), join_style="mitre", mitre_limit=2.0)
        if swept.intersects(area):
            area = _outside(area, get_coordinates(orient(swept)))
    return area


def _tilt_gap_mm(mirror: Mirror, axes: FloatArray, hardware: Hardware) -> float:
    """Largest lateral motion of a mirror's edge as its carrier tilts about its back, plus a gap."""
    height = float(np.ptp(outline_at(mirror, 0.0) @ axes[2])) + 2.0 * hardware.screw.insert_depth_mm
    return hardware.fit.free_mm + height * float(np.tan(np.radians(hardware.holder.adjust_deg)))


def _outside(area: Polygon, corners: FloatArray) -> Polygon:
    """The largest part of a convex area that lies outside one edge of a convex loop (n + 1, 2)."""
    parts = []
    for start, end in pairwise(corners):
        edge = end - start
        lower_half = translate(box(-FAR_MM, -FAR_MM, FAR_MM, 0.0), start[0], start[1])
        half_plane = rotate(lower_half, np.degrees(np.arctan2(edge[1], edge[0])), origin=tuple(start))
        part = area.intersection(half_plane)
        if isinstance(part, Polygon):
            parts.append(part)
    return max(parts, key=lambda part: part.area, default=Polygon())


def _screws_in(area: Polygon, blocked: BaseGeometry, hardware: Hardware) -> FloatArray | None:
    """Axes (3, 2) of screws as far apart as possible; None if there is no space for them."""
    if area.is_empty:
        return None
    free = area.buffer(-boss_mm(hardware)).difference(blocked.buffer(SIMPLIFICATION_MM))
    if free.is_empty:
        return None
    triangle = widest_triangle(free, np.array(area.centroid.coords[0]))
    if triangle is None:
        return None
    needed = max(recess_diameter_mm(hardware) + hardware.printer.wall_mm, 1.5 * boss_mm(hardware))
    return triangle if float(min_altitude_mm(triangle[None])[0]) >= needed else None


def _fitting_size(area: Polygon, hardware: Hardware) -> str:
    """The size of mirror that would have space, as text."""
    if not area.is_empty:
        corners = get_coordinates(area) - np.array(area.centroid.coords[0])
        for factor in CANDIDATE_SCALES:
            if _screws_in(Polygon(factor * corners), Polygon(), hardware) is not None:
                return f"mirrors {factor:.2f} times as large"
    return "larger mirrors"


# Depth of the notch in a carrier's upper edge.
NOTCH_MM = 1.0
# Radius of the end of a screw hole's cone: a ceiling as small needs no support.
END_RADIUS_MM = 0.5


@dataclass(frozen=True)
class CarrierPlan:
    """A carrier in the rig frame, mm: its `body` from its back to its seat, the `pads` on the seat, and the cuts.

    The cuts are `grooves` (with the notch in its upper edge), `holes`, the cones `tips` in which holes for inserts end,
    and `nuts`. `rig_from_back` (4, 4) is the frame
    of its flat back: origin in the centre of its screws, z out of the back towards the holder. `screws_mm` (3, 2) are
    the screws' axes in that frame, `thread` is theirs. `planned_cover` is the fraction of the mirror's back that its
    seat covers, `glue_mm3` the volume of the gap between them.
    """

    name: str
    body: Frustum
    pads: tuple[Frustum, ...]
    grooves: tuple[Frustum, ...]
    holes: tuple[Bore, ...]
    tips: tuple[Countersink, ...]
    nuts: tuple[Frustum, ...]
    nut_flats_mm: float
    rig_from_back: FloatArray
    screws_mm: FloatArray
    thread: str
    planned_cover: float
    glue_mm3: float

    @property
    def pitch_mm(self) -> float:
        """The pitch of its screws."""
        return thread_of(self.thread).pitch_mm

    @property
    def dimensions(self) -> tuple[Hole, ...]:
        """The holes of the screws, and the pockets of their nuts."""
        axis = -self.rig_from_back[:3, 2]
        pockets = (
            Hole(nut.top.mean(axis=0), -axis, round(self.nut_flats_mm, 3), f"for {self.thread} nut", None, "hexagon")
            for nut in self.nuts
        )
        return (*holes(self.holes), *pockets)


def min_level_mm(mirror: Mirror, area: CarrierArea, axes: FloatArray, hole_mm: float, hardware: Hardware) -> float:
    """The smallest z of a carrier's back in the mount's axes, from the pupil.

    The carrier is at least as thick as the holder's floor and, at its screws, as the depth of their holes, to the tips
    of the cones in which these end, plus a wall.
    """
    level_for_floor = float(_seat_z(mirror, area.corners, axes, hardware).max()) + hardware.holder.floor_mm
    angles = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    circle = boss_mm(hardware) * np.column_stack([np.cos(angles), np.sin(angles)])
    around = [float(_seat_z(mirror, screw + circle, axes, hardware).max()) for screw in area.screws]
    over_tips = _seat_z(mirror, area.screws, axes, hardware) + (
        0.0 if _has_nuts(hardware) else tip_mm(hardware.screw, END_RADIUS_MM)
    )
    return max(level_for_floor, max(*around, float(over_tips.max())) + hole_mm + hardware.printer.wall_mm)


def _seat_z(mirror: Mirror, points: FloatArray, axes: FloatArray, hardware: Hardware) -> FloatArray:
    """z (n,) in the mount's axes of a mirror's seat over points (n, 2) of the back."""
    normal, distance = mirror.normal_in_rig, seat_distance_mm(mirror, hardware)
    return np.asarray((-distance - (points @ axes[:2]) @ normal) / (axes[2] @ normal))


def plan_carrier(
    name: str,
    mirror: Mirror,
    area: CarrierArea,
    level_mm: float,
    axes: FloatArray,
    up: FloatArray,
    screw: Adjuster,
    hardware: Hardware,
) -> CarrierPlan:
    """Plan the carrier of a mirror with its back at a given z in the mount's axes.

    A notch marks the middle of the edge that is uppermost in the direction `up` (3,), like the arrow on the mirror's
    back. Raises InputError if the pads do not fit.
    """
    normal = axes[2]
    back = area.corners @ axes[:2]
    top = back + _seat_z(mirror, area.corners, axes, hardware)[:, None] * normal
    frame = mirror.rig_from_plane
    seat = orient(Polygon((top - frame[:3, 3]) @ frame[:3, :2]))
    nuts = tuple(_nut(mirror, axis, level_mm, axes, hardware) for axis in area.screws) if _has_nuts(hardware) else ()
    for nut in nuts:
        seat = seat.difference(Polygon((nut.top - frame[:3, 3]) @ frame[:3, :2]).buffer(hardware.printer.wall_mm / 2.0))
    notch = _notch(area, axes, up)
    notch_on_seat = notch @ axes[:2] + _seat_z(mirror, notch, axes, hardware)[:, None] * normal
    seat = seat.difference(Polygon((notch_on_seat - frame[:3, 3]) @ frame[:3, :2]))
    thickness = float(np.ptp(np.vstack([back + level_mm * normal, top]) @ normal))
    grooves = grooves_of(0, [mirror], normal, hardware)
    pads = pad_shapes(plan_pads(name, mirror, seat, grooves, axes, ((), ()), hardware), hardware)
    depth = screw.hole_mm + OUTSIDE_MM
    radius = (hardware.screw.clearance_hole_mm if nuts else hardware.screw.insert_hole_mm) / 2.0
    mouths = area.screws @ axes[:2] + (level_mm + OUTSIDE_MM) * normal
    cones = (
        ()
        if nuts
        else (
            Countersink(mouth - depth * normal, -normal, radius, END_RADIUS_MM, tip_mm(hardware.screw, END_RADIUS_MM))
            for mouth in mouths
        )
    )
    return CarrierPlan(
        name=name,
        body=Frustum(back + level_mm * normal, top),
        pads=tuple(pad_solid(mirror, shape, hardware) for shape in pads),
        grooves=(
            *(groove_solid(mirror, groove, hardware) for groove in grooves),
            Frustum(
                notch @ axes[:2] + (level_mm + 1.0) * normal, notch @ axes[:2] + (level_mm - thickness - 1.0) * normal
            ),
        ),
        holes=tuple(Bore(mouth, -normal, radius, depth) for mouth in mouths),
        tips=tuple(cones),
        nuts=nuts,
        nut_flats_mm=_nut_flats_mm(hardware),
        rig_from_back=rigid(axes.T, area.centre @ axes[:2] + level_mm * normal),
        screws_mm=area.screws - area.centre,
        thread=hardware.screw.thread,
        planned_cover=planned_cover(mirror, seat, grooves, pads),
        glue_mm3=glue_mm3(seat, pads, hardware),
    )


def _notch(area: CarrierArea, axes: FloatArray, up: FloatArray) -> FloatArray:
    """A V (3, 2) in the middle of the uppermost edge of an area."""
    ends = np.roll(area.corners, -1, axis=0)
    directions = (ends - area.corners) / np.linalg.norm(ends - area.corners, axis=1)[:, None]
    normals = np.column_stack([directions[:, 1], -directions[:, 0]])
    edge = int(np.argmax(normals @ (axes[:2] @ up)))
    middle, side, out = (area.corners[edge] + ends[edge]) / 2.0, directions[edge], normals[edge]
    return np.asarray(middle + NOTCH_MM * np.array([-side + out / 2.0, side + out / 2.0, -out]))


def _has_nuts(hardware: Hardware) -> bool:
    return hardware.screw.kind == "nut"


def _nut_flats_mm(hardware: Hardware) -> float:
    return hardware.screw.nut_flats_mm + hardware.fit.slide_mm


def _nut(mirror: Mirror, centre: FloatArray, level_mm: float, axes: FloatArray, hardware: Hardware) -> Frustum:
    """The pocket of a nut about a screw's axis (2,), closed by the mirror; two corners are along the mount's x."""
    angles = np.pi / 3.0 * np.arange(6)
    corners = centre + _nut_flats_mm(hardware) / np.sqrt(3.0) * np.column_stack([np.cos(angles), np.sin(angles)])
    flat = corners @ axes[:2]
    top = flat + (_seat_z(mirror, corners, axes, hardware) - mirror.thickness_mm)[:, None] * axes[2]
    return Frustum(flat + (level_mm - UNDER_NUT_MM) * axes[2], top)


def rig_from_carrier(carrier: CarrierPlan, turns: FloatArray) -> FloatArray:
    """The motion (4, 4) of a carrier, in the rig frame, for turns (3,) of its screws, clockwise seen from behind."""
    frame = carrier.rig_from_back
    # The plane of the back through the screws: z = height + gradient . (x, y).
    design = np.column_stack([np.ones(3), carrier.screws_mm])
    height, *gradient = np.linalg.solve(design, carrier.pitch_mm * np.asarray(turns, dtype=np.float64))
    normal = np.array([-gradient[0], -gradient[1], 1.0]) / np.sqrt(1.0 + gradient[0] ** 2 + gradient[1] ** 2)
    motion = np.eye(4)
    motion[:3, :3], motion[2, 3] = _smallest_rotation(np.array([0.0, 0.0, 1.0]), normal), height
    return np.asarray(frame @ motion @ np.linalg.inv(frame))


def virtual_centre_after(virtual_centre: FloatArray, carrier: CarrierPlan, turns: FloatArray) -> FloatArray:
    """A mirror's virtual centre (3,) after turns (3,) of its screws, given that before (3,), in the rig frame, mm."""
    motion = rig_from_carrier(carrier, turns)
    normal = motion[:3, :3] @ virtual_centre
    point = motion[:3, :3] @ (virtual_centre / 2.0) + motion[:3, 3]
    unit = normal / np.linalg.norm(normal)
    return np.asarray(2.0 * (unit @ point) * unit)


def turns_to(virtual_centre: FloatArray, target: FloatArray, carrier: CarrierPlan) -> FloatArray:
    """The turns (3,) of the screws, clockwise seen from behind, that bring a mirror to a target plane.

    Parameters
    ----------
    virtual_centre, target : (3,)
        Current and target virtual centre of the mirror in the rig frame, mm.
    carrier : CarrierPlan
        The mirror's carrier.

    Returns
    -------
    (3,)
        Turns in the order of the carrier's screws; exact for any tilt within the carrier's freedom.
    """
    frame = carrier.rig_from_back
    current_normal, target_normal = (_unit(-centre) @ frame[:3, :3] for centre in (virtual_centre, target))
    rotation = _rotation_about_level_axis(current_normal, target_normal)
    point = (virtual_centre / 2.0 - frame[:3, 3]) @ frame[:3, :3]
    target_point = (target / 2.0 - frame[:3, 3]) @ frame[:3, :3]
    height = float(target_normal @ (target_point - rotation @ point)) / float(target_normal[2])
    normal = rotation[:, 2]
    return np.asarray((height - carrier.screws_mm @ normal[:2] / normal[2]) / carrier.pitch_mm)


def tilt_per_turn_deg(carrier: CarrierPlan) -> float:
    """The largest tilt in deg per turn of a screw: the pitch over the smallest altitude of the triangle of screws."""
    altitude = float(min_altitude_mm(carrier.screws_mm[None])[0])
    return float(np.degrees(np.arctan(carrier.pitch_mm / altitude)))


def rotation_about(axis: FloatArray, angle_rad: float) -> FloatArray:
    """The rotation (3, 3) by an angle about a unit vector (3,)."""
    return np.asarray(Rotation.from_rotvec(angle_rad * axis).as_matrix())


def travel_turns(screw: Adjuster) -> float:
    """Largest number of turns of a screw from its nominal position, in either direction."""
    return screw.travel_mm / thread_of(screw.thread).pitch_mm


def tilt_and_shift(virtual_centre: FloatArray, target: FloatArray) -> tuple[float, float]:
    """Angle in deg between a mirror's plane and a target plane, and difference of their distances to the pupil, mm."""
    first, second = _unit(virtual_centre), _unit(target)
    angle = np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)
    return float(np.degrees(angle)), float(np.linalg.norm(virtual_centre) - np.linalg.norm(target)) / 2.0


def _rotation_about_level_axis(start: FloatArray, end: FloatArray) -> FloatArray:
    """The rotation (3, 3) about an axis normal to z that takes one unit vector to another."""
    axis = np.cross([0.0, 0.0, 1.0], end - start)
    length = float(np.linalg.norm(axis))
    if length < 1e-15:
        return np.eye(3)
    axis = axis / length
    first, second = (vector - (vector @ axis) * axis for vector in (start, end))
    return rotation_about(axis, float(np.arctan2(axis @ np.cross(first, second), first @ second)))


def _smallest_rotation(start: FloatArray, end: FloatArray) -> FloatArray:
    """The rotation (3, 3) by the smallest angle that takes one unit vector to another."""
    axis = np.cross(start, end)
    length = float(np.linalg.norm(axis))
    return rotation_about(axis / length, float(np.arctan2(length, start @ end))) if length > 1e-15 else np.eye(3)


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))
