"""Depth of the reference view from all views of a light field, with its uncertainty.

The coarsest pyramid level is searched over all planes; finer ones, near the depth of the previous level (`search`). A
plane sweep gives each pixel a cost at each depth (`cost`): first with competing views, then with the occlusion that
follows from the first depth (`sweep`). Paths along slanted surfaces select a plane (`semiglobal`). Depth edges are
moved to picture edges, and Gauss-Newton steps with a smoothness prior refine the depth (`refine`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.arguments import check_choice, check_count, check_number, check_type
from mirrorcam.core.bounds import WORKERS
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.threads import thread_map
from mirrorcam.optics.light_field.depth.confidence import attainable_probability, log_odds, statistics, unbrightened
from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.depth.enlargement import doubled, enlarged_by_picture
from mirrorcam.optics.light_field.depth.parallax import Parallax, other_views, parallax, reference_index
from mirrorcam.optics.light_field.depth.photometry import (
    ViewPicture,
    colours,
    halved_picture,
    smoothed,
    smoothing_px,
)
from mirrorcam.optics.light_field.depth.refine import JUMP_PX, GradientPicture, Match, Refiner, align_to_picture_edges
from mirrorcam.optics.light_field.depth.search import MAX_FINE_PLANES, LevelViews, PyramidLevel, search
from mirrorcam.optics.light_field.depth.semiglobal import LowestCost, aggregate, lowest_cost
from mirrorcam.optics.light_field.depth.sweep import Volume, full_range, range_around, tracked_range
from mirrorcam.optics.light_field.depth.track import Track
from mirrorcam.optics.light_field.depth.uncertainty import standard_deviation_px
from mirrorcam.optics.light_field.depth.view_comparison import ViewComparison, rough_gain
from mirrorcam.optics.light_field.light_field import LightField, Views

Float32 = NDArray[np.float32]
Quality = Literal["best", "fast"]
DEFAULT_NEAR, DEFAULT_FAR = 0.6, 2.0
"""Default search range, as multiples of the reference depth."""
MAX_COSTS = 2**26
"""Maximum number of pixels times planes of the first search, over all planes."""
MAX_NEAR_COSTS = 2**28
"""The same for a search near a known depth; above it, the result of the coarser level is kept."""
MIN_SEARCHED_PX = 48
"""Minimum side of a picture that is searched after halving."""
MIN_SIDE_PX = 16
MIN_OTHERS = 2
"""Other views that must see a point, or all of them if they are fewer."""
MAX_CHANGED = 0.5
"""Fraction of changed pixels above which a frame of a video is measured on its own."""
ROUGH_HALVINGS, ROUGH_DIRECTIONS = 2, 4
"""Halvings and directions of the search by which the noise of a single light field is measured."""
NOISE_GAIN = 0.2
"""Weight of the last frame of a video in the noise that the next frame is smoothed by."""
MAX_FEW_VIEWS = 2
"""Number of other views up to which both qualities search from a quarter of the size to the full size, along four
directions: on real pairs, paths in more directions smooth too much."""


@dataclass(frozen=True)
class _Effort:
    """Work per quality level.

    Attributes
    ----------
    first_halvings, last_halvings
        Number of times that pictures are halved for the first search, and for the last.
    directions
        Number of directions of the paths of each search.
    slanted_rounds
        Further rounds of the first search, along the slanted surfaces of the round before.
    with_occlusion
        Whether each search is repeated with the occlusion that its result implies.
    steps
        Gauss-Newton steps of the refinement.
    iterations
        Iterations of conjugate gradients in each step.
    """

    first_halvings: int
    last_halvings: int
    directions: int
    slanted_rounds: int
    with_occlusion: bool
    steps: int
    iterations: int


EFFORTS = {"best": _Effort(1, 0, 8, 2, True, 2, 200), "fast": _Effort(2, 1, 4, 1, False, 1, 30)}


@dataclass(frozen=True, eq=False)
class _SearchResult:
    """Search results.

    Attributes
    ----------
    planes
        Planes (j, i) at the last level to search, with depth edges at picture edges.
    margin, rivals
        Margin and rivals (v, u) of the last search at full size, see `LowestCost`.
    first_rivals
        Rivals (v, u) of the first search, over all planes, at full size.
    halved
        Whether the last search was at half size.
    """

    planes: Float32
    margin: Float32
    rivals: Float32
    first_rivals: Float32
    halved: bool


class DepthEstimator:
    """Estimates the depth of light fields of one geometry; builds everything common to all frames once.

    Parameters
    ----------
    light_field
        A light field whose views and weights equal those to be estimated.
    near_mm, far_mm
        Nearest and farthest depth to search, from the pupil along view z; by default 0.6 and 2 times the reference
        depth. `far_mm` may be infinite.
    quality
        "best", or "fast" for videos, which searches at a quarter and at half the size.
    workers
        Number of threads; by default OpenCV's.

    Raises
    ------
    InputError
        If there are fewer than two views, all views coincide, views are too small, or the depths do not increase, lie
        between the views, span too many planes, or are so far from the reference depth that the views share no point;
        for an unknown quality or number of workers.
    """

    def __init__(
        self,
        light_field: LightField,
        *,
        near_mm: float | None = None,
        far_mm: float | None = None,
        quality: Quality = "best",
        workers: int | None = None,
    ) -> None:
        check_type("light_field", light_field, LightField)
        for name, depth_mm in {"near_mm": near_mm, "far_mm": far_mm}.items():
            if depth_mm is not None:
                check_number(name, depth_mm)
        check_choice("quality", quality, *EFFORTS)
        if workers is not None:
            check_count("workers", workers, WORKERS)
        geometry: dict[str, Any] = {field.name: getattr(light_field, field.name) for field in fields(Views)}
        self.views = Views(**geometry)
        self.weights = light_field.weights
        near = DEFAULT_NEAR * self.views.reference_depth_mm if near_mm is None else near_mm
        far = DEFAULT_FAR * self.views.reference_depth_mm if far_mm is None else far_mm
        _check(self.views, near, far)
        self.near_mm, self.far_mm = float(near), float(far)
        self.reference, self.others = reference_index(self.views), other_views(self.views)
        self.workers = workers or cv2.getNumThreads()
        self._run = thread_map(self.workers)
        parallaxes = [parallax(self.views, index) for index in self.others]
        self._check_shared(parallaxes)
        self._effort = EFFORTS[quality]
        if len(self.others) <= MAX_FEW_VIEWS:
            self._effort = replace(self._effort, first_halvings=2, last_halvings=0, directions=4)
        self._levels = self._levels_to_search()
        self._rough = self._coarse_level(ROUGH_HALVINGS)
        self._full = PyramidLevel.of(self.views, self.near_mm, self.far_mm, 0)
        self._comparison = ViewComparison(self._full.sweep, parallaxes, self._run)
        last = self._levels[-1]
        self._refiner = Refiner(last.sweep, parallaxes, self._run, 2**last.halvings)

    def _check_shared(self, parallaxes: Sequence[Parallax]) -> None:
        """Raise InputError if no pixel can have a depth: within the range, too few views show the same point.

        Views share most at the depth of the range that is nearest to the reference depth.
        """
        depth_mm = float(np.clip(self.views.reference_depth_mm, self.near_mm, self.far_mm))
        inverse_distance = 1.0 / (depth_mm - self.views.reference_view_depth_mm)
        size = self.views.width_px, self.views.height_px
        count = np.zeros(size[::-1], np.uint16)
        for index, view in zip(self.others, parallaxes, strict=True):
            valid = (self.weights[index] > 0).astype(np.uint8)
            flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
            count += cv2.warpAffine(valid, view.affine(inverse_distance), size, flags=flags)
        if not (count[self.weights[self.reference] > 0] >= min(MIN_OTHERS, len(self.others))).any():
            raise InputError(
                f"near_mm {self.near_mm:g}, far_mm {self.far_mm:g}: the views share no point at these depths, expected "
                f"depths in mm, such as the reference depth, {self.views.reference_depth_mm:g} mm"
            )

    def _coarse_level(self, halvings: int) -> PyramidLevel:
        """Return the level to search over all planes after at least `halvings`, fewer for small pictures."""

        def level(halvings: int) -> PyramidLevel:
            return PyramidLevel.of(self.views, self.near_mm, self.far_mm, halvings, MAX_FINE_PLANES)

        max_halvings = max(int(np.log2(min(self.views.width_px, self.views.height_px) / MIN_SEARCHED_PX)), 0)
        found = level(min(halvings, max_halvings))
        while found.cost_count > MAX_COSTS and found.halvings < max_halvings:
            found = level(found.halvings + 1)
        return found

    def _levels_to_search(self) -> list[PyramidLevel]:
        """Return the pyramid levels to search, coarsest first."""
        first = self._coarse_level(self._effort.first_halvings)
        finer = range(first.halvings - 1, self._effort.last_halvings - 1, -1)
        return [first, *(PyramidLevel.of(self.views, self.near_mm, self.far_mm, halvings) for halvings in finer)]

    @property
    def plane_count(self) -> int:
        """Number of planes of the finest sweep."""
        return self._levels[-1].sweep.plane_count

    def fits(self, light_field: LightField) -> bool:
        """Return whether a light field has the views and weights of this estimator."""
        pairs = [(getattr(light_field, field.name), getattr(self.views, field.name)) for field in fields(Views)]
        pairs.append((light_field.weights, self.weights))
        return all(ours is theirs or np.array_equal(ours, theirs) for ours, theirs in pairs)

    def estimate(self, light_field: LightField) -> DepthMap:
        """Return the depth of the reference view of a light field with this estimator's geometry.

        Raises InputError if views or weights of the light field differ.
        """
        check_type("light_field", light_field, LightField)
        return self.following(light_field, None, None)[0]

    def following(
        self, light_field: LightField, track: Track | None, changed: NDArray[np.bool_] | None
    ) -> tuple[DepthMap, Track]:
        """Return the depth of a frame of a video, and what the next frame starts from.

        All planes are searched where the reference view has `changed` (v, u), and everywhere in turn; elsewhere, those
        near the depth of the previous frame, given its `track`. Without either, the frame is measured on its own.
        """
        if not self.fits(light_field):
            raise InputError("light field differs in views or weights from the one that the estimator was built for")
        if changed is None or changed.mean() > MAX_CHANGED:
            track = None
        pictures = list(self._run(lambda index: ViewPicture.of(light_field, index), [self.reference, *self.others]))
        colour, compared = colours(light_field, self.reference), self._compared(track)
        if track is None:
            reference, others = pictures[0], pictures[1:]
            gains = list(self._run(lambda other: rough_gain(other.grey, reference.grey), others))
            others = _multiplied(others, gains)
            rough_planes = self._rough_planes(colour, reference, others)
            noise = self._comparison.noise_ratio(reference, others, rough_planes, compared)
        else:
            gains, noise = track.gains, track.noise_ratio
        deviation_px = smoothing_px(noise)
        reference, *others = self._run(lambda picture: picture.smoothed(deviation_px), pictures)
        pyramid = self._pyramid(smoothed(colour, deviation_px))
        others = _multiplied(others, gains)
        first = self._first_search(pyramid, reference, others, track, changed)
        first_planes = self._full.enlarged(first, self._levels[0]).planes
        if track is not None:
            unsmoothed = _multiplied(pictures[1:], gains)
            now = self._comparison.noise_ratio(pictures[0], unsmoothed, first_planes, compared)
            noise += NOISE_GAIN * (now - noise)
        for number, gain in self._comparison.gains(reference, others, first_planes, compared):
            gains = [*gains[:number], gains[number] * gain, *gains[number + 1 :]]
            others[number] = others[number].multiplied(gain)
        result = self._finer_searches(pyramid, reference, others, first, track)
        earlier = None if track is None else track.planes
        planes, depth_map = self._refined(result, pyramid, reference, others, noise, earlier)
        return depth_map, Track(gains, first, planes, noise, 0 if track is None else track.frame + 1)

    def compile_ahead(self, light_field: LightField) -> None:
        """Compile what follows the matching costs, cached for another process, which meanwhile computes them.

        The light field may be small; depths are not computed.
        """
        reference, *others = (ViewPicture.of(light_field, index) for index in (self.reference, *self.others))
        pyramid, level = self._pyramid(colours(light_field, self.reference)), self._levels[-1]
        flat, ranges = np.zeros(level.shape, np.float32), full_range(level.shape, level.sweep.plane_count)
        volume = Volume(ranges, np.zeros(ranges.size, np.uint16))
        found = lowest_cost(aggregate(volume, pyramid[level.halvings], (flat, flat), penalties=(0, 0)), 1.0)
        result = self._result(found, level, np.zeros(self._full.shape, np.float32), pyramid)
        self._refined(result, pyramid, reference, others, 1.0, None)

    def _pyramid(self, colour: Float32) -> list[Float32]:
        """Return the reference view's colours (v, u, 3), halved ever more up to the coarsest level."""
        pyramid = [colour]
        for _ in range(max(self._levels[0].halvings, self._rough.halvings)):
            pyramid.append(halved_picture(pyramid[-1]))
        return pyramid

    def _rough_planes(self, colour: Float32, reference: ViewPicture, others: list[ViewPicture]) -> Float32:
        """Return planes (v, u) by a rough search, good enough to compare views and so measure noise."""
        level = self._rough
        views = LevelViews.of(level, reference, others, self._run)
        found = search(level, self._pyramid(colour)[level.halvings], views, self._run, directions=ROUGH_DIRECTIONS)
        return self._full.enlarged(found, level).planes

    def _first_search(
        self,
        pyramid: list[Float32],
        reference: ViewPicture,
        others: list[ViewPicture],
        track: Track | None,
        changed: NDArray[np.bool_] | None,
    ) -> LowestCost:
        """Return the result at the coarsest level. `pyramid` holds the reference view's colours."""
        level, ranges = self._levels[0], None
        views = LevelViews.of(level, reference, others, self._run)
        arguments = level, pyramid[level.halvings], views, self._run
        if track is not None and changed is not None:
            ranges = track.first_ranges(level, changed)
        directions, rounds = self._effort.directions, self._effort.slanted_rounds
        found = search(*arguments, directions=directions, rounds=rounds, ranges=ranges)
        if self._effort.with_occlusion:
            found = search(*arguments, directions=directions, earlier=found, ranges=ranges)
        if track is None or ranges is None:
            return found
        all_planes = ranges.plane_count == level.sweep.plane_count
        return replace(found, rivals=np.where(all_planes, found.rivals, track.first.rivals))

    def _finer_searches(
        self,
        pyramid: list[Float32],
        reference: ViewPicture,
        others: list[ViewPicture],
        first: LowestCost,
        track: Track | None,
    ) -> _SearchResult:
        """Return the result of the searches near the result of the first, level by level."""
        level, found = self._levels[0], first
        first_rivals = self._full.enlarged(first, level).rivals
        for finer in self._levels[1:]:
            result = finer.enlarged(found, level)
            views = LevelViews.of(finer, reference, others, self._run)
            for again in range(1 + self._effort.with_occlusion):
                if track is not None and finer is self._levels[-1]:
                    ranges = tracked_range([result.planes, track.planes], finer.sweep.plane_count)
                elif again:
                    ranges = tracked_range([result.planes], finer.sweep.plane_count)
                else:
                    ranges = range_around(result.planes, finer.sweep.plane_count)
                if ranges.size > MAX_NEAR_COSTS:
                    return self._result(found, level, first_rivals, pyramid)
                result = search(
                    finer,
                    pyramid[finer.halvings],
                    views,
                    self._run,
                    directions=self._effort.directions,
                    earlier=result,
                    ranges=ranges,
                )
            found, level = result, finer
        return self._result(found, level, first_rivals, pyramid)

    def _result(
        self, found: LowestCost, level: PyramidLevel, first_rivals: Float32, pyramid: list[Float32]
    ) -> _SearchResult:
        """Return what a level found. Depth edges move to picture edges before the map is enlarged."""
        planes = align_to_picture_edges(found.planes, pyramid[level.halvings], self._jump(level), self._run)
        enlarged = self._full.enlarged(found, level)
        planes = self._enlarged(planes, pyramid, level, self._levels[-1])
        return _SearchResult(planes, enlarged.margin, enlarged.rivals, first_rivals, level.halvings > 0)

    def _jump(self, level: PyramidLevel) -> float:
        """Return the difference of planes of a level at a depth edge."""
        full = self._full.sweep
        return 2**level.halvings * JUMP_PX / full.step_px * full.step / level.sweep.step

    def _enlarged(self, planes: Float32, pyramid: list[Float32], level: PyramidLevel, finer: PyramidLevel) -> Float32:
        """Return planes (j, i) of a level at a finer one, as planes of the latter, guided by the picture."""
        planes = finer.sweep.planes(level.sweep.inverse_distance(planes))
        sizes = pyramid[finer.halvings : level.halvings + 1]
        for large, small in reversed(list(pairwise(sizes))):
            planes = enlarged_by_picture(planes, small, large, self._jump(finer), self._run)
        return planes

    def _compared(self, track: Track | None) -> Sequence[int]:
        """Return the numbers of the other views to compare: all of them, or of a video one per frame in turn.

        Mirrors do not change.
        """
        return range(len(self.others)) if track is None else [track.frame % len(self.others)]

    def _refined(
        self,
        result: _SearchResult,
        pyramid: list[Float32],
        reference: ViewPicture,
        others: list[ViewPicture],
        noise: float,
        earlier: Float32 | None,
    ) -> tuple[Float32, DepthMap]:
        """Return refined planes (j, i) of the last level, and the depth map; a video has `earlier` refined planes."""
        spacing = self._refiner.spacing
        gradients = list(
            self._run(lambda view: GradientPicture.of(view.brightness, view.interior, spacing), [reference, *others])
        )
        steps = self._effort.steps, self._effort.iterations
        planes, match, smoothness = self._refiner.refined(result.planes, gradients[0], gradients[1:], *steps, earlier)
        full = planes
        if spacing > 1:
            full = self._enlarged(planes, pyramid, self._levels[-1], self._full)
            match, smoothness = match.enlarged(self._full.shape), doubled(smoothness, self._full.shape)
        return planes, self._depth_map(full, match, smoothness, result, reference, noise)

    def _depth_map(
        self,
        planes: Float32,
        match: Match,
        smoothness: Float32,
        result: _SearchResult,
        reference: ViewPicture,
        noise: float,
    ) -> DepthMap:
        """Build the depth map from refined planes (v, u) and the statistics of their match."""
        full = self._full.sweep
        inverse_distance = full.inverse_distance(np.clip(planes, np.float32(-1.0), np.float32(full.plane_count)))
        inverse_distance = np.maximum(inverse_distance, np.float32(0.0))
        valid = reference.valid & (match.view_count >= min(MIN_OTHERS, len(self.others)))
        step_px = np.float32(full.step_px)
        range_px, views = full.plane_count * full.step_px, len(self.others)
        estimated = self._confidence(
            statistics(
                planes * step_px,
                match,
                result.rivals,
                result.first_rivals,
                range_px=range_px,
                views=views,
                halved=result.halved,
                noise_ratio=noise,
            )
        )
        texture = unbrightened(reference, self.weights[self.reference], smoothing_px(noise))
        confidence = np.minimum(estimated, attainable_probability(match, texture, views))
        sigma_px = standard_deviation_px(
            match,
            smoothness,
            result.margin,
            confidence,
            views=views,
            halved=result.halved,
            range_px=range_px,
            noise_ratio=noise,
        )
        deviation = sigma_px * np.float32(full.step / full.step_px)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.float32(1.0) / inverse_distance
            pupil_depth = np.float32(self.views.reference_view_depth_mm)
            depth, sigma = distance + pupil_depth, deviation * np.square(distance)
        return DepthMap(
            views=self.views,
            view=self.reference,
            depth_mm=np.where(valid, depth, np.float32(np.nan)),
            sigma_mm=np.where(valid, sigma, np.float32(np.nan)).astype(np.float32),
            confidence=np.where(valid, confidence, np.float32(0.0)).astype(np.float32),
        )

    def _confidence(self, statistics: Float32) -> Float32:
        """Return the probability (v, u) that the depth is right; training overrides this to record the statistics."""
        return log_odds().probability(statistics)


