"""Hollows behind the mirrors, open at the holder's flat back, with webs between them and roofs that need no support."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from manifold3d import Manifold
from shapely import Point, Polygon, box, get_coordinates
from shapely.geometry.polygon import orient

from cad.hardware import Hardware
from cad.seats import planes_of
from optics.values import FloatArray

# A narrower hollow saves nothing.
NARROWEST_MM = 5.0
LOWEST_MM = 0.5
# Roofs are a hair steeper than the overhang that prints.
STEEPER = 1.01


@dataclass(frozen=True)
class Hollow:
    """A prism with a pyramid on it. In rig, mm: `base` (n, 3) below the part's back, `eaves` (n, 3) and `apex` (3,)."""

    base: FloatArray
    eaves: FloatArray
    apex: FloatArray

    @property
    def faces(self) -> list[FloatArray]:
        """The flat faces as corner loops, counter-clockwise from outside."""
        base, eaves = self.base, self.eaves
        middle = (base.mean(axis=0) + eaves.mean(axis=0)) / 2.0
        pairs = [(i, (i + 1) % len(base)) for i in range(len(base))]
        loops = [
            base,
            *(np.array([base[i], base[j], eaves[j], eaves[i]]) for i, j in pairs),
            *(np.array([eaves[i], eaves[j], self.apex]) for i, j in pairs),
        ]
        normals, offsets = planes_of(loops)
        inward = normals @ middle > offsets
        return [loop[::-1] if turned else loop for loop, turned in zip(loops, inward, strict=True)]

    @cached_property
    def half_spaces(self) -> tuple[FloatArray, FloatArray]:
        """Outward unit normals (m, 3) and offsets (m,): inside is normals @ x <= offsets."""
        return planes_of(self.faces)


def plan_hollows(
    body: Manifold,
    rig_from_mount: FloatArray,
    footprint: Polygon,
    holes_mm: FloatArray,
    cuts_mm: tuple[tuple[float, ...], tuple[float, ...]],
    hardware: Hardware,
) -> tuple[Hollow, ...]:
    """The hollows of a solid body, in rows and columns over its footprint (in the mount's x and y).

    Over a hollow the floor is `floor_mm` thick, at right angles to its roof; beside it what is not plastic stays
    `web_mm` away, as other hollows do. Round every hole (n, 2) the insert's wall stands, and along the cuts (positions
    across x and across y) half a pin's length.
    """
    dimensions, screw = hardware.holder, hardware.screw
    boss = screw.insert_hole_mm / 2.0 + screw.insert_wall_mm
    joint = dimensions.pin_mm[1] / 2.0 + hardware.printer.wall_mm
    inside = footprint.buffer(-dimensions.web_mm, join_style="mitre")
    if inside.is_empty:
        return ()
    left, low, right, high = inside.bounds
    columns = _spans(left, right, cuts_mm[0], joint, dimensions.cell_mm, dimensions.web_mm)
    rows = _spans(low, high, cuts_mm[1], joint, dimensions.cell_mm, dimensions.web_mm)
    in_mount = body.transform(np.linalg.inv(rig_from_mount)[:3])
    hollows = []
    for column in columns:
        for row in rows:
            cell = box(column[0], row[0], column[1], row[1]).intersection(inside)
            for hole in holes_mm:
                cell = _off_boss(cell, hole, boss)
            if not isinstance(cell, Polygon) or cell.buffer(-NARROWEST_MM / 2.0).is_empty:
                continue
            hollow = _hollow(in_mount, cell, footprint, hardware)
            if hollow is not None:
                base, eaves, apex = (points @ rig_from_mount[:3, :3].T + rig_from_mount[:3, 3] for points in hollow)
                hollows.append(Hollow(base, eaves, apex))
    return tuple(hollows)


def _spans(
    low: float, high: float, cuts: tuple[float, ...], joint: float, widest: float, web: float
) -> list[tuple[float, float]]:
    """Equal spans, no wider than asked for, with webs between them and joints left out."""
    spans = []
    starts, ends = [low, *(cut + joint for cut in cuts)], [*(cut - joint for cut in cuts), high]
    for start, end in zip(starts, ends, strict=True):
        count = max(1, int(np.ceil((end - start + web) / (widest + web))))
        width = (end - start + web) / count - web
        if width > 0.0:
            spans += [(start + i * (width + web), start + i * (width + web) + width) for i in range(count)]
    return spans


