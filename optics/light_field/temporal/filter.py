"""A motion-adaptive recursive temporal filter for light fields: static samples are averaged, changing ones are not.

Each sample is the mean of previous ones, up to MEMORY frames, as long as the new one differs by no more than noise
explains. Two tests decide, both over a small square of the view: on the difference itself, and on its running mean,
which detects drift too slow for the first. A third test detects the lag that slow depth changes leave in a tile of all
views. A moving object, and the background it uncovers, consist of new samples only. If the views share most of the
change, everything moves and nothing is averaged: all views show the same motion, at one disparity, but noise is
independent between views. So a scene that moves everywhere, with a texture as fine as noise, is not mistaken for noise.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.core.processes.threads import thread_map
from mirrorcam.optics.light_field.light_field import LightField, Samples, Views
from mirrorcam.optics.light_field.temporal.noise import (
    MIN_VARIANCE,
    ROUNDING,
    SMALL_STRIDE_PX,
    Blocks,
    Noise,
    chi_square,
    lighting_gains,
    measure_noise,
    row_gains,
    white_level,
)
from mirrorcam.optics.light_field.temporal.recursive_mean import INFORMATION, MEMORY, MOTION_SUMS, TILE_PX, filter_view

Int64 = NDArray[np.int64]

Float32 = NDArray[np.float32]
UNCHANGED_SIGMAS, CHANGED_SIGMAS = 2.0, 4.0
"""Deviation of a square, in standard deviations of noise, at which memory begins to shrink, and at which it is lost."""
MIN_LAG_SIGMAS, MAX_LAG_SIGMAS = 3.0, 6.0
"""The same for the lag of a tile, over all views."""
LAG_RAMP_PX, MAX_LAG_PX = 0.25, 0.5
"""Range of a common lag of all views over which memory shrinks, and lag at which it is lost."""
MOTION_FRACTION, NOISE_FRACTION = 0.82, 0.95
"""Fraction of changes specific to each view: certainly motion below the first, certainly noise above the second."""
MIN_AVERAGED = 1.5
"""Number of frames below which a sample counts as new."""
MAX_SAMPLES = 2**26
SIDE_PX = 10
BLOCKS = 64
"""Approximate number of blocks of the reference view to compare."""
NEIGHBOURS = 4
MAX_DISPARITY_PX = 24
"""Maximum candidate disparity of the nearest neighbour."""
LOW_QUANTILE = 0.25


@dataclass(frozen=True, eq=False)
class _State:
    """State that the next frame is compared with.

    Attributes
    ----------
    mean
        The filtered light field so far.
    last
        The previous frame, unfiltered.
    count
        Number (k, v, u) of frames averaged in each sample.
    mean_difference
        Running mean (k, v, u) of the brightness differences from the mean.
    max_frames
        Maximum number of frames (i, j) to average in tiles of TILE_PX x TILE_PX.
    blocks, noise
        Blocks and noise of the previous frame; no noise after the first.
    """

    mean: LightField
    last: LightField
    count: Float32
    mean_difference: Float32
    max_frames: Float32
    blocks: Blocks
    noise: Noise | None = None

    @classmethod
    def first(cls, light_field: LightField) -> _State:
        """Return the state after the first light field."""
        height, width = light_field.height_px, light_field.width_px
        shape = (light_field.rows * light_field.cols, height, width)
        max_frames = np.full((-(-height // TILE_PX), -(-width // TILE_PX)), MEMORY, np.float32)
        return cls(
            light_field,
            light_field,
            np.ones(shape, np.float32),
            np.zeros(shape, np.float32),
            max_frames,
            Blocks.of(light_field),
        )


class TemporalFilter:
    """Filters the light fields of one video, in order.

    It restarts if views or sample type change. The result depends only on the frames so far;
    memory use is a few light fields, however long the video. Light fields of more than MAX_SAMPLES samples are
    returned unfiltered: in floating point, they would take gigabytes.

    Parameters
    ----------
    workers
        Number of threads; by default OpenCV's.
    """

    def __init__(self, workers: int | None = None) -> None:
        self._run = thread_map(workers or cv2.getNumThreads())
        self._state: _State | None = None
        # Arrays of the state before the last, reused: allocating new ones takes as long as the work itself.
        self._spare: tuple[Float32, Float32] | None = None

    def filtered(self, light_field: LightField) -> LightField:
        """Return the next light field of the video, averaged with previous ones where nothing moved.

        The first one is returned unchanged; others have float32 samples, unchanged where nothing is averaged. A frame
        that repeats the previous one, as cameras deliver in the dark, counts once.
        """
        if light_field.samples.size > MAX_SAMPLES:
            self._state = self._spare = None
            return light_field
        previous = self._state
        if previous is None or not _compatible(previous.last, light_field):
            after = _State.first(light_field)
        elif _repeats(previous.last, light_field):
            after = previous
        else:
            after = self._next(previous, light_field)
        self._state = after
        if previous is not None and after is not previous:
            self._spare = previous.count, previous.mean_difference
        return after.mean

    def unaveraged(self, index: tuple[int, int]) -> NDArray[np.bool_] | None:
        """Return where (v, u) view (t, s) of the last result holds samples of its own frame only; None if everywhere.

        In a video, they are what has changed.
        """
        state = self._state
        if state is None:
            return None
        return np.asarray(state.count[int(np.ravel_multi_index(index, state.last.weights.shape[:2]))] < MIN_AVERAGED)

    def _next(self, previous: _State, frame: LightField) -> _State:
        """Return the state after a frame."""
        blocks = Blocks.of(frame)
        gains = lighting_gains(blocks.means, Blocks.of(previous.mean).means)
        blocks, rows = blocks.with_differences(previous.blocks, gains), row_gains(gains, frame.height_px)
        fraction = specific_fraction(frame, previous.last, rows)
        trust = min(max((fraction - MOTION_FRACTION) / (NOISE_FRACTION - MOTION_FRACTION), 0.0), 1.0)
        measured = measure_noise(
            blocks, previous.blocks, gains, ROUNDING if frame.samples.dtype == np.uint8 else MIN_VARIANCE, trust
        )
        if previous.noise is not None:
            measured = previous.noise.updated(measured)
        new, old = _by_view(frame), _by_view(previous.mean)
        if old.dtype == np.uint8:
            old = old.astype(np.float32) / white_level(previous.mean)
        samples = np.empty(new.shape, np.float32)
        spare, self._spare = self._spare, None
        if spare is None or spare[0].shape != previous.count.shape:
            spare = np.empty_like(previous.count), np.empty_like(previous.mean_difference)
        count, mean_difference = spare
        motion_sums = np.zeros((len(new), *previous.max_frames.shape, MOTION_SUMS), np.float32)
        tables = measured.information()
        # If everything moves, apparent similarity is coincidence.
        max_frames = np.minimum(previous.max_frames, np.float32(1.0 + (MEMORY - 1) * trust))
        limits = np.array([measured.limits(UNCHANGED_SIGMAS), measured.limits(CHANGED_SIGMAS)], np.float32)

        def filter_one_view(view: int) -> None:
            filter_view(
                new[view],
                white_level(frame),
                old[view],
                previous.count[view],
                previous.mean_difference[view],
                rows[view],
                tables,
                INFORMATION,
                limits,
                max_frames,
                samples[view],
                count[view],
                mean_difference[view],
                motion_sums[view],
            )

        list(self._run(filter_one_view, range(len(new))))
        mean = LightField.of(frame, samples.reshape(frame.samples.shape), frame.weights)
        next_max_frames = _update_max_frames(previous.max_frames, motion_sums, measured)
        return _State(mean, frame, count, mean_difference, next_max_frames, blocks, measured)


def _by_view(light_field: LightField) -> Any:
    """Return the samples (k, v, u, c), adjacent in memory."""
    samples: Any = light_field.samples
    return np.ascontiguousarray(samples).reshape(-1, *samples.shape[2:])


def _compatible(previous: LightField, current: LightField) -> bool:
    """Return whether two light fields have the same views, of sufficient size, and the same sample type."""
    same = all(np.array_equal(getattr(previous, field.name), getattr(current, field.name)) for field in fields(Views))
    same = same and min(current.height_px, current.width_px) >= SMALL_STRIDE_PX
    return same and previous.samples.shape == current.samples.shape and previous.samples.dtype == current.samples.dtype


def _repeats(previous: LightField, current: LightField) -> bool:
    """Return whether two light fields have the same samples; usually the first view shows that they differ."""
    first_equal = np.array_equal(previous.samples[0, 0], current.samples[0, 0])
    return first_equal and np.array_equal(previous.samples, current.samples)


def _update_max_frames(previous: Float32, sums: Float32, noise: Noise) -> Float32:
    """Update the maximum number of frames (i, j) that tiles average, from sums (k, i, j, MOTION_SUMS) of the views.

    A mean difference proportional to the gradients of the mean is lag. If the views' lags differ, by their chi-squared
    statistic, the depth is changing, even if no single square shows it. A lag common to all views shifts a surface
    equally in all views, so its depth stays right; a fraction of a pixel is allowed. The tiles' means are excluded,
    since they come from lighting.
    """
    # Add up each tile and its neighbours.
    tiles = np.stack([9.0 * np.asarray(cv2.blur(view, (3, 3))) for view in sums])
    total, x, y, error, *products = np.moveaxis(tiles, -1, 0)
    total = np.maximum(total, np.float32(1e-20))
    pairs = ((x, x), (x, y), (y, y), (x, error), (y, error))
    centred = np.stack([product - a * b / total for product, (a, b) in zip(products, pairs, strict=True)])
    squares, _ = _lag(centred)
    common, lag_px = _lag(centred.sum(axis=1))
    values = 2 * len(sums)
    min_limit, max_limit = (
        chi_square(values - 2, deviations) * noise.pixels_per_independent
        for deviations in (MIN_LAG_SIGMAS, MAX_LAG_SIGMAS)
    )
    kept = np.clip((max_limit - squares.sum(axis=0) + common) / (max_limit - min_limit), 0.0, 1.0)
    lagging = common > chi_square(2, MIN_LAG_SIGMAS) * noise.pixels_per_independent
    # Out-of-range samples carry no information.
    kept = np.where(lagging, np.minimum(kept, np.clip((MAX_LAG_PX - lag_px) / LAG_RAMP_PX, 0.0, 1.0)), kept)
    return np.clip((previous + 1.0) * np.nan_to_num(kept), 1.0, MEMORY).astype(np.float32)


def _lag(parts: Any) -> tuple[Any, Any]:
    """Return the chi-squared statistic (...) of the lag from weighted sums (5, ...), and the lag's length in px."""
    xx, xy, yy, xe, ye = parts
    regularisation = 1e-6 * (xx + yy) + 1e-20
    xx, yy = xx + regularisation, yy + regularisation
    x, y = yy * xe - xy * ye, xx * ye - xy * xe
    scale = xx * yy - xy * xy
    return (x * xe + y * ye) / scale, np.hypot(x, y) / scale


