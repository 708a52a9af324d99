"""A motion-adaptive recursive filter in time for light fields: what stays as it is is averaged, what changes is not.

Each sample is the mean of those before, up to MEMORY frames, as long as the new one differs by no more than noise
explains. Two tests decide, both over a small square of the view: of the difference itself, and of its running mean,
which tells of a drift too slow for the first. What moves, and what it uncovers, is the new sample alone.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.compiled import compiled
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.temporal_noise import (
    LEAST,
    ROUNDING,
    Blocks,
    Noise,
    blocks,
    differing,
    lighting,
    means,
    noise,
    top,
)

Float32 = NDArray[np.float32]
Map = Callable[..., Any]

MEMORY = 16
SIDE_PX = 5
LIKE, UNLIKE = 1.6, 2.4
"""Mean squared difference over a square, in that of noise, from which memory shrinks and from which nothing is left."""
STEADY, DRIFTING = 1.8, 3.0
"""The same of the running mean of the difference."""
AREA_PX = 16
CALM, RESTLESS = 0.2, 0.6
"""Share of an area that changed in the frame before, up to which memory is whole, and from which on there is none."""
DRIFT_SHARE = 0.25
"""Share of a frame in that running mean."""
MOST = 100.0
"""Squared differences count as that at most."""


def _drift_variance() -> Float32:
    """Variance (MEMORY + 1,) of the running mean of differences where nothing moves, by the frames averaged, in noise.

    Differences to a mean of n samples are independent, with a variance of 1 + 1 / n.
    """
    found = np.ones(MEMORY + 1)
    keep = (1.0 - DRIFT_SHARE) ** 2
    variance = 0.0
    for count in range(1, MEMORY + 1):
        variance = keep * variance + DRIFT_SHARE**2 * (1.0 + 1.0 / count)
        found[count] = variance
    return found.astype(np.float32)


DRIFT_VARIANCE = _drift_variance()


@compiled
def _filter(
    new: Any,
    full: Any,
    mean: Any,
    count: Any,
    drift: Any,
    gain: Any,
    colours: Any,
    brightness: Any,
    drift_variance: Any,
    most_frames: Any,
    out: Any,
    out_count: Any,
    out_drift: Any,
    out_changed: Any,
) -> None:
    """Filter one view: new (v, u, c), mean (v, u, c), count and drift (v, u), gain (v, c); tables by brightness."""
    height, width, channels = new.shape
    reach = SIDE_PX // 2
    last_level = np.float32(len(colours) - 1)
    one, share, most = np.float32(1.0), np.float32(DRIFT_SHARE), np.float32(MOST)
    per_channel = one / np.float32(channels)
    like, unlike = np.float32(LIKE), np.float32(UNLIKE)
    steady, drifting = np.float32(STEADY), np.float32(DRIFTING)
    # Rows of squared differences in those of noise, and their sums over the columns of the square.
    rows = np.zeros((SIDE_PX, 2, width), np.float32)
    sums = np.zeros((2, width + 2 * reach), np.float32)
    parts = np.empty((2, width), np.float32)
    for below in range(height + reach):
        ring = rows[below % SIDE_PX]
        if below < height:
            for x in range(width):
                squares, total, level = np.float32(0.0), np.float32(0.0), np.float32(0.0)
                for c in range(channels):
                    before = mean[below, x, c] * gain[below, c]
                    difference = np.float32(new[below, x, c]) / full - before
                    squares += difference * difference
                    total += difference
                    level += before
                place = int(min(level * per_channel, one) * last_level)
                times = count[below, x]
                squares /= colours[place] * (one + one / times)
                total *= per_channel
                moved = drift[below, x] + share * (total - drift[below, x])
                out_drift[below, x] = moved
                ring[0, x] = min(squares, most)
                ring[1, x] = min(moved * moved / (brightness[place] * drift_variance[int(times)]), most)
        else:
            ring[:] = 0.0
        y = below - reach
        if y < 0:
            continue
        for kind in range(2):
            inner = sums[kind, reach : reach + width]
            inner[:] = rows[0, kind]
            for number in range(1, SIDE_PX):
                part = rows[number, kind]
                for x in range(width):
                    inner[x] += part[x]
            across = parts[kind]
            across[:] = sums[kind, :width]
            for offset in range(1, SIDE_PX):
                part = sums[kind, offset : offset + width]
                for x in range(width):
                    across[x] += part[x]
        tall = min(y, reach) + min(height - 1 - y, reach) + 1
        for x in range(width):
            wide = min(x, reach) + min(width - 1 - x, reach) + 1
            pixels = one / np.float32(tall * wide)
            alike = (unlike - parts[0, x] * pixels) / (unlike - like)
            still = (drifting - parts[1, x] * pixels) / (drifting - steady)
            kept = max(min(min(alike, one), min(still, one)), np.float32(0.0))
            out_changed[y // AREA_PX, x // AREA_PX] += one - kept
            times = min(count[y, x] * kept, most_frames[y // AREA_PX, x // AREA_PX] - one) + one
            part = one / times
            rest = one - part
            out_count[y, x] = times
            out_drift[y, x] *= kept
            for c in range(channels):
                out[y, x, c] = part * (np.float32(new[y, x, c]) / full) + rest * (mean[y, x, c] * gain[y, c])


@dataclass(frozen=True, eq=False)
class _State:
    """The mean so far, of how many frames each sample is one (k, v, u), the running mean of differences, and noise."""

    light_field: LightField
    count: Float32
    drift: Float32
    most_frames: Float32
    blocks: Blocks
    noise: Noise | None

    @classmethod
    def of(cls, light_field: LightField, own: Blocks) -> _State:
        """The state after the first light field."""
        height, width = light_field.height_px, light_field.width_px
        shape = (light_field.rows * light_field.cols, height, width)
        most = np.full((-(-height // AREA_PX), -(-width // AREA_PX)), MEMORY, np.float32)
        return cls(light_field, np.ones(shape, np.float32), np.zeros(shape, np.float32), most, own, None)


class TemporalFilter:
    """Filters the light fields of one video, one after the other, in order.

    It starts anew at a light field of other views or another kind of samples. The result depends on the frames given so
    far and on nothing else: memory is that of two light fields, however long the video.

    Parameters
    ----------
    workers
        Number of threads; by default as many as OpenCV uses.
    """

    def __init__(self, workers: int | None = None) -> None:
        self._run: Map = ThreadPoolExecutor(workers or cv2.getNumThreads()).map
        self._state: _State | None = None

    def filtered(self, light_field: LightField) -> LightField:
        """The next light field of the video, averaged with those before where nothing moved.

        The first one is returned as it is; others have float32 samples, 0 to 1, of the same views and weights.
        """
        before, now = self._state, blocks(light_field)
        if before is None or not _alike(before.light_field, light_field):
            self._state = _State.of(light_field, now)
            return light_field
        gains = lighting(means(now), means(blocks(before.light_field)))
        now = differing(now, before.blocks, gains)
        least = ROUNDING if light_field.samples.dtype == np.uint8 else LEAST
        measured = noise(now, before.blocks, gains, least)
        if before.noise is not None:
            measured = before.noise.followed(measured)
        self._state = self._next(before, light_field, gains, now, measured)
        return self._state.light_field

    def _next(self, before: _State, light_field: LightField, gains: Float32, now: Blocks, measured: Noise) -> _State:
        new, old = _by_view(light_field), _by_view(before.light_field)
        if old.dtype == np.uint8:
            old = old.astype(np.float32) / np.float32(255.0)
        samples = np.empty(new.shape, np.float32)
        count, drift = np.empty_like(before.count), np.empty_like(before.drift)
        changed = np.zeros((len(new), *before.most_frames.shape), np.float32)
        tables, rows = measured.tables(), _rows(gains, new.shape[1])

        def one(view: int) -> None:
            _filter(
                new[view],
                top(light_field),
                old[view],
                before.count[view],
                before.drift[view],
                rows[view],
                *tables,
                DRIFT_VARIANCE,
                before.most_frames,
                samples[view],
                count[view],
                drift[view],
                changed[view],
            )

        list(self._run(one, range(len(new))))
        filtered = LightField.of(light_field, samples.reshape(light_field.samples.shape), light_field.weights)
        return _State(filtered, count, drift, _most_frames(changed, new.shape[1:3]), now, measured)


def _by_view(light_field: LightField) -> Any:
    """Samples (k, v, u, c)."""
    samples: Any = light_field.samples
    return samples.reshape(-1, *samples.shape[2:])


def _alike(before: LightField, now: LightField) -> bool:
    return before.samples.shape == now.samples.shape


def _rows(gains: Float32, height: int) -> Float32:
    """Gains (k, v, c) of all rows of pixels, of those (k, m, c) of rows of blocks."""
    down = gains.shape[1]
    place = (np.arange(height, dtype=np.float32) + np.float32(0.5)) * np.float32(down / height) - np.float32(0.5)
    place = np.clip(place, 0, down - 1)
    above = np.minimum(place.astype(np.int64), max(down - 2, 0))
    part = (place - above.astype(np.float32))[:, None]
    below = np.minimum(above + 1, down - 1)
    return np.ascontiguousarray(gains[:, above] + part * (gains[:, below] - gains[:, above]))


def _most_frames(changed: Float32, shape: tuple[int, int]) -> Float32:
    """Frames (i, j) that are averaged at most in areas of AREA_PX, of the samples (k, i, j) of views that changed."""
    rows, columns = (np.minimum(AREA_PX, side - np.arange(0, side, AREA_PX)) for side in shape)
    share: Any = cv2.blur(changed.mean(axis=0) / np.outer(rows, columns).astype(np.float32), (3, 3))
    part = np.clip((RESTLESS - share) / (RESTLESS - CALM), 0.0, 1.0)
    return np.asarray(1.0 + (MEMORY - 1) * part, dtype=np.float32)
