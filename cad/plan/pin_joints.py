"""Joints between the pieces of a part: two steel pins in every cut, in teardrop holes on both sides."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.plan.fasteners import ROOF_DEG
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid

# Two pins nearer to each other than this many diameters leave the pieces free to turn.
PINS_APART = 4.0


def clearance_round_pin_mm(hardware: Hardware) -> float:
    """Least distance from a pin's axis to the outside: the roof of its hole reaches higher than its radius."""
    radius = hardware.holder.pin_mm[0] / 2.0 + hardware.fit.press_mm
    return radius / float(np.sin(np.radians(ROOF_DEG))) + hardware.printer.wall_mm


def reach_of_pin_mm(hardware: Hardware) -> float:
    """Length of solid material that a pin needs on either side of a cut: its hole, and the thinnest wall behind."""
    return hole_depth_mm(hardware) + hardware.printer.wall_mm


def hole_depth_mm(hardware: Hardware) -> float:
    """Depth of a pin's hole in either piece: the pin does not reach its end."""
    return hardware.holder.pin_mm[1] / 2.0 + hardware.fit.slide_mm


def hole_mm(hardware: Hardware) -> float:
    """Diameter of a pin's hole."""
    return hardware.holder.pin_mm[0] + 2.0 * hardware.fit.press_mm


def farthest_pair(points_mm: FloatArray) -> tuple[FloatArray, float]:
    """The two of some points (n, 2) that are farthest apart, as (2, 2), and their distance; 0 mm of no points."""
    distances = np.linalg.norm(points_mm[:, None] - points_mm[None, :], axis=-1)
    if not distances.size:
        return np.zeros((2, 2)), 0.0
    first, second = np.unravel_index(int(np.argmax(distances)), distances.shape)
    return points_mm[[first, second]], float(distances.max())


def hole_frame(middle_mm: FloatArray, axis: int, side: float) -> FloatArray:
    """Frame (4, 4) on the bed of a hole that begins at a point (3,) of a cut across an axis: z into the piece, y up."""
    inwards, upwards = side * np.eye(3)[axis], np.array([0.0, 0.0, 1.0])
    return rigid(np.column_stack([np.cross(upwards, inwards), upwards, inwards]), middle_mm)
