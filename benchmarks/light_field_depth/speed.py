"""Times of depth, one pair of OpenCV's stereo and bare remaps of the views, for more pixels, views and planes."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from itertools import cycle

import cv2
import numpy as np

from benchmarks.records import Rows
from mirrorcam.optics.light_field.depth import DepthEstimator, VideoDepth
from mirrorcam.optics.light_field.depth.estimate import DEFAULT_FAR, DEFAULT_NEAR
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.relief_scene import Card, Relief, even_views, light_field_of

CASES = (
    (3, 400, 240, 1.0),
    (3, 200, 120, 1.0),
    (3, 800, 480, 1.0),
    (2, 400, 240, 1.0),
    (5, 400, 240, 1.0),
    (9, 400, 240, 1.0),
    (3, 400, 240, 0.5),
    (3, 400, 240, 2.0),
)
"""Views along each side, size in px, and the range of 1 / depth that is searched, relative to the default one."""
FARTHEST_MM = 38.0
"""Distance from the central view to the farthest along an axis, as in the default device."""
SCENE = Relief(cards=(Card(400.0, (-80.0, -50.0, -30.0, 10.0)), Card(430.0, (30.0, 0.0, 70.0, 40.0))))
THREADS = 2
NOISE_GREY = 2.0
VIDEO_FRAMES = 4


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


def searched_mm(light_field: LightField, planes: float) -> tuple[float, float]:
    """Return the nearest and the farthest depth of a search over `planes` times the default range of 1 / depth."""
    inverse = 1.0 / light_field.reference_depth_mm
    middle, half = (
        inverse * (1 / DEFAULT_NEAR + 1 / DEFAULT_FAR) / 2,
        inverse * (1 / DEFAULT_NEAR - 1 / DEFAULT_FAR) / 2,
    )
    low = max(middle - planes * half, 0.0)
    return 1.0 / (low + 2.0 * planes * half), 1.0 / low if low > 0 else np.inf


def noisy_frames(light_field: LightField) -> Iterator[LightField]:
    """Return a still video without end: the same frames with different noise, again and again."""
    random = np.random.default_rng(0)
    frames = []
    for _ in range(VIDEO_FRAMES):
        samples = light_field.samples + NOISE_GREY * random.standard_normal(light_field.samples.shape)
        frames.append(LightField.of(light_field, samples.clip(0, 255).astype(np.uint8), light_field.weights))
    return cycle(frames)


def times(light_field: LightField, planes: float, threads: int, rounds: int) -> tuple[int, dict[str, float]]:
    """Return the number of planes, and the median milliseconds of each job: processor time of one thread, or wall time
    of several. Each round runs all jobs."""
    height, width = light_field.height_px, light_field.width_px
    columns, rows = (
        axis.astype(np.float32) + np.float32(0.3) for axis in np.meshgrid(np.arange(width), np.arange(height))
    )
    maps = cv2.convertMaps(columns, rows, cv2.CV_16SC2)
    near, far = searched_mm(light_field, planes)
    best, fast = (
        DepthEstimator(light_field, near_mm=near, far_mm=far, quality=quality, workers=threads)
        for quality in ("best", "fast")
    )
    video, frames = VideoDepth(fast), noisy_frames(light_field)
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
        "video": lambda: video.estimate(next(frames)),
        "one StereoSGBM pair": lambda: matcher.compute(left, right),
        "bare remap": bare,
    }
    clock = time.process_time if threads == 1 else time.perf_counter
    times_ms: dict[str, list[float]] = {name: [] for name in jobs}
    before = cv2.getNumThreads()
    cv2.setNumThreads(threads)
    for _ in range(rounds + 1):
        for name, job in jobs.items():
            start = clock()
            job()
            times_ms[name].append(1e3 * (clock() - start))
    cv2.setNumThreads(before)
    return best.plane_count, {name: statistics.median(values[1:]) for name, values in times_ms.items()}


def speed(rounds: int) -> Rows:
    """Print and return the times."""
    print(
        f"medians of {rounds} rounds, ms: processor time of one thread / wall time of {THREADS}; in brackets, the "
        "processor time relative to one pair. A frame of a video is filtered in time, and measured by `fast`."
    )
    names = ("best", "fast", "video", "one StereoSGBM pair", "bare remap")
    rows = Rows("views, px, planes", *names)
    for count, width, height, planes in CASES:
        light_field = rendered(count, width, height)
        plane_count, alone = times(light_field, planes, 1, rounds)
        _, together = times(light_field, planes, THREADS, rounds)
        cells = [f"{alone[name]:.1f} / {together[name]:.1f}" for name in names]
        for number, name in enumerate(names[:3]):
            cells[number] += f" ({alone[name] / alone[names[3]]:.1f})"
        rows.add(f"{count}x{count}, {width}x{height}, {plane_count}", *cells)
    return rows
