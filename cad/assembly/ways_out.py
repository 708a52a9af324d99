"""How inserts and nuts get to their seats: the moves by which they would leave them, from the plans of the pockets."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.parts.foot import foot_plate_mm
from mirrorcam.cad.plan.fasteners import beyond
from mirrorcam.cad.plan.prisms import corners_of
from mirrorcam.core.values import FloatArray

SIDE = np.array([1.0, 0.0, 0.0])
SCENE = np.array([0.0, 1.0, 0.0])
ABOVE = np.array([0.0, 0.0, 1.0])
# An insert is drawn so far from its hole.
INSERT_OUT_MM = 17.0


def insert_way_mm(out: FloatArray) -> FloatArray:
    """The move (1, 3) of inserts that enter a part by the face that the screw enters; `out` (3,) has length 1."""
    return INSERT_OUT_MM * out[None]


def holder_nut_ways_mm(device: Device, seats: FloatArray) -> FloatArray:
    """Moves (n, 1, 3) in rig of the nuts at seats (n, 3) in the holder's back: along their slots."""
    corners, ways = device.holder.corners_in_rig, device.holder.slot_ways
    unit = ways / np.linalg.norm(ways, axis=1)[:, None]
    return np.array([[beyond(corners, seat, way)] for seat, way in zip(seats, unit, strict=True)])


def slide_nut_ways_mm(device: Device, seats: FloatArray) -> FloatArray:
    """Moves (n, 1, 3) of the nuts of the clip's slide: off its wall, out at the side to the scene."""
    corners = corners_of(device.clip.pieces)
    return np.array([[beyond(corners, seat, SCENE)] for seat in seats])


def foot_nut_ways_mm(device: Device, seats: FloatArray) -> FloatArray:
    """Moves (n, 2, 3) of the nuts in the mount's foot: off its plate into the truss, out by the nearer side."""
    corners, screw = corners_of(device.mount.pieces), device.hardware.screw
    plate = device.mount.foot_z_mm + foot_plate_mm(device.mount.section.depth_mm, device.hardware)
    # The origin of a nut is at its face towards the screw.
    off_plate = [(plate - seat[2] + screw.nut_height_mm / 4.0) * ABOVE for seat in seats]
    sides = [beyond(corners, seat, np.sign(seat[0]) * SIDE) for seat in seats]
    return np.stack([off_plate, sides], axis=1)
