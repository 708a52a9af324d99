"""Comparison of views at points of a first depth: gains that equalise their brightness, and their noise."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.processes.threads import MapFunction
from mirrorcam.optics.light_field.depth.parallax import Parallax
from mirrorcam.optics.light_field.depth.photometry import ViewPicture
from mirrorcam.optics.light_field.depth.sweep import Sweep

Float32 = NDArray[np.float32]

MIN_GAIN, MAX_GAIN = np.float32(0.4), np.float32(2.5)
GAIN_STRIDE_PX = 8
GAIN_PATCH_PX = 5
MIN_SAMPLES = 50
MIN_GAIN_CHANGE = 0.03
"""Minimum relative difference in brightness that is equalised before depth is known."""
OCCLUSION_SCALES = (24.0, 12.0, 6.0, 6.0)
"""Scale of the robust loss per round, out of 255: larger differences probably show different surfaces."""
NOISE_STRIDE_PX = 4
MAX_NOISE_RATIO = 7.0


@dataclass(frozen=True, eq=False)
class ViewComparison:
    """Compares other views with the reference view, given its depth.

    Attributes
    ----------
    sweep
        Full-size sweep, in whose planes depth is given.
    parallaxes
        Parallax in each other view.
    run
        `map`, or the `map` of a thread pool.
    """

    sweep: Sweep
    parallaxes: Sequence[Parallax]
    run: MapFunction

    def gains(
        self, reference: ViewPicture, others: Sequence[ViewPicture], planes: Float32, numbers: Iterable[int]
    ) -> list[tuple[int, Float32]]:
        """Return gains (v, u) that equalise other views to the reference view, by number, given its planes (v, u)."""
        stride = slice(GAIN_STRIDE_PX // 2, None, GAIN_STRIDE_PX)
        reference_patches = patch_means(reference.grey)[stride, stride]
        pixels = self._pixels(planes, stride)

        def gain(number: int) -> tuple[int, Float32]:
            return number, matching_gain(others[number].grey, *pixels(number), reference_patches)

        return list(self.run(gain, numbers))

    def noise_ratio(
        self, reference: ViewPicture, others: Sequence[ViewPicture], planes: Float32, numbers: Iterable[int]
    ) -> float:
        """Return the noise of the mean of two views relative to the texture that they share, given planes (v, u).

        The views must not be smoothed. Views share texture and not noise, whatever a camera's processing made of it:
        the difference of two views is noise, and their sum has twice the texture as well. Only texture as fine as noise
        counts. Medians disregard occluded points. 0 if too few points are shared.
        """
        stride = slice(NOISE_STRIDE_PX // 2, None, NOISE_STRIDE_PX)
        own = reference.fine_texture[stride, stride]
        pixels = self._pixels(planes, stride)

        def compared(number: int) -> tuple[Float32, Float32]:
            texture = others[number].fine_texture
            there = cv2.remap(texture, *pixels(number), cv2.INTER_LINEAR, borderValue=float("nan"))
            known = np.isfinite(there) & np.isfinite(own)
            return np.abs(there - own)[known], np.abs(there + own)[known]

        differences, sums = (np.concatenate(parts) for parts in zip(*self.run(compared, numbers), strict=True))
        if len(differences) < MIN_SAMPLES:
            return 0.0
        difference, total = float(np.median(differences)), float(np.median(sums))
        shared = np.sqrt(max(total**2 - difference**2, 0.0))
        return min(difference / shared, MAX_NOISE_RATIO) if shared > 0.0 else MAX_NOISE_RATIO * (difference > 0.0)

    def _pixels(self, planes: Float32, stride: slice) -> Callable[[int], tuple[Float32, Float32]]:
        """Return a function of a view's number: its pixels (m, n) that show every n-th point of planes (v, u)."""
        rows, columns = np.indices(planes.shape, dtype=np.float32)[:, stride, stride]
        inverse_distance = self.sweep.inverse_distance(planes[stride, stride])
        return lambda number: self.parallaxes[number].pixels(columns, rows, inverse_distance)


def rough_gain(picture: Float32, reference: Float32) -> float:
    """Return the factor that roughly equalises a grey view (v, u) to the reference view before depth is known.

    It is the median ratio of means over large squares; 1 below `MIN_GAIN_CHANGE`, which depth alone may explain.
    """
    side = max(3, min(picture.shape) // 8)
    shared = (picture >= 0) & (reference >= 0)

    def means(values: Float32) -> Float32:
        blurred: Any = cv2.blur(np.where(shared, values, np.float32(0.0)), (side, side))
        return np.asarray(blurred[side // 2 :: side, side // 2 :: side])

    reference_means, picture_means = means(reference), means(picture)
    usable = (reference_means > 1.0) & (picture_means > 1.0)
    if not usable.any():
        return 1.0
    gain = float(np.median(reference_means[usable] / picture_means[usable]))
    return float(np.clip(gain, MIN_GAIN, MAX_GAIN)) if abs(gain - 1.0) > MIN_GAIN_CHANGE else 1.0


def patch_means(picture: Float32) -> Float32:
    """Means over small squares of a grey picture (v, u); negative where a square has a missing sample."""
    return np.asarray(cv2.blur(picture, (GAIN_PATCH_PX, GAIN_PATCH_PX)))


def matching_gain(picture: Float32, u: Float32, v: Float32, reference: Float32) -> Float32:
    """Return the gain (v, u) that equalises a grey view to the reference view; ones if the overlap is too small.

    The gain is a plane over the view, g = a + b u + c v, fitted to the points that both views show; points that differ
    too much, probably occluded in one view, lose weight round by round (Geman-McClure).

    Parameters
    ----------
    picture
        The view (v, u), 0 to 255, `NO_SAMPLE` where there is none.
    u, v
        Pixels (m, n) of the view that show given points of the reference view.
    reference
        Brightness (m, n) of these points in the reference view, from `patch_means`.
    """
    picture_means = np.asarray(
        cv2.remap(patch_means(picture), u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=-1.0)
    )
    shared = (picture_means >= 0) & (reference >= 0)
    if np.count_nonzero(shared) < MIN_SAMPLES:
        return np.ones_like(picture)
    height, width = picture.shape
    basis = np.stack([np.ones_like(u), u / width - 0.5, v / height - 0.5], axis=-1)[shared].astype(float)
    target = reference[shared].astype(float)
    terms, weight = basis * picture_means[shared].astype(float)[:, None], np.ones(len(target))
    for scale in OCCLUSION_SCALES:
        weighted = terms * weight[:, None]
        # The weak prior of gain 1 gives even a black picture a gain.
        gain = np.linalg.solve(weighted.T @ terms + np.eye(3), weighted.T @ target + [1.0, 0.0, 0.0])
        weight = 1.0 / np.square(1.0 + np.square((terms @ gain - target) / scale))
    columns = np.arange(width, dtype=np.float32) / np.float32(width) - np.float32(0.5)
    rows = np.arange(height, dtype=np.float32)[:, None] / np.float32(height) - np.float32(0.5)
    plane = (np.float32(gain[0]) + np.float32(gain[1]) * columns) + np.float32(gain[2]) * rows
    return np.asarray(np.clip(plane, MIN_GAIN, MAX_GAIN))
