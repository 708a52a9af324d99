"""The fit coupon: one small print that tells, before the rest, whether mirrors, inserts, wrist and lens fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cad.hardware import Hardware
from cad.parts.fasteners import Bore, Hexagon, stack, thread
from cad.parts.prisms import box
from cad.seats import Frustum
from optics.layout import Layout
from optics.values import FloatArray

MIRROR_MM = (20.0, 15.0)
"""The test mirror, cut from the layout's sheet."""

PLATE_MM = 2.4
LENS_STEPS_MM = (-0.3, 0.0, 0.3)
SEGMENT_DEG = 60.0
RIG_FROM_COUPON_MM = np.array([130.0, 0.0, -100.0])
"""It stands beside the device."""


@dataclass(frozen=True)
class CouponPlan:
    """A coupon in rig, mm: pieces and cuts, and a segment of the clamp's ring about a point `segment` (3,), along z."""

    pieces: tuple[Frustum, ...]
    cuts: tuple[Frustum | Bore | Hexagon, ...]
    segment: FloatArray
    radius_mm: float
    ring_mm: float
    band_mm: float
    segment_deg: float


def plan_coupon(layout: Layout, hardware: Hardware) -> CouponPlan:
    """Lay out the coupon; of the layout only the thickest sheet counts."""
    at = RIG_FROM_COUPON_MM
    fit, screw = hardware.fit.free_mm, hardware.screw
    ring = hardware.camera.lens_ring_mm
    rim = hardware.holder.rim_mm
    thickness = max(mirror.thickness_mm for mirror in layout.mirrors)
    pitch = ring + 4.0
    width = max(len(LENS_STEPS_MM) * pitch + 2.0, MIRROR_MM[0] + 40.0)
    pieces: list[Frustum] = []
    cuts: list[Frustum | Bore | Hexagon] = []

    def solid(low: tuple[float, float, float], high: tuple[float, float, float]) -> Frustum:
        return box(tuple(at + low), tuple(at + high))

    seat_depth = MIRROR_MM[1] + 2.0 * (fit + rim)
    gauge_y = seat_depth + pitch / 2.0
    pieces.append(solid((0.0, 0.0, 0.0), (width, seat_depth + pitch, PLATE_MM)))
    # The seat: a rim all round, as high over the sheet as the holder's.
    high = PLATE_MM + hardware.holder.rim_height_of_sheet * thickness
    seat_width = MIRROR_MM[0] + 2.0 * (fit + rim)
    for low_x, low_y, high_x, high_y in (
        (0.0, 0.0, seat_width, rim),
        (0.0, seat_depth - rim, seat_width, seat_depth),
        (0.0, 0.0, rim, seat_depth),
        (seat_width - rim, 0.0, seat_width, seat_depth),
    ):
        pieces.append(solid((low_x, low_y, 0.0), (high_x, high_y, high)))
    # A block with a screw's hole, lying as the holes in the parts do.
    wall = stack(hardware.mount.skin_mm, hardware).wall_mm
    size = screw.nut_flats_mm + 2.0 * screw.insert_wall_mm + 1.0
    block_x = seat_width + 4.0
    pieces.append(solid((block_x, 0.0, 0.0), (block_x + size, wall, PLATE_MM + size)))
    mouth = at + np.array([block_x + size / 2.0, 0.0, PLATE_MM + size / 2.0])
    cuts += thread(mouth, np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]), wall, screw)
    for index, step in enumerate(LENS_STEPS_MM):
        middle = at + np.array([1.0 + pitch * (index + 0.5), gauge_y, PLATE_MM + 0.5])
        cuts.append(Bore(middle, np.array([0.0, 0.0, -1.0]), (ring + step) / 2.0, PLATE_MM + 1.0))
        # One, two, three notches in the edge say which hole it is.
        for count in range(index + 1):
            x = 1.0 + pitch * (index + 0.5) + 3.0 * (count - index / 2.0)
            cuts.append(
                solid((x - 0.6, seat_depth + pitch - 1.0, -1.0), (x + 0.6, seat_depth + pitch + 1.0, PLATE_MM + 1.0))
            )
    radius = hardware.wrist.diameter_mm / 2.0
    middle_x = width - radius * np.sin(np.deg2rad(SEGMENT_DEG / 2.0)) - hardware.wrist.ring_mm
    segment = at + np.array([min(middle_x, width / 2.0), seat_depth + pitch + radius - 0.1 * radius, 0.0])
    return CouponPlan(
        pieces=tuple(pieces),
        cuts=tuple(cuts),
        segment=segment,
        radius_mm=radius,
        ring_mm=hardware.wrist.ring_mm,
        band_mm=hardware.wrist.band_mm,
        segment_deg=SEGMENT_DEG,
    )
