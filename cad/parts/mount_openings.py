"""Cuts of the mount: holes for screws and screwdrivers, the cable's window, and the clip's graduated scale."""

from __future__ import annotations

import numpy as np
from shapely import LineString

from mirrorcam.cad.holder.adjuster import DRIVER_HOLE_ENDS_MM, DRIVER_HOLE_MM
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan
from mirrorcam.cad.parts.camera_box import SCENE, UP
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.truss import Foot, Webs, foot_plate_mm, foot_stack
from mirrorcam.cad.plan.fasteners import (
    OUTSIDE_MM,
    ROOF_DEG,
    ROOF_IN_SKINS_DEG,
    ROOF_IN_WEBS_DEG,
    Bore,
    Hexagon,
    head_space_mm,
    thread,
)
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import prism_along_x, roofed_window
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.stand import rotated
from mirrorcam.cad.plan.stiffness import Section
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import transform

# Width of the marks of the scale at the clip's upper end, and length of the longest mark.
MARK_MM = 0.6
LONGEST_MARK_MM = 14.0
# Distance between the cable's window and the slots for its tie on both sides.
TIE_GAP_MM = 3.0
# Slicers detect overhangs slightly before the printer's limit.
ROUNDING_DEG = 2.0
# How much shorter than the printer's longest bridge the ceilings of slots are.
BRIDGE_MARGIN_MM = 0.1
# Length of a screwdriver's axis, beyond any mount.
BEYOND_MOUNT_MM = 1e3


def openings(
    holder: HolderPlan, clip: ClipPlan, foot: Foot, section: Section, hardware: Hardware
) -> tuple[Frustum | Bore | Hexagon, ...]:
    """All cuts of a mount, in the rig frame."""
    depth, half_width = section.depth_mm, section.width_mm / 2.0
    plate = foot_plate_mm(depth, hardware)
    mount, screw = hardware.mount, hardware.screw
    driver_radius = head_space_mm(hardware)
    cuts: list[Frustum | Bore | Hexagon] = []
    normal = holder.rig_from_mount[:3, 2]
    up = UP - (UP @ normal) * normal
    up /= np.linalg.norm(up)
    for hole in transform(holder.rig_from_mount, np.column_stack([holder.holes_in_mount_mm, np.zeros(4)])):
        clearance, through = screw.clearance_hole_mm / 2.0, mount.grip_mm + 2.0
        cuts.append(Bore(hole - normal, normal, clearance, through, up, roof_deg=ROOF_IN_SKINS_DEG))
        start = hole + mount.grip_mm * normal
        cuts.append(Bore(start, normal, driver_radius, 2.0 * depth, up, roof_deg=ROOF_IN_WEBS_DEG))
    cuts += _carrier_driver_cuts(holder, up, half_width, 2.0 * depth, hardware)
    for screw_point in clip.slide_points:
        start, through = screw_point + SCENE, clip.slide.grip_mm + 2.0
        radius, ceiling = screw.clearance_hole_mm / 2.0, hardware.printer.bridge_mm - BRIDGE_MARGIN_MM
        cuts.append(Bore(start, -SCENE, radius, through, UP, 2.0 * clip.travel_mm, ceiling_mm=ceiling))
        start = screw_point - clip.slide.grip_mm * SCENE
        cuts.append(Bore(start, -SCENE, driver_radius, 2.0 * depth, UP, 2.0 * clip.travel_mm, ROOF_IN_WEBS_DEG))
    for screw_point in foot.screws_in_rig:
        cuts += thread(screw_point, foot.up_in_rig, UP, foot_stack(hardware), plate, screw)
    cuts += _cable_cuts(clip.slide_y_mm, foot, section, hardware)
    cuts += _scale_marks(clip, half_width, hardware)
    return tuple(cuts)


def leaves_unprintable_web_ends(holder: HolderPlan, webs: Webs, section: Section, hardware: Hardware) -> bool:
    """Return whether a screwdriver hole behind the holder is too nearly parallel to a web to print the cut web's end.

    The end overhangs along the web under the hole's roof: the smaller the angle between web and hole, the flatter the
    overhang.
    """
    normal = _back_normal(holder)
    drivers = _driver_holes(holder, section.width_mm / 2.0, hardware)
    max_tangent = np.tan(np.deg2rad(hardware.printer.overhang_deg + ROUNDING_DEG))
    for start, end in webs.webs:
        direction = (end - start) / np.linalg.norm(end - start)
        sine = abs(direction[0] * normal[1] - direction[1] * normal[0])
        if sine >= np.tan(np.deg2rad(ROOF_IN_WEBS_DEG)) * max_tangent:
            continue
        web = LineString([start, end])
        for point, radius in drivers:
            if web.distance(LineString([point, point + BEYOND_MOUNT_MM * normal])) < radius + section.web_mm / 2.0:
                return True
    return False


def head_end_mm(holder: HolderPlan, half_width_mm: float, web_mm: float, hardware: Hardware) -> float:
    """Upper end of a mount of given half width on the holder's back, measured along the back from the rig's origin.

    It is above the holder's screws, where the last web, which is parallel to the screwdriver holes, clears all of them.
    """
    normal = _back_normal(holder)
    up = np.array([normal[1], -normal[0]])
    drivers = sorted((float(point @ up), radius) for point, radius in _driver_holes(holder, half_width_mm, hardware))
    screws = transform(holder.rig_from_mount, np.column_stack([holder.holes_in_mount_mm, np.zeros(4)]))[:, 1:]
    end = float((screws @ up).max()) + head_space_mm(hardware) + hardware.screw.insert_wall_mm
    for centre, radius in drivers:
        if centre - radius < end and end - web_mm < centre + radius:
            end = centre + radius + web_mm
    return end


