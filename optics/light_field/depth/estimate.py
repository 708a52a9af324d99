"""Depth of a light field: a sweep of planes, semi-global aggregation, and refinement to parts of a pixel.

Where things move by many pixels between the views, half the size is enough for the sweep, and four times as fast.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.light_field.depth import cost
from mirrorcam.optics.light_field.depth.cost import Planes
from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.depth.geometry import halved, other_views, plane_inverse_distances, reference_index
from mirrorcam.optics.light_field.depth.photometry import grey, normalised
from mirrorcam.optics.light_field.depth.refine import MatchStatistics, Refiner, enlarged, guided
from mirrorcam.optics.light_field.depth.semiglobal import aggregate
from mirrorcam.optics.light_field.light_field import LightField, Views

Float32 = NDArray[np.float32]

NEAR, FAR = 0.6, 2.0
"""Nearest and farthest depth that is searched by default, in reference depths."""
FULL_STEP_PX, HALF_STEP_PX = 0.5, 1.0
"""How far the farthest view moves from one plane to the next, in pixels of the size that is searched at."""
FULL_PLANES = 64
"""More planes than that are not searched at full size but at half."""
COST_PX = 3
"""Side of the square over which costs are averaged."""
NEXT_PLANE = 6 * cost.UNITS
ANY_PLANE = 45 * cost.UNITS
NEAR_REACH_PX, FAR_REACHES_PX = 7, (9, 25)
"""Sides of the squares whose nearest, or farthest, depth a pixel may take: what is near comes out too wide."""
SMOOTH_RADIUS_PX = 5
SMOOTH_PX = 0.3
"""Waves of a surface up to that many px of the farthest view are smoothed, larger ones kept."""
DISTINCT = 0.25
"""By what part the next best depth must be worse for full confidence."""
SMALLEST_PX = 16
QUANTISATION = 1.0 / 6.0
"""Variance of the difference of two rounded numbers."""


class DepthEstimator:
    """Finds the depth of light fields of one geometry; what does not change from frame to frame is built once.

    Parameters
    ----------
    light_field
        One of those to come: views and weights are taken from it.
    near_mm, far_mm
        Depths between which is searched, from the pupil along view z; by default 0.6 and 2 times that of the reference
        plane. Infinity is a depth.
    workers
        Number of threads; by default as many as OpenCV uses.

    Raises
    ------
    InputError
        If there are fewer than two views, all views are in one place, views are too small, or the depths do not grow,
        lie within the views or are too far apart for the pixels there are.
    """

    def __init__(
        self,
        light_field: LightField,
        *,
        near_mm: float | None = None,
        far_mm: float | None = None,
        workers: int | None = None,
    ) -> None:
        geometry: dict[str, Any] = {field.name: getattr(light_field, field.name) for field in fields(Views)}
        self.views = Views(**geometry)
        self.weights = light_field.weights
        near = NEAR * self.views.reference_depth_mm if near_mm is None else near_mm
        far = FAR * self.views.reference_depth_mm if far_mm is None else far_mm
        _check(self.views, near, far)
        self.near_mm, self.far_mm = float(near), float(far)
        self.reference, self.others = reference_index(self.views), other_views(self.views)
        self._run = ThreadPoolExecutor(workers or cv2.getNumThreads()).map
        self._halve = False
        searched, self._inverse_distances = self.views, self._spaced(self.views, FULL_STEP_PX)
        if self.planes > FULL_PLANES:
            self._halve = True
            searched = halved(self.views)
            self._inverse_distances = self._spaced(searched, HALF_STEP_PX)
        seen = np.zeros((searched.rows, searched.cols, searched.height_px, searched.width_px), np.float32)
        for index in np.ndindex(searched.rows, searched.cols):
            seen[index] = self._sized(grey(light_field, index)) >= 0
        self._planes = Planes(searched, seen, self._inverse_distances)
        self._refiner = Refiner(self.views, self._run)

    def _spaced(self, views: Views, step_px: float) -> FloatArray:
        return plane_inverse_distances(views, self.near_mm, self.far_mm, step_px)

    def _sized(self, picture: Float32) -> Float32:
        """A grey picture at the size searched at: two by two pixels joined, negative where one has no sample."""
        if not self._halve:
            return picture
        rows, columns = picture.shape[0] // 2, picture.shape[1] // 2
        even = picture[: 2 * rows, : 2 * columns]
        return np.asarray(cv2.resize(even, (columns, rows), interpolation=cv2.INTER_AREA))

    @property
    def planes(self) -> int:
        """Number of planes swept."""
        return len(self._inverse_distances)

    def fits(self, light_field: LightField) -> bool:
        """Return whether a light field has the views and weights that this estimator was built for."""
        names = [field.name for field in fields(Views)]
        same = all(np.array_equal(getattr(light_field, name), getattr(self.views, name)) for name in names)
        return same and np.array_equal(light_field.weights, self.weights)

    def estimate(self, light_field: LightField) -> DepthMap:
        """The depth of the reference view of a light field of this estimator's geometry.

        Raises InputError for a light field of other views or weights.
        """
        if not self.fits(light_field):
            raise InputError("light field has other views or weights than the one the estimator was built for")
        reference, *pictures = self._run(lambda index: grey(light_field, index), [self.reference, *self.others])
        coarse, distinct = self._coarse(reference, pictures)
        nearest, *farthest = (
            _square(side // 2 + 1 if self._halve else side) for side in (NEAR_REACH_PX, *FAR_REACHES_PX)
        )
        candidates: list[Any] = [coarse, cv2.dilate(coarse, nearest), *(cv2.erode(coarse, far) for far in farthest)]
        if self._halve:
            *candidates, distinct = (enlarged(small, reference.shape) for small in (*candidates, distinct))
        pictures = self._refiner.matched(pictures, reference, candidates[0])
        known = reference >= 0
        reference = np.where(known, reference, np.float32(0.0))
        found = self._refiner.chosen(candidates, pictures, reference)
        step = float(self._inverse_distances[1] - self._inverse_distances[0])
        found, statistics = self._refiner.stepped(found, pictures, reference, step)
        px = self.views.focal_px * float(np.abs(self.views.positions_mm[..., :2]).max())
        moved = found * np.float32(px)
        # Where the views carry no information, this small weight lets neighbouring pixels decide.
        usual = max(float(statistics.information.mean()), float(np.finfo(np.float32).tiny))
        trust = statistics.information * np.float32(1.0 / usual) + np.float32(1e-3)
        found = guided(moved, moved, SMOOTH_RADIUS_PX, SMOOTH_PX, trust) * np.float32(1.0 / px)
        return self._depth_map(found, statistics, distinct, known, step)

    def _coarse(self, reference: Float32, pictures: list[Float32]) -> tuple[Float32, Float32]:
        """Inverse distances (v, u) to part of a plane, at the size searched at, and how much worse the next best is."""
        own, *others = self._run(lambda picture: normalised(self._sized(picture)), [reference, *pictures])
        count = self.planes
        prepared = self._planes.prepared(others, self._run)
        volume = np.empty((own.shape[0], count, own.shape[1]), np.uint16)

        def fill(plane: int) -> None:
            cv2.blur(self._planes.cost(plane, prepared, own), (COST_PX, COST_PX), volume[:, plane])

        list(self._run(fill, range(count)))
        total = aggregate(volume, NEXT_PLANE, ANY_PLANE, self._run)
        # The least cost and where it is, in one pass: the plane's number is the lower half of each word.
        words = total.astype(np.uint32)
        words <<= np.uint32(16)
        words |= np.arange(count, dtype=np.uint32)[:, None]
        best = words.min(axis=1)
        plane = (best & np.uint32(0xFFFF)).astype(np.int16)
        inner = np.clip(plane, 1, count - 2).astype(np.int64)
        before, at, after = (
            np.take_along_axis(total, (inner + offset)[:, None], axis=1)[:, 0].astype(np.float32)
            for offset in (-1, 0, 1)
        )
        curvature = np.maximum(before - 2.0 * at + after, np.float32(1.0))
        part = np.clip((before - after) / (2.0 * curvature), np.float32(-1.0), np.float32(1.0))
        first, step = self._inverse_distances[0], self._inverse_distances[1] - self._inverse_distances[0]
        next_best = np.full(plane.shape, 0xFFFF, np.uint16)
        for number in range(count):
            apart = np.abs(plane - np.int16(number)) > 2
            np.minimum(next_best, total[:, number], out=next_best, where=apart)
        least = (best >> np.uint32(16)).astype(np.float32)
        distinct = 1.0 - least / np.maximum(next_best, np.uint16(1)).astype(np.float32)
        return (first + step * (inner + part)).astype(np.float32), distinct

    def _depth_map(
        self, found: Float32, statistics: MatchStatistics, distinct: Float32, known: NDArray[np.bool_], step: float
    ) -> DepthMap:
        """The depth map of inverse distances (v, u) and what is known of them."""
        low, high = self._inverse_distances[[0, -1]]
        found = np.clip(found, np.float32(max(low - step, 0.0)), np.float32(high + step))
        known = known & (statistics.seeing >= min(2, len(self.others)))
        # Without information, any depth of the range is as likely as any other.
        flat = np.float32((high - low) / np.sqrt(12.0))
        deviation = np.sqrt(
            (statistics.variance + np.float32(QUANTISATION)) / np.maximum(statistics.information, 1e-30)
        )
        deviation = np.minimum(deviation, flat)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.float32(1.0) / found
            behind = np.float32(self.views.reference_view_depth_mm)
            depth, sigma = distance + behind, deviation * np.square(distance)
        agreeing = np.minimum(2.0 * statistics.agreeing / len(self.others), 1.0)
        sharp = 1.0 / (1.0 + np.square(deviation / np.float32(step)))
        confidence = agreeing * sharp * np.clip(distinct / DISTINCT, 0.0, 1.0)
        return DepthMap(
            views=self.views,
            view=self.reference,
            depth_mm=np.where(known, depth, np.float32(np.nan)),
            sigma_mm=np.where(known, sigma, np.float32(np.nan)).astype(np.float32),
            confidence=np.where(known, confidence, np.float32(0.0)).astype(np.float32),
        )


def _square(side_px: int) -> NDArray[np.uint8]:
    return np.ones((side_px, side_px), np.uint8)


def _check(views: Views, near_mm: float, far_mm: float) -> None:
    if views.rows * views.cols < 2:
        raise InputError("light field has one view, expected two or more to measure depth")
    if np.abs(views.positions_mm[..., :2]).max() < 1e-9:
        raise InputError("all views are in one place, expected some distance between them to measure depth")
    if min(views.width_px, views.height_px) < SMALLEST_PX:
        raise InputError(
            f"views are {views.width_px}x{views.height_px} px, expected {SMALLEST_PX} or more along each side"
        )
    behind = views.reference_view_depth_mm
    least = behind + max(float(views.positions_mm[..., 2].max()), 0.0)
    if np.isinf(near_mm):
        raise InputError("the reference plane is at infinity, expected --near-mm, the nearest depth to look for")
    if not least < near_mm < far_mm:
        raise InputError(f"depths {near_mm:g} to {far_mm:g} mm, expected two that grow, beyond {least:.0f} mm")


def estimate_depth(light_field: LightField, *, near_mm: float | None = None, far_mm: float | None = None) -> DepthMap:
    """Measure the depth of the reference view of one light field; for a video, one `DepthEstimator` serves all frames.

    Parameters
    ----------
    light_field
        Two or more views; colour or grey.
    near_mm, far_mm
        Depths between which is searched, from the pupil along view z; by default 0.6 and 2 times that of the reference
        plane. Infinity is a depth.

    Returns
    -------
    DepthMap
        `depth_mm` (v, u) from the pupil along view z, `sigma_mm` and `confidence` of every pixel of the reference view.

    Raises
    ------
    InputError
        For a light field or depths that `DepthEstimator` refuses.
    """
    return DepthEstimator(light_field, near_mm=near_mm, far_mm=far_mm).estimate(light_field)
