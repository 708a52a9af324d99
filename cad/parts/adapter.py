"""The adapter: a split clamp around the robot's wrist, its upper half (the saddle) screwed to the mount's foot.

The wrist runs along y, below the camera: parallel to the views of a fold of 90 deg. Both halves are profiles in the x-z
plane along y; they print with the clamp's face on the bed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.parts.camera_box import ABOVE
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.foot import FOOT_DEPTH_MM, FOOT_X_MM, foot_screws, foot_z_mm
from mirrorcam.cad.plan.dimension import Hole, Length
from mirrorcam.cad.plan.fasteners import NUT_FIT_MM, OUTSIDE_MM, Bore, Hexagon, Stack, head_room_mm, stack, thread
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.hole_dimensions import holes, length
from mirrorcam.cad.plan.prisms import box, corners_of
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.optics.base.values import FloatArray, InputError

UP = np.array([0.0, -1.0, 0.0])
CAP_EAR_MM = 5.0
EAR_OFF_MM = 0.3


@dataclass(frozen=True)
class RingPlan:
    """Half of the clamp in rig, mm: a ring about x = 0, z = `axis_z_mm`, over or under that, and what it carries.

    `above` says which half; the ring spans `band_mm` (2,) along y and is `radius_mm` wide inside. `ears` (2, 3) are
    where the clamp's screws go through its face towards the other half.
    """

    name: str
    above: bool
    radius_mm: float
    ring_mm: float
    axis_z_mm: float
    gap_mm: float
    band_mm: FloatArray
    pieces: tuple[Frustum, ...]
    cuts: tuple[Frustum | Bore | Hexagon, ...]
    ears: FloatArray

    @property
    def dimensions(self) -> tuple[Length | Hole, ...]:
        """The bore, the clamp's band, and the holes."""
        middle = np.array([0.0, self.band_mm[1], self.axis_z_mm])
        across, along = np.array([self.radius_mm, 0.0, 0.0]), np.array([0.0, np.ptp(self.band_mm), 0.0])
        ear = np.array([self.ears[:, 0].max(), self.band_mm[1], self.ears[0, 2]])
        return (
            length(middle - across, middle + across, "bore diameter"),
            length(ear - along, ear, "band"),
            *holes(self.cuts),
        )

    @property
    def bounds(self) -> Frustum:
        """A box around all of it."""
        reach = self.radius_mm + self.ring_mm
        level = self.axis_z_mm + (self.gap_mm if self.above else -self.gap_mm) / 2.0
        end = self.axis_z_mm + (reach if self.above else -reach)
        solids = (
            box((-reach, self.band_mm[0], min(level, end)), (reach, self.band_mm[1], max(level, end))),
            *self.pieces,
        )
        corners = corners_of(solids)
        return box(tuple(corners.min(axis=0)), tuple(corners.max(axis=0)))


@dataclass(frozen=True)
class AdapterPlan:
    """Both halves, the stacks of the clamp's and the foot's screws, and where their heads (n, 3) rest."""

    saddle: RingPlan
    cap: RingPlan
    clamp: Stack
    foot: Stack
    foot_heads: FloatArray
    clamp_heads: FloatArray


def plan_adapter(clip: ClipPlan, hardware: Hardware) -> AdapterPlan:
    """Lay out the clamp below the foot of the mount; the same for all layouts."""
    wrist, skin = hardware.wrist, hardware.mount.skin_mm
    foot, clamp = stack(skin, hardware), stack(CAP_EAR_MM + wrist.gap_mm, hardware)
    place = _place(clip, hardware)
    spans, ear_at = _ears(place, hardware)
    heads = foot_screws(clip, hardware) - skin * ABOVE
    clamp_heads = ear_at - (CAP_EAR_MM + wrist.gap_mm) * ABOVE
    (back, front), face, half = place.band_mm, wrist.gap_mm / 2.0, FOOT_X_MM + place.around_mm + 1.0
    saddle_z, cap_z = place.axis_z_mm + face, place.axis_z_mm - face
    saddle_pieces = (
        box((-half, back, place.axis_z_mm + 0.6 * place.radius_mm), (half, front, place.foot_z_mm)),
        box((-half, clip.slide_y_mm - FOOT_DEPTH_MM, place.under_mm), (half, front, place.foot_z_mm)),
        *(box((low, back, saddle_z), (high, front, saddle_z + clamp.wall_mm)) for low, high in spans),
    )
    cap_pieces = tuple(box((low, back, cap_z - CAP_EAR_MM), (high, front, cap_z)) for low, high in spans)
    clearance = hardware.screw.clearance_hole_mm / 2.0
    cap_cuts = tuple(Bore(head - ABOVE, ABOVE, clearance, CAP_EAR_MM + 2.0, UP) for head in clamp_heads)
    saddle_cuts = (*_foot_cuts(heads, hardware), *_ear_cuts(ear_at, place.band_mm, clamp, hardware))
    common = (place.radius_mm, wrist.ring_mm, place.axis_z_mm, wrist.gap_mm, place.band_mm)
    return AdapterPlan(
        saddle=RingPlan("adapter_saddle", True, *common, saddle_pieces, saddle_cuts, ear_at),
        cap=RingPlan("adapter_cap", False, *common, cap_pieces, cap_cuts, ear_at - wrist.gap_mm * ABOVE),
        clamp=clamp,
        foot=foot,
        foot_heads=heads,
        clamp_heads=clamp_heads,
    )


