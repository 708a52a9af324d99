"""A camera's body in rig, what a clip holds it with, and the axes of the rig by the names that parts use."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.parts.nest import Nest
from mirrorcam.cad.plan.fasteners import Bore, Hexagon
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import box
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera_body import CameraBody

UP = np.array([1.0, 0.0, 0.0])
SCENE = np.array([0.0, 1.0, 0.0])
ABOVE = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class BodyBox:
    """A camera's body in rig, mm: a box from `low` (3,) to `high` (3,), its front at the right depth of the pupil."""

    low: FloatArray
    high: FloatArray

    @property
    def solid(self) -> Frustum:
        return box(tuple(self.low), tuple(self.high))

    @property
    def middle(self) -> FloatArray:
        """The middle (3,) of the box."""
        return (self.low + self.high) / 2.0


def body_box(camera: CameraBody) -> BodyBox:
    """The camera's body with its entrance pupil at the origin."""
    low, high = camera.box_mm
    return BodyBox(np.array(low), np.array(high))


def tie_height_mm(hardware: Hardware) -> float:
    """Height of the wall below a camera that the slots for its cable's tie need."""
    return hardware.mount.tie_mm[0] + 2.0 * (hardware.printer.wall_mm + hardware.fit.slide_mm)


@dataclass(frozen=True)
class Held:
    """How a camera is held, in rig, mm: pieces and cuts, and the wall that joins them.

    The wall's face towards the camera is at y = `inner_y_mm`; it spans `x_mm` (from, to) and `z_mm` (from, to).
    `board_screws` (n, 3) are where the heads of a board's own screws rest; a body has a nest.
    """

    pieces: tuple[Frustum, ...]
    cuts: tuple[Frustum | Bore | Hexagon, ...]
    inner_y_mm: float
    x_mm: tuple[float, float]
    z_mm: tuple[float, float]
    board_screws: FloatArray
    nest: Nest | None = None
