"""The recursive mean of a video, row by row: changes are distinguished from noise, and static samples are averaged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.optics.light_field.light_field import Samples

Float32 = NDArray[np.float32]

MEMORY = 24
"""Approximate maximum number of averaged frames; a static sample's noise falls to 0.15 of a frame's."""
SIDE_PX = 5
"""Side of the square over which changes are tested."""
TILE_PX = 16
"""Side of the tiles over which lag is measured."""
MOTION_SUMS = 9
"""Number of sums per tile: see `_add_motion_sums`."""
DIFFERENCE_WEIGHT = 0.25
"""Weight of a frame in the running mean of differences."""
MAX_SQUARES = 100.0
"""Limit of squared differences."""


def _information() -> Float32:
    """Return inverse variances (2, MEMORY + 1), relative to the noise, for each number of averaged frames.

    The rows are those of differences and of their running mean.

    Without motion, differences from a mean of n samples are independent, with a variance of 1 + 1 / n.
    """
    inverse_variances = np.ones((2, MEMORY + 1))
    keep = (1.0 - DIFFERENCE_WEIGHT) ** 2
    variance = 0.0
    for count in range(1, MEMORY + 1):
        variance = keep * variance + DIFFERENCE_WEIGHT**2 * (1.0 + 1.0 / count)
        inverse_variances[:, count] = 1.0 / (1.0 + 1.0 / count), 1.0 / variance
    return inverse_variances.astype(np.float32)


INFORMATION = _information()


@compiled
def _repeat_gain(gain: Float32, out: Float32) -> None:
    """Fill `out` (u c,) with the gain (c,) of each sample of a row, unless it holds it; rows often share one."""
    channels = len(gain)
    same = True
    for channel in range(channels):
        same = same and out[channel] == gain[channel]
    if same:
        return
    if channels == 1:
        out[:] = gain[0]
        return
    red, green, blue = gain[0], gain[1], gain[2]
    for x in range(len(out) // 3):
        i = np.uint32(3 * x)
        out[i], out[i + 1], out[i + 2] = red, green, blue


@compiled
def _differences(
    new: Samples, scale: float, mean: Float32, gains: Float32, work: Float32, level: Float32, change: Float32
) -> None:
    """Fill the levels (u,) of a row's mean, scaled to the frame's lighting, and changes (2, u) of the row from it.

    The changes are the mean over the channels, and the sum of squares. `new`, `mean` and their `gains` are (u c,);
    `work` (2, u c) is a buffer.
    """
    lit, difference, total, squares = work[0], work[1], change[0], change[1]
    third = np.float32(1.0 / 3.0)
    for x in range(len(lit)):
        lit[x] = mean[x] * gains[x]
    for x in range(len(difference)):
        difference[x] = np.float32(new[x]) * scale - lit[x]
    if len(level) == len(lit):
        level[:], total[:] = lit, difference
        for x in range(len(squares)):
            squares[x] = difference[x] * difference[x]
        return
    for x in range(len(level)):
        i = np.uint32(3 * x)
        level[x] = (lit[i] + lit[i + 1] + lit[i + 2]) * third
    for x in range(len(level)):
        i = np.uint32(3 * x)
        a, b, c = difference[i], difference[i + 1], difference[i + 2]
        total[x] = (a + b + c) * third
        squares[x] = a * a + (b * b + c * c)


@compiled
def _test_changes(
    changes: Float32,
    level: Float32,
    count: Float32,
    mean_difference: Float32,
    tables: Float32,
    count_tables: Float32,
    out_mean: Float32,
    information: Float32,
    change: Float32,
    drift: Float32,
) -> None:
    """Fill squares (u,) of the difference, `change`, and of its running mean, `drift`, over their variances.

    The running mean is written to `out_mean` (u,), and its inverse variance to `information` (u,).
    """
    last, one = np.float32(tables.shape[1] - 1), np.float32(1.0)
    weight, max_squares, total, squares = np.float32(DIFFERENCE_WEIGHT), np.float32(MAX_SQUARES), changes[0], changes[1]
    for x in range(len(level)):
        running = max(min(mean_difference[x] + weight * (total[x] - mean_difference[x]), one), -one)
        out_mean[x] = running
        entry, averaged = np.uint32(max(min(level[x], one), np.float32(0.0)) * last), np.uint32(count[x])
        change[x] = min(squares[x] * tables[0, entry] * count_tables[0, averaged], max_squares)
        information[x] = tables[1, entry] * count_tables[1, averaged]
        drift[x] = min(running * running * information[x], max_squares)


@compiled
def _add_motion_sums(
    above: Float32, level: Float32, below: Float32, mean_difference: Float32, information: Float32, out: Float32
) -> None:
    """Add a row to weighted sums (j, MOTION_SUMS) over tiles: mean differences, the mean's gradients, and products."""
    width = len(level)
    half = np.float32(0.5)
    for tile in range(len(out)):
        total, x_total, y_total, error_total = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
        xx, xy, yy, xe, ye = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
        for x in range(max(tile * TILE_PX, 1), min((tile + 1) * TILE_PX, width - 1)):
            dx, dy = half * (level[x + 1] - level[x - 1]), half * (below[x] - above[x])
            weight, error = information[x], mean_difference[x]
            total += weight
            error_total += weight * error
            x_total += weight * dx
            y_total += weight * dy
            xx += weight * dx * dx
            xy += weight * dx * dy
            yy += weight * dy * dy
            xe += weight * dx * error
            ye += weight * dy * error
        sums = out[tile]
        sums[0] += total
        sums[1] += x_total
        sums[2] += y_total
        sums[3] += error_total
        sums[4] += xx
        sums[5] += xy
        sums[6] += yy
        sums[7] += xe
        sums[8] += ye


