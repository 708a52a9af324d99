"""Areas of carriers on the back of a holder, and the axes of their screws: within the outlines of their mirrors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from shapely import Point, Polygon, box, get_coordinates
from shapely.affinity import rotate, translate
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from mirrorcam.cad.holder.adjuster import boss_mm, recess_wide_mm
from mirrorcam.cad.holder.pads import least_height_mm, widest_triangle
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import outline_at, seat_height_mm
from mirrorcam.core.values import FloatArray, InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror

FAR_MM = 1e4
# Places of screws are found on a border that is simplified by less than this.
SIMPLIFIED_MM = 0.03
# Scales that are tried for what would fit.
LARGER = np.arange(1.05, 4.0, 0.05)


@dataclass(frozen=True)
class CarrierArea:
    """A carrier as seen from the holder's back, along two axes of that from the pupil, mm.

    `corners` (n, 2) are convex and counter-clockwise; `screws` (3, 2) are the axes of its screws.
    """

    corners: FloatArray
    screws: FloatArray

    @property
    def middle(self) -> FloatArray:
        """The middle (2,) of the screws, about which it is tilted."""
        return np.asarray(self.screws.mean(axis=0))

    @property
    def reaches_mm(self) -> tuple[float, float]:
        """Largest distances of the screws and of the corners from there."""
        ends = (np.linalg.norm(points - self.middle, axis=1).max() for points in (self.screws, self.corners))
        screws, corners = (float(end) for end in ends)
        return screws, corners


def plan_areas(
    layout: Layout, axes: FloatArray, taken: Iterable[BaseGeometry], hardware: Hardware
) -> tuple[int, tuple[CarrierArea, ...]]:
    """The areas of all carriers, and which of some places of the mount's screws they are for.

    Parameters
    ----------
    layout : Layout
        The mirrors.
    axes : (3, 3)
        Rows x, y and z of the mount.
    taken : iterable of BaseGeometry
        Where no axis of a carrier's screw may be, for each place of the mount's screws: the first is taken that leaves
        every carrier three.
    hardware : Hardware
        Screws, springs, and how far mirrors tilt.

    Raises
    ------
    InputError
        Where a mirror has no space for three screws about its middle.
    """
    shadows = [_shadow(mirror, axes, 0.0, hardware) for mirror in layout.mirrors]
    areas = [_free_area(index, layout, shadows, axes, hardware) for index in range(len(layout.mirrors))]
    alone = [_screws_in(area, Polygon(), hardware) for area in areas]
    for index, screws in enumerate(alone):
        if screws is None:
            raise InputError(_no_space(layout, index, f"{_what_fits(areas[index], hardware)}, or ", hardware))
    last = 0
    for place, occupied in enumerate(taken):
        found: list[CarrierArea] = []
        for index, (area, screws) in enumerate(zip(areas, alone, strict=True)):
            free = screws is not None and not any(occupied.contains(Point(at)) for at in screws)
            chosen = screws if free else _screws_in(area, occupied, hardware)
            if chosen is None:
                last = index
                break
            found.append(CarrierArea(get_coordinates(orient(area))[:-1], chosen))
        if len(found) == len(areas):
            return place, tuple(found)
    raise InputError(_no_space(layout, last, "more beside the mount's own screws, or ", hardware))


def _no_space(layout: Layout, index: int, expected: str, hardware: Hardware) -> str:
    width, height = np.ptp(layout.mirrors[index].outline_in_plane_mm, axis=0)
    return (
        f"mirror {layout.mirror_names[index]} of {width:.1f} x {height:.1f} mm has no space behind it for three M3 "
        f"screws with {boss_mm(hardware):.1f} mm of plastic about their middles, expected {expected}"
        'holder.mirrors = "glue"'
    )


def _shadow(mirror: Mirror, axes: FloatArray, inset_mm: float, hardware: Hardware) -> Polygon:
    """A mirror's outline, made smaller, as seen along the mount's z."""
    flat = Polygon(mirror.outline_in_plane_mm).buffer(-inset_mm, join_style="mitre")
    if flat.is_empty:
        return Polygon()
    corners = get_coordinates(orient(flat))[:-1]
    in_plane = np.column_stack([corners, np.full(len(corners), seat_height_mm(mirror, hardware))])
    frame = mirror.rig_from_plane
    return orient(Polygon((in_plane @ frame[:3, :3].T + frame[:3, 3]) @ axes[:2].T))


def _free_area(index: int, layout: Layout, shadows: Sequence[Polygon], axes: FloatArray, hardware: Hardware) -> Polygon:
    """What a carrier may take: the shadow of its mirror, cut straight where other mirrors come near when tilted."""
    area = _shadow(layout.mirrors[index], axes, hardware.holder.carrier_inset_mm, hardware)
    for other, shadow in enumerate(shadows):
        if other == index or area.is_empty:
            continue
        near = shadow.buffer(_swing_mm(layout.mirrors[other], axes, hardware), join_style="mitre", mitre_limit=2.0)
        if near.intersects(area):
            area = _beside(area, get_coordinates(orient(near)))
    return area


def _swing_mm(mirror: Mirror, axes: FloatArray, hardware: Hardware) -> float:
    """How far a tilted mirror's edge may come to the side, with a gap: it turns about its carrier's back."""
    high = float(np.ptp(outline_at(mirror, 0.0) @ axes[2])) + 2.0 * hardware.screw.insert_depth_mm
    return hardware.fit.free_mm + high * float(np.tan(np.radians(hardware.holder.adjust_deg)))


def _beside(area: Polygon, corners: FloatArray) -> Polygon:
    """The largest part of a convex area on the outer side of an edge of a convex loop (n + 1, 2)."""
    parts = []
    for start, end in pairwise(corners):
        along = end - start
        half = translate(box(-FAR_MM, -FAR_MM, FAR_MM, 0.0), start[0], start[1])
        turned = rotate(half, np.degrees(np.arctan2(along[1], along[0])), origin=tuple(start))
        part = area.intersection(turned)
        if isinstance(part, Polygon):
            parts.append(part)
    return max(parts, key=lambda part: part.area, default=Polygon())


def _screws_in(area: Polygon, taken: BaseGeometry, hardware: Hardware) -> FloatArray | None:
    """Axes (3, 2) of screws as far apart as they can be; None where there is no space for them."""
    if area.is_empty:
        return None
    free = area.buffer(-boss_mm(hardware)).difference(taken.buffer(SIMPLIFIED_MM))
    if free.is_empty:
        return None
    found = widest_triangle(free, np.array(area.centroid.coords[0]))
    if found is None:
        return None
    least = max(recess_wide_mm(hardware) + hardware.printer.wall_mm, 1.5 * boss_mm(hardware))
    return found if float(least_height_mm(found[None])[0]) >= least else None


def _what_fits(area: Polygon, hardware: Hardware) -> str:
    """By how much larger the mirror would have to be, in words."""
    if not area.is_empty:
        corners = get_coordinates(area) - np.array(area.centroid.coords[0])
        for factor in LARGER:
            if _screws_in(Polygon(factor * corners), Polygon(), hardware) is not None:
                return f"mirrors {factor:.2f} times as large"
    return "larger mirrors"
