"""A bracket under the mount's foot: an upright plate behind it, a shelf and two ribs; it prints on its back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.backs.back import Neck
from mirrorcam.cad.backs.blocks import ALONG_X, ALONG_Y, BlocksPlan
from mirrorcam.cad.parts.camera_box import ABOVE
from mirrorcam.cad.parts.foot import FOOT_DEPTH_MM
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.dimension import length
from mirrorcam.cad.plan.fasteners import OUTSIDE_MM, Bore, Hexagon
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import along_x, box
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.values import FloatArray

RIB_MM = 5.0


@dataclass(frozen=True)
class Bracket:
    """A bracket in rig, mm: its plan, the middle (3,) of its plate's back, the heads (4, 3) of the foot's screws.

    The plate's front is at y = `front_mm`.
    """

    plan: BlocksPlan
    middle: FloatArray
    front_mm: float
    heads: FloatArray
    neck: Neck


def plan_bracket(
    name: str,
    below_mm: float,
    sides_mm: tuple[float, float, float],
    rib_x_mm: float,
    cuts: tuple[Frustum | Bore | Hexagon, ...],
    grip_mm: float,
    mount: MountPlan,
    hardware: Hardware,
    ends: tuple[tuple[FloatArray, FloatArray], ...] = (),
) -> Bracket:
    """Lay out a bracket whose plate has its middle `below_mm` under the mount's foot.

    `sides_mm` are the plate's half width, how far it reaches below its middle, and its thickness; the ribs stand from
    `rib_x_mm` outwards on both sides. `cuts` of the plate, and the `ends` (3,) of further dimensions, are given
    about the middle of its back as the origin. The shelf is `grip_mm` thick: heads rest under it.
    """
    half, down, thick = sides_mm
    foot_z, slide = mount.foot_z_mm, float(mount.slide[1])
    front = slide - FOOT_DEPTH_MM
    back, middle_z = front - thick, foot_z - below_mm
    middle, reach = np.array([0.0, back, middle_z]), rib_x_mm + RIB_MM
    heads = mount.foot - grip_mm * ABOVE
    rib = np.array(
        [(front - 1.0, middle_z - down / 2.0), (front - 1.0, foot_z), (slide, foot_z), (slide, foot_z - grip_mm)]
    )
    rib = np.vstack([rib, [(front, middle_z - down / 2.0)]])
    pieces = [
        box((-half, back, middle_z - down), (half, front, foot_z)),
        box((-reach, back, foot_z - grip_mm), (reach, slide, foot_z)),
        *(along_x(rib, low, low + RIB_MM) for low in (-reach, rib_x_mm)),
    ]
    clearance = hardware.screw.clearance_hole_mm / 2.0
    own = [_moved(cut, middle) for cut in cuts]
    own += [Bore(head - OUTSIDE_MM * ABOVE, ABOVE, clearance, grip_mm + 2.0 * OUTSIDE_MM, ALONG_Y) for head in heads]
    root = np.array([-reach, slide, foot_z])
    lengths = [
        length(np.array([-half, back, foot_z]), np.array([-half, front, foot_z])),
        length(root, root - grip_mm * ABOVE),
        length(root, root + RIB_MM * ALONG_X),
        length(np.array([-reach, front, foot_z]), np.array([-reach, front, middle_z - down / 2.0])),
    ]
    if reach < half:
        lengths.append(length(root, root + 2.0 * reach * ALONG_X))
    # The ribs alone, at the root of the shelf.
    deep = below_mm + down / 2.0
    neck = Neck("ribs at the plate", np.array([0.0, front, foot_z - deep / 2.0]), ALONG_Y, ABOVE, (deep, 2.0 * RIB_MM))
    lengths += [length(start + middle, end + middle) for start, end in ends]
    return Bracket(BlocksPlan(name, tuple(pieces), tuple(own), tuple(lengths)), middle, front, heads, neck)


def plate_neck(bracket: Bracket, width_mm: float, thick_mm: float, up_mm: float) -> Neck:
    """The section of the plate `up_mm` over its middle, over the screws that hold it."""
    at = bracket.middle + np.array([0.0, thick_mm / 2.0, up_mm])
    return Neck("plate over its screws", at, ABOVE, ALONG_X, (width_mm, thick_mm))


def _moved(cut: Frustum | Bore | Hexagon, by: FloatArray) -> Frustum | Bore | Hexagon:
    if isinstance(cut, Bore):
        return Bore(cut.mouth + by, cut.axis, cut.radius_mm, cut.depth_mm, cut.up)
    if isinstance(cut, Hexagon):
        return Hexagon(cut.mouth + by, cut.axis, cut.up, cut.flats_mm, cut.depth_mm)
    return Frustum(cut.base + by, cut.top + by)
