"""The pupil of a thin lens: a disc in the plane z = 0 of the rig, from all of which the light of a pixel comes.

The rays of a pixel run through one point, at the distance in focus on its chief ray. Seen from there, each edge of a
mirror cuts the pupil along a straight line: the part of it that a mirror serves is the intersection of a disc with
half-planes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.mirror import Mirror

CHORDS = 24
"""Number of chords over which a part of the disc is integrated."""


@dataclass(frozen=True)
class DiscPart:
    """The part of the unit disc that lies in some half-planes, for n sets of them.

    Attributes
    ----------
    share
        Its area (n,) over that of the disc.
    centroid
        Mean place (n, 2); 0 where there is none.
    spread
        Mean xx, yy and xy (n, 3) about the centroid: 1/4, 1/4 and 0 of the whole disc; 0 where there is none.
    """

    share: FloatArray
    centroid: FloatArray
    spread: FloatArray


@dataclass(frozen=True)
class HalfPlanes:
    """Half-planes direction . point + distance >= 0 of the pupil's plane: unit `direction` (n, m, 2), `distance` (n, m).

    `distance` is that of the pupil's middle from the border, mm; negative where it lies outside.
    """

    direction: FloatArray
    distance: FloatArray


def served_by(mirror: Mirror, normalized: FloatArray, focus_mm: float, height_mm: float = 0.0) -> HalfPlanes:
    """Where in the pupil rays start that meet a mirror within its outline: a half-plane for each of its m edges.

    Parameters
    ----------
    mirror
        The mirror, as if it were flat.
    normalized
        Chief rays (n, 2).
    focus_mm
        Distance in focus, along the axis.
    height_mm
        Height over the reflecting surface, towards the pupil, of the plane that is met.
    """
    rays = np.column_stack([normalized, np.ones(len(normalized))])
    normal, nearness = mirror.normal_in_rig, 1.0 / focus_mm
    corners = mirror.outline_in_rig_mm + height_mm * normal
    inwards = np.cross(normal, np.roll(corners, -1, axis=0) - corners)
    inwards *= np.sign(((corners.mean(axis=0) - corners) * inwards).sum(axis=1))[:, None]
    away = mirror.distance_mm - height_mm
    # A ray a + t (r - a / focus) meets the plane at a height over each edge of (constant + slope . a) / a positive
    # number: terms of second order in a cancel.
    reach = (corners * inwards).sum(axis=1)
    along, beside = rays @ normal, rays @ inwards.T
    constant = along[:, None] * reach + away * beside
    slope = (
        -(along + away * nearness)[:, None, None] * inwards[:, :2]
        + (beside - nearness * reach)[..., None] * normal[:2]
    )
    length = np.linalg.norm(slope, axis=-1)
    return HalfPlanes(slope / length[..., None], constant / length)


def disc_part(planes: HalfPlanes, radius_mm: float) -> DiscPart:
    """The part of the pupil of a radius that lies in all half-planes, in units of the radius.

    Exact to 1e-3 of the disc: chords along the normal of its border, or halfway between those of its two nearest
    borders, are cut exactly, and integrated by the Gauss-Chebyshev rule.
    """
    direction, distance = planes.direction, planes.distance / radius_mm
    x_axis = _chord_direction(direction, distance)
    y_axis = np.column_stack([-x_axis[:, 1], x_axis[:, 0]])
    angles = np.pi * np.arange(1, CHORDS + 1) / (CHORDS + 1)
    y, half = np.cos(angles), np.sin(angles)
    low, high = np.tile(-half, (len(distance), 1)), np.tile(half, (len(distance), 1))
    for k in range(distance.shape[1]):
        along = (direction[:, k] * x_axis).sum(axis=1)[:, None]
        inside = distance[:, k, None] + (direction[:, k] * y_axis).sum(axis=1)[:, None] * y
        # A chord along the border is wholly on one side of it.
        border = -inside / np.where(np.abs(along) > 1e-12, along, 1e-12)
        low = np.where(along >= 0.0, np.maximum(low, border), low)
        high = np.where(along < 0.0, np.minimum(high, border), high)
    high = np.maximum(low, high)
    weight = half / (CHORDS + 1)
    length, squares, cubes = (((high**power - low**power) * weight / power) for power in (1, 2, 3))
    share = length.sum(axis=1)
    area = np.where(share > 0.0, share, 1.0)
    x_mean, y_mean = squares.sum(axis=1) / area, (length * y).sum(axis=1) / area
    xx = cubes.sum(axis=1) / area - x_mean**2
    yy = (length * y**2).sum(axis=1) / area - y_mean**2
    xy = (squares * y).sum(axis=1) / area - x_mean * y_mean
    turn = np.stack([x_axis, y_axis], axis=2)
    spread = turn @ np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2) @ turn.mT
    return DiscPart(
        share,
        (turn @ np.stack([x_mean, y_mean], axis=-1)[..., None])[..., 0],
        np.column_stack([spread[:, 0, 0], spread[:, 1, 1], spread[:, 0, 1]]),
    )


def _chord_direction(direction: FloatArray, distance: FloatArray) -> FloatArray:
    """Unit vectors (n, 2) along the chords, by the two half-planes (n, m) whose borders lie nearest to the middle."""
    rows = np.arange(len(distance))
    order = np.argsort(distance, axis=1)
    first = direction[rows, order[:, 0]]
    if distance.shape[1] == 1:
        return first
    second = direction[rows, order[:, 1]]
    both = first + second
    length = np.linalg.norm(both, axis=1)
    use = (distance[rows, order[:, 1]] < 1.0) & (length > 0.1)
    return np.where(use[:, None], both / np.maximum(length, 0.1)[:, None], first)
