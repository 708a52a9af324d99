"""The fit coupon: one small print to test, before the rest, whether mirrors, inserts, wrist and lens fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.plan.dimension import Hole, Length
from mirrorcam.cad.plan.fasteners import Bore, Hexagon, stack, thread
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.hole_dimensions import holes
from mirrorcam.cad.plan.prisms import box
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout

MIRROR_MM = (20.0, 15.0)
"""The test mirror, cut from the stock sheet of the layout's mirrors."""

PLATE_MM = 2.4
GAUGE_WALL_MM = 3.0
LENS_STEPS_MM = (-0.3, 0.0, 0.3)
RIG_FROM_COUPON_MM = np.array([130.0, 0.0, -100.0])
"""It stands beside the device."""


@dataclass(frozen=True)
class CouponPlan:
    """A coupon in rig, mm: pieces and cuts, and a segment of the clamp's ring, open to +x, about `centre` (3,) along z.

    `right_mm` is the plate's edge, where the segment ends; the wrist touches nothing else.
    """

    pieces: tuple[Frustum, ...]
    cuts: tuple[Frustum | Bore | Hexagon, ...]
    centre: FloatArray
    radius_mm: float
    ring_mm: float
    band_mm: float
    right_mm: float

    @property
    def dimensions(self) -> tuple[Length | Hole, ...]:
        """The gauges for the lens ring, and the screw's hole."""
        return holes(self.cuts)


def plan_coupon(layout: Layout, hardware: Hardware) -> CouponPlan:
    """Lay out the coupon; of the layout only the thickness of the thickest mirror counts."""
    at, screw, dimensions = RIG_FROM_COUPON_MM, hardware.screw, hardware.holder
    fit, rim = hardware.fit.free_mm, dimensions.rim_mm
    thickness = max(mirror.thickness_mm for mirror in layout.mirrors)
    ring, radius = hardware.camera.lens_ring_mm, hardware.wrist.diameter_mm / 2.0
    pitch = ring + 2.0 * GAUGE_WALL_MM
    seat_x, seat_y = (side + 2.0 * (fit + rim) for side in MIRROR_MM)
    held = stack(hardware.mount.skin_mm, hardware)
    wall = held.wall_mm
    block = screw.nut_flats_mm + 2.0 * screw.insert_wall_mm + 1.0
    depth = seat_y + pitch
    half_chord = min(0.42 * depth, 0.5 * radius)
    sagitta = radius - np.sqrt(radius**2 - half_chord**2)
    right = max(len(LENS_STEPS_MM) * pitch, seat_x + block + 4.0) + sagitta + hardware.wrist.ring_mm
    pieces: list[Frustum] = []
    cuts: list[Frustum | Bore | Hexagon] = []

    def solid(low: tuple[float, float, float], high: tuple[float, float, float]) -> Frustum:
        return box(tuple(at + low), tuple(at + high))

    pieces.append(solid((0.0, 0.0, 0.0), (right, depth, PLATE_MM)))
    # The seat: rims all round as high over it as the holder's, grooves for the glue as the holder has.
    high = PLATE_MM + dimensions.rim_height_of_sheet * thickness
    for low_x, low_y, high_x, high_y in (
        (0.0, 0.0, seat_x, rim),
        (0.0, seat_y - rim, seat_x, seat_y),
        (0.0, 0.0, rim, seat_y),
        (seat_x - rim, 0.0, seat_x, seat_y),
    ):
        pieces.append(solid((low_x, low_y, 0.0), (high_x, high_y, high)))
    for side in (-0.5, 0.5):
        middle = seat_x / 2.0 + side * dimensions.groove_pitch_mm
        from_x, to_x = middle - dimensions.groove_mm / 2.0, middle + dimensions.groove_mm / 2.0
        cuts.append(solid((from_x, -1.0, PLATE_MM - dimensions.groove_depth_mm), (to_x, seat_y, high + 1.0)))
    # A block with a screw's hole, lying as the holes in the parts do.
    block_x = seat_x + 2.0
    pieces.append(solid((block_x, 0.0, 0.0), (block_x + block, wall, PLATE_MM + block + screw.insert_wall_mm)))
    mouth = at + np.array([block_x + block / 2.0, 0.0, PLATE_MM + block / 2.0])
    cuts += thread(mouth, np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]), held, wall, screw)
    for index, step in enumerate(LENS_STEPS_MM):
        x = pitch * (index + 0.5)
        middle = at + np.array([x, seat_y + pitch / 2.0, PLATE_MM + 0.5])
        cuts.append(Bore(middle, np.array([0.0, 0.0, -1.0]), (ring + step) / 2.0, PLATE_MM + 1.0))
        # One, two, three notches in the edge say which hole it is.
        for count in range(index + 1):
            notch = x + 3.0 * (count - index / 2.0)
            cuts.append(solid((notch - 0.6, depth - 1.0, -1.0), (notch + 0.6, depth + 1.0, PLATE_MM + 1.0)))
    return CouponPlan(
        pieces=tuple(pieces),
        cuts=tuple(cuts),
        centre=at + np.array([right + np.sqrt(radius**2 - half_chord**2), depth / 2.0, 0.0]),
        radius_mm=radius,
        ring_mm=hardware.wrist.ring_mm,
        band_mm=hardware.wrist.band_mm,
        right_mm=float(at[0] + right),
    )
