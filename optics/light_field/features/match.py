"""Matches of keypoints along their epipolar lines, and the slope on which most views agree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features.keypoints import DetectorName, Keypoints, differing_bits
from mirrorcam.optics.light_field.features.slope import ViewGeometry

# Views are parallel and close together: keypoints neither scale nor rotate between them.
MAX_SCALE_RATIO = 1.5
MAX_ROTATION_DEG = 25.0
# Maximum number of candidates per keypoint and view, the most similar ones; consistency over the views decides.
CANDIDATES_PER_VIEW = 4
# More candidates within this margin of the best (factor on its distance, plus a fraction of the limit) in any view mean
# that the keypoint is part of a repetitive pattern along the line, and uninformative.
REPETITION_MARGIN = (1.25, 0.1)
# Maximum distance between descriptors of one point, in bits: of 256, of 488.
MAX_DESCRIPTOR_DISTANCE: dict[DetectorName, float] = {"ORB": 64.0, "AKAZE": 110.0}
# Another slope competes if it predicts a position at least this far away, in tolerances, in the view with the largest
# parallax, and has at least this fraction of the best slope's votes.
COMPETING_PX = 3.0
COMPETING_VOTES = 0.8


@dataclass(frozen=True, eq=False)
class Candidates:
    """Matches of n keypoints of the reference view in other views; NaN if there are fewer than CANDIDATES_PER_VIEW.

    Attributes
    ----------
    inverse_distance
        Inverse distance (n, views, CANDIDATES_PER_VIEW) of each match, 1/mm.
    epipolar_distance_px
        Distance (n, views, CANDIDATES_PER_VIEW) of the match from the keypoint's epipolar line.
    rate_px_mm
        Rate (n, views, CANDIDATES_PER_VIEW) at which a match moves along this line, px per 1/mm.
    """

    inverse_distance: FloatArray
    epipolar_distance_px: FloatArray
    rate_px_mm: FloatArray


def find_candidates(
    geometry: ViewGeometry,
    reference: Keypoints,
    others: dict[int, Keypoints],
    name: DetectorName,
    inverse_distance_range: tuple[float, float],
    tolerance_px: FloatArray,
    run: Callable[..., Any],
) -> Candidates:
    """Match the reference view's keypoints between two inverse distances; `others` are keyed by view number.

    Matches lie at most `tolerance_px` (n,) off the line; `run` is `map`, or the `map` of a thread pool.
    """
    arrays = [np.full((len(reference.pixels), len(others), CANDIDATES_PER_VIEW), np.nan) for _ in range(3)]
    repeating = np.zeros(len(reference.pixels), dtype=bool)

    def match_view(column: int, view: int, other: Keypoints) -> None:
        first, matched = _epipolar_pairs(geometry, reference, other, view, inverse_distance_range, tolerance_px)
        distance = differing_bits(reference.descriptors[first], other.descriptors[matched])
        is_similar = distance <= MAX_DESCRIPTOR_DISTANCE[name]
        first, matched, distance = first[is_similar], matched[is_similar], distance[is_similar]
        order = np.lexsort((matched, distance, first))
        first, matched = first[order], matched[order]
        rank = np.arange(len(first)) - np.searchsorted(first, first)
        min_distance = distance[order][np.searchsorted(first, first)]
        close_to_best = (
            distance[order]
            <= REPETITION_MARGIN[0] * min_distance + REPETITION_MARGIN[1] * MAX_DESCRIPTOR_DISTANCE[name]
        )
        repeating[first[(rank == CANDIDATES_PER_VIEW) & close_to_best]] = True
        is_kept = rank < CANDIDATES_PER_VIEW
        first, matched, rank = first[is_kept], matched[is_kept], rank[is_kept]
        estimates = _slope_estimates(geometry, view, reference.pixels[first], other.pixels[matched])
        for array, values in zip(arrays, estimates, strict=True):
            array[first, column, rank] = values

    list(run(match_view, range(len(others)), others.keys(), others.values()))
    for array in arrays:
        array[repeating] = np.nan
    return Candidates(*arrays)


def _slope_estimates(
    geometry: ViewGeometry, view: int, reference_px: FloatArray, pixels: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Estimate from matches inverse distances (n,), 1/mm, distances from epipolar lines, and px along them per 1/mm."""
    slopes, b = geometry.terms(view, pixels)
    residual = b - geometry.focal_px[view] * geometry.directions(reference_px)
    rate = np.hypot(slopes[:, 0], slopes[:, 1])
    inverse = (slopes * residual).sum(axis=1) / rate**2
    off_line = (slopes[:, 0] * residual[:, 1] - slopes[:, 1] * residual[:, 0]) / rate
    relative_depth = 1.0 - geometry.axial_mm[view] * inverse
    return inverse, off_line / relative_depth, rate / relative_depth


