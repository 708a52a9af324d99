"""Gaps between mirrors, in space and between their sub-images, and the mirrors' edges and areas."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.optimize import nnls
from shapely import Polygon

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror import Mirror


def hull_distance(first: FloatArray, second: FloatArray) -> float:
    """Distance between the convex hulls of two point sets (n, 3) and (m, 3); 0 if they meet.

    Lawson and Hanson's least-distance programming: let D hold all pairwise differences. The w >= 0 that minimises
    |D w|^2 + (1 - sum w)^2 gives the point D w / sum w of hull(D) nearest to the origin; the minimum is
    d^2 / (1 + d^2).
    """
    differences, weights = _least_distance(first, second)
    return float(np.linalg.norm(differences @ weights) / weights.sum())


def closest_points(first: FloatArray, second: FloatArray) -> FloatArray:
    """Closest points (2, 3) of the convex hulls of point sets (n, 3) and (m, 3); equal if the hulls meet.

    See `hull_distance`.
    """
    _, weights = _least_distance(first, second)
    pairs = (weights / weights.sum()).reshape(len(first), len(second))
    return np.array([pairs.sum(axis=1) @ first, pairs.sum(axis=0) @ second])


def _least_distance(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """All differences (3, n m) of two point sets, and their weights for the point of their hull nearest the origin."""
    differences = (first[:, None] - second[None, :]).reshape(-1, 3).T
    scale = float(np.abs(differences).max())
    system = np.vstack([differences / scale, np.ones(differences.shape[1])])
    weights, _ = nnls(system, np.array([0.0, 0.0, 0.0, 1.0]))
    return differences, weights


def stacked(arrays: Sequence[FloatArray]) -> FloatArray:
    """Stack arrays (k_i, ...) to (n, max k, ...); shorter ones repeat their last row, which changes no extremum."""
    longest = max(len(array) for array in arrays)
    return np.stack([np.concatenate([a, np.repeat(a[-1:], longest - len(a), axis=0)]) for a in arrays])


def _min_gaps_mm(mirrors: Sequence[Mirror]) -> FloatArray:
    """Lower bounds (n, n) on the distances between solids, mm: the largest separation along the normal of a face."""
    corners = stacked([mirror.solid.corners_in_rig_mm for mirror in mirrors])
    faces = [mirror.solid.half_spaces for mirror in mirrors]
    normals, offsets = stacked([normals for normals, _ in faces]), stacked([offsets for _, offsets in faces])
    heights = np.tensordot(normals, corners, axes=(2, 2)) - offsets[:, :, None, None]
    gaps = heights.min(axis=3).max(axis=1)
    return np.maximum(np.maximum(gaps, gaps.T), 0.0)


def pairs_closer_than(mirrors: Sequence[Mirror], gap_mm: float) -> list[tuple[int, int]]:
    """Pairs i < j of mirrors whose solids are less than `gap_mm` apart."""
    corners = [mirror.solid.corners_in_rig_mm for mirror in mirrors]
    candidates = np.argwhere(np.triu(_min_gaps_mm(mirrors) < gap_mm, 1))
    return [(int(i), int(j)) for i, j in candidates if hull_distance(corners[i], corners[j]) < gap_mm]


def smallest_gap_mm(mirrors: Sequence[Mirror]) -> float:
    """Smallest distance between the solids of any two mirrors, mm; 0 if two meet, infinite for a single mirror."""
    corners = [mirror.solid.corners_in_rig_mm for mirror in mirrors]
    first, second = np.triu_indices(len(corners), 1)
    bounds = _min_gaps_mm(mirrors)[first, second]
    smallest = float("inf")
    for k in np.argsort(bounds, kind="stable"):
        if bounds[k] >= smallest:
            break
        smallest = min(smallest, hull_distance(corners[first[k]], corners[second[k]]))
    return smallest


def edges_mm(mirror: Mirror) -> FloatArray:
    """Lengths (n,) of the outline's edges."""
    outline = mirror.outline_in_rig_mm
    return np.array([np.linalg.norm(b - a) for a, b in pairwise([*outline, outline[0]])])


def area_mm2(mirror: Mirror) -> float:
    """Area of the outline, by the shoelace formula in the mirror's plane."""
    x, y = mirror.outline_in_plane_mm.T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0)


def _sub_image_gaps(mirrors: Sequence[Mirror]) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """All pairs i < j and the distances between their sub-images, in normalized coordinates."""
    sub_images = np.array([Polygon(mirror.apparent.outline_normalized) for mirror in mirrors])
    first, second = np.triu_indices(len(sub_images), 1)
    return first, second, shapely.distance(sub_images[first], sub_images[second])


def sub_images_closer_than(mirrors: Sequence[Mirror], gap: float) -> list[tuple[int, int]]:
    """Pairs i < j of mirrors whose sub-images are less than `gap` apart, in normalized coordinates."""
    return [(int(i), int(j)) for i, j, distance in zip(*_sub_image_gaps(mirrors), strict=True) if distance < gap]


def smallest_sub_image_gap(mirrors: Sequence[Mirror]) -> float:
    """Smallest distance between any two sub-images, in normalized coordinates; infinite for a single mirror."""
    return float(_sub_image_gaps(mirrors)[2].min(initial=np.inf))
