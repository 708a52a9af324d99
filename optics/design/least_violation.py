"""Violations of a spec that no layout meets: the mirrors involved, and the segments to draw."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise, product

import numpy as np
import shapely
from shapely import LineString, Point, Polygon

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.chief_rays import blocked_light
from mirrorcam.optics.design.program.seeds import Seed, mirrors_of
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.mirror import Mirror, reflect
from mirrorcam.optics.geometry.mirror_gaps import area_mm2, closest_points, edges_mm, hull_distance
from mirrorcam.optics.geometry.violation import LeastViolation, Violation

MET_MM = 1e-3
"""Constraints violated by no more than this count as met."""

BEAM_LENGTH = 5.0
"""Length of beams, as a multiple of the distance from a virtual centre to a corner of its mirror."""


def least_violation(
    spec: DesignSpec, constraint: str, mirrors: tuple[FloatArray, FloatArray], regions: FloatArray | None = None
) -> LeastViolation | None:
    """The violations of a constraint by the mirrors with the smallest violation of a spec.

    Parameters
    ----------
    spec
        The spec.
    constraint
        The constraint, as named by `InfeasibleDesign`.
    mirrors
        Virtual centres (n, 3) in view axes, in units of the design scale, and normalized corners (n, sides, 2) of the
        sub-images.
    regions
        Corners (depths, k, 2) in view axes, in units of the design scale, of the regions that all views must show.

    Returns
    -------
    LeastViolation or None
        None if the mirrors are impossible because a plate reaches past the pupil.
    """
    centres, corners = mirrors
    try:
        solids = mirrors_of(spec, centres * spec.scale_mm, corners)
    except InfeasibleDesign:
        return None
    violations = _overlap(spec, solids, regions) if constraint == "overlap" else FINDERS[constraint](spec, solids)
    worst_first = sorted(violations, key=lambda violation: -violation.missing_mm)
    return LeastViolation(constraint=constraint, mirrors=solids, violations=tuple(worst_first))


def past_the_pupil(spec: DesignSpec, seed: Seed, excess_mm: float) -> LeastViolation:
    """The violation by plates so thick that they reach past the pupil, for a seed with thin mirrors.

    The segment runs from the pupil along its axis to the central mirror.
    """
    centre = spec.arrangement.central_index
    thin = mirrors_of(spec.replaced(surface="first"), seed.centres * spec.scale_mm, seed.corners)
    segment = np.array([np.zeros(3), thin[centre].outline_in_rig_mm.mean(axis=0)])
    violation = Violation(mirrors=(centre,), missing_mm=excess_mm, place_in_rig_mm=segment)
    return LeastViolation(constraint="occlusion", mirrors=thin, violations=(violation,))


def _pairs(mirrors: Sequence[Mirror]) -> Iterator[tuple[int, int]]:
    return ((i, j) for i in range(len(mirrors)) for j in range(i + 1, len(mirrors)))


def _violation(mirrors: tuple[int, ...], excess_mm: float, segment: FloatArray | list[FloatArray]) -> list[Violation]:
    if excess_mm <= MET_MM:
        return []
    return [Violation(mirrors=mirrors, missing_mm=excess_mm, place_in_rig_mm=np.asarray(segment))]


def _spacing(spec: DesignSpec, mirrors: tuple[Mirror, ...]) -> list[Violation]:
    """Pairs of mirrors that are too close, with their closest points."""
    violations = []
    for i, j in _pairs(mirrors):
        first, second = (mirrors[k].solid.corners_in_rig_mm for k in (i, j))
        violations += _violation((i, j), spec.spacing_mm - hull_distance(first, second), closest_points(first, second))
    return violations


def _sub_image_gap(spec: DesignSpec, mirrors: tuple[Mirror, ...]) -> list[Violation]:
    """Pairs of sub-images that are too close, with their closest points in the image, mapped onto the mirrors."""
    violations = []
    for i, j in _pairs(mirrors):
        faces = [mirrors[k].apparent for k in (i, j)]
        line = shapely.shortest_line(*(Polygon(face.outline_normalized) for face in faces))
        segment = [face.intersect(np.array(end)) for face, end in zip(faces, line.coords, strict=True)]
        violations += _violation((i, j), spec.seen_gap_mm - line.length * spec.scale_mm, segment)
    return violations


def _size(spec: DesignSpec, mirrors: tuple[Mirror, ...]) -> list[Violation]:
    """Mirrors with too short an edge or too small an area (by its square root), with their shortest edge."""
    violations = []
    for k, mirror in enumerate(mirrors):
        lengths, outline = edges_mm(mirror), mirror.outline_in_rig_mm
        shortest = int(lengths.argmin())
        ends = list(pairwise([*outline, outline[0]]))[shortest]
        short_mm = spec.min_edge_mm - float(lengths[shortest])
        small_mm = float(np.sqrt(spec.min_area_mm2) - np.sqrt(area_mm2(mirror)))
        violations += _violation((k,), max(short_mm, small_mm), list(ends))
    return violations


def _depth(spec: DesignSpec, mirrors: tuple[Mirror, ...]) -> list[Violation]:
    """Mirrors that reach past the nearest depth, with the line from their farthest corner back to it."""
    violations, view_axis = [], spec.view_from_rig[2]
    for k, mirror in enumerate(mirrors):
        corners = mirror.solid.corners_in_rig_mm
        farthest = corners[int((corners @ view_axis).argmax())]
        excess_mm = float(farthest @ view_axis) - min(spec.depths_mm)
        violations += _violation((k,), excess_mm, [farthest, farthest - excess_mm * view_axis])
    return violations


def _occlusion(spec: DesignSpec, mirrors: tuple[Mirror, ...]) -> list[Violation]:
    """Mirrors that block others' light, with the closest points of solid and beam; by the root of the shadowed area."""
    violations = []
    light = blocked_light(mirrors, max(spec.depths_mm), view_axis=spec.view_from_rig[2], pupil=spec.camera.pupil)
    for blocked in light:
        face, solid = mirrors[blocked.mirror].apparent, mirrors[blocked.occluder].solid.corners_in_rig_mm
        outline = face.outline_in_rig_mm
        ends = np.zeros((1, 3)) if blocked.leg == "in" else _beam(face)
        shadow_mm = float(np.sqrt(blocked.fraction * area_mm2(face)))
        segment = closest_points(np.concatenate([outline, ends]), solid)
        violations += _violation((blocked.mirror, blocked.occluder), shadow_mm, segment)
    return violations