def neighbours(views: Views) -> tuple[int, NDArray[np.int64], NDArray[np.int64]]:
    """Return the reference view, its nearest neighbours (n,), and their shifts (d, n, 2) along u and v per disparity.

    Views are numbered row by row; a disparity is the shift of the nearest neighbour in pixels.
    """
    positions = views.positions_mm.reshape(-1, 3)[:, :2]
    distance = np.linalg.norm(positions, axis=1)
    order = np.argsort(distance, kind="stable")
    nearest = order[1 : NEIGHBOURS + 1]
    nearest = nearest[distance[nearest] > 0]
    if not len(nearest):
        return int(order[0]), nearest, np.zeros((0, 0, 2), np.int64)
    steps = positions[nearest] / distance[nearest].min()
    max_disparity = min(MAX_DISPARITY_PX, min(views.width_px, views.height_px) // 4)
    disparities = np.arange(-max_disparity, max_disparity + 1)
    return int(order[0]), nearest, np.rint(disparities[:, None, None] * steps).astype(np.int64)


@compiled
def _changes(current: Samples, previous: Samples, gain: Float32, channel: int, out: Float32) -> None:
    """Fill the change (v, u) of one channel of a view (v, u, c), with the previous frame scaled by gains (v, c)."""
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            out[y, x] = np.float32(current[y, x, channel]) - gain[y, channel] * np.float32(previous[y, x, channel])


@compiled
def _compare(reference: Float32, others: Float32, shifts: Int64, stride: int, out: Float32) -> int:
    """Fill energies (2, b) of blocks' changes, total and specific to each view; return their number."""
    height, width = reference.shape
    block = 0
    for top in range((stride - SIDE_PX) // 2, height - SIDE_PX + 1, stride):
        for left in range((stride - SIDE_PX) // 2, width - SIDE_PX + 1, stride):
            energy = np.float32(0.0)
            for y in range(top, top + SIDE_PX):
                for x in range(left, left + SIDE_PX):
                    energy += reference[y, x] * reference[y, x]
            max_correlation, min_correlation, compared = np.float32(-1.0), np.float32(1.0), 0
            for number in range(len(shifts)):
                product, scale = np.float32(0.0), np.float32(0.0)
                for k in range(len(others)):
                    du, dv = shifts[number, k, 0], shifts[number, k, 1]
                    inside = left + du >= 0 and left + du + SIDE_PX <= width
                    if not inside or top + dv < 0 or top + dv + SIDE_PX > height:
                        continue
                    product_k, energy_k = np.float32(0.0), np.float32(0.0)
                    for y in range(top, top + SIDE_PX):
                        reference_row = reference[y, left : left + SIDE_PX]
                        other_row = others[k, y + dv, left + du : left + du + SIDE_PX]
                        for x in range(SIDE_PX):
                            product_k += reference_row[x] * other_row[x]
                            energy_k += other_row[x] * other_row[x]
                    product += product_k
                    scale += np.sqrt(energy * energy_k)
                if scale > 0:
                    max_correlation = max(max_correlation, product / scale)
                    min_correlation = min(min_correlation, product / scale)
                    compared += 1
            # By chance, the maximum and the minimum correlation are equally far from zero.
            common = np.float32(0.0)
            if compared > 0:
                common = max(max_correlation + min(min_correlation, np.float32(0.0)), np.float32(0.0))
            out[0, block], out[1, block] = energy, energy * (np.float32(1.0) - min(common, np.float32(1.0)))
            block += 1
    return block


def specific_fraction(current: LightField, previous: LightField, gains: Float32) -> float:
    """Return the fraction of the change between two frames that adjacent views do not share, in quiet blocks.

    Parameters
    ----------
    current, previous
        Consecutive frames of the same views.
    gains
        Gains (k, v, c) of rows from the previous frame's brightness to this one's.
    """
    reference, nearest, shifts = neighbours(current)
    height, width = current.height_px, current.width_px
    if not len(nearest) or min(height, width) < 2 * SIDE_PX:
        return 1.0
    new_samples, old_samples = (_by_view(frame) for frame in (current, previous))
    channel = new_samples.shape[-1] // 2
    changes = np.empty((1 + len(nearest), height, width), np.float32)
    for number, view in enumerate([reference, *nearest]):
        _changes(new_samples[view], old_samples[view], gains[view], channel, changes[number])
    stride = max(SIDE_PX, int(np.sqrt(height * width / BLOCKS)))
    energies: Any = np.empty((2, (height // SIDE_PX + 1) * (width // SIDE_PX + 1)), np.float32)
    count = _compare(changes[0], changes[1:], shifts, stride, energies)
    total, specific = np.quantile(energies[:, :count], LOW_QUANTILE, axis=1)
    return float(specific / total) if total > 0 else 1.0