def _epipolar_pairs(
    geometry: ViewGeometry,
    reference: Keypoints,
    other: Keypoints,
    view: int,
    inverse_distance_range: tuple[float, float],
    tolerance_px: FloatArray,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return pairs (reference keypoint, keypoint of a view on its epipolar line) of similar scale and angle."""
    directions = geometry.directions(reference.pixels)
    ends = np.stack([geometry.predict(view, directions, inverse) for inverse in inverse_distance_range])
    x, y = geometry.lateral_mm[view]
    # Lines are parallel except for the views' z positions: sorted along their normal, candidates are a short range.
    normal = np.array([-y, x]) / max(np.hypot(x, y), 1e-12)
    offsets = other.pixels @ normal
    order = np.argsort(offsets, kind="stable")
    start = np.searchsorted(offsets[order], (ends @ normal).min(axis=0) - tolerance_px)
    count = np.searchsorted(offsets[order], (ends @ normal).max(axis=0) + tolerance_px) - start
    first = np.repeat(np.arange(len(start)), count)
    rank = np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count)
    matched = order[np.repeat(start, count) + rank]
    rotation = np.abs((reference.angle[first] - other.angle[matched] + np.pi) % (2 * np.pi) - np.pi)
    ratio = np.abs(np.log(reference.scale_px[first] / other.scale_px[matched]))
    keep = (rotation <= np.deg2rad(MAX_ROTATION_DEG)) & (ratio <= np.log(MAX_SCALE_RATIO))
    first, matched = first[keep], matched[keep]
    inverse, off_line, rate = _slope_estimates(geometry, view, reference.pixels[first], other.pixels[matched])
    tolerance = tolerance_px[first]
    tolerance_w = tolerance / rate
    keep = np.abs(off_line) <= tolerance
    keep &= (inverse >= min(inverse_distance_range) - tolerance_w) & (
        inverse <= max(inverse_distance_range) + tolerance_w
    )
    return first[keep], matched[keep]


def vote(matches: Candidates, tolerance_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the inverse distances (n,) on which most views agree, and competing ones (n,); NaN if there is none.

    Each match of a keypoint proposes its slope; every view votes by the distance of its nearest match, with no vote
    beyond `tolerance_px` (n,). The slope with the most votes is refined by the matches that voted for it.
    """
    count, views, per_view = matches.inverse_distance.shape
    proposals = matches.inverse_distance.reshape(count, views * per_view)
    votes = np.zeros_like(proposals)
    weighted, weights = np.zeros_like(proposals), np.zeros_like(proposals)
    tolerance_squared = tolerance_px[:, None, None] ** 2
    for view in range(views):
        if np.isnan(matches.inverse_distance[:, view]).all():
            continue
        inverse, rate = matches.inverse_distance[:, view, None, :], matches.rate_px_mm[:, view, None, :]
        parallel_px = (proposals[:, :, None] - inverse) * rate
        distance_squared = parallel_px**2 + matches.epipolar_distance_px[:, view, None, :] ** 2
        distance_squared = np.where(np.isnan(distance_squared), np.inf, distance_squared)
        best = distance_squared.argmin(axis=2)[..., None]
        vote_weight = np.maximum(
            1.0 - np.take_along_axis(distance_squared, best, 2)[..., 0] / tolerance_squared[..., 0], 0.0
        )
        weight = np.where(
            vote_weight > 0, np.take_along_axis(np.broadcast_to(rate, distance_squared.shape), best, 2)[..., 0] ** 2, 0
        )
        chosen = np.take_along_axis(np.broadcast_to(inverse, distance_squared.shape), best, 2)[..., 0]
        votes += vote_weight
        weights += weight
        weighted += np.where(weight > 0, weight * chosen, 0.0)
    best = votes.argmax(axis=1)[:, None]
    winner, winning_votes = np.take_along_axis(proposals, best, 1), np.take_along_axis(votes, best, 1)
    max_rate = np.nanmax(np.where(np.isnan(matches.rate_px_mm), 0.0, matches.rate_px_mm), axis=(1, 2), initial=0.0)[
        :, None
    ]
    total = np.take_along_axis(weights, best, 1)
    inverse = np.where(total > 0, np.take_along_axis(weighted, best, 1) / np.where(total > 0, total, 1.0), np.nan)
    with np.errstate(invalid="ignore"):
        distant = np.abs(proposals - winner) * max_rate > COMPETING_PX * tolerance_px[:, None]
    distant_votes = np.where(distant, votes, 0.0)
    runner_up = distant_votes.argmax(axis=1)[:, None]
    competes = np.take_along_axis(distant_votes, runner_up, 1) > COMPETING_VOTES * winning_votes
    return inverse[:, 0], np.where(competes, np.take_along_axis(proposals, runner_up, 1), np.nan)[:, 0]
