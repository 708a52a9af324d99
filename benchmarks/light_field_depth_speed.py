"""How long depth takes, beside one pair of OpenCV's stereo and a bare `cv2.remap` of the views.

`python -m benchmarks.light_field_depth_speed [ROUNDS]` times, in turn, both qualities, StereoSGBM of two neighbouring
views and remaps of all views, on cards before a wall that are photographed by views like those of the default device:
for more pixels and for more views over the same baselines. Times are medians; all threads that OpenCV uses.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.light_field_depth import DEFAULT_LAYOUT
from benchmarks.records import add_json_option, write_record
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import choose_views
from mirrorcam.optics.light_field.depth import DepthEstimator
from mirrorcam.optics.light_field.depth.parallax import parallax
from mirrorcam.optics.light_field.light_field import LightField, Views

CASES = ((3, 400, 240), (3, 200, 120), (3, 800, 480), (2, 400, 240), (5, 400, 240), (9, 400, 240))
WALL_MM = 480.0
CARDS = (
    (430.0, 0.05, 0.12, 0.35, 0.83),
    (390.0, 0.45, 0.08, 0.3, 0.5),
    (350.0, 0.6, 0.5, 0.32, 0.42),
    (320.0, 0.15, 0.62, 0.28, 0.3),
)
"""Depth, and left, top, width and height as parts of the picture."""
GRAINS = ((2, 14.0), (5, 25.0), (17, 40.0), (60, 40.0))
"""Size, px, and contrast, grey, of the texture's parts."""
BEYOND_PX = 200
NOISE_GREY = 1.0


def views_of(count: int, width_px: int, height_px: int) -> Views:
    """A grid of count by count views that reaches as far as the default layout's, on the grid's middle."""
    base = choose_views(Layout.load(DEFAULT_LAYOUT), 375.0, "common")
    reach = np.abs(base.positions_mm[..., :2]).max(axis=(0, 1))
    offsets = (np.arange(count) - count // 2) / (count // 2)
    scale = width_px / base.width_px
    return replace(
        base,
        positions_mm=np.stack([*np.meshgrid(offsets * reach[0], offsets * reach[1]), np.zeros((count, count))], -1),
        focal_px=base.focal_px * scale,
        centre_px=(base.centre_px + 0.5) * scale - 0.5,
        width_px=width_px,
        height_px=height_px,
    )


def cards(views: Views, seed: int = 0) -> tuple[LightField, FloatArray]:
    """Cards before a wall, all textured, as the views see them, with noise; and the depth (v, u) of the reference."""
    random = np.random.default_rng(seed)
    size = views.width_px, views.height_px
    surfaces = [(WALL_MM, 0.0, 0.0, 1.0, 1.0), *CARDS]
    textures = [_texture(views, random) for _ in surfaces]
    samples = np.empty((views.rows, views.cols, views.height_px, views.width_px, 3), np.uint8)
    for index in np.ndindex(views.rows, views.cols):
        picture = np.zeros((*size[::-1], 3), np.float32)
        for (depth, *place), texture in zip(surfaces, textures, strict=True):
            matrix = parallax(views, index).affine(1.0 / (depth - views.reference_view_depth_mm))
            inset = matrix.copy()
            inset[:, 2] -= matrix[:, :2] @ [BEYOND_PX, BEYOND_PX]
            shown: Any = cv2.warpAffine(texture, inset, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
            if depth == WALL_MM:
                picture = shown
                continue
            card = np.zeros(size[::-1], np.float32)
            card[_part(views, place)] = 1.0
            share: Any = cv2.warpAffine(card, matrix, size)[..., None]
            picture = picture * (1.0 - share) + shown * share
        samples[index] = np.rint(np.clip(picture + random.normal(scale=NOISE_GREY, size=picture.shape), 0.0, 255.0))
    truth = np.full(size[::-1], WALL_MM)
    for depth, *place in CARDS:
        truth[_part(views, place)] = depth
    return LightField.of(views, samples, np.ones(samples.shape[:4], np.float32)), truth


def _part(views: Views, place: list[float]) -> tuple[slice, slice]:
    left, top, width, height = place
    (u, v), (w, h) = (
        (round(x * views.width_px), round(y * views.height_px)) for x, y in ((left, top), (width, height))
    )
    return slice(v, v + h), slice(u, u + w)


def _texture(views: Views, random: np.random.Generator) -> Any:
    width, height = views.width_px + 2 * BEYOND_PX, views.height_px + 2 * BEYOND_PX
    texture = np.full((height, width, 3), 120.0, np.float32)
    for grain, contrast in GRAINS:
        coarse = random.uniform(-contrast, contrast, (height // grain, width // grain, 3)).astype(np.float32)
        texture += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.clip(texture, 0.0, 255.0)


def times(light_field: LightField, rounds: int) -> dict[str, list[float]]:
    """Milliseconds of each round of each job."""
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
    return {name: each[1:] for name, each in found.items()}


def main(rounds: int, json: Path | None) -> None:
    figures: dict[str, float] = {}
    print(f"{cv2.getNumThreads()} threads; medians of {rounds} rounds, ms; in brackets, times one pair, times remaps")
    for count, width, height in CASES:
        light_field, truth = cards(views_of(count, width, height))
        found = DepthEstimator(light_field).estimate(light_field)
        wrong = np.mean(~(np.abs(found.depth_mm - truth) < 0.02 * truth))
        middle = {name: statistics.median(each) for name, each in times(light_field, rounds).items()}
        pair, bare = middle["one StereoSGBM pair"], middle["bare remap"]
        texts = [f"{name} {value:.0f} ({value / pair:.1f}, {value / bare:.0f})" for name, value in middle.items()]
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        seconds = {prefix: middle[name] / 1e3 for prefix, name in (("", "best"), ("fast_", "fast"))}
        if (width, height) == (400, 240):
            figures |= {f"{prefix or 'views_'}{count}x{count}_s": each for prefix, each in seconds.items()}
        if count == 3:
            figures |= {f"{prefix}width_{width}_s": each for prefix, each in seconds.items()}
        if (count, width) == (3, 400):
            figures |= {f"{prefix}times_one_pair": 1e3 * each / pair for prefix, each in seconds.items()}
            figures |= {f"{prefix}times_remaps": 1e3 * each / bare for prefix, each in seconds.items()}
        rates = ", ".join(f"{1e3 / middle[name]:.1f}/s {name}" for name in ("best", "fast"))
        print(f"{count}x{count} views of {width}x{height} px: {', '.join(texts)}; {rates}; ", end="")
        print(f"off by more than 2 %: {wrong:.1%}; {peak:.0f} MiB at most so far")

    write_record(json, "light_field_depth_speed", figures)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rounds", type=int, nargs="?", default=10, metavar="ROUNDS")
    add_json_option(parser)
    options = parser.parse_args()
    main(options.rounds, options.json)
