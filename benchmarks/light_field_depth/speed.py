"""Times of depth, one pair of OpenCV's stereo and a bare `cv2.remap` of the views, for more pixels and more views."""

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
FARTHEST_MM = 38.0
"""Distance from the central view to the farthest along an axis, as in the default device."""
SCENE = Relief(cards=(Card(400.0, (-80.0, -50.0, -30.0, 10.0)), Card(430.0, (30.0, 0.0, 70.0, 40.0))))


def rendered(count: int, width_px: int, height_px: int) -> LightField:
    """Render the scene with a grid of views; the field of view is the same for any number of pixels."""
    views = even_views(
        count,
        FARTHEST_MM / (count // 2),
        focal_px=1.5 * width_px,
        centre_px=np.array([(width_px - 1) / 2.0, (height_px - 1) / 2.0]),
        width_px=width_px,
        height_px=height_px,
    )
    return light_field_of(SCENE, views, subsamples=1)[0]


def times(light_field: LightField, rounds: int) -> dict[str, float]:
    """Return the median milliseconds of each job; each round runs all jobs."""
    height, width = light_field.height_px, light_field.width_px
    columns, rows = (
        axis.astype(np.float32) + np.float32(0.3) for axis in np.meshgrid(np.arange(width), np.arange(height))
    )
    maps = cv2.convertMaps(columns, rows, cv2.CV_16SC2)
    best, fast = (DepthEstimator(light_field, quality=quality) for quality in ("best", "fast"))
    # As many disparities as one view moves between the nearest and the farthest plane.
    disparities = 16 * int(np.ceil(best.plane_count * 0.5 / 16))
    matcher = cv2.StereoSGBM.create(numDisparities=disparities, blockSize=5, P1=600, P2=2400, disp12MaxDiff=1)
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
    times_ms: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds + 1):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            times_ms[name].append(1e3 * (time.perf_counter() - start))
    return {name: statistics.median(values[1:]) for name, values in times_ms.items()}


def speed(rounds: int) -> Rows:
    """Print and return the times."""
    print(
        f"{cv2.getNumThreads()} threads; medians of {rounds} rounds, ms; in brackets, relative to one pair, to remaps"
    )
    rows = Rows("views", "best", "fast", "one StereoSGBM pair", "bare remap")
    for count, width, height in CASES:
        medians = times(rendered(count, width, height), rounds)
        pair, bare = medians["one StereoSGBM pair"], medians["bare remap"]
        cells = (
            f"{medians[name]:.0f} ({medians[name] / pair:.1f}, {medians[name] / bare:.0f})" for name in ("best", "fast")
        )
        rows.add(f"{count}x{count} of {width}x{height} px", *cells, f"{pair:.0f}", f"{bare:.1f}")
    return rows
