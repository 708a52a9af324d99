"""Carriers: a wedge behind every mirror, glued to it, which three screws draw to the holder.

A carrier ends within the outline of its mirror, as seen straight from the holder's back: there is no space between
mirrors. Its back is level with the holder's, its front is the mirror's seat, with pads and grooves like a holder's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from shapely import Polygon
from shapely.geometry.polygon import orient

from mirrorcam.cad.holder.adjuster import UNDER_NUT_MM, Adjuster, boss_mm
from mirrorcam.cad.holder.carrier_areas import CarrierArea
from mirrorcam.cad.holder.glue import glue_mm3, groove_volume, grooves_of, planned_cover
from mirrorcam.cad.holder.pads import pad_shapes, pad_volume, plan_pads
from mirrorcam.cad.plan.dimension import Hole, holes
from mirrorcam.cad.plan.fasteners import OUTSIDE_MM, Bore
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import Frustum, seat_distance_mm
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import rigid

# Depth of the notch in a carrier's upper edge.
NOTCH_MM = 1.0


@dataclass(frozen=True)
class CarrierPlan:
    """A carrier in rig, mm: its `body` from its back to its seat, the `pads` on that, and what is cut from it
    (`grooves`, the notch in its upper edge among them).

    `rig_from_back` (4, 4) is the frame of its flat back, in the middle of its screws, z out of it, towards the holder;
    `screws_mm` (3, 2) are on it. `planned_cover` is the share of the mirror's back that its seat faces, `glue_mm3` the
    volume of the gap between them.
    """

    name: str
    body: Frustum
    pads: tuple[Frustum, ...]
    grooves: tuple[Frustum, ...]
    holes: tuple[Bore, ...]
    nuts: tuple[Frustum, ...]
    nut_flats_mm: float
    rig_from_back: FloatArray
    screws_mm: FloatArray
    planned_cover: float
    glue_mm3: float

    @property
    def dimensions(self) -> tuple[Hole, ...]:
        """The holes of the screws, and the pockets of their nuts."""
        axis = -self.rig_from_back[:3, 2]
        pockets = (
            Hole(nut.top.mean(axis=0), -axis, round(self.nut_flats_mm, 3), "for M3 nut", None, "hexagon")
            for nut in self.nuts
        )
        return (*holes(self.holes), *pockets)


def least_level_mm(mirror: Mirror, area: CarrierArea, axes: FloatArray, hole_mm: float, hardware: Hardware) -> float:
    """The nearest place along the mount's z, from the pupil, where a carrier's back may be.

    At its thinnest it is as thick as the holder's floor, and over its screws as their holes are deep, and a wall.
    """
    thick = float(_seat_along(mirror, area.corners, axes, hardware).max()) + hardware.holder.floor_mm
    turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    around = boss_mm(hardware) * np.column_stack([np.cos(turns), np.sin(turns)])
    over = [
        float(_seat_along(mirror, screw + around, axes, hardware).max()) + hole_mm + hardware.printer.wall_mm
        for screw in area.screws
    ]
    return max(thick, *over)


def _seat_along(mirror: Mirror, points: FloatArray, axes: FloatArray, hardware: Hardware) -> FloatArray:
    """Position (n,) along the mount's z of a mirror's seat over points (n, 2) of the back."""
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
    """The carrier of a mirror with its back at a place along the mount's z; InputError where its pads do not fit.

    A notch is in the middle of the edge that is uppermost in the device, in the direction `up` (3,), as the arrow on
    the mirror's back points.
    """
    away = axes[2]
    flat = area.corners @ axes[:2]
    top = flat + _seat_along(mirror, area.corners, axes, hardware)[:, None] * away
    frame = mirror.rig_from_plane
    seat = orient(Polygon((top - frame[:3, 3]) @ frame[:3, :2]))
    nuts = tuple(_nut(mirror, at, level_mm, axes, hardware) for at in area.screws) if _has_nuts(hardware) else ()
    for nut in nuts:
        seat = seat.difference(Polygon((nut.top - frame[:3, 3]) @ frame[:3, :2]).buffer(hardware.printer.wall_mm / 2.0))
    notch = _notch(area, axes, up)
    marked = notch @ axes[:2] + _seat_along(mirror, notch, axes, hardware)[:, None] * away
    seat = seat.difference(Polygon((marked - frame[:3, 3]) @ frame[:3, :2]))
    thick = float(np.ptp(np.vstack([flat + level_mm * away, top]) @ away))
    grooves = grooves_of(0, [mirror], away, hardware)
    middles = plan_pads(name, mirror, seat, grooves, axes, ((), ()), hardware)
    pads = pad_shapes(middles, hardware)
    depth = screw.hole_mm + OUTSIDE_MM
    radius = (hardware.screw.clearance_hole_mm if nuts else hardware.screw.insert_hole_mm) / 2.0
    mouths = area.screws @ axes[:2] + (level_mm + OUTSIDE_MM) * away
    return CarrierPlan(
        name=name,
        body=Frustum(flat + level_mm * away, top),
        pads=tuple(pad_volume(mirror, shape, hardware) for shape in pads),
        grooves=(
            *(groove_volume(mirror, groove, hardware) for groove in grooves),
            Frustum(
                notch @ axes[:2] + (level_mm + 1.0) * away,
                notch @ axes[:2] + (level_mm - thick - 1.0) * away,
            ),
        ),
        holes=tuple(Bore(mouth, -away, radius, depth) for mouth in mouths),
        nuts=nuts,
        nut_flats_mm=_nut_flats_mm(hardware),
        rig_from_back=rigid(axes.T, area.middle @ axes[:2] + level_mm * away),
        screws_mm=area.screws - area.middle,
        planned_cover=planned_cover(mirror, seat, grooves, pads),
        glue_mm3=glue_mm3(seat, pads, hardware),
    )


def _notch(area: CarrierArea, axes: FloatArray, up: FloatArray) -> FloatArray:
    """A V (3, 2) in the middle of the edge of an area that faces most upwards."""
    ends = np.roll(area.corners, -1, axis=0)
    along = (ends - area.corners) / np.linalg.norm(ends - area.corners, axis=1)[:, None]
    outward = np.column_stack([along[:, 1], -along[:, 0]])
    edge = int(np.argmax(outward @ (axes[:2] @ up)))
    middle, way, out = (area.corners[edge] + ends[edge]) / 2.0, along[edge], outward[edge]
    return np.asarray(middle + NOTCH_MM * np.array([-way + out / 2.0, way + out / 2.0, -out]))


def _has_nuts(hardware: Hardware) -> bool:
    return hardware.screw.kind == "nut"


def _nut_flats_mm(hardware: Hardware) -> float:
    return hardware.screw.nut_flats_mm + hardware.fit.slide_mm


def _nut(mirror: Mirror, at: FloatArray, level_mm: float, axes: FloatArray, hardware: Hardware) -> Frustum:
    """The pocket of a nut, open to the mirror, which closes it; two of its corners lie along the mount's x."""
    turns = np.pi / 3.0 * np.arange(6)
    loop = at + _nut_flats_mm(hardware) / np.sqrt(3.0) * np.column_stack([np.cos(turns), np.sin(turns)])
    flat = loop @ axes[:2]
    top = flat + (_seat_along(mirror, loop, axes, hardware) - mirror.thickness_mm)[:, None] * axes[2]
    return Frustum(flat + (level_mm - UNDER_NUT_MM) * axes[2], top)
