"""Cuts of the mount: holes for screws and drivers, the cable's window, and the scale."""

from __future__ import annotations

import numpy as np
from shapely import LineString

from mirrorcam.cad.holder.adjuster import DRIVER_HOLE_ENDS_MM, DRIVER_HOLE_MM
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan
from mirrorcam.cad.parts.camera_box import ABOVE, SCENE, UP
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.truss import Webs, foot_plate_mm, foot_screws, foot_z_mm
from mirrorcam.cad.plan.fasteners import (
    OUTSIDE_MM,
    ROOF_DEG,
    ROOF_IN_SKINS_DEG,
    ROOF_IN_WEBS_DEG,
    Bore,
    Hexagon,
    head_space_mm,
    stack,
    thread,
)
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import along_x, roofed
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.stiffness import Section
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import transform

# Width of the marks of the scale at the clip's upper end, and length of the longest.
MARK_MM = 0.6
LONGEST_MARK_MM = 14.0
# Distance between the cable's window and the slots for its tie, on both sides.
TIE_OFF_MM = 3.0
# Slicers detect overhangs slightly before the printer's limit.
ROUNDING_DEG = 2.0
FAR_MM = 1e3


def openings(
    holder: HolderPlan, clip: ClipPlan, head: FloatArray, section: Section, hardware: Hardware
) -> tuple[Frustum | Bore | Hexagon, ...]:
    """All cuts of a mount whose face on the holder's back lies between two points, `head` (2, 2; y and z)."""
    depth, half_width = section.depth_mm, section.width_mm / 2.0
    plate = foot_plate_mm(depth, hardware)
    mount, screw = hardware.mount, hardware.screw
    driver = head_space_mm(hardware)
    cuts: list[Frustum | Bore | Hexagon] = []
    away = holder.rig_from_mount[:3, 2]
    up = UP - (UP @ away) * away
    up /= np.linalg.norm(up)
    for hole in transform(holder.rig_from_mount, np.column_stack([holder.holes_in_mount_mm, np.zeros(4)])):
        clearance, through = screw.clearance_hole_mm / 2.0, mount.skin_mm + 2.0
        cuts.append(Bore(hole - away, away, clearance, through, up, roof_deg=ROOF_IN_SKINS_DEG))
        cuts.append(Bore(hole + mount.skin_mm * away, away, driver, 2.0 * depth, up, roof_deg=ROOF_IN_WEBS_DEG))
    cuts += _for_driver(holder, up, half_width, 2.0 * depth, hardware)
    y = clip.slide_y_mm
    for at in clip.slide_at:
        mouth, reach = at + SCENE, clip.slide.grip_mm + 2.0
        cuts.append(Bore(mouth, -SCENE, screw.clearance_hole_mm / 2.0, reach, UP, 2.0 * clip.travel_mm, flat=True))
        mouth = at - clip.slide.grip_mm * SCENE
        cuts.append(Bore(mouth, -SCENE, driver, 2.0 * depth, UP, 2.0 * clip.travel_mm, ROOF_IN_WEBS_DEG))
    for spot in foot_screws(clip, depth, hardware):
        cuts += thread(spot, ABOVE, UP, stack(mount.skin_mm, hardware), plate, screw)
    cuts += _for_cable(y, foot_z_mm(clip, depth, hardware) + plate, section, hardware)
    cuts += _scale(clip, half_width, hardware)
    if abs(away[0]) > 1e-6:
        cuts.append(_flush(holder, head, half_width))
    return tuple(cuts)


