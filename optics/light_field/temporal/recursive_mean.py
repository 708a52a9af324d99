"""The recursive mean of a video, row by row: changes are distinguished from noise, and static samples are averaged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.optics.light_field.light_field import Samples

Float32 = NDArray[np.float32]

MEMORY = 24
"""Approximate number of frames averaged at most; a static sample's noise falls to 0.15 of a frame's."""
SIDE_PX = 5
"""Side of the square over which changes are tested."""
AREA_PX = 16
LAG_SUMS = 9
DRIFT_SHARE = 0.25
"""Weight of a frame in the running mean of differences."""
MAX_SQUARES = 100.0
"""Limit of squared differences."""


def _information() -> Float32:
    """Inverse variances (2, MEMORY + 1) of differences and of their running mean, by frames averaged, in units of
    noise.

    Without motion, differences from a mean of n samples are independent, with a variance of 1 + 1 / n.
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
def _differences(new: Samples, scale: float, mean: Float32, gain: Float32, difference: Float32, level: Float32) -> None:
    """Differences (u, c) of a row from its mean scaled to this lighting, and the brightness (u,) of that mean."""
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
def _test_changes(
    difference: Float32,
    level: Float32,
    count: Float32,
    drift: Float32,
    tables: Float32,
    by_count: Float32,
    drifted: Float32,
    information: Float32,
    out: Float32,
) -> None:
    """Squares (2, u) of the difference and of its running mean, over their variances.

    The running mean is written to `drifted` (u,), and its inverse variance to `information` (u,).
    """
    width, channels = difference.shape
    last, one = np.float32(tables.shape[1] - 1), np.float32(1.0)
    share, max_squares, third = np.float32(DRIFT_SHARE), np.float32(MAX_SQUARES), np.float32(1.0 / 3.0)
    for x in range(width):
        a = difference[x, 0]
        squares, total = a * a, a
        if channels == 3:
            b, c = difference[x, 1], difference[x, 2]
            squares += b * b + c * c
            total = (a + b + c) * third
        running = max(min(drift[x] + share * (total - drift[x]), one), -one)
        drifted[x] = running
        entry, averaged = np.uint32(max(min(level[x], one), np.float32(0.0)) * last), np.uint32(count[x])
        out[0, x] = min(squares * tables[0, entry] * by_count[0, averaged], max_squares)
        information[x] = tables[1, entry] * by_count[1, averaged]
        out[1, x] = min(running * running * information[x], max_squares)


@compiled
def _add_lag(
    above: Float32, level: Float32, below: Float32, drift: Float32, information: Float32, out: Float32
) -> None:
    """Add a row to the weighted sums (j, LAG_SUMS) of areas: drift, gradients of the mean, and their products."""
    width = len(level)
    half = np.float32(0.5)
    for area in range(len(out)):
        total, across, down, moved = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
        xx, xy, yy, xe, ye = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
        for x in range(max(area * AREA_PX, 1), min((area + 1) * AREA_PX, width - 1)):
            right, lower = half * (level[x + 1] - level[x - 1]), half * (below[x] - above[x])
            weight, error = information[x], drift[x]
            total += weight
            moved += weight * error
            across += weight * right
            down += weight * lower
            xx += weight * right * right
            xy += weight * right * lower
            yy += weight * lower * lower
            xe += weight * right * error
            ye += weight * lower * error
        sums = out[area]
        sums[0] += total
        sums[1] += across
        sums[2] += down
        sums[3] += moved
        sums[4] += xx
        sums[5] += xy
        sums[6] += yy
        sums[7] += xe
        sums[8] += ye


