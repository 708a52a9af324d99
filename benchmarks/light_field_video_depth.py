"""Depth of videos: how much it flickers where nothing moves, and whether what moves stays as good as in single frames.

`python -m benchmarks.light_field_video_depth [--every N] [--best] [--frames N] [--sensor NAME] SCENE...` makes videos
of 3x3 views of scenes in the format of the 4D Light Field Benchmark, with the noise of a webcam and 8 bits: as they
are, in flickering and in growing light, with an object that moves before it, and panned. Depth of each frame on its
own stands beside that of frames filtered in time. `... speed` times both.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.light_field_depth import BAD_PX
from benchmarks.light_field_depth_scenes import at_edges, sigma_px
from mirrorcam.optics.light_field.depth import DepthEstimator, DepthMap, Quality
from mirrorcam.optics.light_field.io.formats.hci import HciScene, read_hci
from mirrorcam.optics.light_field.light_field import LightField, Views
from mirrorcam.optics.light_field.temporal import TemporalFilter
from mirrorcam.render_scenes.settings import SENSORS, SensorModel

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

Passing = Literal["raw", "interpolated", "jpeg"]

WIDTH_PX, HEIGHT_PX = 240, 180
MARGIN_PX = 15
SETTLED = 16
"""Frames after which a still scene counts."""
JUMP_PX = 0.5
"""Change from frame to frame, px of the farthest view's motion, that is a jump to another plane."""
OBJECT_PX = 56
BEHIND_PX = 8
MAINS_PART, RAMP_PART = 0.03, 0.01


@dataclass(frozen=True, eq=False)
class Shot:
    """One frame without noise: samples (t, s, v, u, c), 0 to 255, and true disparity (v, u), px per view step.

    `moving` marks (v, u) the inside of the object, `behind` what it has just uncovered.
    """

    samples: Float32
    truth: Float32
    moving: Mask
    behind: Mask


@dataclass(frozen=True)
class Motion:
    """What happens in a video, in px per frame: an object's motion, a pan; and how light changes."""

    name: str
    object_px: float | None = None
    pan_px: float = 0.0
    light: str = "even"


MOTIONS = (
    Motion("still"),
    Motion("mains flicker", light="mains"),
    Motion("light grows", light="ramp"),
    *(Motion(f"object {speed:g} px/frame", object_px=speed) for speed in (0.0, 0.1, 0.25, 0.5, 2.0, 6.0)),
    *(Motion(f"pan {speed:g} px/frame", pan_px=speed) for speed in (0.1, 0.25, 0.5, 2.0)),
)


def shifted(pictures: Any, right_px: float) -> Float32:
    """Pictures (t, s, v, u, c) or a map (v, u), moved to the right."""
    matrix = np.array([[1.0, 0.0, right_px], [0.0, 1.0, 0.0]])

    def one(picture: Any) -> Any:
        way = cv2.INTER_CUBIC if picture.ndim == 3 else cv2.INTER_LINEAR
        size = picture.shape[1], picture.shape[0]
        return cv2.warpAffine(picture, matrix, size, flags=way, borderMode=cv2.BORDER_REPLICATE)

    if pictures.ndim == 2:
        return np.asarray(one(pictures))
    return np.stack([np.stack([one(view) for view in row]) for row in pictures])


def texture(size: int, grain_px: float = 1.5) -> Float32:
    """Colours (size, size, 3) of an object, 0 to 255."""
    random = np.random.default_rng(5)
    colours = cv2.GaussianBlur(random.normal(size=(size, size, 3)).astype(np.float32), (0, 0), grain_px)
    broad = cv2.GaussianBlur(random.normal(size=(size, size, 1)).astype(np.float32), (0, 0), 4 * grain_px)
    total = colours / colours.std() + broad[..., None] / broad.std()
    return np.clip(110.0 + 18.0 * total, 20.0, 235.0).astype(np.float32)


