"""Slots in the clip's wall for cable ties."""

from __future__ import annotations

from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import box
from mirrorcam.cad.plan.seats import Frustum

# Depth of the hollow for a tie in the wall, below the groove of the rib.
TIE_THICK_MM = 1.6


def tie_slot_mm(hardware: Hardware) -> tuple[float, float]:
    """Half the height of a tie's slot, and half its width."""
    width, thickness = hardware.mount.tie_mm
    return width / 2.0 + hardware.fit.slide_mm, thickness / 2.0 + hardware.fit.slide_mm


def tie_slots(left: float, right: float, z: float, wall_y: tuple[float, float], hardware: Hardware) -> list[Frustum]:
    """Two slots through the wall at x and z for a tie, and the hollow for it in the wall's outer face."""
    half_z, half_x = tie_slot_mm(hardware)
    outer_y, inner_y = wall_y
    depth = hardware.clip.rib_mm + hardware.fit.slide_mm + TIE_THICK_MM
    z_range = (z - half_z, z + half_z)
    cuts = [
        box((x - half_x, outer_y - 1.0, z_range[0]), (x + half_x, inner_y + 1.0, z_range[1])) for x in (left, right)
    ]
    return [*cuts, box((left - half_x, outer_y - 1.0, z_range[0]), (right + half_x, outer_y + depth, z_range[1]))]
