"""The mount's foot: what it stands on, and where the adapter's screws enter it."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.plan.fasteners import stack
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.optics.base.values import FloatArray

# The adapter's screws in the mount's foot: +-x from the middle, and below the slide's plane. In the adapter the roofs
# of their heads' holes have a wall to its end and between them.
FOOT_X_MM = 17.0
FOOT_Y_MM = (4.5, 14.0)
FOOT_DEPTH_MM = 20.0


def foot_z_mm(clip: ClipPlan, hardware: Hardware) -> float:
    """The foot's lower face: below the clip's lowest position there is the cable's window, then the foot's plate."""
    return clip.bottom_mm - clip.travel_mm - 1.0 - hardware.mount.cable_window_mm[1] - foot_plate_mm(hardware)


def foot_plate_mm(hardware: Hardware) -> float:
    """Thickness of the foot's plate, which holds the adapter's screws and a tripod nut."""
    return max(
        stack(hardware.mount.skin_mm, hardware).wall_mm, hardware.mount.tripod_height_mm + hardware.mount.web_mm + 0.2
    )


def foot_screws(clip: ClipPlan, hardware: Hardware) -> FloatArray:
    """Points (4, 3) in rig where the adapter's screws enter the foot's lower face."""
    z = foot_z_mm(clip, hardware)
    return np.array([(x, clip.slide_y_mm - y, z) for x in (-FOOT_X_MM, FOOT_X_MM) for y in FOOT_Y_MM])