def _back_normal(holder: HolderPlan) -> FloatArray:
    """The unit normal (y, z) of the holder's back, out of the holder."""
    normal = holder.rig_from_mount[1:3, 2]
    return np.asarray(normal / np.linalg.norm(normal))


def _driver_holes(holder: HolderPlan, half_width_mm: float, hardware: Hardware) -> list[tuple[FloatArray, float]]:
    """A point (y, z) on the axis of each screwdriver hole behind the holder, and the hole's radius."""
    screws = transform(holder.rig_from_mount, np.column_stack([holder.holes_in_mount_mm, np.zeros(4)]))
    drivers = [(screw[1:], head_space_mm(hardware)) for screw in screws]
    if isinstance(holder, ScrewedHolderPlan):
        heads = [head for head in holder.heads if _crosses(head, half_width_mm)]
        drivers += [(head[1:], DRIVER_HOLE_MM / 2.0) for head in heads]
    return drivers


def _crosses(head: FloatArray, half_width_mm: float) -> bool:
    """Return whether the screwdriver hole of a carrier's screw meets a mount of given half width."""
    low, high = (float(head[0]) + end for end in DRIVER_HOLE_ENDS_MM)
    return high >= -half_width_mm and low <= half_width_mm


def driver_holes_top_mm(clip: ClipPlan, hardware: Hardware) -> float:
    """z, in the rig frame, of the top of the screwdriver holes for the clip's screws."""
    return max(clip.slide_z_mm) + clip.travel_mm + head_space_mm(hardware)


def _carrier_driver_cuts(
    holder: HolderPlan, up: FloatArray, half_width_mm: float, depth_mm: float, hardware: Hardware
) -> list[Bore | Frustum]:
    """Screwdriver holes for the carriers' screws; those near a side of the mount are open to that side."""
    if not isinstance(holder, ScrewedHolderPlan):
        return []
    normal, wall, radius = holder.rig_from_mount[:3, 2], hardware.printer.wall_mm, DRIVER_HOLE_MM / 2.0
    half_slot = radius * np.cross(normal, up)
    cuts: list[Bore | Frustum] = []
    for head in holder.heads:
        if not _crosses(head, half_width_mm):
            continue
        low, high = (float(head[0]) + end for end in DRIVER_HOLE_ENDS_MM)
        cuts.append(Bore(head - normal, normal, radius, depth_mm, up, roof_deg=ROOF_IN_WEBS_DEG))
        open_ends = [1.0] if high + wall > half_width_mm else [-1.0] if low - wall < -half_width_mm else []
        for end in open_ends:
            outwards = (end * (half_width_mm + 1.0) - float(head[0])) * up
            base = head - normal + np.array([-half_slot, half_slot, half_slot + outwards, outwards - half_slot])
            cuts.append(Frustum(base, base + depth_mm * normal))
    return cuts


def cable_half_width_mm(hardware: Hardware) -> float:
    """Half width of the cable's window and tie slots, including the thinnest wall."""
    width, height = hardware.mount.cable_window_mm
    tie_width, tie_height = hardware.mount.tie_mm
    roof = tie_height / 2.0 / np.tan(np.deg2rad(ROOF_DEG))
    return float(width + height) / 2.0 + TIE_GAP_MM + tie_width + roof + hardware.printer.wall_mm


def _cable_cuts(slide_y: float, foot: Foot, section: Section, hardware: Hardware) -> list[Frustum]:
    """A window for the cable above the foot's plate, and slots for a tie on both sides in the rear skin."""
    mount, depth, rotation = hardware.mount, section.depth_mm, foot.rig_from_stand
    width, height = mount.cable_window_mm
    half, floor = width / 2.0, foot.z_mm + foot_plate_mm(depth, hardware)
    tie_width, tie_height = mount.tie_mm
    # The skins lean, so the window passes through them in front of the foot's face or behind it.
    beyond = 1.0 + abs(rotation[1, 2] / rotation[1, 1]) * (floor + height - foot.z_mm)
    front, back = foot.front_y_mm + beyond, foot.back_y_mm - beyond
    window = roofed_window((-half, half), (floor, floor + height), (back, front))
    # The rear skin is at y - depth in the rig frame, where the window's middle is at this height.
    rear_y = slide_y - depth
    middle_z = (floor + height / 2.0 - rotation[1, 2] * rear_y) / rotation[2, 2]
    ties = [
        roofed_window(
            (x, x + tie_width),
            (middle_z - tie_height / 2.0, middle_z + tie_height / 2.0),
            (rear_y - 1.0, rear_y + section.skin_mm + 1.0),
        )
        for x in (-half - TIE_GAP_MM - tie_width, half + height / 2.0 + TIE_GAP_MM)
    ]
    return [rotated(window, rotation), *ties]


def _scale_marks(clip: ClipPlan, half_width: float, hardware: Hardware) -> list[Frustum]:
    """Marks 1 mm apart; the clip's upper end is at the longest mark when the pupil is at its nominal depth.

    They are open to the side that prints last, so that they have no overhang.
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
        marks.append(prism_along_x(notch, half_width - length, half_width + 1.0))
    return marks


def longest_mark_mm(clip: ClipPlan, half_width: float, hardware: Hardware) -> float:
    """Length of the longest mark, which ends short of the clip's slots, since notched ceilings do not bridge."""
    slot_margin = hardware.screw.clearance_hole_mm / 2.0 + hardware.printer.wall_mm
    over_slots = clip.top_mm - int(clip.travel_mm) > max(clip.slide_z_mm) + clip.travel_mm + slot_margin
    return LONGEST_MARK_MM if over_slots else min(LONGEST_MARK_MM, half_width - clip.slide_x_mm - slot_margin)