@dataclass(frozen=True)
class _Place:
    """Where the clamp is in rig, mm: the wrist's radius and axis, the clamp's band (2,) along y.

    Its plate reaches from `under_mm` to the mount's foot; `around_mm` is from a screw's axis to the end of its wall.
    """

    radius_mm: float
    axis_z_mm: float
    band_mm: FloatArray
    under_mm: float
    foot_z_mm: float
    around_mm: float


def _place(clip: ClipPlan, hardware: Hardware) -> _Place:
    """Place the clamp; raises InputError where its plate is too thin for its screws."""
    wrist, screw = hardware.wrist, hardware.screw
    foot_z = foot_z_mm(clip, hardware)
    radius = wrist.diameter_mm / 2.0
    axis_z = foot_z - wrist.riser_mm - radius
    under = axis_z + radius + wrist.joint_mm
    needed = hardware.mount.skin_mm + screw.head_height_mm + hardware.printer.wall_mm
    if (thick := foot_z - under) < needed:
        raise InputError(
            f"adapter's plate is {thick:.1f} mm thick, expected {needed:.1f} mm for its screws: raise riser_mm"
        )
    band = np.array([clip.slide_y_mm, clip.slide_y_mm + wrist.band_mm])
    return _Place(radius, axis_z, band, under, foot_z, screw.insert_hole_mm / 2.0 + screw.insert_wall_mm)


def _ears(place: _Place, hardware: Hardware) -> tuple[list[tuple[float, float]], FloatArray]:
    """The reach of the left and the right ear along x, and where their screws (2, 3) go through the saddle's face."""
    wrist, screw, radius = hardware.wrist, hardware.screw, place.radius_mm
    x = radius + wrist.ring_mm + place.around_mm
    end = x + max(place.around_mm, (screw.nut_flats_mm + NUT_FIT_MM) / 2.0 + 1.2 * hardware.printer.wall_mm)
    spans = [(-end, -radius - 0.5 * wrist.ring_mm), (radius + 0.5 * wrist.ring_mm, end)]
    # The holes' roofs are higher than the holes: a little off the middle, both sides have their wall.
    y, z = float(place.band_mm.mean()) + EAR_OFF_MM, place.axis_z_mm + wrist.gap_mm / 2.0
    return spans, np.array([(-x, y, z), (x, y, z)])


def _foot_cuts(heads: FloatArray, hardware: Hardware) -> Iterator[Bore]:
    """Holes for the screws of the foot, whose heads (n, 3) rest in the saddle, and for the driver."""
    screw, skin = hardware.screw, hardware.mount.skin_mm
    driver = head_room_mm(hardware)
    for head in heads:
        yield Bore(head - OUTSIDE_MM * ABOVE, ABOVE, screw.clearance_hole_mm / 2.0, skin + 1.0, UP)
        yield Bore(head, -ABOVE, driver, 99.0, UP)


def _ear_cuts(
    ears: FloatArray, band_mm: FloatArray, clamp: Stack, hardware: Hardware
) -> Iterator[Frustum | Bore | Hexagon]:
    """The threads of the clamp's screws in the saddle's ears.

    An ear is too narrow for a nut's pocket all round: a channel through it holds the nut by two sides.
    """
    screw = hardware.screw
    flat = (screw.nut_flats_mm + NUT_FIT_MM) / 2.0
    for ear in ears:
        hole, *pocket = thread(ear, ABOVE, UP, clamp, clamp.wall_mm, screw)
        yield hole
        if pocket:
            top = ear[2] + clamp.wall_mm
            low = (ear[0] - flat, band_mm[0] - 1.0, top - screw.nut_height_mm - NUT_FIT_MM)
            yield box(low, (ear[0] + flat, band_mm[1] + 1.0, top + 1.0))
