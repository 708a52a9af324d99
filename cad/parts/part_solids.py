"""B-rep solids of the printed parts other than the mirror holder, made from their plans."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from build123d import (
    Align,
    BuildLine,
    BuildPart,
    BuildSketch,
    Cylinder,
    Line,
    Locations,
    Mode,
    Part,
    Plane,
    Polyline,
    Rectangle,
    Solid,
    ThreePointArc,
    extrude,
    insert,
    make_face,
)

from mirrorcam.cad.holder.carriers import CarrierPlan
from mirrorcam.cad.holder.holder_solid import solid_of
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.coupon import CouponPlan
from mirrorcam.cad.parts.dust_cover import CoverPlan
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.device_names import CLIP, COUPON, COVER, MOUNT, carrier_name
from mirrorcam.cad.plan.fasteners import Bore, Countersink, Hexagon
from mirrorcam.cad.plan.part_plan import recipe
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray

Cut = Frustum | Bore | Countersink | Hexagon


def bore_solid(bore: Bore) -> Solid:
    """The solid that a bore removes: a cylinder or a slot, with a roof that prints without support."""
    up = bore.up if bore.up is not None else np.roll(bore.axis, 1)
    x_axis = np.cross(up, bore.axis)
    plane = Plane(origin=tuple(bore.mouth), x_dir=tuple(x_axis), z_dir=tuple(bore.axis))
    r, half = bore.radius_mm, bore.travel_mm / 2.0
    with BuildPart() as tool:
        if bore.up is None and not half:
            with Locations(plane * Plane((0.0, 0.0, bore.depth_mm / 2.0)).location):
                Cylinder(r, bore.depth_mm)
        else:
            with BuildSketch(plane):
                with BuildLine():
                    _outline(r, half, np.deg2rad(bore.roof_deg), bore.roof_mm)
                make_face()
            extrude(amount=bore.depth_mm)
    return tool.solids()[0]


def _outline(r: float, half: float, roof_angle: float, roof: float) -> None:
    """Draw two round ends (one circle if half is 0) under a roof of two tangents; y is up."""
    roof_normal, half_angle = np.array([np.cos(roof_angle), np.sin(roof_angle)]), (roof_angle - np.pi / 2.0) / 2.0
    halfway = np.array([np.cos(half_angle), np.sin(half_angle)])
    right, mirrored = np.array([half, 0.0]), np.array([-1.0, 1.0])
    start, arc_middle, end = right + np.array([0.0, -r]), right + r * halfway, right + r * roof_normal
    ThreePointArc(tuple(start), tuple(arc_middle), tuple(end))
    # Intersection of the tangent with a level roof.
    ridge = max(0.0, end[0] - (roof - end[1]) * np.tan(roof_angle))
    crest = [(ridge, roof), (-ridge, roof)] if ridge > 1e-9 else [(0.0, roof)]
    Polyline(tuple(end), *crest, tuple(mirrored * end))
    ThreePointArc(tuple(mirrored * end), tuple(mirrored * arc_middle), tuple(mirrored * start))
    if half:
        Line(tuple(mirrored * start), tuple(start))


def countersink_solid(cut: Countersink) -> Solid:
    """The solid that a countersink removes: a cone, or a groove with a cone at either end."""

    def cone(mouth: FloatArray) -> Solid:
        plane = Plane(origin=tuple(mouth), z_dir=tuple(cut.axis))
        return Solid.make_cone(cut.radius_mm, cut.end_radius_mm, cut.depth_mm, plane)

    if cut.up is None or not cut.travel_mm:
        return cone(cut.mouth)
    half, side = cut.travel_mm / 2.0 * np.cross(cut.up, cut.axis), np.asarray(cut.up)
    mouth, end = (
        centre + np.array([-radius * side - half, radius * side - half, radius * side + half, half - radius * side])
        for centre, radius in ((cut.mouth, cut.radius_mm), (cut.mouth + cut.depth_mm * cut.axis, cut.end_radius_mm))
    )
    with BuildPart() as groove:
        for solid in (cone(cut.mouth - half), cone(cut.mouth + half), solid_of(Frustum(mouth, end))):
            insert(solid)
    return groove.solids()[0]


def hexagon_solid(pocket: Hexagon) -> Solid:
    """The solid that a nut's pocket removes."""
    radius, sine = pocket.corner_mm, np.sqrt(0.75)
    if pocket.up is None:
        angles = np.pi / 3.0 * np.arange(6)
        x_axis = np.array([1.0, 0.0, 0.0])
        loop = np.outer(np.cos(angles), x_axis) + np.outer(np.sin(angles), np.cross(pocket.axis, x_axis))
        base = pocket.mouth + radius * loop
        return solid_of(Frustum(base, base + pocket.depth_mm * pocket.axis))
    side = np.cross(pocket.axis, pocket.up)
    # The two upper sides would overhang at 60 deg and are replaced by a roof.
    ups = np.array([-1.0, -0.5, 0.5, pocket.ridge_mm / radius, 0.5, -0.5])
    sides = np.array([0.0, sine, sine, 0.0, -sine, -sine])
    base = pocket.mouth + radius * (np.outer(ups, pocket.up) + np.outer(sides, side))
    return solid_of(Frustum(base, base + pocket.depth_mm * pocket.axis))


