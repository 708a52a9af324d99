"""Times of depth beside one pair of OpenCV's stereo and a bare `cv2.remap` of the views, as pixels and views grow."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import cv2
import numpy as np

from benchmarks.records import Rows
from mirrorcam.optics.light_field.depth import DepthEstimator
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.relief_scene import Card, Relief, even_views, light_field_of

CASES = ((3, 400, 240), (3, 200, 120), (3, 800, 480), (5, 400, 240), (9, 400, 240))
REACH_MM = 38.0
"""From the central view to the farthest along an axis, as of the default device."""
SCENE = Relief(cards=(Card(400.0, (-80.0, -50.0, -30.0, 10.0)), Card(430.0, (30.0, 0.0, 70.0, 40.0))))


def photographed(count: int, width_px: int, height_px: int) -> LightField:
    """The scene by a grid of views whose field of view is the same for any number of pixels."""
    views = even_views(
        count,
        REACH_MM / (count // 2),
        focal_px=1.5 * width_px,
        centre_px=np.array([(width_px - 1) / 2.0, (height_px - 1) / 2.0]),
        width_px=width_px,
        height_px=height_px,
    )
    return light_field_of(SCENE, views, subsamples=1)[0]


def times(light_field: LightField, rounds: int) -> dict[str, float]:
    """Median milliseconds of each job; all jobs in each round."""
    height, width = light_field.height_px, light_field.width_px
    columns, rows = (
        axis.astype(np.float32) + np.float32(0.3) for axis in np.meshgrid(np.arange(width), np.arange(height))
    )
    maps = cv2.convertMaps(columns, rows, cv2.CV_16SC2)
    best, fast = (DepthEstimator(light_field, quality=quality) for quality in ("best", "fast"))
    # As many disparities as one view moves between the nearest and the farthest plane.
    most = 16 * int(np.ceil(best.planes * 0.5 / 16))
    matcher = cv2.StereoSGBM.create(numDisparities=most, blockSize=5, P1=600, P2=2400, disp12MaxDiff=1)
    left, right = (np.ascontiguousarray(light_field.samples[0, col]) for col in (0, 1))

    def bare() -> None:
        for index in np.ndindex(light_field.rows, light_field.cols):
            cv2.remap(light_field.samples[index], *maps, cv2.INTER_LINEAR)

    jobs: dict[str, Callable[[], object]] = {
        "best": lambda: best.estimate(light_field),
        "fast": lambda: fast.estimate(light_field),
        "one StereoSGBM pair": lambda: matcher.compute(left, right),
        "bare remap": bare,
    }
    found: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds + 1):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            found[name].append(1e3 * (time.perf_counter() - start))
    return {name: statistics.median(each[1:]) for name, each in found.items()}


def speed(rounds: int) -> Rows:
    """Print the times."""
    print(f"{cv2.getNumThreads()} threads; medians of {rounds} rounds, ms; in brackets, times one pair, times remaps")
    rows = Rows("views", "best", "fast", "one StereoSGBM pair", "bare remap")
    for count, width, height in CASES:
        middle = times(photographed(count, width, height), rounds)
        pair, bare = middle["one StereoSGBM pair"], middle["bare remap"]
        cells = (
            f"{middle[name]:.0f} ({middle[name] / pair:.1f}, {middle[name] / bare:.0f})" for name in ("best", "fast")
        )
        rows.add(f"{count}x{count} of {width}x{height} px", *cells, f"{pair:.0f}", f"{bare:.1f}")
    return rows
