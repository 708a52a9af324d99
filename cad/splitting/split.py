"""Splitting of a part larger than the printer's bed into parts that fit it, and the pins between them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from manifold3d import Manifold
from shapely import get_coordinates

from mirrorcam.cad.plan.cuts import (
    BEYOND_MM,
    PINS_APART,
    Cell,
    Cuts,
    Joint,
    PiecePlan,
    Span,
    bed_lengths_mm,
    cells_between,
    farthest_pair,
    hole_depth_mm,
    hole_frame,
    hole_mm,
    joints_between,
    off_corners,
    require_height,
    turned_onto_bed,
)
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import BoughtItem, PartPlan
from mirrorcam.cad.splitting.body_cuts import area_for_pins, best_places_mm, fragments, inside, mesh_of, triangles_of
from mirrorcam.cad.splitting.piece_solid import make_piece, whole_part
from mirrorcam.core.values import FloatArray, InputError
from mirrorcam.optics.geometry.transforms import rigid, transform

EXPLODE_MM = 25.0


@dataclass(frozen=True)
class Pieces:
    """The printed parts that a part is split into, or itself, and the pins between them."""

    parts: tuple[PartPlan, ...]
    pins: tuple[BoughtItem, ...]


@dataclass(frozen=True)
class _Pin:
    """A pin between two pieces; `rig_from_holes` (2, 4, 4) are the frames of its hole in either."""

    cells: tuple[Cell, Cell]
    rig_from_holes: FloatArray


def split(part: PartPlan, corners_in_rig: FloatArray, hardware: Hardware, cuts_mm: Cuts | None = None) -> Pieces:
    """The part as it is, where it fits the printer's bed; else cut in pieces.

    Parameters
    ----------
    part : PartPlan
        The whole part. It is made only if it has to be cut.
    corners_in_rig : (n, 3)
        Points in rig, mm, whose box on the bed holds the part.
    hardware : Hardware
        The printer's bed and thinnest wall, fits and pins.
    cuts_mm : pair of tuples of float, optional
        Places of cuts along the bed's x and y, kept to within `plan.bed.MOVED_MM`; without them, the places with the
        most space for pins.

    Returns
    -------
    Pieces
        One part without pins, or pieces numbered along the bed's x and then y, with two pins in every joint. Cuts are
        upright on the bed, so that every piece prints as the whole part would.

    Raises
    ------
    InputError
        With the measure that breaks: too high, no space for two pins in a cut, or a piece that falls apart.
    """
    corners = transform(part.print_from_rig, corners_in_rig)
    low, high = corners.min(axis=0), corners.max(axis=0)
    require_height(part.title.lower(), float(high[2] - low[2]), hardware)
    lengths = (float(high[0] - low[0]), float(high[1] - low[1]))
    bed = bed_lengths_mm(lengths, hardware)
    if lengths[0] <= bed[0] and lengths[1] <= bed[1]:
        return Pieces((turned_onto_bed(part, lengths[0], bed[0], hardware),), ())
    body = mesh_of(whole_part(part.plan, part.make)).transform(part.print_from_rig[:3])
    if cuts_mm is None:
        spans = [(float(low[axis]), float(high[axis])) for axis in (0, 1)]
        cuts_mm = (
            best_places_mm(body, 0, spans[0], bed[0], hardware),
            best_places_mm(body, 1, spans[1], bed[1], hardware),
        )
    triangles, wall = triangles_of(body), hardware.printer.wall_mm
    cuts_mm = (off_corners(triangles, 0, cuts_mm[0], wall), off_corners(triangles, 1, cuts_mm[1], wall))
    return _pieces(part, body, (low, high), cuts_mm, bed, hardware)


def _pieces(
    part: PartPlan,
    body: Manifold,
    box_on_bed: tuple[FloatArray, FloatArray],
    cuts_mm: Cuts,
    bed_mm: Span,
    hardware: Hardware,
) -> Pieces:
    """The pieces between the cuts, numbered along the bed's x and then y, with two pins in every joint."""
    low, high = box_on_bed
    rig_from_bed = np.asarray(np.linalg.inv(part.print_from_rig), dtype=np.float64)
    cells = cells_between(cuts_mm, low, high)
    pins = [
        pin
        for joint in joints_between(cells, hardware.holder.pin_mm[1])
        for pin in _two_pins(part, body, joint, rig_from_bed, hardware)
    ]
    pieces = {}
    for number, (cell, spans) in enumerate(cells.items(), start=1):
        bounds = _bounds_of_piece(part, number, inside(body, spans), bed_mm, hardware)
        holes = [hole for pin in pins for at, hole in zip(pin.cells, pin.rig_from_holes, strict=True) if at == cell]
        plan = PiecePlan(
            whole=part.plan,
            make=part.make,
            rig_from_bed=rig_from_bed,
            low_mm=(spans[0][0], spans[1][0], float(low[2]) - BEYOND_MM),
            high_mm=(spans[0][1], spans[1][1], float(high[2]) + BEYOND_MM),
            rig_from_pins=np.array(holes).reshape(-1, 4, 4),
            hole_mm=(hole_mm(hardware), hole_depth_mm(hardware)),
            crumb_mm=hardware.printer.wall_mm,
        )
        piece = _piece(part, number, plan, bounds, bounds.mean(axis=0) - (low + high) / 2.0)
        pieces[cell] = turned_onto_bed(piece, float(bounds[1, 0] - bounds[0, 0]), bed_mm[0], hardware)
    return Pieces(tuple(pieces.values()), tuple(_bought(pin, pieces, hardware) for pin in pins))


