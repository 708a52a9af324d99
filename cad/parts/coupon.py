"""The fit coupon: a small test print, made before the other parts, for the fit of mirrors, inserts, wrist and lens."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mirrorcam.cad.holder.pads import pad_shapes
from mirrorcam.cad.parts.truss import foot_stack
from mirrorcam.cad.plan.back_table import RingGauge
from mirrorcam.cad.plan.dimension import Datum, Hole, Length, holes, length
from mirrorcam.cad.plan.fasteners import Bore, Hexagon, thread
from mirrorcam.cad.plan.hardware import PRINT_SETTINGS, Hardware
from mirrorcam.cad.plan.prisms import box
from mirrorcam.cad.plan.rectangles import coupon_mirror_mm, is_sold_in_size
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera_body import BoardHoles
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror_gaps import smallest_gap_mm

PLATE_MM = 2.4
STRIP_MM = (22.0, 8.0)
"""Length and width of the strip that gauges the gap of carriers, or between mirrors."""

GAUGE_WALL_MM = 3.0
LENS_STEPS_MM = (-0.3, 0.0, 0.3)
THREAD_STEPS_MM = (-0.1, 0.0, 0.1)
"""Differences of a gauge's holes from the parts' holes, in the order of one, two and three notches."""

GO_MM, GO_DEPTH_MM = 0.3, 4.0
"""Allowance of the go slot (wider than the camera's body) and of the no-go slot (narrower), and the depth of each."""
RIG_FROM_COUPON_MM = np.array([130.0, 0.0, -100.0])
"""Origin of the coupon in the rig frame, next to the device."""


@dataclass(frozen=True)
class CouponPlan:
    """A coupon in the rig frame, mm: pieces, cuts and, for an adapter that clamps, a segment of its ring, open to +x.

    The segment of `ring` is about `centre` (3,) along z and ends at the plate's edge, x = `right_mm`, so that the
    clamped shell touches nothing else.
    """

    pieces: tuple[Frustum, ...]
    cuts: tuple[Frustum | Bore | Hexagon, ...]
    centre: FloatArray
    ring: RingGauge | None
    right_mm: float
    lengths: tuple[Length, ...]

    @property
    def dimensions(self) -> tuple[Length | Hole, ...]:
        """The sizes of the gauges; the outer upright screw holes are dimensioned from the middle one."""
        upright = [cut for cut in self.cuts if isinstance(cut, Bore | Hexagon) and cut.axis[2] > 0.5]
        centre = np.mean([cut.mouth for cut in upright], axis=0)
        datum = Datum(centre, "middle hole")
        screw_holes = (
            replace(hole, datum=datum) if np.linalg.norm(hole.centre_in_rig[:2] - centre[:2]) > 1.0 else hole
            for hole in holes(upright)
        )
        others = [cut for cut in self.cuts if not any(cut is other for other in upright)]
        return (*self.lengths, *holes(others), *screw_holes)


@dataclass(frozen=True)
class Gauge:
    """A gauge of the coupon: its name, the criterion of a fit, and the parameter that corrects it."""

    name: str
    fits: str
    parameter: str


def gauges_of(layout: Layout, hardware: Hardware) -> tuple[Gauge, ...]:
    """The gauges of a device's coupon, for the assembly guide."""
    screw, camera, fit = hardware.screw, hardware.camera, hardware.fit
    smaller, _, larger = (f"{step:+g}" for step in THREAD_STEPS_MM)
    insert = screw.kind == "insert"
    width, height = coupon_mirror_mm(layout)
    source = "a spare one of the pack" if is_sold_in_size(layout) else "`mirror_test` of the cutting file"
    gauges = [
        Gauge(
            "seat of a mirror",
            f"a mirror of {width:g} x {height:g} mm, {source}, drops in with a gap of {fit.free_mm:g} mm all round and "
            "rests on the three pads without rocking",
            "`free_mm` under `[fit]`",
        ),
        Gauge(
            "three screw holes in a side of the block, and three in the underside of the plate (one to three notches)",
            "an insert sinks straight into the one with two notches and sits flush; with one notch the hole is "
            f"{smaller} mm, with three {larger} mm; if the two kinds differ, set the larger hole"
            if insert
            else "a nut slides into the one with two notches and does not turn; with one notch the pocket is "
            f"{smaller} mm, with three {larger} mm",
            f"`insert_hole_mm` under `[screw]` (now {screw.insert_hole_mm:g})"
            if insert
            else f"`nut_flats_mm` under `[screw]` (now {screw.nut_flats_mm:g})",
        ),
        Gauge(
            "three holes for the lens (one to three notches)",
            f"the lens ring goes into the one with two notches, Ø{camera.lens_ring_mm:g} mm, and not into the one with "
            f"one; they differ by {LENS_STEPS_MM[2]:g} mm",
            f"`lens_ring_mm` in the camera's file (now {camera.lens_ring_mm:g})",
        ),
    ]
    if _slot_y_mm(hardware):
        gauges.append(
            Gauge(
                "slot with a step",
                f"the camera's body, over its height, enters the first {GO_DEPTH_MM:g} mm and stops at the step",
                f"`height_mm` in the camera's file (now {camera.height_mm:g})",
            )
        )
    if hardware.back.ring_gauge is not None:
        gauges.append(
            Gauge(
                "segment of the clamp",
                "it sits on the wrist without rocking and without a gap in its middle",
                "`diameter_mm` under `[back]`",
            )
        )
    return tuple(gauges)


def spacer_mm(layout: Layout, hardware: Hardware) -> float:
    """Thickness of a strip for the gaps between mirrors: the smallest gap in whole layers; 0 if none prints.

    Neighbours lack rims on the sides where they face each other.
    """
    if len(layout.mirrors) < 2 or hardware.holder.mirrors == "screws":
        return 0.0
    layer = PRINT_SETTINGS.layer_mm
    spacer = round(np.floor(smallest_gap_mm(layout.mirrors) / layer + 1e-6) * layer, 3)
    return spacer if spacer >= hardware.printer.floor_mm else 0.0


def plan_coupon(layout: Layout, hardware: Hardware, gap_mm: float = 0.0) -> CouponPlan:
    """Lay out the coupon, which depends on the layout only through mirrors' thickness and gaps and the test mirror.

    A strip of the thickness `gap_mm`, if any, extends from it: the gap between carriers and holder, or `spacer_mm`.
    """
    origin, ring = RIG_FROM_COUPON_MM, hardware.back.ring_gauge
    seat_x, seat_y = _seat_mm(layout, hardware)
    pitch = hardware.camera.lens_ring_mm + 2.0 * GAUGE_WALL_MM
    slot_y = _slot_y_mm(hardware)
    from_y = max(seat_y, _upright_y_mm(hardware)[1])
    depth = from_y + pitch + slot_y
    # Below the middle hole for the lens where there is space, so that both have one dimension in the drawing.
    block_x = max(seat_x + 1.0, (len(LENS_STEPS_MM) * pitch - _block_mm(hardware)) / 2.0)
    blocks, screw_holes = _screw_blocks(block_x, hardware)
    right = max(
        len(LENS_STEPS_MM) * pitch, block_x + _block_mm(hardware) + 2.0, _slot_x_mm(hardware) if slot_y else 0.0
    )
    centre = right
    if ring:
        half_chord = min(0.42 * depth, 0.5 * ring.radius_mm)
        to_chord = np.sqrt(ring.radius_mm**2 - half_chord**2)
        right += ring.radius_mm - to_chord + ring.ring_mm
        centre = right + to_chord
    rims, grooves = _seat(layout, hardware)
    return CouponPlan(
        pieces=(
            _box((0.0, 0.0, 0.0), (right, depth, PLATE_MM)),
            *rims,
            *blocks,
            *_pads(layout, hardware),
            *([_strip(right, gap_mm, hardware)] if gap_mm else []),
        ),
        cuts=(*grooves, *screw_holes, *_lens_gauges(from_y, pitch, hardware), *_slot(right, depth, hardware)),
        centre=origin + np.array([centre, depth / 2.0, 0.0]),
        ring=ring,
        right_mm=float(origin[0] + right),
        lengths=(*_seat_lengths(right, gap_mm, layout, hardware), *_slot_lengths(right, depth, hardware)),
    )


def _length(start: tuple[float, float, float], end: tuple[float, float, float], text: str = "") -> Length:
    """The distance between two points in the coupon's frame."""
    return length(RIG_FROM_COUPON_MM + start, RIG_FROM_COUPON_MM + end, text)


def _strip_end_mm(right_mm: float, hardware: Hardware) -> tuple[float, float]:
    """The outer corner of the strip: left of the plate or, where that would be wider than the bed, in front of it."""
    return (-STRIP_MM[0], 0.0) if right_mm + STRIP_MM[0] <= hardware.printer.bed_mm[0] else (0.0, -STRIP_MM[0])


def _strip(right_mm: float, gap_mm: float, hardware: Hardware) -> Frustum:
    x, y = _strip_end_mm(right_mm, hardware)
    return _box((x, y, 0.0), (1.0, STRIP_MM[1], gap_mm) if x else (STRIP_MM[1], 1.0, gap_mm))


def _seat_lengths(right_mm: float, gap_mm: float, layout: Layout, hardware: Hardware) -> Iterator[Length]:
    """The thickness of plate and strip, and the seat's size within its rims."""
    rim, (x, y) = hardware.holder.rim_mm, _seat_mm(layout, hardware)
    yield _length((right_mm, 0.0, 0.0), (right_mm, 0.0, PLATE_MM), "plate")
    if gap_mm:
        end = _strip_end_mm(right_mm, hardware)
        yield _length((*end, 0.0), (*end, gap_mm), "strip")
    yield _length((rim, rim, PLATE_MM), (x - rim, rim, PLATE_MM), "seat")
    yield _length((rim, rim, PLATE_MM), (rim, y - rim, PLATE_MM), "seat")


def _slot_lengths(right_mm: float, depth_mm: float, hardware: Hardware) -> Iterator[Length]:
    """Width and depth of the go and no-go slots for a camera's body."""
    if not _slot_y_mm(hardware):
        return
    centre_x, height = right_mm / 2.0, hardware.camera.height_mm
    for text, size, slot_depth in (("go", height + GO_MM, GO_DEPTH_MM), ("no-go", height - GO_MM, 2.0 * GO_DEPTH_MM)):
        left, end = centre_x - size / 2.0, depth_mm - slot_depth
        yield _length((left, end, PLATE_MM), (left + size, end, PLATE_MM), text)
        yield _length((left, end, PLATE_MM), (left, depth_mm, PLATE_MM), text)


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Frustum:
    """The box between two opposite corners in the coupon's frame."""
    return box(tuple(RIG_FROM_COUPON_MM + low), tuple(RIG_FROM_COUPON_MM + high))


def _seat_mm(layout: Layout, hardware: Hardware) -> tuple[float, float]:
    """Width and depth of the test mirror's seat, including its rims."""
    x, y = (side + 2.0 * (hardware.fit.free_mm + hardware.holder.rim_mm) for side in coupon_mirror_mm(layout))
    return x, y


def _thread_pitch_mm(hardware: Hardware) -> float:
    """Pitch of the block's screw holes."""
    return hardware.screw.nut_flats_mm + hardware.screw.insert_wall_mm + 1.0


def _block_mm(hardware: Hardware) -> float:
    """Width of the block with screw holes."""
    return len(THREAD_STEPS_MM) * _thread_pitch_mm(hardware) + hardware.screw.insert_wall_mm


def _slot_x_mm(hardware: Hardware) -> float:
    return hardware.camera.height_mm + GO_MM + 2.0 * GAUGE_WALL_MM


def _slot_y_mm(hardware: Hardware) -> float:
    """Extent of the plate along y for the slot of a camera's body; 0 for a bare board, which is held by its holes."""
    return 0.0 if isinstance(hardware.camera.held_by, BoardHoles) else 2.0 * GO_DEPTH_MM + 2.0


def _seat(layout: Layout, hardware: Hardware) -> tuple[list[Frustum], list[Frustum]]:
    """The rims of the seat and its grooves for glue, if any, with the holder's dimensions."""
    dimensions, (seat_x, seat_y) = hardware.holder, _seat_mm(layout, hardware)
    rim, thickness = dimensions.rim_mm, max(mirror.thickness_mm for mirror in layout.mirrors)
    rim_top = PLATE_MM + dimensions.bond_mm + dimensions.on_pads_mm + dimensions.rim_height_of_sheet * thickness
    rims = [
        _box((0.0, 0.0, 0.0), (seat_x, rim, rim_top)),
        _box((0.0, seat_y - rim, 0.0), (seat_x, seat_y, rim_top)),
        _box((0.0, 0.0, 0.0), (rim, seat_y, rim_top)),
        _box((seat_x - rim, 0.0, 0.0), (seat_x, seat_y, rim_top)),
    ]
    grooves = []
    for side in () if dimensions.mirrors == "tape" else (-0.5, 0.5):
        centre_x = seat_x / 2.0 + side * dimensions.groove_pitch_mm
        from_x, to_x = centre_x - dimensions.groove_mm / 2.0, centre_x + dimensions.groove_mm / 2.0
        grooves.append(_box((from_x, -1.0, PLATE_MM - dimensions.groove_depth_mm), (to_x, seat_y, rim_top + 1.0)))
    return rims, grooves


def _pads(layout: Layout, hardware: Hardware) -> list[Frustum]:
    """Three pads in the seat, clear of the grooves."""
    margin = hardware.holder.rim_mm + 2.0 * hardware.fit.free_mm + hardware.holder.pad_mm / 2.0
    seat_x, seat_y = _seat_mm(layout, hardware)
    centres = np.array([(margin, margin), (seat_x - margin, margin), (seat_x / 2.0, seat_y - margin)])
    pads = []
    for shape in pad_shapes(centres, hardware):
        base = RIG_FROM_COUPON_MM + np.column_stack([shape, np.full(len(shape), PLATE_MM - 0.5)])
        pads.append(Frustum(base, base + np.array([0.0, 0.0, 0.5 + hardware.holder.bond_mm])))
    return pads


def _upright_y_mm(hardware: Hardware) -> tuple[float, float]:
    """Start and end along y of the block with upright screw holes, behind the one with horizontal holes."""
    start = foot_stack(hardware).wall_mm + 1.0
    return start, start + _thread_pitch_mm(hardware) + hardware.screw.insert_wall_mm


def _screw_blocks(x_mm: float, hardware: Hardware) -> tuple[list[Frustum], list[Frustum | Bore | Hexagon]]:
    """Two blocks with holes for inserts or nuts, as the parts are printed, and notches in their upper edges.

    The holes of the first are horizontal, as in the mount; those of the second upright and open on the bed, as in the
    backs of the holder and of the clip.
    """
    screw, pitch, width = hardware.screw, _thread_pitch_mm(hardware), _block_mm(hardware)
    threads = foot_stack(hardware)
    top = PLATE_MM + pitch + 2.0 * screw.insert_wall_mm
    (from_y, to_y), height = _upright_y_mm(hardware), threads.wall_mm
    blocks = [
        _box((x_mm, 0.0, 0.0), (x_mm + width, threads.wall_mm, top)),
        _box((x_mm, from_y, 0.0), (x_mm + width, to_y, height)),
    ]
    scene, up = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    cuts: list[Frustum | Bore | Hexagon] = []
    for index, step in enumerate(THREAD_STEPS_MM):
        varied = screw.replaced(insert_hole_mm=screw.insert_hole_mm + step, nut_flats_mm=screw.nut_flats_mm + step)
        x = x_mm + screw.insert_wall_mm / 2.0 + pitch * (index + 0.5)
        mouth = RIG_FROM_COUPON_MM + np.array([x, 0.0, PLATE_MM + pitch / 2.0])
        cuts += thread(mouth, scene, up, threads, threads.wall_mm, varied)
        cuts += _notches(index + 1, x, (-1.0, threads.wall_mm + 1.0), (top - 1.0, top + 1.0))
        on_bed = RIG_FROM_COUPON_MM + np.array([x, (from_y + to_y) / 2.0, 0.0])
        cuts += thread(on_bed, up, None, threads, height, varied)
        cuts += _notches(index + 1, x, (to_y - 1.0, to_y + 1.0), (height - 1.0, height + 1.0))
    return blocks, cuts


def _notches(count: int, x_mm: float, y_mm: tuple[float, float], z_mm: tuple[float, float]) -> list[Frustum]:
    """A row of notches centred on an x coordinate."""
    centres = [x_mm + 2.4 * (number - (count - 1) / 2.0) for number in range(count)]
    (y0, y1), (z0, z1) = y_mm, z_mm
    return [_box((centre - 0.5, y0, z0), (centre + 0.5, y1, z1)) for centre in centres]


def _slot(right_mm: float, depth_mm: float, hardware: Hardware) -> list[Frustum]:
    """A go and no-go gauge for the height of a camera's body, open at the far edge; none for a bare board."""
    if not _slot_y_mm(hardware):
        return []
    centre_x, height = right_mm / 2.0, hardware.camera.height_mm
    return [
        _box(
            (centre_x - half, depth_mm - depth, -1.0),
            (centre_x + half, depth_mm + 1.0, PLATE_MM + 1.0),
        )
        for half, depth in ((height / 2.0 + GO_MM / 2.0, GO_DEPTH_MM), (height / 2.0 - GO_MM / 2.0, 2.0 * GO_DEPTH_MM))
    ]


def _lens_gauges(from_y_mm: float, pitch_mm: float, hardware: Hardware) -> list[Frustum | Bore | Hexagon]:
    """Holes to try on the lens ring, marked by one, two and three notches in the edge."""
    cuts: list[Frustum | Bore | Hexagon] = []
    end = from_y_mm + pitch_mm
    for index, step in enumerate(LENS_STEPS_MM):
        x = pitch_mm * (index + 0.5)
        mouth = RIG_FROM_COUPON_MM + np.array([x, from_y_mm + pitch_mm / 2.0, PLATE_MM + 0.5])
        radius = (hardware.camera.lens_ring_mm + step) / 2.0
        cuts.append(Bore(mouth, np.array([0.0, 0.0, -1.0]), radius, PLATE_MM + 1.0))
        cuts += _notches(index + 1, x, (end - 1.0, end + 0.2), (-1.0, PLATE_MM + 1.0))
    return cuts
