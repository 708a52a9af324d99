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
from mirrorcam.optics.light_field.shared_changes import own_share
from mirrorcam.optics.light_field.temporal_noise import (
    LEAST,
    ROUNDING,
    Blocks,
    Noise,
    blocks,
    differing,
    lighting,
    noise,
    top,
)

Float32 = NDArray[np.float32]
Map = Callable[..., Any]

MEMORY = 24
SIDE_PX = 5
LIKE, UNLIKE = 2.0, 4.0
"""Standard deviations of chance by which a square may differ before memory shrinks, and before nothing is left of it."""
AREA_PX = 16
CALM, RESTLESS = 0.2, 0.6
"""Share of an area that changed in the frame before, up to which memory is whole, and from which on there is none."""
MOVING, RESTING = 0.75, 0.92
"""Share of what changes that is each view's own, up to which noise cannot be told from motion, and from which it can."""
DRIFT_SHARE = 0.25
"""Share of a frame in that running mean."""
MOST = 100.0
"""Squared differences count as that at most."""


def _information() -> Float32:
    """Inverse variance (2, MEMORY + 1) of differences and of their running mean, by the frames averaged, in noise.

    Where nothing moves, differences to a mean of n samples are independent and have a variance of 1 + 1 / n.
    """
    found = np.ones((2, MEMORY + 1))
    keep = (1.0 - DRIFT_SHARE) ** 2
    variance = 0.0
    for count in range(1, MEMORY + 1):
        variance = keep * variance + DRIFT_SHARE**2 * (1.0 + 1.0 / count)
        found[:, count] = 1.0 / (1.0 + 1.0 / count), 1.0 / variance
    return found.astype(np.float32)


INFORMATION = _information()


@compiled
def _differences(new: Any, scale: Any, mean: Any, gain: Any, difference: Any, level: Any) -> None:
    """Differences (u, c) of a row to its mean in the light of now, and the brightness (u,) of that mean."""
    width, channels = new.shape
    if channels == 3:
        for x in range(width):
            red, green, blue = mean[x, 0] * gain[0], mean[x, 1] * gain[1], mean[x, 2] * gain[2]
            difference[x, 0] = np.float32(new[x, 0]) * scale - red
            difference[x, 1] = np.float32(new[x, 1]) * scale - green
            difference[x, 2] = np.float32(new[x, 2]) * scale - blue
            level[x] = (red + green + blue) * np.float32(1.0 / 3.0)
    else:
        for x in range(width):
            level[x] = mean[x, 0] * gain[0]
            difference[x, 0] = np.float32(new[x, 0]) * scale - level[x]


@compiled
def _tested(
    difference: Any, level: Any, count: Any, drift: Any, tables: Any, by_count: Any, drifted: Any, out: Any
) -> None:
    """Squares (2, u) of the difference and of its running mean, in those of noise; the running mean is `drifted`."""
    width, channels = difference.shape
    last, one = np.float32(tables.shape[1] - 1), np.float32(1.0)
    share, most, third = np.float32(DRIFT_SHARE), np.float32(MOST), np.float32(1.0 / 3.0)
    for x in range(width):
        a = difference[x, 0]
        squares, total = a * a, a
        if channels == 3:
            b, c = difference[x, 1], difference[x, 2]
            squares += b * b + c * c
            total = (a + b + c) * third
        moved = drift[x] + share * (total - drift[x])
        drifted[x] = moved
        place, times = np.uint32(min(level[x], one) * last), np.uint32(count[x])
        out[0, x] = min(squares * tables[0, place] * by_count[0, times], most)
        out[1, x] = min(moved * moved * tables[1, place] * by_count[1, times], most)


@compiled
def _kept(sums: Any, inverse: Any, limits: Any, out: Any) -> None:
    """Share (u,) of memory that is kept, of sums (2, u) of squares over the square's rows, padded at both sides, by `limits`."""
    width = len(out)
    zero, one = np.float32(0.0), np.float32(1.0)
    unlike, drifting = limits[1, 0], limits[1, 1]
    alike, still = one / (unlike - limits[0, 0]), one / (drifting - limits[0, 1])
    for x in range(width):
        change, drift = sums[0, x], sums[1, x]
        for offset in range(1, SIDE_PX):
            change += sums[0, x + offset]
            drift += sums[1, x + offset]
        like = (unlike - change * inverse[x]) * alike
        steady = (drifting - drift * inverse[x]) * still
        out[x] = max(min(like, steady, one), zero)


