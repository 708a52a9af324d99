"""The mount's foot: where a back's screws enter it."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.plan.fasteners import Stack, stack, stack_into
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.core.values import FloatArray

# The back's screws in the mount's foot: +-x from the middle, and below the slide's plane. In a clamp the
# roofs of their heads' holes have a wall to its end and between them.
FOOT_X_MM = 17.0
FOOT_Y_MM = (4.5, 14.0)
FOOT_DEPTH_MM = 20.0
# The foot's plate bears the whole moment of the mirrors, from the outer skin to the screws near the inner one. In a
# mount this many times as deep as its plate is thick, the plate bends less than the truss over it.
DEPTHS_PER_PLATE = 3.0


def foot_z_mm(clip: ClipPlan, depth_mm: float, hardware: Hardware) -> float:
    """The foot's lower face: below the clip's lowest position there is the cable's window, then the foot's plate."""
    plate = foot_plate_mm(depth_mm, hardware)
    return clip.bottom_mm - clip.travel_mm - 1.0 - hardware.mount.cable_window_mm[1] - plate


def foot_plate_mm(depth_mm: float, hardware: Hardware) -> float:
    """Thickness of the foot's plate, which holds the back's screws, in a mount of a depth."""
    return max(stack(hardware.mount.skin_mm, hardware).wall_mm, depth_mm / DEPTHS_PER_PLATE)


def foot_stack(grip_mm: float, hardware: Hardware) -> Stack:
    """The screws of a back with `grip_mm` of material under their heads, into the threads of the mount's foot.

    Their tips may stand out of the foot's plate into the hollow over it. Raises InputError where no screw on the list
    holds there.
    """
    held, screw = stack(hardware.mount.skin_mm, hardware), hardware.screw
    length = screw.insert_mm if screw.kind == "insert" else screw.nut_height_mm
    deepest = screw.insert_depth_mm if screw.kind == "insert" else held.wall_mm + 1.0
    return stack_into(grip_mm, (held.begins_mm, held.begins_mm + length), deepest, held.wall_mm, screw)


def foot_screws(clip: ClipPlan, depth_mm: float, hardware: Hardware) -> FloatArray:
    """Points (4, 3) in rig where the back's screws enter the foot's lower face, in a mount of a depth."""
    z = foot_z_mm(clip, depth_mm, hardware)
    return np.array([(x, clip.slide_y_mm - y, z) for x in (-FOOT_X_MM, FOOT_X_MM) for y in FOOT_Y_MM])
