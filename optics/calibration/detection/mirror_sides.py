"""Sides of a mirror in its own plane: of its outline, and of the part of it that shows the scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from shapely import Polygon

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.plate import outer_tangent


@dataclass(frozen=True)
class Side:
    """An edge of a polygon in a mirror's own frame, in mm, from `start` (2,) on; `outward` is its normal."""

    start: FloatArray
    along: FloatArray
    outward: FloatArray
    length_mm: float

    @classmethod
    def of(cls, polygon: FloatArray, edge: int) -> Side:
        start, end = polygon[edge], polygon[(edge + 1) % len(polygon)]
        length_mm = float(np.linalg.norm(end - start))
        along = (end - start) / length_mm
        outward = np.array([along[1], -along[0]])
        return cls(start, along, outward * np.sign(outward @ (start - polygon.mean(axis=0))), length_mm)

    def moved(self, other: Side, off_mm: FloatArray) -> FloatArray:
        """The line (3,), nx x + ny y = d, of this edge moved by the offsets (2,) at the ends of the nearby `other`."""
        ends = np.array([other.start, other.start + other.length_mm * other.along])
        at = (ends - self.start) @ self.along
        first, second = self.start + at[:, None] * self.along + off_mm[:, None] * self.outward
        normal = np.array([second[1] - first[1], first[0] - second[0]]) / np.linalg.norm(second - first)
        return np.array([*normal, normal @ first])


def shown_in_plane_mm(mirror: Mirror) -> FloatArray:
    """The part (n, 2) of a mirror that shows the scene, where the camera sees it on the `apparent` mirror's plane.

    For a first-surface mirror this is all of it. For a second-surface mirror, whose front is cut like its coating, it
    is where light both enters and leaves through the front. `Mirror.usable_normalized` approximates this by the chief
    ray, with errors of some pixels towards the sides. Here the corners are exact: each corner of the front is seen
    directly, and again where light leaves that entered at the corner, after twice the plate's thickness.
    """
    seen = mirror.apparent
    if not mirror.is_second_surface:
        return seen.outline_in_plane_mm
    air_mm = mirror.distance_mm - mirror.thickness_mm
    foot = -air_mm * mirror.normal_in_rig
    across = mirror.outline_in_rig_mm + mirror.distance_mm * mirror.normal_in_rig
    across_mm = np.linalg.norm(across, axis=1, keepdims=True)
    tangent = outer_tangent(across_mm, air_mm, 2.0 * mirror.thickness_mm, mirror.refractive_index)
    nearer = np.divide(air_mm * tangent, across_mm, out=np.ones_like(tangent), where=across_mm > 0.0)
    front, into = foot + across, foot + nearer * across
    shown = Polygon(front[:, :2] / front[:, 2:]).intersection(Polygon(into[:, :2] / into[:, 2:]))
    if shown.area <= 0.0:
        return np.zeros((0, 2))
    on_plane = seen.cut(np.array(shown.exterior.coords)[:-1])
    return (on_plane - seen.rig_from_plane[:3, 3]) @ seen.rig_from_plane[:3, :2]