@compiled
def _memory_fraction(sums: Float32, inverse: Float32, limits: Float32, out: Float32) -> None:
    """Fill the fraction (u,) of memory that is kept, from sums (2, u) over a square's rows, padded on both sides.

    `limits` (2, 2): where memory begins to shrink and where it is lost, for the difference and its running mean.
    """
    width = len(out)
    zero, one = np.float32(0.0), np.float32(1.0)
    max_change, max_drift = limits[1, 0], limits[1, 1]
    change_slope, drift_slope = one / (max_change - limits[0, 0]), one / (max_drift - limits[0, 1])
    for x in range(width):
        change, mean_difference = sums[0, x], sums[1, x]
        for offset in range(1, SIDE_PX):
            change += sums[0, x + offset]
            mean_difference += sums[1, x + offset]
        kept_by_change = (max_change - change * inverse[x]) * change_slope
        kept_by_drift = (max_drift - mean_difference * inverse[x]) * drift_slope
        out[x] = max(min(kept_by_change, kept_by_drift, one), zero)


@compiled
def _add_rows(rows: Float32, out: Float32) -> None:
    """Fill the sum (u,) of SIDE_PX rows (n, u)."""
    first, second, third, fourth, fifth = rows[0], rows[1], rows[2], rows[3], rows[4]
    for x in range(len(out)):
        out[x] = first[x] + second[x] + third[x] + fourth[x] + fifth[x]


@compiled
def _count_frames(
    count: Float32, kept: Float32, limit: Float32, out_count: Float32, new_weight: Float32, mean_difference: Float32
) -> None:
    """Fill the numbers (u,) of averaged frames after a frame and its weights; shrink the mean differences."""
    one = np.float32(1.0)
    # Each loop runs over few arrays, which lets the compiler vectorise.
    for x in range(len(out_count)):
        out_count[x] = min(count[x] * kept[x], limit[x]) + one
    for x in range(len(new_weight)):
        new_weight[x] = one / out_count[x]
    for x in range(len(mean_difference)):
        mean_difference[x] *= kept[x]


