"""The adapter: a split clamp around the robot's wrist, its upper half (the saddle) screwed to the mount's foot.

The wrist runs along y, below the camera: parallel to the views of a fold of 90 deg. Both halves are profiles in the x-z
plane along y; they print with the clamp's face on the bed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.parts.clip import ABOVE, ClipPlan
from mirrorcam.cad.parts.foot import FOOT_DEPTH_MM, FOOT_X_MM, foot_screws, foot_z_mm
from mirrorcam.cad.plan.dimension import Hole, Length
from mirrorcam.cad.plan.fasteners import NUT_FIT_MM, OUTSIDE_MM, Bore, Hexagon, Stack, stack, thread
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
    wrist, screw, skin = hardware.wrist, hardware.screw, hardware.mount.skin_mm
    foot_z = foot_z_mm(clip, hardware)
    radius = wrist.diameter_mm / 2.0
    axis_z = foot_z - wrist.riser_mm - radius
    around = screw.insert_hole_mm / 2.0 + screw.insert_wall_mm
    foot, clamp = stack(skin, hardware), stack(CAP_EAR_MM + wrist.gap_mm, hardware)
    back, front = clip.slide_y_mm - FOOT_DEPTH_MM, clip.slide_y_mm + wrist.band_mm
    band = np.array([clip.slide_y_mm, front])
    half = FOOT_X_MM + around + 1.0
    under = axis_z + radius + wrist.joint_mm
    if (thick := foot_z - under) < skin + screw.head_height_mm + hardware.printer.wall_mm:
        raise InputError(
            f"adapter's plate is {thick:.1f} mm thick, expected "
            f"{skin + screw.head_height_mm + hardware.printer.wall_mm:.1f} mm for its screws: raise riser_mm"
        )
    face = wrist.gap_mm / 2.0
    ear_x = radius + wrist.ring_mm + around
    ear_end = ear_x + max(around, (screw.nut_flats_mm + NUT_FIT_MM) / 2.0 + 1.2 * hardware.printer.wall_mm)
    ears = [(-ear_end, -radius - 0.5 * wrist.ring_mm), (radius + 0.5 * wrist.ring_mm, ear_end)]
    saddle_ears = [
        box((low, band[0], axis_z + face), (high, band[1], axis_z + face + clamp.wall_mm)) for low, high in ears
    ]
    cap_ears = [box((low, band[0], axis_z - face - CAP_EAR_MM), (high, band[1], axis_z - face)) for low, high in ears]
    # The holes' roofs are higher than the holes: a little off the middle, both sides have their wall.
    ear_y = float(band.mean()) + EAR_OFF_MM
    ear_at = np.array([(-ear_x, ear_y, axis_z + face), (ear_x, ear_y, axis_z + face)])
    clamp_heads = ear_at - (CAP_EAR_MM + wrist.gap_mm) * ABOVE
    heads = foot_screws(clip, hardware) - skin * ABOVE
    driver = screw.head_mm / 2.0 + hardware.fit.free_mm
    clearance = screw.clearance_hole_mm / 2.0
    saddle_cuts: list[Frustum | Bore | Hexagon] = []
    for head in heads:
        saddle_cuts.append(Bore(head - OUTSIDE_MM * ABOVE, ABOVE, clearance, skin + 1.0, UP))
        saddle_cuts.append(Bore(head, -ABOVE, driver, 99.0, UP))
    for ear in ear_at:
        hole, *pocket = thread(ear, ABOVE, UP, clamp, clamp.wall_mm, screw)
        saddle_cuts.append(hole)
        if pocket:
            # The ear is too narrow for a pocket all round: a channel through it holds the nut by two sides.
            flat, top = (screw.nut_flats_mm + NUT_FIT_MM) / 2.0, axis_z + face + clamp.wall_mm
            low = (ear[0] - flat, band[0] - 1.0, top - screw.nut_height_mm - NUT_FIT_MM)
            saddle_cuts.append(box(low, (ear[0] + flat, band[1] + 1.0, top + 1.0)))
    cap_cuts = tuple(Bore(head - ABOVE, ABOVE, clearance, CAP_EAR_MM + 2.0, UP) for head in clamp_heads)
    block = [
        box((-half, band[0], axis_z + 0.6 * radius), (half, band[1], foot_z)),
        box((-half, back, under), (half, band[1], foot_z)),
    ]
    common = (radius, wrist.ring_mm, axis_z, wrist.gap_mm, band)
    return AdapterPlan(
        saddle=RingPlan("adapter_saddle", True, *common, (*block, *saddle_ears), tuple(saddle_cuts), ear_at),
        cap=RingPlan("adapter_cap", False, *common, tuple(cap_ears), cap_cuts, ear_at - wrist.gap_mm * ABOVE),
        clamp=clamp,
        foot=foot,
        foot_heads=heads,
        clamp_heads=clamp_heads,
    )
