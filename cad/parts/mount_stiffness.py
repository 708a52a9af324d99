"""Stiffness of the mount: skins, webs and the foot's plate as folded plates, with the compliance of their openings.

The modulus of a perforated strip is reduced as for a plate with holes, in closed form.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import compress, pairwise
from typing import Self

import numpy as np
from shapely import LineString, Point, Polygon, box
from shapely.affinity import scale, translate

from mirrorcam.cad.parts.truss import FOOT_X_MM, Foot, foot_plate_mm, webs_between
from mirrorcam.cad.plan.fasteners import Bore, Hexagon
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import clip_loop
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.stiffness import POISSON, FoldedPlates, Section
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror_gaps import stacked

# Larger than any opening and strip.
FAR_MM = 500.0
# Cuts that overlap a strip by less than this only touch it.
TOUCH_MM = 1e-6


@dataclass(frozen=True)
class ThroughCuts:
    """Openings that may go through a strip, and the corners (n, corners, 2; y and z) that contain them, seen along x.

    Pockets for nuts do not, and are left out.
    """

    cuts: tuple[Frustum | Bore, ...]
    profiles: FloatArray

    @classmethod
    def of(cls, cuts: Iterable[Frustum | Bore | Hexagon]) -> Self:
        """Return the openings among the cuts of a part."""
        through = tuple(cut for cut in cuts if not isinstance(cut, Hexagon))
        return cls(through, stacked([_profile(cut) for cut in through]) if through else np.zeros((0, 1, 2)))

    def meeting(self, start: FloatArray, end: FloatArray) -> Iterator[Frustum | Bore]:
        """Yield the openings that may meet a strip: not all their corners are on one side of it, or beyond an end."""
        length = float(np.linalg.norm(end - start))
        y, z = (end - start) / length
        along, left = np.moveaxis((self.profiles - start) @ np.array([[y, -z], [z, y]]), -1, 0)
        crossing = (left.min(axis=1) < -TOUCH_MM) & (left.max(axis=1) > TOUCH_MM)
        return compress(self.cuts, crossing & (along.min(axis=1) < length) & (along.max(axis=1) > 0.0))


def _profile(cut: Frustum | Bore) -> FloatArray:
    """Corners (n, 2; y and z) whose convex hull contains a cut, seen along x."""
    if isinstance(cut, Frustum):
        return np.vstack([cut.base, cut.top])[:, 1:]
    axis = cut.axis[1:] / np.linalg.norm(cut.axis[1:])
    across = (cut.radius_mm + cut.travel_mm / 2.0) * np.array([-axis[1], axis[0]])
    return cut.mouth[1:] + np.array([-across, across, cut.depth_mm * axis - across, cut.depth_mm * axis + across])


def softening(start: FloatArray, end: FloatArray, half_width_mm: float, cuts: ThroughCuts) -> float:
    """Ratio of a strip's compliance along its length with openings to its compliance without.

    The strip is a plate between two points (2,; y and z), `half_width_mm` to either side of x = 0. An ellipse with the
    axes 2 a normal to the stress and 2 b along it adds its fraction of the area times 1 + 2 a / b (Kachanov 1992,
    Effective elastic properties of cracked solids; holes without interaction). An opening of another shape counts as
    the ellipse of the same width and length.
    """
    length = float(np.linalg.norm(end - start))
    band = box(-half_width_mm, -FAR_MM, half_width_mm, FAR_MM)
    strip = box(-half_width_mm, 0.0, half_width_mm, length)
    ratio = 1.0
    for cut in cuts.meeting(start, end):
        opening = _in_plane(cut, start, (end - start) / length)
        if opening is None or not opening.intersects(strip):
            continue
        opening = opening.intersection(band)
        low_x, low, high_x, high = opening.bounds
        fraction = opening.intersection(strip).area / strip.area
        ratio += fraction * (1.0 + 2.0 * (high_x - low_x) / (high - low))
    return ratio


def _in_plane(cut: Frustum | Bore, start: FloatArray, tangent: FloatArray) -> Polygon | None:
    """Section of a cut by the plane that x spans with a line from a point along a tangent, both (2,; y and z).

    Coordinates are x and the distance along the line; None if the cut does not meet the plane.
    """
    if isinstance(cut, Frustum):
        loop = np.array([(-FAR_MM, -FAR_MM), (FAR_MM, -FAR_MM), (FAR_MM, FAR_MM), (-FAR_MM, FAR_MM)])
        for normal, offset in zip(*cut.half_spaces, strict=True):
            direction = np.array([normal[0], normal[1:] @ tangent])
            if len(loop) == 0:
                return None
            loop = clip_loop(loop, direction, offset - normal[1:] @ start)
        return Polygon(loop) if len(loop) > 2 else None
    # A bore in the y-z plane, or nearly so, with its roof towards +x.
    axis = cut.axis[1:] / np.linalg.norm(cut.axis[1:])
    side = np.array([-axis[1], axis[0]])
    sine = float(tangent @ side)
    if abs(sine) < 1e-3:
        return None
    from_mouth = start - cut.mouth[1:]
    outline = _bore_outline(cut.radius_mm, cut.travel_mm, cut.roof_mm if cut.up is not None else 0.0)
    outline = scale(outline, 1.0, 1.0 / abs(sine), origin=(0.0, 0.0))
    outline = translate(outline, float(cut.mouth[0]), -float(from_mouth @ side) / sine)
    cosine = float(tangent @ axis)
    if abs(cosine) < 1e-9:
        return outline if 0.0 < from_mouth @ axis < cut.depth_mm else None
    limits = sorted(float(depth - from_mouth @ axis) / cosine for depth in (0.0, cut.depth_mm))
    return outline.intersection(box(-FAR_MM, limits[0], FAR_MM, limits[1]))


@cache
def _bore_outline(radius_mm: float, travel_mm: float, roof_mm: float) -> Polygon:
    """The outline of a bore or a slot about its centre, with its roof towards +x and its travel along y."""
    half = max(travel_mm / 2.0, 1e-9)
    ends = LineString([(0.0, -half), (0.0, half)]).buffer(radius_mm)
    # The roof consists of the two tangents from its ridge.
    return ends.union(Point(roof_mm, 0.0)).convex_hull if roof_mm > radius_mm else ends


# A screw at the mount's top clamps its skin this far to either side: about the radius of the screw's head.
CLAMPED_MM = 3.0
# Extent of the thicker skin round the rows of the holder's screws, to either side, by how the holder holds mirrors.
# Where a step of the skin cuts the roofs of the holes for the drivers of carriers' screws, slicers support them.
HEAD_MM = {"glue": 8.0, "tape": 8.0, "screws": 18.0}
# A screw of the foot clamps the plastic on a disc of this radius, over which its pressure spreads in the adapter.
DISC_MM = 6.0
# Solid finite elements tilt up to 1.28 times as far about x as these plates, and .96 to 1.05 times about the other
# axes, over mounts of 1 x 2 to 5 x 5 mirrors (docs/parts.md). The plates neglect the interaction of openings, and cuts
# of webs where they meet a skin. With both factors, all of these mounts are at least as stiff as calculated.
KNOCK_DOWN_ABOUT_X, KNOCK_DOWN = 1.18, 1.1


def mount_compliance(
    inner: FloatArray,
    outer: FloatArray,
    section: Section,
    foot: Foot,
    screws: FloatArray,
    cuts: Sequence[Frustum | Bore | Hexagon],
    load: FloatArray,
    hardware: Hardware,
) -> FloatArray:
    """Compliance of the mirror holder on a mount whose foot is screwed to a fixed support.

    Parameters
    ----------
    inner, outer
        The lines (n, 2; y and z) that bound the mount's profile.
    section
        Its skins and webs.
    foot
        The foot, whose screws are held.
    screws : (4, 3) array
        Points in the rig frame, mm, of the head's screws on its face, two in each of two rows.
    cuts
        Openings of the mount.
    load : (3,) array
        Point in the rig frame, mm, where forces act on the holder.
    hardware
        Dimensions of the foot and the head.

    Returns
    -------
    (6, 6) array
        Column j: shift of the point in mm and rotation in rad for a unit force (j < 3, N) or moment (N mm) on the
        holder, which is assumed rigid. Conservatively large, by the knock-down factors.
    """
    webs = webs_between(inner, outer, section, hardware)
    plate = foot_plate_mm(section.depth_mm, hardware)
    # The skins meet the foot's plate at its top.
    up = foot.up_in_rig[1:]
    half_skin = section.skin_mm / section.depth_mm / 2.0
    top = [end + np.array([0.0, plate / up[1]]) for end in (inner[0], outer[0])]
    feet = [top[0] + part * (top[1] - top[0]) for part in (half_skin, 1.0 - half_skin)]
    foot_points = foot.screws_in_rig[:2, 1:] + plate * up
    head = LineString(webs.inner)
    head_mm = HEAD_MM[hardware.holder.mirrors]
    rows = [
        np.array(head.interpolate(head.project(Point(row)) + side * CLAMPED_MM).coords[0])
        for row in screws[[0, 2], 1:]
        for side in (-1.0, 1.0)
    ]
    ends = [
        np.array(head.interpolate(head.project(Point(row)) + side * head_mm).coords[0])
        for row in screws[[0, 2], 1:]
        for side in (-1.0, 1.0)
    ]
    grip = max(section.skin_mm, hardware.mount.grip_mm)
    edges = _Edges()
    strips = [
        *(
            (start, end, grip if _on_head(head, (start + end) / 2.0, screws, head_mm) else skin)
            for start, end, skin in _strips_along(
                [feet[0], *webs.inner], [*webs.webs.reshape(-1, 2), *rows, *ends], section.skin_mm
            )
        ),
        *_strips_along([feet[1], *webs.outer], webs.webs.reshape(-1, 2), section.skin_mm),
        *((start, end, plate) for start, end in pairwise([feet[0], *foot_points, feet[1]])),
        *((start, end, section.web_mm) for start, end in webs.webs),
    ]
    half_width = section.width_mm / 2.0
    through = ThroughCuts.of(cuts)
    ratios = np.array([softening(start, end, half_width, through) for start, end, _ in strips])
    plates = FoldedPlates(
        strips=np.array([(edges.at(start), edges.at(end)) for start, end, _ in strips]),
        edges=np.array(edges.points),
        thickness_mm=np.array([thickness for *_, thickness in strips]),
        modulus_mpa=section.plastic_mpa / ratios,
        poisson=POISSON,
        half_width_mm=half_width,
    )
    foot_edges = np.repeat([edges.at(point) for point in foot_points], 2)
    head_edges = np.repeat([edges.at(row) for row in rows], 2)
    compliance = plates.compliance(
        support_stiffness=disc_on_solid(DISC_MM, section.plastic_mpa),
        supports=(foot_edges, np.tile([-FOOT_X_MM, FOOT_X_MM], len(foot_points))),
        attachments=(head_edges, np.concatenate([screws[[0, 1, 0, 1], 0], screws[[2, 3, 2, 3], 0]])),
        load=load,
    )
    # Forces along y and z, and moments about x, act in the plane of the profile and are coupled.
    in_plane = np.sqrt(KNOCK_DOWN_ABOUT_X) ** np.array([0, 1, 1, 1, 0, 0])
    return np.asarray(KNOCK_DOWN * compliance * np.outer(in_plane, in_plane))


def _on_head(line: LineString, point: FloatArray, screws: FloatArray, head_mm: float) -> bool:
    """Return whether a point (2,) of the inner skin's line is on the thicker skin round the holder's screws (4, 3)."""
    position = line.project(Point(point))
    return any(abs(position - line.project(Point(row))) < head_mm for row in screws[[0, 2], 1:])


def disc_on_solid(radius_mm: float, modulus_mpa: float) -> FloatArray:
    """Stiffness (4,) of a rigid disc bonded to a half-space: along x, y and z in N/mm, about x in N mm/rad.

    It lies in the plane of x and y. Johnson, Contact Mechanics (1985), sections 3.7 and 3.8 for frictionless discs.
    """
    shear = modulus_mpa / (2.0 * (1.0 + POISSON))
    lateral = 8.0 * shear * radius_mm / (2.0 - POISSON)
    normal = 4.0 * shear * radius_mm / (1.0 - POISSON)
    return np.array([lateral, lateral, normal, 8.0 * shear * radius_mm**3 / (3.0 * (1.0 - POISSON))])


class _Edges:
    """The edges of the strips as unique points (2,; y and z)."""

    def __init__(self) -> None:
        self.points: list[FloatArray] = []
        self._index: dict[tuple[float, ...], int] = {}

    def at(self, point: FloatArray) -> int:
        key = tuple(float(value) for value in np.round(point, 3))
        if key not in self._index:
            self._index[key] = len(self.points)
            self.points.append(point)
        return self._index[key]


def _strips_along(
    line: Sequence[FloatArray], points: Sequence[FloatArray] | FloatArray, thickness_mm: float
) -> list[tuple[FloatArray, FloatArray, float]]:
    """Strips along a line, divided at its corners and at the points that are on it."""
    path = LineString(line)
    on_path = [point for point in points if path.distance(Point(point)) < 1e-6]
    ordered = sorted([*line, *on_path], key=lambda point: path.project(Point(point)))
    return [(start, end, thickness_mm) for start, end in pairwise(ordered) if float(np.linalg.norm(end - start)) > 1e-3]