def _beam(face: Mirror) -> FloatArray:
    """Ends (n, 3) of the rays that leave a mirror through the corners of its face."""
    outline = face.outline_in_rig_mm
    return outline + BEAM_LENGTH * (outline - face.virtual_centre_in_rig_mm)


def _body(spec: DesignSpec, mirrors: tuple[Mirror, ...]) -> list[Violation]:
    """Mirrors, or beams leaving them, inside a box around the camera's body or lens, with closest points."""
    violations = []
    for (k, mirror), box in product(enumerate(mirrors), spec.keep_outs_in_rig_mm):
        face = mirror.apparent
        rays = face.outline_in_rig_mm - face.virtual_centre_in_rig_mm
        sides = np.cross(rays, np.roll(rays, -1, axis=0))
        beam = np.concatenate([face.outline_in_rig_mm, _beam(face)])
        for hull, normals in ((mirror.solid.corners_in_rig_mm, mirror.solid.half_spaces[0]), (beam, sides)):
            violations += _violation((k,), _depth_in_box_mm(hull, normals, box), closest_points(hull, box))
    return violations


def _depth_in_box_mm(points: FloatArray, normals: FloatArray, box: FloatArray) -> float:
    """Smallest shift along an axis or a normal (k, 3) that moves the hull of points out of a box; 0 if outside."""
    if hull_distance(points, box) > MET_MM:
        return 0.0
    directions = np.concatenate([np.eye(3), normals / np.linalg.norm(normals, axis=1, keepdims=True)])
    directions = np.concatenate([directions, -directions])
    return float(((box @ directions.T).max(axis=0) - (points @ directions.T).min(axis=0)).min())


def _overlap(spec: DesignSpec, mirrors: tuple[Mirror, ...], regions: FloatArray | None) -> list[Violation]:
    """Mirrors that do not show the entire region, with the line from the edge to the farthest corner's image."""
    violations = []
    for depth_mm, region in zip(spec.depths_mm, regions if regions is not None else [], strict=False):
        points = np.column_stack([region * spec.scale_mm, np.full(len(region), depth_mm)]) @ spec.view_from_rig
        for k, mirror in enumerate(mirrors):
            face = mirror.apparent
            images = reflect(points, face.virtual_centre_in_rig_mm)
            outline, image_corners = Polygon(face.outline_normalized), images[:, :2] / images[:, 2:]
            outside = [outline.distance(Point(corner)) for corner in image_corners]
            line: LineString = shapely.shortest_line(outline, Point(image_corners[int(np.argmax(outside))]))
            segment = face.intersect(np.array(line.coords))
            violations += _violation((k,), float(np.linalg.norm(segment[1] - segment[0])), segment)
    return violations


FINDERS = {
    "spacing": _spacing,
    "seen gap": _sub_image_gap,
    "size": _size,
    "depth": _depth,
    "occlusion": _occlusion,
    "body": _body,
}
"""Functions that find the violations of each constraint; `_overlap` also takes regions."""