@compiled
def _blend(
    new: Samples, white_level: float, mean: Float32, gains: Float32, new_weight: Float32, weights: Float32, out: Float32
) -> None:
    """Blend a row of new samples, by their weight (u,), with their mean, scaled to the frame's lighting.

    `new`, `mean`, its `gains`, `out` and the buffer `weights` are (u c,).
    """
    one = np.float32(1.0)
    if len(new_weight) == len(out):
        weights[:] = new_weight
    else:
        for x in range(len(new_weight)):
            i = np.uint32(3 * x)
            weights[i], weights[i + 1], weights[i + 2] = new_weight[x], new_weight[x], new_weight[x]
    for x in range(len(out)):
        out[x] = weights[x] * (np.float32(new[x]) / white_level)
    for x in range(len(out)):
        out[x] += (one - weights[x]) * (mean[x] * gains[x])


@compiled
def filter_view(
    new: Samples,
    white_level: float,
    mean: Float32,
    count: Float32,
    mean_difference: Float32,
    gain: Float32,
    tables: Float32,
    count_tables: Float32,
    limits: Float32,
    max_frames: Float32,
    out: Float32,
    out_count: Float32,
    out_mean_difference: Float32,
    out_sums: Float32,
) -> None:
    """Filter one view: `new` and `mean` (v, u, c), `count` and `mean_difference` (v, u); white is `white_level`.

    `gain` (v, c) scales the mean to the frame's lighting; `tables` and `count_tables` are inverse variances by
    brightness and by count; `max_frames` (i, j) and `out_sums` (i, j, MOTION_SUMS) hold values per tile.
    """
    height, width, channels = new.shape
    radius = SIDE_PX // 2
    scale = np.float32(1.0) / white_level
    # Samples of a row, without a channel axis: the compiler vectorises loops over them.
    new_rows, mean_rows = new.reshape((height, width * channels)), mean.reshape((height, width * channels))
    out_rows = out.reshape((height, width * channels))
    work, changes = np.empty((2, width * channels), np.float32), np.empty((2, width), np.float32)
    gains = np.zeros((2, width * channels), np.float32)
    levels = np.empty((radius + 2, width), np.float32)
    information = np.empty_like(levels)
    rows = np.zeros((2, SIDE_PX, width), np.float32)
    sums = np.zeros((2, width + 2 * radius), np.float32)
    kept, new_weight, inverse = np.empty(width, np.float32), np.empty(width, np.float32), np.empty(width, np.float32)
    frames_limit, inverse_rows = np.empty(width, np.float32), 0
    for below in range(height + radius):
        if below < height:
            level, row_information = levels[below % (radius + 2)], information[below % (radius + 2)]
            _repeat_gain(gain[below], gains[0])
            _differences(new_rows[below], scale, mean_rows[below], gains[0], work, level, changes)
            _test_changes(
                changes,
                level,
                count[below],
                mean_difference[below],
                tables,
                count_tables,
                out_mean_difference[below],
                row_information,
                rows[0, below % SIDE_PX],
                rows[1, below % SIDE_PX],
            )
        else:
            rows[:, below % SIDE_PX] = 0.0
        y = below - radius
        if y < 0:
            continue
        for kind in range(2):
            _add_rows(rows[kind], sums[kind, radius : radius + width])
        window_rows = min(y, radius) + min(height - 1 - y, radius) + 1
        if window_rows != inverse_rows:
            inverse_rows = window_rows
            for x in range(width):
                pixels = window_rows * (min(x, radius) + min(width - 1 - x, radius) + 1)
                inverse[x] = np.float32(1.0) / np.float32(pixels)
        _memory_fraction(sums, inverse, limits, kept)
        if y % TILE_PX == 0:
            for tile in range(max_frames.shape[1]):
                frames_limit[tile * TILE_PX : (tile + 1) * TILE_PX] = max_frames[y // TILE_PX, tile] - np.float32(1.0)
        _count_frames(count[y], kept, frames_limit, out_count[y], new_weight, out_mean_difference[y])
        if y % 2 == 1 and y < height - 1:
            above, next_row = levels[(y - 1) % (radius + 2)], levels[(y + 1) % (radius + 2)]
            this_row, row_information = levels[y % (radius + 2)], information[y % (radius + 2)]
            _add_motion_sums(above, this_row, next_row, out_mean_difference[y], row_information, out_sums[y // TILE_PX])
        _repeat_gain(gain[y], gains[1])
        _blend(new_rows[y], white_level, mean_rows[y], gains[1], new_weight, work[0], out_rows[y])