def _multiplied(views: list[ViewPicture], gains: Sequence[Float32 | float]) -> list[ViewPicture]:
    return [view.multiplied(gain) for view, gain in zip(views, gains, strict=True)]


def _check(views: Views, near_mm: float, far_mm: float) -> None:
    if views.rows * views.cols < 2:
        raise InputError("light field has one view, expected two or more to measure depth")
    if np.abs(views.positions_mm[..., :2]).max() < 1e-9:
        raise InputError("all views coincide, expected views at different positions to measure depth")
    if min(views.width_px, views.height_px) < MIN_SIDE_PX:
        raise InputError(
            f"views are {views.width_px}x{views.height_px} px, expected {MIN_SIDE_PX} px or more along each side"
        )
    pupil_depth = views.reference_view_depth_mm
    min_depth = pupil_depth + max(float(views.positions_mm[..., 2].max()), 0.0)
    if np.isinf(near_mm):
        raise InputError("the reference plane is at infinity, expected near_mm, the nearest depth to search")
    if not min_depth < near_mm < far_mm:
        limits = f"near_mm {near_mm:g}, far_mm {far_mm:g}"
        raise InputError(
            f"{limits}: expected near_mm below far_mm, and both beyond the foremost view, at {min_depth:.0f} mm"
        )


def estimate_depth(light_field: LightField, *, near_mm: float | None = None, far_mm: float | None = None) -> DepthMap:
    """Estimate the depth of the reference view; for a video, use one `DepthEstimator` for all frames.

    Parameters
    ----------
    light_field
        Two or more views, colour or grey.
    near_mm, far_mm
        Nearest and farthest depth to search, from the pupil along view z; by default 0.6 and 2 times the reference
        depth. `far_mm` may be infinite.

    Returns
    -------
    DepthMap
        `depth_mm` (v, u) from the pupil along view z, `sigma_mm` and `confidence` of every pixel of the reference view.

    Raises
    ------
    InputError
        If `DepthEstimator` refuses the light field or the depths.
    """
    return DepthEstimator(light_field, near_mm=near_mm, far_mm=far_mm).estimate(light_field)
