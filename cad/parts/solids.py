"""The printed parts beside the mirror holder as B-rep solids, made of the numbers of their plans."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from build123d import (
    BuildLine,
    BuildPart,
    BuildSketch,
    Circle,
    Cylinder,
    Line,
    Locations,
    Mode,
    Part,
    Plane,
    PolarLocations,
    Polygon,
    Polyline,
    Rectangle,
    Solid,
    ThreePointArc,
    extrude,
    insert,
    make_face,
)

from cad.holder.solid import solid_of
from cad.parts.adapter import RingPlan
from cad.parts.clip import ClipPlan
from cad.parts.coupon import CouponPlan
from cad.parts.fasteners import Bore, Hexagon
from cad.parts.mount import MountPlan
from cad.seats import Frustum
from optics.values import InputError

Cut = Frustum | Bore | Hexagon


def bore_solid(bore: Bore) -> Solid:
    """What a bore takes away: a cylinder, or a slot, with a roof that prints without support."""
    up = bore.up if bore.up is not None else np.roll(bore.axis, 1)
    along = np.cross(bore.axis, up)
    plane = Plane(origin=tuple(bore.mouth), x_dir=tuple(along), z_dir=tuple(bore.axis))
    r, half = bore.radius_mm, bore.travel_mm / 2.0
    with BuildPart() as tool:
        if bore.up is None and not half:
            with Locations(plane * Plane((0.0, 0.0, bore.depth_mm / 2.0)).location):
                Cylinder(r, bore.depth_mm)
        else:
            with BuildSketch(plane):
                with BuildLine():
                    _outline(r, half, bore.roof_mm)
                make_face()
            extrude(amount=bore.depth_mm)
    return tool.solids()[0]


def _outline(r: float, half: float, roof: float) -> None:
    """Two round ends (one circle, if half is 0) under a roof of 45 deg; y is up."""
    side = r / np.sqrt(2.0)
    ridge = half + r * np.sqrt(2.0) - roof
    right = ThreePointArc((half, -r), (half + r * np.cos(np.pi / 8), -r * np.sin(np.pi / 8)), (half + side, side))
    left = ThreePointArc((-half - side, side), (-half - r * np.cos(np.pi / 8), -r * np.sin(np.pi / 8)), (-half, -r))
    Polyline(right @ 1, (ridge, roof), (-ridge, roof), left @ 0)
    if half:
        Line(left @ 1, right @ 0)


def hexagon_solid(pocket: Hexagon) -> Solid:
    """What a nut's pocket takes away."""
    side = np.cross(pocket.axis, pocket.up)
    angles = np.pi / 3.0 * np.arange(6)
    radius = pocket.flats_mm / np.sqrt(3.0)
    base = pocket.mouth + radius * (np.outer(np.cos(angles), pocket.up) + np.outer(np.sin(angles), side))
    return solid_of(Frustum(base, base + pocket.depth_mm * pocket.axis))


def cut_solid(cut: Cut) -> Solid:
    """What any cut takes away."""
    if isinstance(cut, Bore):
        return bore_solid(cut)
    return hexagon_solid(cut) if isinstance(cut, Hexagon) else solid_of(cut)


def one_solid(name: str, built: BuildPart) -> Part:
    """The part, if it is one solid; raises InputError otherwise."""
    pieces = built.solids()
    if len(pieces) != 1:
        raise InputError(f"{name} falls apart into {len(pieces)} pieces, expected one")
    return Part(pieces, label=name)


def _built(name: str, pieces: Iterable[Frustum], cuts: Iterable[Cut]) -> Part:
    with BuildPart() as part:
        insert([solid_of(piece) for piece in pieces])
        insert([cut_solid(cut) for cut in cuts], mode=Mode.SUBTRACT)
    return one_solid(name, part)


def make_ring(plan: RingPlan) -> Part:
    """Half of the wrist's clamp."""
    side = 1.0 if plan.above else -1.0
    # Seen along +y, with x to the left and z up.
    plane = Plane(origin=(0.0, plan.band_mm[0], plan.axis_z_mm), x_dir=(-1.0, 0.0, 0.0), z_dir=(0.0, 1.0, 0.0))
    outer, reach = plan.radius_mm + plan.ring_mm, 2.0 * (plan.radius_mm + plan.ring_mm)
    with BuildPart() as part:
        with BuildSketch(plane):
            Circle(outer)
            with Locations((0.0, -side * (reach - plan.gap_mm) / 2.0)):
                Rectangle(2.0 * reach, reach, mode=Mode.SUBTRACT)
        extrude(amount=plan.band_mm[1] - plan.band_mm[0])
        insert([solid_of(piece) for piece in plan.pieces])
        with BuildSketch(plane.offset(-reach)):
            Circle(plan.radius_mm)
        extrude(amount=2.0 * reach, mode=Mode.SUBTRACT)
        insert([cut_solid(cut) for cut in plan.cuts], mode=Mode.SUBTRACT)
    return one_solid(plan.name, part)


def make_coupon(plan: CouponPlan) -> Part:
    """The fit coupon."""
    with BuildPart() as part:
        insert([solid_of(piece) for piece in plan.pieces])
        with BuildSketch(Plane.XY.offset(plan.segment[2])), Locations(tuple(plan.segment[:2])):
            Circle(plan.radius_mm + plan.ring_mm)
            Circle(plan.radius_mm, mode=Mode.SUBTRACT)
            with PolarLocations(0.0, 1, start_angle=-90.0):
                size = 2.0 * plan.radius_mm
                half = np.deg2rad(plan.segment_deg / 2.0)
                Polygon(
                    (0, 0),
                    (size, -size * np.tan(half)),
                    (size, size * np.tan(half)),
                    align=None,
                    mode=Mode.INTERSECT,
                )
        extrude(amount=plan.band_mm)
        insert([cut_solid(cut) for cut in plan.cuts], mode=Mode.SUBTRACT)
    return one_solid("fit_coupon", part)


def make_clip(plan: ClipPlan) -> Part:
    """The camera clip: its pieces joined, its holes cut."""
    return _built("camera_clip", plan.pieces, plan.cuts)


def make_mount(plan: MountPlan) -> Part:
    """The mount: skins, webs and foot joined; windows, holes and what light comes near cut."""
    return _built("mount", plan.pieces, (*plan.cuts, *plan.light))