def with_object(samples: Float32, truth: Float32, left_px: float, disparity_px: float, way: float) -> Shot:
    """A textured square at a place and a disparity before a scene; it moves to the right or, with `way` -1, left."""
    rows, cols, height, width = samples.shape[:4]
    colours = np.pad(texture(OBJECT_PX), ((4, 4), (4, 4), (0, 0)), mode="edge")
    opaque = np.pad(np.ones((OBJECT_PX, OBJECT_PX), np.float32), 4)
    top_px, result = (height - OBJECT_PX) / 2.0, samples.copy()
    mask = np.zeros((height, width), np.float32)
    for t, s in np.ndindex(rows, cols):
        x = left_px - disparity_px * (s - cols // 2) - 4
        y = top_px - disparity_px * (t - rows // 2) - 4
        place = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
        cover = cv2.warpAffine(opaque, place, (width, height), flags=cv2.INTER_LINEAR)
        shown = cv2.warpAffine(colours, place, (width, height), flags=cv2.INTER_CUBIC)
        result[t, s] += cover[..., None] * (shown - result[t, s])
        if (t, s) == (rows // 2, cols // 2):
            mask = np.asarray(cover)
    inside = mask > 0.5
    inner = cv2.erode(inside.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    past = np.zeros_like(inside)
    for step in range(1, BEHIND_PX + 1):
        past |= np.roll(inside, -step if way > 0 else step, axis=1)
    return Shot(result, np.where(inside, np.float32(disparity_px), truth), inner, past & ~inside)


def shots(scene: HciScene, motion: Motion, count: int) -> Iterator[Shot]:
    """The frames of a video of a scene, without noise."""
    samples, truth = scene.light_field.samples.astype(np.float32), scene.disparity_px
    assert truth is not None, "no truth in the scene's folder"
    top_px, left = (truth.shape[0] - HEIGHT_PX) // 2, (truth.shape[1] - WIDTH_PX) // 2
    window = (slice(top_px, top_px + HEIGHT_PX), slice(left, left + WIDTH_PX))
    nothing = np.zeros((HEIGHT_PX, WIDTH_PX), bool)
    near = float(np.nanmax(truth)) + 0.4
    random = np.random.default_rng(11)
    for number in range(count):
        moved, deep = samples, truth
        if motion.pan_px:
            moved, deep = shifted(samples, motion.pan_px * number), shifted(truth, motion.pan_px * number)
        shot = Shot(moved[:, :, *window], deep[window], nothing, nothing)
        if motion.object_px is not None:
            start = (WIDTH_PX - OBJECT_PX - motion.object_px * (count - 1)) / 2
            shot = with_object(shot.samples, shot.truth, start + motion.object_px * number, near, 1.0)
        light = 1.0
        if motion.light == "mains":
            light = 1.0 + MAINS_PART * float(random.uniform(-1, 1))
        elif motion.light == "ramp":
            light = (1.0 + RAMP_PART) ** (number - count / 2)
        yield replace(shot, samples=shot.samples * np.float32(light))


def photographed(
    samples: Float32, sensor: SensorModel, random: np.random.Generator, passing: Passing = "raw"
) -> NDArray[np.uint8]:
    """Samples with the shot and read noise of a sensor, rounded to 8 bits.

    Their noise is that of pixels, or as after interpolation midway between them, or as after JPEG.
    """
    variance = np.full_like(samples, sensor.read_noise_grey**2)
    if sensor.full_well_electrons:
        variance += np.maximum(samples, 0.0) * np.float32(255.0 / sensor.full_well_electrons)
    noise = np.sqrt(variance) * random.standard_normal(samples.shape, dtype=np.float32)
    if passing == "interpolated":
        for index in np.ndindex(samples.shape[:2]):
            noise[index] = cv2.blur(noise[index], (2, 2))
    result = np.clip(np.rint(samples + noise), 0, 255).astype(np.uint8)
    if passing == "jpeg":
        for index in np.ndindex(samples.shape[:2]):
            quality = [cv2.IMWRITE_JPEG_QUALITY, sensor.jpeg_quality or 95]
            result[index] = cv2.imdecode(cv2.imencode(".jpg", result[index], quality)[1], cv2.IMREAD_COLOR)
    return result


def window_views(views: Views) -> Views:
    """The views of the middle of the pictures."""
    geometry: dict[str, Any] = {field.name: getattr(views, field.name) for field in fields(Views)}
    off = np.array([(views.width_px - WIDTH_PX) // 2, (views.height_px - HEIGHT_PX) // 2])
    changed = {"width_px": WIDTH_PX, "height_px": HEIGHT_PX, "centre_px": views.centre_px - off}
    return Views(**(geometry | changed))


@dataclass(frozen=True, eq=False)
class Track:
    """Disparity (n, v, u) of the frames of a video, px per view step, and errors in standard deviations."""

    disparity: Float32
    sigmas: Float32


def error_in_sigmas(found: DepthMap, truth: Float32) -> Float32:
    steps = max(found.views.cols, found.views.rows) // 2
    return np.asarray(np.abs(found.disparity_px() - truth) * steps / sigma_px(found), dtype=np.float32)


@dataclass(frozen=True)
class Scores:
    """Of one video and one way: flicker (px per view step) and errors; percentages, and MSE times 100."""

    flicker: float
    flicker_median: float
    flicker_flat: float
    jumps: float
    bad: float
    mse: float
    moving_bad: float
    moving_mse: float
    behind_bad: float
    behind_mse: float
    sigmas: float


def scores(tracks: Track, truths: Float32, moving: Any, behind: Any, every: int, steps: int) -> Scores:
    """Scores of the frames, once settled."""
    inner = (slice(None), slice(MARGIN_PX, -MARGIN_PX), slice(MARGIN_PX, -MARGIN_PX))
    found, truth = tracks.disparity[inner], truths[inner]
    deviation = found.std(axis=0)
    flat = ~at_edges(truth[0], every)
    jumps = np.abs(np.diff(found, axis=0)) * steps > JUMP_PX
    error = (found - truth) / every

    def errors(mask: Any) -> tuple[float, float]:
        chosen = error[mask]
        if not chosen.size:
            return np.nan, np.nan
        return 100.0 * float(np.mean(~(np.abs(chosen) <= BAD_PX))), 100.0 * float(np.nanmean(np.square(chosen)))

    everywhere = np.ones_like(error, bool)
    away = tracks.sigmas[inner][:, flat]
    return Scores(
        float(np.sqrt(np.nanmean(np.square(deviation)))),
        float(np.nanmedian(deviation)),
        float(np.sqrt(np.nanmean(np.square(deviation[flat])))),
        100.0 * float(jumps.mean()),
        *errors(everywhere),
        *errors(moving[inner]),
        *errors(behind[inner]),
        float(np.nanmedian(away)),
    )


def compared(
    scene: HciScene,
    motion: Motion,
    every: int,
    count: int,
    sensor: SensorModel,
    passing: Passing,
    quality: Quality,
) -> tuple[Scores, Scores]:
    """Scores of single frames, and of frames that are filtered in time."""
    views = window_views(scene.light_field)
    weights = np.ones((views.rows, views.cols, HEIGHT_PX, WIDTH_PX), np.float32)
    random, temporal = np.random.default_rng(3), TemporalFilter(1)
    found: tuple[list[Any], list[Any]] = ([], [])
    sigmas: tuple[list[Any], list[Any]] = ([], [])
    made: list[Shot] = []
    estimator: DepthEstimator | None = None
    for number, shot in enumerate(shots(scene, motion, count)):
        light_field = LightField.of(views, photographed(shot.samples, sensor, random, passing), weights)
        if estimator is None:
            near, far = views.depth_mm_from_disparity(
                np.array([np.nanmax(scene.disparity_px) + 0.6, np.nanmin(scene.disparity_px) - 0.2])
            )
            estimator = DepthEstimator(light_field, near_mm=near, far_mm=far, quality=quality, workers=1)
        filtered = temporal.filtered(light_field)
        if number < SETTLED:
            continue
        made.append(shot)
        for way, each in enumerate((light_field, filtered)):
            depth = estimator.estimate(each)
            found[way].append(depth.disparity_px().astype(np.float32))
            sigmas[way].append(error_in_sigmas(depth, shot.truth))
    truths = np.stack([shot.truth for shot in made])
    moving, behind = np.stack([shot.moving for shot in made]), np.stack([shot.behind for shot in made])
    return tuple(  # type: ignore[return-value]
        scores(Track(np.stack(found[way]), np.stack(sigmas[way])), truths, moving, behind, every, views.cols // 2)
        for way in range(2)
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", type=Path, metavar="SCENE")
    parser.add_argument("--every", type=int, default=4, help="take every Nth view of a whole scene")
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--sensor", choices=sorted(SENSORS), default="c920", help="whose noise")
    parser.add_argument("--passing", choices=get_args(Passing), default="raw", help="what pictures went through")
    parser.add_argument("--only", default="", help="videos whose name contains this")
    parser.add_argument("--best", action="store_true")
    options = parser.parse_args()
    quality: Quality = "best" if options.best else "fast"
    for folder in options.scenes:
        scene = read_hci(folder, every=options.every)
        for motion in (motion for motion in MOTIONS if options.only in motion.name):
            single, filtered = compared(
                scene, motion, options.every, options.frames, SENSORS[options.sensor], options.passing, quality
            )
            print(f"{folder.name}, {motion.name}: single -> filtered")
            for field in fields(Scores):
                one, two = getattr(single, field.name), getattr(filtered, field.name)
                if np.isfinite(one):
                    print(f"  {field.name:15} {one:8.4f} {two:8.4f}  {two / one if one else np.nan:5.2f}", flush=True)


if __name__ == "__main__":
    main()