def _piece(part: PartPlan, number: int, plan: PiecePlan, bounds: FloatArray, off_middle: FloatArray) -> PartPlan:
    """A piece as a part, from its bounds (2, 3) on the bed and how far its middle (3,) is from the whole part's."""
    lowered = rigid(np.eye(3), [0.0, 0.0, -bounds[0, 2]])
    apart = plan.rig_from_bed[:3, :3] @ (off_middle * [1.0, 1.0, 0.0])
    return replace(
        part,
        name=f"{part.name}_{number}",
        title=f"{part.title}, piece {number}",
        number=f"{part.number}-{number}",
        plan=plan,
        make=make_piece,
        print_from_rig=lowered @ part.print_from_rig,
        explode_mm=part.explode_mm + EXPLODE_MM * apart / max(float(np.linalg.norm(apart)), 1e-9),
    )


def _bought(pin: _Pin, pieces: dict[Cell, PartPlan], hardware: Hardware) -> BoughtItem:
    """A pin in its place, half in either piece."""
    diameter, length = hardware.holder.pin_mm
    first, second = (pieces[cell] for cell in pin.cells)
    return BoughtItem(
        kind="pin",
        size=f"{diameter:g}",
        length_mm=length,
        rig_from_item=pin.rig_from_holes[1] @ rigid(np.eye(3), [0.0, 0.0, length / 2.0]),
        explode_mm=(first.explode_mm + second.explode_mm) / 2.0,
        joins=(first.name, second.name),
    )


def _two_pins(part: PartPlan, body: Manifold, joint: Joint, rig_from_bed: FloatArray, hardware: Hardware) -> list[_Pin]:
    """The two pins of a joint, as far apart as they can be."""
    axis, cut = joint.axis, joint.at_mm
    area = area_for_pins(body, axis, cut, joint.span_mm, hardware)
    corners, apart = farthest_pair(get_coordinates(area))
    needed = PINS_APART * hardware.holder.pin_mm[0]
    if apart < needed:
        raise InputError(
            f"{part.title.lower()} is larger than the printer's bed, and a cut at {'xy'[axis]} = {cut:.1f} mm has "
            f"space for two pins {apart:.1f} mm apart, expected {needed:g} mm"
        )
    pins = []
    for corner in corners:
        middle = np.zeros(3)
        middle[[1 - axis, 2]], middle[axis] = corner, cut
        holes = [rig_from_bed @ hole_frame(middle, axis, side) for side in (-1.0, 1.0)]
        pins.append(_Pin(joint.cells, np.array(holes)))
    return pins


def _bounds_of_piece(part: PartPlan, number: int, body: Manifold, bed_mm: Span, hardware: Hardware) -> FloatArray:
    """Bounds (2, 3) on the bed of a piece; raises InputError where it falls apart or does not fit the bed."""
    title = f"piece {number} of the {part.title.lower()}"
    found = fragments(body, hardware.printer.wall_mm)
    if len(found) != 1:
        raise InputError(f"{title} falls apart into {len(found)}, expected one")
    bounds: FloatArray = np.array(found[0].bounding_box()).reshape(2, 3)
    for length, longest in zip(np.ptp(bounds, axis=0), bed_mm, strict=False):
        if length > longest + 1e-6:
            raise InputError(f"{title} is {length:.1f} mm along the bed, expected at most {longest:g} mm")
    return bounds