def leaves_blades(holder: HolderPlan, webs: Webs, section: Section, hardware: Hardware) -> bool:
    """Return whether a driver's hole behind the holder is so nearly parallel to a web that its end cannot be printed.

    The end of a web over a hole recedes along the web, under the hole's roof. The more parallel web and hole are, the
    flatter it recedes.
    """
    away = _away(holder)
    drivers = _driver_holes(holder, section.width_mm / 2.0, hardware)
    steepest = np.tan(np.deg2rad(hardware.printer.overhang_deg + ROUNDING_DEG))
    for start, end in webs.webs:
        along = (end - start) / np.linalg.norm(end - start)
        sine = abs(along[0] * away[1] - along[1] * away[0])
        if sine >= np.tan(np.deg2rad(ROOF_IN_WEBS_DEG)) * steepest:
            continue
        web = LineString([start, end])
        for point, radius in drivers:
            if web.distance(LineString([point, point + FAR_MM * away])) < radius + section.web_mm / 2.0:
                return True
    return False


def head_end_mm(holder: HolderPlan, half_width_mm: float, web_mm: float, hardware: Hardware) -> float:
    """Upper end of a mount of given half width on the holder's back, measured along the back from the rig's origin.

    It is above the holder's screws, where the last web, which is parallel to the drivers' holes, clears all of them.
    """
    away = _away(holder)
    up = np.array([away[1], -away[0]])
    drivers = sorted((float(point @ up), radius) for point, radius in _driver_holes(holder, half_width_mm, hardware))
    screws = transform(holder.rig_from_mount, np.column_stack([holder.holes_in_mount_mm, np.zeros(4)]))[:, 1:]
    end = float((screws @ up).max()) + head_space_mm(hardware) + hardware.screw.insert_wall_mm
    for at, radius in drivers:
        if at - radius < end and end - web_mm < at + radius:
            end = at + radius + web_mm
    return end


def _away(holder: HolderPlan) -> FloatArray:
    """The normal (2,; y and z) of the holder's back."""
    away = holder.rig_from_mount[1:3, 2]
    return np.asarray(away / np.linalg.norm(away))


def _driver_holes(holder: HolderPlan, half_width_mm: float, hardware: Hardware) -> list[tuple[FloatArray, float]]:
    """Points (2,; y and z) on the axes of the drivers' holes behind the holder, and the holes' radii."""
    screws = transform(holder.rig_from_mount, np.column_stack([holder.holes_in_mount_mm, np.zeros(4)]))
    drivers = [(screw[1:], head_space_mm(hardware)) for screw in screws]
    if isinstance(holder, ScrewedHolderPlan):
        heads = [head for head in holder.heads if _crosses(head, half_width_mm)]
        drivers += [(head[1:], DRIVER_HOLE_MM / 2.0) for head in heads]
    return drivers


def _crosses(head: FloatArray, half_width_mm: float) -> bool:
    """Return whether the driver's hole of a carrier's screw meets a mount of given half width."""
    low, high = (float(head[0]) + end for end in DRIVER_HOLE_ENDS_MM)
    return high >= -half_width_mm and low <= half_width_mm


def over_drivers_mm(clip: ClipPlan, hardware: Hardware) -> float:
    """z in rig of the upper side of the driver's holes for the clip's screws."""
    return max(clip.slide_z_mm) + clip.travel_mm + head_space_mm(hardware)


def _for_driver(
    holder: HolderPlan, up: FloatArray, half_width_mm: float, deep_mm: float, hardware: Hardware
) -> list[Bore | Frustum]:
    """Holes for the driver of the carriers' screws; those near an end of the mount are open to that end."""
    if not isinstance(holder, ScrewedHolderPlan):
        return []
    away, wall, radius = holder.rig_from_mount[:3, 2], hardware.printer.wall_mm, DRIVER_HOLE_MM / 2.0
    across = radius * np.cross(away, up)
    cuts: list[Bore | Frustum] = []
    for head in holder.heads:
        if not _crosses(head, half_width_mm):
            continue
        low, high = (float(head[0]) + end for end in DRIVER_HOLE_ENDS_MM)
        cuts.append(Bore(head - away, away, radius, deep_mm, up, roof_deg=ROOF_IN_WEBS_DEG))
        beyond = [1.0] if high + wall > half_width_mm else [-1.0] if low - wall < -half_width_mm else []
        for end in beyond:
            out = (end * (half_width_mm + 1.0) - float(head[0])) * up
            base = head - away + np.array([-across, across, across + out, out - across])
            cuts.append(Frustum(base, base + deep_mm * away))
    return cuts


