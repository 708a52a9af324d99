"""The pupil of a thin lens: a disc in the plane z = 0 of the rig that passes all light of a pixel.

The rays of a pixel intersect on its chief ray at the distance in focus. Projected from that point into the pupil, each
edge of a mirror is a straight line, so the unvignetted part of the pupil is the intersection of a disc and half-planes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.plate import tangent_in_glass

if TYPE_CHECKING:
    from mirrorcam.optics.geometry.mirror import Mirror

CHORDS = 32
"""Number of chords in the integration over a part of the disc."""
FOCUS_MM = 500.0
SHARP_VARIANCE_PX2 = 0.8**2 + 1.0 / 12.0
"""Variance along an axis of the blur of a webcam's lens in focus and its square pixels."""


@dataclass(frozen=True)
class Pupil:
    """A pupil with a diameter (0 for a pinhole) and the distance in focus along the axis.

    The pupil of a real lens walks: for chief rays (x, y, 1) it lies `walk_mm` (x^2 + y^2) nearer to the scene. The lens
    model holds at the distance in focus.
    """

    aperture_mm: float = 0.0
    focus_mm: float = FOCUS_MM
    walk_mm: float = 0.0

    @property
    def radius_mm(self) -> float:
        return self.aperture_mm / 2.0

    def centre_mm(self, normalized: FloatArray) -> FloatArray:
        """Points (..., 2) on z = 0 of rays from the walked pupil's centre to points in focus on chief rays (..., 2)."""
        walk = self.walk_mm * np.square(normalized).sum(axis=-1, keepdims=True)
        return np.asarray(-normalized * walk / (1.0 - walk / self.focus_mm))


PINHOLE = Pupil()


@dataclass(frozen=True)
class DiscPart:
    """The intersection of the unit disc with half-planes, for n sets of half-planes.

    Attributes
    ----------
    fraction
        Area (n,) as a fraction of the disc's.
    centroid
        Centroid (n, 2); 0 for an empty part.
    spread
        Second central moments xx, yy and xy (n, 3): 1/4, 1/4 and 0 for the full disc; 0 for an empty part.
    """

    fraction: FloatArray
    centroid: FloatArray
    spread: FloatArray

    def selected(self, mask: NDArray[np.bool_]) -> DiscPart:
        """The parts selected by a mask (n,)."""
        return DiscPart(self.fraction[mask], self.centroid[mask], self.spread[mask])


def concatenated(first: DiscPart, second: DiscPart) -> DiscPart:
    """Concatenate two sets of parts."""
    return DiscPart(
        np.concatenate([first.fraction, second.fraction]),
        np.concatenate([first.centroid, second.centroid]),
        np.concatenate([first.spread, second.spread]),
    )


@dataclass(frozen=True)
class HalfPlanes:
    """Half-planes in the plane of the pupil: points with direction . point + distance >= 0.

    Attributes
    ----------
    direction
        Unit vectors (n, m, 2).
    distance
        Distances (n, m) of the pupil's centre from the borders, mm; negative if it lies outside.
    """

    direction: FloatArray
    distance: FloatArray


def outline_aperture(
    mirror: Mirror, normalized: FloatArray, focus_mm: float, shift_mm: FloatArray | None = None
) -> HalfPlanes:
    """The part of the pupil whose rays meet the front of a mirror within its outline: a half-plane for each edge.

    Parameters
    ----------
    mirror
        The mirror, taken as flat.
    normalized
        Chief rays (n, 2).
    focus_mm
        Distance in focus, along the axis.
    shift_mm
        Shift (n,) along the front between the points where rays enter and leave it, away from its point nearest to
        the pupil.
    """
    rays = np.column_stack([normalized, np.ones(len(normalized))])
    corners = mirror.outline_in_rig_mm + mirror.front_mm * mirror.normal_in_rig
    edges = np.stack([corners, np.roll(corners, -1, axis=0)])
    constant, gradient, edge_vectors = edge_clearance(edges, corners.mean(axis=0), rays, 1.0 / focus_mm)
    normal_part = rays @ mirror.normal_in_rig
    if shift_mm is not None:
        in_plane = rays - normal_part[:, None] * mirror.normal_in_rig
        outward = in_plane / np.maximum(np.linalg.norm(in_plane, axis=1), 1e-12)[:, None]
        constant -= (normal_part * shift_mm)[:, None] * (outward @ np.cross(edge_vectors, mirror.normal_in_rig).T)
    length = np.linalg.norm(gradient, axis=-1)
    is_facing = normal_part < 0.0
    return HalfPlanes(gradient / length[..., None], np.where(is_facing[:, None], constant / length, -np.inf))


