"""Hollows behind the mirrors, open at the holder's flat back, with webs between them and roofs that need no support."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from manifold3d import Manifold
from shapely import Point, Polygon, box, get_coordinates
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from mirrorcam.cad.plan.cuts import Cuts, depth_for_pin_mm
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import planes_of
from mirrorcam.core.values import FloatArray

# Narrower hollows save no plastic.
MIN_WIDTH_MM = 5.0
# Minimum height of the eaves over the back.
MIN_EAVES_MM = 0.5
# Skip the edges of the body's sides: rounding makes them neither solid nor air.
ROUNDING_MM = 1e-3
# Factor on the slope of roofs, so that they are slightly steeper than the overhang limit.
ROOF_STEEPNESS = 1.01


@dataclass(frozen=True)
class Hollow:
    """A prism with a truncated pyramid on it, by three loops: `base` below the part's back, `eaves` and `top`.

    All are (n, 3) in the rig frame, mm, with corresponding corners.
    """

    base: FloatArray
    eaves: FloatArray
    top: FloatArray

    @property
    def faces(self) -> list[FloatArray]:
        """The flat faces as loops of corners, counter-clockwise seen from outside."""
        base, eaves, top = self.base, self.eaves, self.top
        centre = (base.mean(axis=0) + eaves.mean(axis=0)) / 2.0
        pairs = [(i, (i + 1) % len(base)) for i in range(len(base))]
        loops = [
            base,
            top,
            *(np.array([base[i], base[j], eaves[j], eaves[i]]) for i, j in pairs),
            *(np.array([eaves[i], eaves[j], top[j], top[i]]) for i, j in pairs),
        ]
        normals, offsets = planes_of(loops)
        inward = normals @ centre > offsets
        return [loop[::-1] if reverse else loop for loop, reverse in zip(loops, inward, strict=True)]

    @cached_property
    def half_spaces(self) -> tuple[FloatArray, FloatArray]:
        """Outward unit normals (m, 3) and offsets (m,): a point x is inside if normals @ x <= offsets."""
        return planes_of(self.faces)


def plan_hollows(
    body: Manifold,
    rig_from_mount: FloatArray,
    footprint: Polygon,
    holes_mm: FloatArray,
    cuts_mm: Cuts,
    hardware: Hardware,
) -> tuple[Hollow, ...]:
    """Plan the hollows of a solid body, in rows and columns over its footprint (in the mount's x and y).

    Over a hollow the floor is `floor_mm` thick, normal to the hollow's roof. A hollow is `web_mm` from other hollows
    and from air. Material remains round every hole (n, 2) for the insert's wall, and along the cuts (normal to x and to
    y) for the pins' holes.
    """
    dimensions, screw = hardware.holder, hardware.screw
    boss_radius = screw.insert_hole_mm / 2.0 + screw.insert_wall_mm
    # The margin keeps the sections that are tested for a pin clear of the side of a hollow.
    joint_margin = depth_for_pin_mm(hardware) + 0.1
    inside = footprint.buffer(-dimensions.web_mm, join_style="mitre")
    footprint = footprint.buffer(-ROUNDING_MM, join_style="mitre")
    if inside.is_empty:
        return ()
    x_min, y_min, x_max, y_max = inside.bounds
    mount_from_rig = np.asarray(np.linalg.inv(rig_from_mount), dtype=np.float64)
    in_mount = body.transform(mount_from_rig[:3])
    hollows = []
    for start, stop in _spans(x_min, x_max, cuts_mm[0], joint_margin, dimensions.cell_mm, dimensions.web_mm):
        for bottom, top in _spans(y_min, y_max, cuts_mm[1], joint_margin, dimensions.cell_mm, dimensions.web_mm):
            cell = box(start, bottom, stop, top).intersection(inside)
            for hole in holes_mm:
                cell = _outside_boss(cell, hole, boss_radius)
            if not isinstance(cell, Polygon) or cell.buffer(-MIN_WIDTH_MM / 2.0).is_empty:
                continue
            hollow = _hollow(in_mount, cell, footprint, hardware)
            if hollow is not None:
                hollows.append(hollow)
    rotation, origin = rig_from_mount[:3, :3], rig_from_mount[:3, 3]
    return tuple(
        Hollow(hollow.base @ rotation.T + origin, hollow.eaves @ rotation.T + origin, hollow.top @ rotation.T + origin)
        for hollow in hollows
    )


def _spans(
    low: float, high: float, cuts: tuple[float, ...], margin: float, max_width: float, web: float
) -> list[tuple[float, float]]:
    """Equal spans, at most `max_width` wide, with webs between them, clear of the joints at cuts."""
    spans = []
    starts, ends = [low, *(cut + margin for cut in cuts)], [*(cut - margin for cut in cuts), high]
    for start, end in zip(starts, ends, strict=True):
        count = max(1, int(np.ceil((end - start + web) / (max_width + web))))
        width = (end - start + web) / count - web
        if width > 0.0:
            spans += [(start + i * (width + web), start + i * (width + web) + width) for i in range(count)]
    return spans


def _outside_boss(cell: Polygon, hole: FloatArray, radius: float) -> Polygon:
    """The largest part of a cell that one straight cut leaves outside a disc round a hole."""
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


def _hollow(body: Manifold, cell: Polygon, footprint: Polygon, hardware: Hardware) -> Hollow | None:
    """The highest hollow over a convex cell, in the mount frame; None if none fits.

    Its roof rises from the eaves towards the cell's centroid, up to a flat top that a printer bridges. With roof and
    top offset outwards by the floor's thickness, and the walls by a web's, the hollow must not meet air. Under each
    side of the roof, and under the part of the top next to it, the constraint is linear in the corners of the air, so
    that the height is a minimum over these corners.
    """
    floor = hardware.holder.floor_mm
    corners = get_coordinates(orient(cell.simplify(1e-6)))[:-1]
    centroid = np.array(cell.centroid.coords[0])
    directions = np.roll(corners, -1, axis=0) - corners
    outward = np.column_stack([directions[:, 1], -directions[:, 0]])
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    distances = np.sum((corners - centroid) * outward, axis=1)
    # Heights of the complete pyramid and of its part below the top.
    slope = ROOF_STEEPNESS * np.tan(np.radians(90.0 - hardware.printer.overhang_deg))
    pyramid = float(distances.max()) * slope
    top_scale = min(hardware.holder.ceiling_mm / (2.0 * float(distances.min())), 0.95)
    roof_height = pyramid * (1.0 - top_scale)
    outer_scale = 1.0 + hardware.holder.web_mm / float(distances.min())
    # Below the mount's origin (towards the mirrors) z is negative.
    levels = (body.bounding_box()[2] - 1.0, -0.5 * MIN_EAVES_MM)
    # Slightly more than the tested region: the complete body takes twice as long.
    near = body ^ _column(centroid + 1.01 * outer_scale * (corners - centroid), levels)
    eaves = np.inf
    for i in range(len(corners)):
        side = corners[[i, (i + 1) % len(corners)]] - centroid
        floor_height = floor * float(np.hypot(1.0, pyramid / distances[i]))
        # Intersection of the offset roof and the offset top.
        edge_scale = float(np.clip(1.0 - (roof_height + floor - floor_height) / pyramid, 0.0, outer_scale))
        under_top = Polygon([centroid, *(centroid + edge_scale * side)]) if edge_scale > 0.0 else Polygon()
        under_roof = Polygon([*(centroid + edge_scale * side), *(centroid + outer_scale * side[::-1])])
        heights = [height - floor - roof_height for height, _ in _air(near, under_top.intersection(footprint), levels)]
        for height, point in _air(near, under_roof.intersection(footprint), levels):
            scale_at = float((point - centroid) @ outward[i]) / distances[i]
            heights.append(height - floor_height - pyramid * (1.0 - scale_at))
        eaves = min([eaves, *heights])
    if eaves == np.inf:
        return None
    # If the roof would start below the back, the same pyramid is truncated higher up.
    eaves_scale = min(1.0, top_scale + (1.0 - top_scale) * (eaves + roof_height - MIN_EAVES_MM) / roof_height)
    if eaves_scale <= top_scale or 2.0 * eaves_scale * distances.min() < MIN_WIDTH_MM:
        return None
    eaves_corners = centroid + eaves_scale * (corners - centroid)
    top = centroid + top_scale * (corners - centroid)
    return Hollow(
        np.column_stack([eaves_corners, np.full(len(corners), 1.0)]),
        np.column_stack([eaves_corners, np.full(len(corners), -max(eaves, MIN_EAVES_MM))]),
        np.column_stack([top, np.full(len(corners), -(eaves + roof_height))]),
    )


def _air(body: Manifold, area: BaseGeometry, levels: tuple[float, float]) -> list[tuple[float, FloatArray]]:
    """Height over the back, and x and y (2,), of every corner of the air over a convex area."""
    if area.area < 1e-9:
        return []
    points = np.asarray((_column(get_coordinates(area), levels) - body).to_mesh64().vert_properties)
    return [(-float(point[2]), point[:2]) for point in points]


def _column(flat: FloatArray, levels: tuple[float, float]) -> Manifold:
    """The prism on the convex hull of points (n, 2), between two z coordinates."""
    return Manifold.hull_points(np.vstack([np.column_stack([flat, np.full(len(flat), z)]) for z in levels]))
