"""The fit coupon: one small print to test, before the rest, whether mirrors, inserts, wrist and lens fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.plan.back_table import RingGauge
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
    """A coupon in rig, mm: pieces and cuts; of a back that clamps, a segment of its ring, open to +x.

    The segment of `ring` is about `centre` (3,) along z. `right_mm` is the plate's edge, where it ends; what is clamped
    touches nothing else.
    """

    pieces: tuple[Frustum, ...]
    cuts: tuple[Frustum | Bore | Hexagon, ...]
    centre: FloatArray
    ring: RingGauge | None
    right_mm: float

    @property
    def dimensions(self) -> tuple[Length | Hole, ...]:
        """The gauges for the lens ring, and the screw's hole."""
        return holes(self.cuts)


def plan_coupon(layout: Layout, hardware: Hardware) -> CouponPlan:
    """Lay out the coupon; of the layout only the thickness of the thickest mirror counts."""
    at, ring = RIG_FROM_COUPON_MM, hardware.back.ring_gauge
    seat_x, seat_y = _seat_mm(hardware)
    pitch = hardware.camera.lens_ring_mm + 2.0 * GAUGE_WALL_MM
    depth = seat_y + pitch
    right = max(len(LENS_STEPS_MM) * pitch, seat_x + _block_mm(hardware) + 4.0)
    centre = right
    if ring:
        half_chord = min(0.42 * depth, 0.5 * ring.radius_mm)
        to_chord = np.sqrt(ring.radius_mm**2 - half_chord**2)
        right += ring.radius_mm - to_chord + ring.ring_mm
        centre = right + to_chord
    rims, grooves = _seat(layout, hardware)
    block, hole = _screw_block(seat_x + 2.0, hardware)
    return CouponPlan(
        pieces=(_box((0.0, 0.0, 0.0), (right, depth, PLATE_MM)), *rims, block),
        cuts=(*grooves, *hole, *_lens_gauges(seat_y, pitch, hardware)),
        centre=at + np.array([centre, depth / 2.0, 0.0]),
        ring=ring,
        right_mm=float(at[0] + right),
    )


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Frustum:
    """The box between two corners, from the coupon's own corner on."""
    return box(tuple(RIG_FROM_COUPON_MM + low), tuple(RIG_FROM_COUPON_MM + high))


def _seat_mm(hardware: Hardware) -> tuple[float, float]:
    """Width and depth of the seat of the test mirror, with its rims."""
    x, y = (side + 2.0 * (hardware.fit.free_mm + hardware.holder.rim_mm) for side in MIRROR_MM)
    return x, y


def _block_mm(hardware: Hardware) -> float:
    """Width of the block with a screw's hole."""
    return hardware.screw.nut_flats_mm + 2.0 * hardware.screw.insert_wall_mm + 1.0


def _seat(layout: Layout, hardware: Hardware) -> tuple[list[Frustum], list[Frustum]]:
    """The seat: rims all round as high over it as the holder's, and grooves for the glue as the holder has."""
    dimensions, (seat_x, seat_y) = hardware.holder, _seat_mm(hardware)
    rim, thickness = dimensions.rim_mm, max(mirror.thickness_mm for mirror in layout.mirrors)
    high = PLATE_MM + dimensions.rim_height_of_sheet * thickness
    rims = [
        _box((0.0, 0.0, 0.0), (seat_x, rim, high)),
        _box((0.0, seat_y - rim, 0.0), (seat_x, seat_y, high)),
        _box((0.0, 0.0, 0.0), (rim, seat_y, high)),
        _box((seat_x - rim, 0.0, 0.0), (seat_x, seat_y, high)),
    ]
    grooves = []
    for side in (-0.5, 0.5):
        middle = seat_x / 2.0 + side * dimensions.groove_pitch_mm
        from_x, to_x = middle - dimensions.groove_mm / 2.0, middle + dimensions.groove_mm / 2.0
        grooves.append(_box((from_x, -1.0, PLATE_MM - dimensions.groove_depth_mm), (to_x, seat_y, high + 1.0)))
    return rims, grooves


def _screw_block(x_mm: float, hardware: Hardware) -> tuple[Frustum, tuple[Bore | Hexagon, ...]]:
    """A block with a screw's hole, lying as the holes in the parts do."""
    screw, width = hardware.screw, _block_mm(hardware)
    held = stack(hardware.mount.skin_mm, hardware)
    solid = _box((x_mm, 0.0, 0.0), (x_mm + width, held.wall_mm, PLATE_MM + width + screw.insert_wall_mm))
    mouth = RIG_FROM_COUPON_MM + np.array([x_mm + width / 2.0, 0.0, PLATE_MM + width / 2.0])
    return solid, thread(mouth, np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]), held, held.wall_mm, screw)


def _lens_gauges(from_y_mm: float, pitch_mm: float, hardware: Hardware) -> list[Frustum | Bore | Hexagon]:
    """Holes to try on the lens ring; one, two, three notches in the edge say which is which."""
    cuts: list[Frustum | Bore | Hexagon] = []
    end = from_y_mm + pitch_mm
    for index, step in enumerate(LENS_STEPS_MM):
        x = pitch_mm * (index + 0.5)
        middle = RIG_FROM_COUPON_MM + np.array([x, from_y_mm + pitch_mm / 2.0, PLATE_MM + 0.5])
        radius = (hardware.camera.lens_ring_mm + step) / 2.0
        cuts.append(Bore(middle, np.array([0.0, 0.0, -1.0]), radius, PLATE_MM + 1.0))
        for count in range(index + 1):
            notch = x + 3.0 * (count - index / 2.0)
            cuts.append(_box((notch - 0.6, end - 1.0, -1.0), (notch + 0.6, end + 1.0, PLATE_MM + 1.0)))
    return cuts