def edge_clearance(
    edges_mm: FloatArray, interior_mm: FloatArray, rays: FloatArray, inverse_focus_per_mm: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Signed clearance of rays from the pupil to edges: constant + gradient . p for a point p of the pupil.

    A pixel with the chief ray r collects light along r - p / focus from each point p of the pupil. The triple
    product of that direction with A - p and B - p, where A and B are the ends of an edge, is linear in p.

    Parameters
    ----------
    edges_mm
        Both ends (2, ..., m, 3) of the edges.
    interior_mm
        Points (..., 3) inside the outlines, where clearances are positive.
    rays
        Chief rays (..., n, 3).
    inverse_focus_per_mm
        Inverse of the distance in focus, 1/mm.

    Returns
    -------
    Constants (..., n, m), gradients (..., n, m, 2), and vectors (..., m, 3) along the edges, oriented so that the
    clearances of interior points are positive.
    """
    normals = np.cross(edges_mm[0], edges_mm[1])
    sign = np.sign(normals @ interior_mm[..., None])
    normals, edge_vectors = normals * sign, (edges_mm[1] - edges_mm[0]) * sign
    x, y = rays[..., 0, None], rays[..., 1, None]
    dx, dy, dz = np.moveaxis(edge_vectors[..., None, :, :], -1, 0)
    gradient = np.stack([y * dz - dy, dx - x * dz], axis=-1) - inverse_focus_per_mm * normals[..., None, :, :2]
    return rays @ np.swapaxes(normals, -1, -2), gradient, edge_vectors


def clear_aperture(mirror: Mirror, normalized: FloatArray, focus_mm: float, passes: int = 1) -> HalfPlanes:
    """The part of the pupil whose light, with chief rays (n, 2), enters and leaves the plate within its outline.

    `passes` is the number of reflections at the coating of a second-surface mirror; 0 for light reflected at its front.
    """
    entrance = outline_aperture(mirror, normalized, focus_mm)
    if passes == 0 or not mirror.is_second_surface:
        return entrance
    in_glass = tangent_in_glass(incidence_tangent(mirror, normalized), mirror.refractive_index)
    exit_ = outline_aperture(mirror, normalized, focus_mm, 2.0 * passes * mirror.thickness_mm * in_glass)
    return HalfPlanes(
        np.concatenate([entrance.direction, exit_.direction], axis=1),
        np.concatenate([entrance.distance, exit_.distance], axis=1),
    )


def incidence_tangent(mirror: Mirror, normalized: FloatArray) -> FloatArray:
    """Tangent (n,) of the angle between rays (n, 2) and the mirror's normal; at least 1e-6."""
    n = mirror.normal_in_rig
    normal_part = -(normalized @ n[:2] + n[2])
    squared = 1.0 + np.square(normalized).sum(axis=1)
    return np.sqrt(np.maximum(squared / normal_part**2 - 1.0, 1e-12))


def disc_part(planes: HalfPlanes, radius_mm: float) -> DiscPart:
    """The part of a pupil (for a pinhole, its centre) in all half-planes, in units of its radius."""
    nearest = planes.distance.min(axis=1)
    fraction = (nearest > 0.0).astype(np.float64)
    centroid, spread = np.zeros((len(nearest), 2)), fraction[:, None] * [0.25, 0.25, 0.0]
    borders = (np.abs(planes.distance) < radius_mm).sum(axis=1)
    is_crossed = np.abs(nearest) < radius_mm
    for mask, part_of in ((is_crossed & (borders == 1), _segment), (is_crossed & (borders > 1), _integrated)):
        if mask.any():
            part = part_of(planes.direction[mask], planes.distance[mask] / radius_mm)
            fraction[mask], centroid[mask], spread[mask] = part.fraction, part.centroid, part.spread
    return DiscPart(fraction, centroid, spread)


def segment_fraction(inside: FloatArray) -> FloatArray:
    """Area fraction of the unit disc on the positive side of a line at the signed distance `inside` (...)."""
    inside = np.clip(inside, -1.0, 1.0)
    return np.asarray(1.0 - (np.arccos(inside) - inside * np.sqrt(1.0 - inside**2)) / np.pi)


def _segment(direction: FloatArray, distance: FloatArray) -> DiscPart:
    """The part of the unit disc in half-planes (n, m) of which only the nearest border crosses the disc."""
    x_axis, inside = _nearest(direction, distance, 0), distance.min(axis=1)
    fraction, angle = segment_fraction(inside), np.arccos(-inside)
    sine, double, fourfold = np.sin(angle), np.sin(2.0 * angle), np.sin(4.0 * angle)
    area = np.pi * fraction
    x_mean = 2.0 / 3.0 * sine**3 / area
    xx = (angle / 4.0 - fourfold / 16.0) / area - x_mean**2
    yy = (angle / 4.0 - double / 6.0 + fourfold / 48.0) / area
    return _rotated(fraction, (x_mean, np.zeros_like(xx)), (xx, yy, np.zeros_like(xx)), x_axis)


def _integrated(direction: FloatArray, distance: FloatArray) -> DiscPart:
    """The part of the unit disc in half-planes (n, m), with an error below 3e-3 of the disc.

    Chords along the bisector of the normals of the two nearest borders are clipped exactly and integrated by the
    Gauss-Chebyshev rule.
    """
    first, second = (_nearest(direction, distance, rank) for rank in range(2))
    norm = np.linalg.norm(first + second, axis=1)
    opposite = norm < 0.1
    x_axis = np.where(opposite[:, None], first, (first + second) / np.maximum(norm, 0.1)[:, None])
    y_axis = np.column_stack([-x_axis[:, 1], x_axis[:, 0]])
    angles = np.pi * np.arange(1, CHORDS + 1) / (CHORDS + 1)
    y, half = np.cos(angles), np.sin(angles)
    low, high = np.tile(-half, (len(distance), 1)), np.tile(half, (len(distance), 1))
    for k in range(distance.shape[1]):
        slope = (direction[:, k] * x_axis).sum(axis=1)[:, None]
        inside = distance[:, k, None] + (direction[:, k] * y_axis).sum(axis=1)[:, None] * y
        # A chord parallel to the border is entirely on one side of it.
        border = -inside / np.where(np.abs(slope) > 1e-12, slope, 1e-12)
        low = np.where(slope >= 0.0, np.maximum(low, border), low)
        high = np.where(slope < 0.0, np.minimum(high, border), high)
    high = np.maximum(low, high)
    weight = half / (CHORDS + 1)
    lengths, squares, cubes = (((high**power - low**power) * weight / power) for power in (1, 2, 3))
    fraction = lengths.sum(axis=1)
    area = np.where(fraction > 0.0, fraction, 1.0)
    x_mean, y_mean = squares.sum(axis=1) / area, (lengths * y).sum(axis=1) / area
    xx = cubes.sum(axis=1) / area - x_mean**2
    yy = (lengths * y**2).sum(axis=1) / area - y_mean**2
    xy = (squares * y).sum(axis=1) / area - x_mean * y_mean
    return _rotated(fraction, (x_mean, y_mean), (xx, yy, xy), x_axis)


def _nearest(direction: FloatArray, distance: FloatArray, rank: int) -> FloatArray:
    """Unit vectors (n, 2) into the half-plane whose border has the given rank (from 0) by distance."""
    order = np.argpartition(distance, rank, axis=1)[:, rank]
    return np.asarray(direction[np.arange(len(order)), order])


def _rotated(
    fraction: FloatArray,
    mean: tuple[FloatArray, FloatArray],
    spread: tuple[FloatArray, FloatArray, FloatArray],
    x_axis: FloatArray,
) -> DiscPart:
    """Rotate moments from the frame with the given `x_axis` (n, 2) to the pupil's axes."""
    c, s = x_axis.T
    xx, yy, xy = spread
    return DiscPart(
        fraction,
        np.column_stack([c * mean[0] - s * mean[1], s * mean[0] + c * mean[1]]),
        np.column_stack(
            [
                np.maximum(c * c * xx + s * s * yy - 2.0 * c * s * xy, 0.0),
                np.maximum(s * s * xx + c * c * yy + 2.0 * c * s * xy, 0.0),
                c * s * (xx - yy) + (c * c - s * s) * xy,
            ]
        ),
    )