def _off_boss(cell: Polygon, hole: FloatArray, radius: float) -> Polygon:
    """The largest part of a cell, cut straight across, that leaves a disc round a hole standing."""
    if not cell.intersects(Point(hole).buffer(radius)):
        return cell
    (x, y), far = hole, 1e4
    sides = (
        box(-far, -far, x - radius, far),
        box(x + radius, -far, far, far),
        box(-far, -far, far, y - radius),
        box(-far, y + radius, far, far),
    )
    return max((cell.intersection(side) for side in sides), key=lambda part: part.area)


def _hollow(
    body: Manifold, cell: Polygon, footprint: Polygon, hardware: Hardware
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Base, eaves and apex of the highest hollow over a convex cell, in the mount frame; None where there is no room.

    The roof rises to the apex over the cell's middle. With its roof moved out by the floor's thickness and its walls
    by a web's, the hollow must meet no air: over each side that is linear in the corners of the air there, so the
    eaves' height is a minimum over corners.
    """
    floor = hardware.holder.floor_mm
    corners = get_coordinates(orient(cell.simplify(1e-6)))[:-1]
    middle = np.array(cell.centroid.coords[0])
    directions = np.roll(corners, -1, axis=0) - corners
    outward = np.column_stack([directions[:, 1], -directions[:, 0]])
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    distances = np.sum((corners - middle) * outward, axis=1)
    rise = STEEPER * float(distances.max()) * np.tan(np.radians(90.0 - hardware.printer.overhang_deg))
    scale = 1.0 + hardware.holder.web_mm / float(distances.min())
    grown = middle + scale * (corners - middle)
    # Below the mount's origin (towards the mirrors) z is negative.
    lowest, highest = body.bounding_box()[2] - 1.0, -0.5 * LOWEST_MM
    eaves = np.inf
    for i in range(len(corners)):
        sector = Polygon([middle, grown[i], grown[(i + 1) % len(corners)]]).intersection(footprint)
        if sector.area < 1e-9:
            continue
        column = Manifold.hull_points(
            np.vstack(
                [
                    np.column_stack([get_coordinates(sector), np.full(len(get_coordinates(sector)), z)])
                    for z in (lowest, highest)
                ]
            )
        )
        air = column - body
        if air.is_empty():
            continue
        points = np.asarray(air.to_mesh64().vert_properties)[:, :3]
        reach = (points[:, :2] - middle) @ outward[i] / distances[i]
        above = floor * float(np.hypot(1.0, rise / distances[i]))
        eaves = min(eaves, float((-points[:, 2] - above - rise * (1.0 - reach)).min()))
    if eaves == np.inf:
        return None
    apex = eaves + rise
    if eaves < LOWEST_MM:
        # The roof starts at the back itself: the same pyramid, cut off lower down.
        shrunk = (apex - LOWEST_MM) / rise
        corners, eaves = middle + shrunk * (corners - middle), LOWEST_MM
        if 2.0 * shrunk * distances.min() < NARROWEST_MM:
            return None
    return (
        np.column_stack([corners, np.full(len(corners), 1.0)]),
        np.column_stack([corners, np.full(len(corners), -eaves)]),
        np.array([*middle, -apex]),
    )


def sag_um(load_n: float, hardware: Hardware) -> float:
    """How far the floor over one hollow gives way under a force spread over it, in micrometres.

    A square plate clamped along its edges, w = 0.00126 q a^4 / D, D = E t^3 / (12 (1 - nu^2)), nu = 0.35 (Timoshenko,
    Theory of Plates and Shells, table 35). The roof is thicker than the floor everywhere but at its apex.
    """
    side, thickness = hardware.holder.cell_mm, hardware.holder.floor_mm
    stiffness = hardware.printer.plastic_mpa * thickness**3 / (12.0 * (1.0 - 0.35**2))
    return 0.00126 * load_n / side**2 * side**4 / stiffness * 1000.0