@compiled
def _memory_share(sums: Float32, inverse: Float32, limits: Float32, out: Float32) -> None:
    """Share (u,) of memory that is kept, from sums (2, u) over the rows of the square, padded at both sides.

    `limits` (2, 2) hold where memory begins to shrink and where it is lost, for the difference and its running mean.
    """
    width = len(out)
    zero, one = np.float32(0.0), np.float32(1.0)
    changed, drifting = limits[1, 0], limits[1, 1]
    change_slope, drift_slope = one / (changed - limits[0, 0]), one / (drifting - limits[0, 1])
    for x in range(width):
        change, drift = sums[0, x], sums[1, x]
        for offset in range(1, SIDE_PX):
            change += sums[0, x + offset]
            drift += sums[1, x + offset]
        kept_by_change = (changed - change * inverse[x]) * change_slope
        kept_by_drift = (drifting - drift * inverse[x]) * drift_slope
        out[x] = max(min(kept_by_change, kept_by_drift, one), zero)


@compiled
def _blend(new: Samples, full: float, mean: Float32, gain: Float32, new_share: Float32, out: Float32) -> None:
    """Blend a row (u, c) of new samples with their mean scaled to this lighting, by the new ones' share (u,)."""
    one = np.float32(1.0)
    for x in range(len(new_share)):
        mean_share = one - new_share[x]
        for c in range(out.shape[1]):
            out[x, c] = new_share[x] * (np.float32(new[x, c]) / full) + mean_share * (mean[x, c] * gain[c])


@compiled
def filter_view(
    new: Samples,
    full: float,
    mean: Float32,
    count: Float32,
    drift: Float32,
    gain: Float32,
    tables: Float32,
    by_count: Float32,
    limits: Float32,
    most_frames: Float32,
    out: Float32,
    out_count: Float32,
    out_drift: Float32,
    out_lag: Float32,
) -> None:
    """Filter one view: `new` (v, u, c) of `full` brightness, `mean` (v, u, c), `count` and `drift` (v, u).

    `gain` (v, c) scales the mean to this lighting; `tables` and `by_count` are inverse variances by brightness and by
    count; `most_frames` (i, j) and `out_lag` (i, j, LAG_SUMS) belong to areas.
    """
    height, width, channels = new.shape
    reach = SIDE_PX // 2
    one, scale = np.float32(1.0), np.float32(1.0) / full
    difference = np.empty((width, channels), np.float32)
    levels = np.empty((reach + 2, width), np.float32)
    information = np.empty_like(levels)
    rows = np.zeros((SIDE_PX, 2, width), np.float32)
    sums = np.zeros((2, width + 2 * reach), np.float32)
    kept, new_share, inverse = np.empty(width, np.float32), np.empty(width, np.float32), np.empty(width, np.float32)
    for below in range(height + reach):
        if below < height:
            level, own = levels[below % (reach + 2)], information[below % (reach + 2)]
            _differences(new[below], scale, mean[below], gain[below], difference, level)
            ring = rows[below % SIDE_PX]
            _test_changes(difference, level, count[below], drift[below], tables, by_count, out_drift[below], own, ring)
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
        window_rows = min(y, reach) + min(height - 1 - y, reach) + 1
        for x in range(width):
            inverse[x] = one / np.float32(window_rows * (min(x, reach) + min(width - 1 - x, reach) + 1))
        _memory_share(sums, inverse, limits, kept)
        for area in range(most_frames.shape[1]):
            max_frames = most_frames[y // AREA_PX, area] - one
            for x in range(area * AREA_PX, min((area + 1) * AREA_PX, width)):
                frames = min(count[y, x] * kept[x], max_frames) + one
                out_count[y, x] = frames
                new_share[x] = one / frames
                out_drift[y, x] *= kept[x]
        if y % 2 == 1 and y < height - 1:
            above, next_row = levels[(y - 1) % (reach + 2)], levels[(y + 1) % (reach + 2)]
            this_row, own = levels[y % (reach + 2)], information[y % (reach + 2)]
            _add_lag(above, this_row, next_row, out_drift[y], own, out_lag[y // AREA_PX])
        _blend(new[y], full, mean[y], gain[y], new_share, out[y])