def cable_reach_mm(hardware: Hardware) -> float:
    """Distance from the middle to the end of the cable's window and tie slots, including the thinnest wall."""
    width, height = hardware.mount.cable_window_mm
    tie_width, tie_height = hardware.mount.tie_mm
    roof = tie_height / 2.0 / np.tan(np.deg2rad(ROOF_DEG))
    return float(width + height) / 2.0 + TIE_OFF_MM + tie_width + roof + hardware.printer.wall_mm


def _for_cable(y: float, floor_z: float, section: Section, hardware: Hardware) -> list[Frustum]:
    """A window for the cable above the foot's plate, and slots for a tie on both sides."""
    mount, depth = hardware.mount, section.depth_mm
    width, height = mount.cable_window_mm
    half, middle_z = width / 2.0, floor_z + height / 2.0
    tie_width, tie_height = mount.tie_mm
    window = roofed((-half, half), (floor_z, floor_z + height), (y - depth - 1.0, y + 1.0))
    ties = [
        roofed(
            (x, x + tie_width),
            (middle_z - tie_height / 2.0, middle_z + tie_height / 2.0),
            (y - depth - 1.0, y - depth + section.skin_mm + 1.0),
        )
        for x in (-half - TIE_OFF_MM - tie_width, half + height / 2.0 + TIE_OFF_MM)
    ]
    return [window, *ties]


def _scale(clip: ClipPlan, half_width: float, hardware: Hardware) -> list[Frustum]:
    """Marks 1 mm apart; the clip's upper end is at the longest when the pupil is at its nominal depth.

    They are open to the end that prints last, so that they have no overhang.
    """
    marks = []
    steps = int(clip.travel_mm)
    longest = longest_mark_mm(clip, half_width, hardware)
    for step in range(-steps, steps + 1):
        length = longest * (1.0 if step == 0 else 0.7 if abs(step) == steps else 0.4)
        z, y = clip.top_mm + step, clip.slide_y_mm
        notch = np.array(
            [(y + OUTSIDE_MM, z - MARK_MM / 2.0), (y + OUTSIDE_MM, z + MARK_MM / 2.0), (y - MARK_MM / 2.0, z)]
        )
        marks.append(along_x(notch, half_width - length, half_width + 1.0))
    return marks


def longest_mark_mm(clip: ClipPlan, half_width: float, hardware: Hardware) -> float:
    """Length of the scale's longest mark, which ends before the clip's slots: notched ceilings would not bridge."""
    beside = hardware.screw.clearance_hole_mm / 2.0 + hardware.printer.wall_mm
    over_slots = clip.top_mm - int(clip.travel_mm) > max(clip.slide_z_mm) + clip.travel_mm + beside
    return LONGEST_MARK_MM if over_slots else min(LONGEST_MARK_MM, half_width - clip.slide_x_mm - beside)


def _flush(holder: HolderPlan, head: FloatArray, half_width: float) -> Frustum:
    """The cut that keeps the head out of the holder if its back is turned sideways."""
    ends: FloatArray = np.column_stack([np.zeros(2), head])
    mount_from_rig = np.asarray(np.linalg.inv(holder.rig_from_mount), dtype=np.float64)
    on_back = transform(mount_from_rig, ends)
    low, high = on_back[:, 1].min(), on_back[:, 1].max() + 1.0
    # The middle of the mount may differ from the middle of the holder's screws.
    left, right = on_back[:, 0].mean() + np.array([-1.0, 1.0]) * (half_width + 5.0)
    corners = np.array([(left, low, 0.0), (right, low, 0.0), (right, high, 0.0), (left, high, 0.0)])
    base: FloatArray = transform(holder.rig_from_mount, corners)
    away = holder.rig_from_mount[:3, 2]
    return Frustum(base, base - (2.0 * abs(away[0]) * half_width + 1.0) * away)