@compiled
def _blended(new: Any, full: Any, mean: Any, gain: Any, part: Any, out: Any) -> None:
    """A row (u, c) of new samples and their mean in the light of now, by the share (u,) of the new ones."""
    one = np.float32(1.0)
    for x in range(len(part)):
        rest = one - part[x]
        for c in range(out.shape[1]):
            out[x, c] = part[x] * (np.float32(new[x, c]) / full) + rest * (mean[x, c] * gain[c])


@compiled
def _filter(
    new: Any,
    full: Any,
    mean: Any,
    count: Any,
    drift: Any,
    gain: Any,
    tables: Any,
    by_count: Any,
    limits: Any,
    most_frames: Any,
    out: Any,
    out_count: Any,
    out_drift: Any,
    out_changed: Any,
) -> None:
    """Filter one view: new (v, u, c), mean (v, u, c), count and drift (v, u), gain (v, c); tables by brightness."""
    height, width, channels = new.shape
    reach = SIDE_PX // 2
    one, scale = np.float32(1.0), np.float32(1.0) / full
    difference, level = np.empty((width, channels), np.float32), np.empty(width, np.float32)
    rows = np.zeros((SIDE_PX, 2, width), np.float32)
    sums = np.zeros((2, width + 2 * reach), np.float32)
    kept, part, inverse = np.empty(width, np.float32), np.empty(width, np.float32), np.empty(width, np.float32)
    for below in range(height + reach):
        if below < height:
            _differences(new[below], scale, mean[below], gain[below], difference, level)
            ring = rows[below % SIDE_PX]
            _tested(difference, level, count[below], drift[below], tables, by_count, out_drift[below], ring)
        else:
            rows[below % SIDE_PX] = 0.0
        y = below - reach
        if y < 0:
            continue
        for kind in range(2):
            inner = sums[kind, reach : reach + width]
            inner[:] = rows[0, kind]
            for number in range(1, SIDE_PX):
                row = rows[number, kind]
                for x in range(width):
                    inner[x] += row[x]
        tall = min(y, reach) + min(height - 1 - y, reach) + 1
        for x in range(width):
            inverse[x] = one / np.float32(tall * (min(x, reach) + min(width - 1 - x, reach) + 1))
        _kept(sums, inverse, limits, kept)
        for area in range(most_frames.shape[1]):
            most = most_frames[y // AREA_PX, area] - one
            changed = np.float32(0.0)
            for x in range(area * AREA_PX, min((area + 1) * AREA_PX, width)):
                changed += one - kept[x]
                times = min(count[y, x] * kept[x], most) + one
                out_count[y, x] = times
                part[x] = one / times
                out_drift[y, x] *= kept[x]
            out_changed[y // AREA_PX, area] += changed
        _blended(new[y], full, mean[y], gain[y], part, out[y])


@dataclass(frozen=True, eq=False)
class _State:
    """The mean so far, the last frame, of how many frames each sample is one (k, v, u), the running mean of differences, and noise."""

    light_field: LightField
    frame: LightField
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
        return cls(light_field, light_field, np.ones(shape, np.float32), np.zeros(shape, np.float32), most, own, None)


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
        gains = lighting(now.means, blocks(before.light_field).means)
        now = differing(now, before.blocks, gains)
        least = ROUNDING if light_field.samples.dtype == np.uint8 else LEAST
        rows = _rows(gains, light_field.height_px)
        trust = (own_share(light_field, before.frame, rows) - MOVING) / (RESTING - MOVING)
        measured = noise(now, before.blocks, gains, least, min(max(trust, 0.0), 1.0))
        if before.noise is not None:
            measured = before.noise.followed(measured)
        self._state = self._next(before, light_field, rows, now, measured)
        return self._state.light_field

    def _next(self, before: _State, light_field: LightField, rows: Float32, now: Blocks, measured: Noise) -> _State:
        new, old = _by_view(light_field), _by_view(before.light_field)
        if old.dtype == np.uint8:
            old = old.astype(np.float32) / np.float32(255.0)
        samples = np.empty(new.shape, np.float32)
        count, drift = np.empty_like(before.count), np.empty_like(before.drift)
        changed = np.zeros((len(new), *before.most_frames.shape), np.float32)
        tables = measured.information()
        limits = np.array([measured.limits(LIKE), measured.limits(UNLIKE)], np.float32)

        def one(view: int) -> None:
            _filter(
                new[view],
                top(light_field),
                old[view],
                before.count[view],
                before.drift[view],
                rows[view],
                tables,
                INFORMATION,
                limits,
                before.most_frames,
                samples[view],
                count[view],
                drift[view],
                changed[view],
            )

        list(self._run(one, range(len(new))))
        filtered = LightField.of(light_field, samples.reshape(light_field.samples.shape), light_field.weights)
        return _State(filtered, light_field, count, drift, _most_frames(changed, new.shape[1:3]), now, measured)


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