def cut_solid(cut: Cut) -> Solid:
    """The solid that a cut removes."""
    if isinstance(cut, Bore):
        return bore_solid(cut)
    if isinstance(cut, Countersink):
        return countersink_solid(cut)
    return hexagon_solid(cut) if isinstance(cut, Hexagon) else solid_of(cut)


def one_solid(name: str, built: BuildPart) -> Part:
    """The part, if it is one solid; raises InputError otherwise."""
    pieces = built.solids()
    if len(pieces) != 1:
        raise InputError(f"{name} falls apart into {len(pieces)} pieces, expected one")
    return Part(pieces, label=name)


def built_of(name: str, pieces: Iterable[Frustum], cuts: Iterable[Cut]) -> Part:
    """The union of convex pieces, minus cuts; raises InputError if it is not one solid."""
    with BuildPart() as part:
        insert([solid_of(piece) for piece in pieces])
        insert([cut_solid(cut) for cut in cuts], mode=Mode.SUBTRACT)
    return one_solid(name, part)


@recipe("cad.parts.solids.make_coupon")
def make_coupon(plan: CouponPlan) -> Part:
    """The fit coupon."""
    with BuildPart() as part:
        insert([solid_of(piece) for piece in plan.pieces])
        if (ring := plan.ring) is not None:
            with Locations(tuple(plan.centre)):
                upright = (Align.CENTER, Align.CENTER, Align.MIN)
                Cylinder(ring.radius_mm + ring.ring_mm, ring.band_mm, align=upright)
                Cylinder(ring.radius_mm, ring.band_mm, align=upright, mode=Mode.SUBTRACT)
            # Cut the ring off at the plate's edge.
            with BuildSketch(Plane.XY.offset(plan.centre[2])), Locations((plan.right_mm, plan.centre[1])):
                Rectangle(4.0 * ring.radius_mm, 4.0 * ring.radius_mm, align=(Align.MIN, Align.CENTER))
            extrude(amount=ring.band_mm, mode=Mode.SUBTRACT)
        insert([cut_solid(cut) for cut in plan.cuts], mode=Mode.SUBTRACT)
    return one_solid(COUPON, part)


@recipe("cad.parts.solids.make_carrier")
def make_carrier(plan: CarrierPlan) -> Part:
    """A mirror's carrier: its wedge with pads, minus grooves and the holes of its screws."""
    cuts: tuple[Cut, ...] = (*plan.grooves, *plan.holes, *plan.tips, *plan.nuts)
    return built_of(carrier_name(plan.name), (plan.body, *plan.pads), cuts)


@recipe("cad.parts.solids.make_clip")
def make_clip(plan: ClipPlan) -> Part:
    """The camera clip: the union of its pieces, minus its cuts."""
    return built_of(CLIP, plan.pieces, plan.cuts)


@recipe("cad.parts.solids.make_mount")
def make_mount(plan: MountPlan) -> Part:
    """The mount: the union of skins, webs and foot, minus windows, holes and light."""
    return built_of(MOUNT, plan.pieces, (*plan.cuts, *plan.light))


@recipe("cad.parts.solids.make_cover")
def make_cover(plan: CoverPlan) -> Part:
    """The dust cover: a hollow cap with a notch in its rim and with catches."""
    with BuildPart() as part:
        insert(solid_of(plan.outer))
        insert([solid_of(plan.inner), solid_of(plan.notch)], mode=Mode.SUBTRACT)
        insert([solid_of(catch) for catch in plan.catches])
    return one_solid(COVER, part)
