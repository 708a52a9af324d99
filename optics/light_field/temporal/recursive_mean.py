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
def _differences(new: Samples, scale: float, mean: Float32, gain: Float32, difference: Float32, level: Float32) -> None:
    """Fill differences (u, c) of a row from its mean, scaled to the frame's lighting, and that mean's levels (u,)."""
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
    mean_difference: Float32,
    tables: Float32,
    count_tables: Float32,
    out_mean: Float32,
    information: Float32,
    out: Float32,
) -> None:
    """Fill squares (2, u) of the difference and of its running mean, over their variances.

    The running mean is written to `out_mean` (u,), and its inverse variance to `information` (u,).
    """
    width, channels = difference.shape
    last, one = np.float32(tables.shape[1] - 1), np.float32(1.0)
    weight, max_squares, third = np.float32(DIFFERENCE_WEIGHT), np.float32(MAX_SQUARES), np.float32(1.0 / 3.0)
    for x in range(width):
        a = difference[x, 0]
        squares, total = a * a, a
        if channels == 3:
            b, c = difference[x, 1], difference[x, 2]
            squares += b * b + c * c
            total = (a + b + c) * third
        running = max(min(mean_difference[x] + weight * (total - mean_difference[x]), one), -one)
        out_mean[x] = running
        entry, averaged = np.uint32(max(min(level[x], one), np.float32(0.0)) * last), np.uint32(count[x])
        out[0, x] = min(squares * tables[0, entry] * count_tables[0, averaged], max_squares)
        information[x] = tables[1, entry] * count_tables[1, averaged]
        out[1, x] = min(running * running * information[x], max_squares)


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
def _blend(new: Samples, white_level: float, mean: Float32, gain: Float32, new_weight: Float32, out: Float32) -> None:
    """Blend a row (u, c) of new samples, by their weight (u,), with their mean, scaled to the frame's lighting."""
    one = np.float32(1.0)
    if out.shape[1] == 3:
        red_gain, green_gain, blue_gain = gain[0], gain[1], gain[2]
        for x in range(len(new_weight)):
            weight, mean_weight = new_weight[x], one - new_weight[x]
            red = weight * (np.float32(new[x, 0]) / white_level) + mean_weight * (mean[x, 0] * red_gain)
            green = weight * (np.float32(new[x, 1]) / white_level) + mean_weight * (mean[x, 1] * green_gain)
            blue = weight * (np.float32(new[x, 2]) / white_level) + mean_weight * (mean[x, 2] * blue_gain)
            out[x, 0], out[x, 1], out[x, 2] = red, green, blue
    else:
        for x in range(len(new_weight)):
            mean_weight = one - new_weight[x]
            out[x, 0] = new_weight[x] * (np.float32(new[x, 0]) / white_level) + mean_weight * (mean[x, 0] * gain[0])


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
    one, scale = np.float32(1.0), np.float32(1.0) / white_level
    difference = np.empty((width, channels), np.float32)
    levels = np.empty((radius + 2, width), np.float32)
    information = np.empty_like(levels)
    rows = np.zeros((SIDE_PX, 2, width), np.float32)
    sums = np.zeros((2, width + 2 * radius), np.float32)
    kept, new_weight, inverse = np.empty(width, np.float32), np.empty(width, np.float32), np.empty(width, np.float32)
    for below in range(height + radius):
        if below < height:
            level, row_information = levels[below % (radius + 2)], information[below % (radius + 2)]
            _differences(new[below], scale, mean[below], gain[below], difference, level)
            ring = rows[below % SIDE_PX]
            _test_changes(
                difference,
                level,
                count[below],
                mean_difference[below],
                tables,
                count_tables,
                out_mean_difference[below],
                row_information,
                ring,
            )
        else:
            rows[below % SIDE_PX] = 0.0
        y = below - radius
        if y < 0:
            continue
        for kind in range(2):
            inner = sums[kind, radius : radius + width]
            inner[:] = rows[0, kind]
            for number in range(1, SIDE_PX):
                row = rows[number, kind]
                for x in range(width):
                    inner[x] += row[x]
        window_rows = min(y, radius) + min(height - 1 - y, radius) + 1
        for x in range(width):
            inverse[x] = one / np.float32(window_rows * (min(x, radius) + min(width - 1 - x, radius) + 1))
        _memory_fraction(sums, inverse, limits, kept)
        for tile in range(max_frames.shape[1]):
            frames_limit = max_frames[y // TILE_PX, tile] - one
            for x in range(tile * TILE_PX, min((tile + 1) * TILE_PX, width)):
                frames = min(count[y, x] * kept[x], frames_limit) + one
                out_count[y, x] = frames
                new_weight[x] = one / frames
                out_mean_difference[y, x] *= kept[x]
        if y % 2 == 1 and y < height - 1:
            above, next_row = levels[(y - 1) % (radius + 2)], levels[(y + 1) % (radius + 2)]
            this_row, row_information = levels[y % (radius + 2)], information[y % (radius + 2)]
            _add_motion_sums(above, this_row, next_row, out_mean_difference[y], row_information, out_sums[y // TILE_PX])
        _blend(new[y], white_level, mean[y], gain[y], new_weight, out[y])
