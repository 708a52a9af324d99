"""A motion-adaptive recursive temporal filter for light fields: static samples are averaged, changing ones are not.

Each sample is the mean of previous ones, up to MEMORY frames, as long as the new one differs by no more than noise
explains. Two tests decide, both over a small square of the view: on the difference itself, and on its running mean,
which detects drift too slow for the first. A third test detects the lag that slow depth changes leave in an area of all
views. A moving object, and the background it uncovers, are the new samples alone. If views share most of the change,
everything moves and nothing is averaged: all views show the same motion, at one disparity, but noise is independent
between views. So a scene that moves everywhere, with a texture as fine as noise, is not mistaken for noise.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.optics.light_field.light_field import LightField, Samples, Views
from mirrorcam.optics.light_field.temporal.noise import (
    LEAST,
    ROUNDING,
    SMALL_STRIDE_PX,
    Blocks,
    Noise,
    chi_square,
    full_brightness,
    lighting,
    measure_noise,
    row_gains,
)
from mirrorcam.optics.light_field.temporal.recursive_mean import AREA_PX, INFORMATION, LAG_SUMS, MEMORY, filter_view

Int64 = NDArray[np.int64]

Float32 = NDArray[np.float32]
Map = Callable[..., Any]
UNCHANGED_SIGMAS, CHANGED_SIGMAS = 2.0, 4.0
"""Deviation of a square, in standard deviations of noise, at which memory begins to shrink, and at which it is lost."""
NO_LAG_SIGMAS, LAG_SIGMAS = 3.0, 6.0
"""The same for the lag of an area, over all views."""
LAG_RAMP_PX, MAX_LAG_PX = 0.25, 0.5
"""Lag of all views over which memory shrinks, and at which it is lost."""
MOVING_SHARE, RESTING_SHARE = 0.82, 0.95
"""Share of changes specific to each view: motion below the first, certainly noise above the second."""
MAX_SAMPLES = 2**26
SIDE_PX = 10
BLOCKS = 64
"""Approximate number of blocks of the reference view to compare."""
NEIGHBOURS = 4
MAX_DISPARITY_PX = 24
"""Largest trial disparity of the nearest neighbour."""
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
    drift
        Running mean (k, v, u) of the brightness differences from the mean.
    most_frames
        Largest number of frames (i, j) to average in areas of AREA_PX.
    blocks, noise
        Blocks and noise of the previous frame; no noise after the first.
    """

    mean: LightField
    last: LightField
    count: Float32
    drift: Float32
    most_frames: Float32
    blocks: Blocks
    noise: Noise | None = None

    @classmethod
    def first(cls, light_field: LightField) -> _State:
        """The state after the first light field."""
        height, width = light_field.height_px, light_field.width_px
        shape = (light_field.rows * light_field.cols, height, width)
        max_frames = np.full((-(-height // AREA_PX), -(-width // AREA_PX)), MEMORY, np.float32)
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

    It restarts at a light field with other views or another sample type. The result depends only on the frames so far;
    memory use is a few light fields, however long the video. Light fields of more than MAX_SAMPLES samples are
    returned unfiltered: in floating point, they would take gigabytes.

    Parameters
    ----------
    workers
        Number of threads; default: OpenCV's.
    """

    def __init__(self, workers: int | None = None) -> None:
        self._run: Map = ThreadPoolExecutor(workers or cv2.getNumThreads()).map
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
        before = self._state
        if before is None or not _compatible(before.last, light_field):
            after = _State.first(light_field)
        elif np.array_equal(before.last.samples, light_field.samples):
            after = before
        else:
            after = self._next(before, light_field)
        self._state = after
        if before is not None and after is not before:
            self._spare = before.count, before.drift
        return after.mean

    def _next(self, before: _State, frame: LightField) -> _State:
        """Return the state after a frame."""
        blocks = Blocks.of(frame)
        gains = lighting(blocks.means, Blocks.of(before.mean).means)
        blocks, rows = blocks.after(before.blocks, gains), row_gains(gains, frame.height_px)
        share = own_share(frame, before.last, rows)
        trust = min(max((share - MOVING_SHARE) / (RESTING_SHARE - MOVING_SHARE), 0.0), 1.0)
        measured = measure_noise(
            blocks, before.blocks, gains, ROUNDING if frame.samples.dtype == np.uint8 else LEAST, trust
        )
        if before.noise is not None:
            measured = before.noise.updated(measured)
        new, old = _by_view(frame), _by_view(before.mean)
        if old.dtype == np.uint8:
            old = old.astype(np.float32) / full_brightness(before.mean)
        samples = np.empty(new.shape, np.float32)
        spare, self._spare = self._spare, None
        if spare is None or spare[0].shape != before.count.shape:
            spare = np.empty_like(before.count), np.empty_like(before.drift)
        count, drift = spare
        lag = np.zeros((len(new), *before.most_frames.shape, LAG_SUMS), np.float32)
        tables = measured.information()
        # If everything moves, apparent similarity is coincidence.
        max_frames = np.minimum(before.most_frames, np.float32(1.0 + (MEMORY - 1) * trust))
        limits = np.array([measured.limits(UNCHANGED_SIGMAS), measured.limits(CHANGED_SIGMAS)], np.float32)

        def filter_one(view: int) -> None:
            filter_view(
                new[view],
                full_brightness(frame),
                old[view],
                before.count[view],
                before.drift[view],
                rows[view],
                tables,
                INFORMATION,
                limits,
                max_frames,
                samples[view],
                count[view],
                drift[view],
                lag[view],
            )

        list(self._run(filter_one, range(len(new))))
        mean = LightField.of(frame, samples.reshape(frame.samples.shape), frame.weights)
        return _State(mean, frame, count, drift, _most_frames(before.most_frames, lag, measured), blocks, measured)


def _by_view(light_field: LightField) -> Any:
    """Samples (k, v, u, c)."""
    samples: Any = light_field.samples
    return samples.reshape(-1, *samples.shape[2:])


def _compatible(before: LightField, now: LightField) -> bool:
    """Whether two light fields have the same views, of sufficient size, and the same sample type."""
    same = all(np.array_equal(getattr(before, field.name), getattr(now, field.name)) for field in fields(Views))
    same = same and min(now.height_px, now.width_px) >= SMALL_STRIDE_PX
    return same and before.samples.shape == now.samples.shape and before.samples.dtype == now.samples.dtype


def _most_frames(before: Float32, sums: Float32, noise: Noise) -> Float32:
    """Update the largest numbers of frames (i, j) that areas average, from sums (k, i, j, LAG_SUMS) of the views.

    Drift proportional to the gradients of the mean is lag. If the views' lags differ, by their chi-squared statistic,
    the depth is changing, which no single square may show. A lag common to all views shifts a surface equally in all
    views, so its depth stays right; a fraction of a pixel is allowed. Means are excluded, since they come from
    lighting.
    """
    # Add up each area with its neighbours.
    areas = np.stack([9.0 * np.asarray(cv2.blur(view, (3, 3))) for view in sums])
    total, across, down, moved, *products = np.moveaxis(areas, -1, 0)
    total = np.maximum(total, np.float32(1e-20))
    pairs = ((across, across), (across, down), (down, down), (across, moved), (down, moved))
    centred = np.stack([product - one * two / total for product, (one, two) in zip(products, pairs, strict=True)])
    squares, _ = _lag(centred)
    shared, lag_px = _lag(centred.sum(axis=1))
    values = 2 * len(sums)
    no_lag_limit, lag_limit = (
        chi_square(values - 2, deviations) * noise.joined for deviations in (NO_LAG_SIGMAS, LAG_SIGMAS)
    )
    kept = np.clip((lag_limit - squares.sum(axis=0) + shared) / (lag_limit - no_lag_limit), 0.0, 1.0)
    lagging = shared > chi_square(2, NO_LAG_SIGMAS) * noise.joined
    # Out-of-range samples carry no information.
    kept = np.where(lagging, np.minimum(kept, np.clip((MAX_LAG_PX - lag_px) / LAG_RAMP_PX, 0.0, 1.0)), kept)
    return np.clip((before + 1.0) * np.nan_to_num(kept), 1.0, MEMORY).astype(np.float32)


def _lag(parts: Any) -> tuple[Any, Any]:
    """Chi-squared statistic (...) of the lag from weighted sums (5, ...), and its length in px."""
    xx, xy, yy, xe, ye = parts
    regularisation = 1e-6 * (xx + yy) + 1e-20
    xx, yy = xx + regularisation, yy + regularisation
    across, down = yy * xe - xy * ye, xx * ye - xy * xe
    scale = xx * yy - xy * xy
    return (across * xe + down * ye) / scale, np.hypot(across, down) / scale


def neighbours(views: Views) -> tuple[int, NDArray[np.int64], NDArray[np.int64]]:
    """Return the reference view, its nearest neighbours (n,), and their shifts (d, n, 2), right and down, per
    disparity.

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
def _changes(now: Samples, before: Samples, gain: Float32, channel: int, out: Float32) -> None:
    """Change (v, u) of one channel of a view (v, u, c), with the previous frame scaled by gains (v, c)."""
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            out[y, x] = np.float32(now[y, x, channel]) - gain[y, channel] * np.float32(before[y, x, channel])


@compiled
def _compare(own: Float32, others: Float32, shifts: Int64, stride: int, out: Float32) -> int:
    """Fill energies (2, b) of blocks' changes, total and specific to each view; return their number."""
    height, width = own.shape
    found = 0
    for top in range((stride - SIDE_PX) // 2, height - SIDE_PX + 1, stride):
        for left in range((stride - SIDE_PX) // 2, width - SIDE_PX + 1, stride):
            energy = np.float32(0.0)
            for y in range(top, top + SIDE_PX):
                for x in range(left, left + SIDE_PX):
                    energy += own[y, x] * own[y, x]
            highest, lowest, compared = np.float32(-1.0), np.float32(1.0), 0
            for number in range(len(shifts)):
                product, scale = np.float32(0.0), np.float32(0.0)
                for k in range(len(others)):
                    across, down = shifts[number, k, 0], shifts[number, k, 1]
                    inside = left + across >= 0 and left + across + SIDE_PX <= width
                    if not inside or top + down < 0 or top + down + SIDE_PX > height:
                        continue
                    product_k, energy_k = np.float32(0.0), np.float32(0.0)
                    for y in range(top, top + SIDE_PX):
                        own_row = own[y, left : left + SIDE_PX]
                        other_row = others[k, y + down, left + across : left + across + SIDE_PX]
                        for x in range(SIDE_PX):
                            product_k += own_row[x] * other_row[x]
                            energy_k += other_row[x] * other_row[x]
                    product += product_k
                    scale += np.sqrt(energy * energy_k)
                if scale > 0:
                    highest, lowest = max(highest, product / scale), min(lowest, product / scale)
                    compared += 1
            # By chance, the largest and the smallest correlation are equally far from zero.
            shared = max(highest + min(lowest, np.float32(0.0)), np.float32(0.0)) if compared > 0 else np.float32(0.0)
            out[0, found], out[1, found] = energy, energy * (np.float32(1.0) - min(shared, np.float32(1.0)))
            found += 1
    return found


def own_share(now: LightField, before: LightField, gains: Float32) -> float:
    """Share, 0 to 1, of the change between two frames that adjacent views do not share, in blocks with little change.

    Parameters
    ----------
    now, before
        Consecutive frames of the same views.
    gains
        Gains (k, v, c) of rows from the previous frame's brightness to this one's.
    """
    reference, nearest, shifts = neighbours(now)
    height, width = now.height_px, now.width_px
    if not len(nearest) or min(height, width) < 2 * SIDE_PX:
        return 1.0
    new_samples, old_samples = (each.samples.reshape(-1, *each.samples.shape[2:]) for each in (now, before))
    channel = new_samples.shape[-1] // 2
    changes = np.empty((1 + len(nearest), height, width), np.float32)
    for number, view in enumerate([reference, *nearest]):
        _changes(new_samples[view], old_samples[view], gains[view], channel, changes[number])
    stride = max(SIDE_PX, int(np.sqrt(height * width / BLOCKS)))
    energies: Any = np.empty((2, (height // SIDE_PX + 1) * (width // SIDE_PX + 1)), np.float32)
    count = _compare(changes[0], changes[1:], shifts, stride, energies)
    total, specific = np.quantile(energies[:, :count], LOW_QUANTILE, axis=1)
    return float(specific / total) if total > 0 else 1.0
