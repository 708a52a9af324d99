"""Depth of videos: how much it flickers where nothing moves, and whether what moves stays as good as in single frames.

`python -m benchmarks.light_field_video_depth [--every N] [--best] [--frames N] [--sensor NAME] SCENE...` makes videos
of 3x3 views of scenes in the format of the 4D Light Field Benchmark, with the noise of a webcam and 8 bits: as they
are, in flickering and in growing light, with an object that moves before it, and panned. Depth of each frame on its
own stands beside that of frames filtered in time. `... speed` times both.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.light_field_depth import BAD_PX
from benchmarks.light_field_depth_errors import at_edges, sigma_px
from benchmarks.records import Rows, add_json_option, write_record
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
NEARER_PX = 0.4
"""Disparity of the object, beyond the nearest of the scene."""
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
    """What happens in a video, in px per frame: an object's motion, a pan; and how light changes.

    An object may come nearer, by disparity per frame, and its texture be weaker than usual.
    """

    name: str
    object_px: float | None = None
    nearing_px: float = 0.0
    contrast: float = 1.0
    pan_px: float = 0.0
    light: str = "even"


MOTIONS = (
    Motion("still"),
    Motion("mains flicker", light="mains"),
    Motion("light grows", light="ramp"),
    *(Motion(f"object {speed:g} px/frame", object_px=speed) for speed in (0.0, 0.1, 0.25, 0.5, 2.0, 6.0)),
    *(Motion(f"object nears {speed:g} px/frame", object_px=0.0, nearing_px=speed) for speed in (0.01, 0.03, 0.1)),
    *(
        Motion(f"weak object nears {speed:g}", object_px=0.0, nearing_px=speed, contrast=0.2)
        for speed in (0.01, 0.03, 0.1)
    ),
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


def with_object(samples: Float32, truth: Float32, left_px: float, disparity_px: float, contrast: float) -> Shot:
    """A textured square, which moves to the right, at a place and a disparity before a scene."""
    rows, cols, height, width = samples.shape[:4]
    colours = np.pad(110.0 + contrast * (texture(OBJECT_PX) - 110.0), ((4, 4), (4, 4), (0, 0)), mode="edge").astype(
        np.float32
    )
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
        past |= np.roll(inside, -step, axis=1)
    return Shot(result, np.where(inside, np.float32(disparity_px), truth), inner, past & ~inside)


def shots(scene: HciScene, motion: Motion, count: int) -> Iterator[Shot]:
    """The frames of a video of a scene, without noise."""
    samples, truth = scene.light_field.samples.astype(np.float32), scene.disparity_px
    assert truth is not None, "no truth in the scene's folder"
    top_px, left = (truth.shape[0] - HEIGHT_PX) // 2, (truth.shape[1] - WIDTH_PX) // 2
    window = (slice(top_px, top_px + HEIGHT_PX), slice(left, left + WIDTH_PX))
    nothing = np.zeros((HEIGHT_PX, WIDTH_PX), bool)
    nearest = float(np.nanmax(truth)) + NEARER_PX
    random = np.random.default_rng(11)
    for number in range(count):
        moved, deep = samples, truth
        if motion.pan_px:
            moved, deep = shifted(samples, motion.pan_px * number), shifted(truth, motion.pan_px * number)
        shot = Shot(moved[:, :, *window], deep[window], nothing, nothing)
        if motion.object_px is not None:
            near = nearest + motion.nearing_px * (number - count + 1)
            start = (WIDTH_PX - OBJECT_PX - motion.object_px * (count - 1)) / 2
            shot = with_object(shot.samples, shot.truth, start + motion.object_px * number, near, motion.contrast)
        light = 1.0
        if motion.light == "mains":
            light = 1.0 + MAINS_PART * float(random.uniform(-1, 1))
        elif motion.light == "ramp":
            light = (1.0 + RAMP_PART) ** (number - count / 2)
        yield replace(shot, samples=shot.samples * np.float32(light))


def photographed(samples: Float32, camera: Camera, random: np.random.Generator) -> NDArray[np.uint8]:
    """Samples with the shot and read noise of a camera's sensor, rounded to 8 bits.

    Their noise is that of pixels, or as after interpolation midway between them, or as after JPEG.
    """
    sensor = camera.sensor
    variance = np.full_like(samples, sensor.read_noise_grey**2)
    if sensor.full_well_electrons:
        variance += np.maximum(samples, 0.0) * np.float32(255.0 / sensor.full_well_electrons)
    noise = np.sqrt(variance) * random.standard_normal(samples.shape, dtype=np.float32)
    if camera.passing == "interpolated":
        for index in np.ndindex(samples.shape[:2]):
            noise[index] = cv2.blur(noise[index], (2, 2))
    result = np.clip(np.rint(samples + noise), 0, 255).astype(np.uint8)
    if camera.passing == "jpeg":
        for index in np.ndindex(samples.shape[:2]):
            quality = [cv2.IMWRITE_JPEG_QUALITY, sensor.jpeg_quality or 95]
            coded: Any = cv2.imencode(".jpg", result[index], quality)[1]
            result[index] = cv2.imdecode(coded, cv2.IMREAD_COLOR)
    return result


def window_views(views: Views) -> Views:
    """The views of the middle of the pictures."""
    geometry: dict[str, Any] = {field.name: getattr(views, field.name) for field in fields(Views)}
    off = np.array([(views.width_px - WIDTH_PX) // 2, (views.height_px - HEIGHT_PX) // 2])
    changed = {"width_px": WIDTH_PX, "height_px": HEIGHT_PX, "centre_px": views.centre_px - off}
    return Views(**(geometry | changed))


@dataclass(frozen=True)
class Scores:
    """Of one video, measured in one way.

    Attributes
    ----------
    flicker, flicker_flat, flicker_median
        Standard deviation over time of each pixel's disparity, px per view step: root mean square everywhere and away
        from depth edges, and the median.
    jumps
        Percentage of pixels that jump from one frame to the next.
    bad, mse, moving_mse, behind_bad, behind_mse
        BadPix(0.07) in % and MSE x 100 in px per step of the full grid: everywhere, inside the object, and in what it
        has just uncovered.
    sigmas
        Median error in standard deviations, away from depth edges.
    """

    flicker: float
    flicker_flat: float
    flicker_median: float
    jumps: float
    bad: float
    mse: float
    moving_mse: float
    behind_bad: float
    behind_mse: float
    sigmas: float


def scores(found: Sequence[DepthMap], shown: Sequence[Shot], every: int) -> Scores:
    """Scores of the depths of frames."""
    inner = (slice(None), slice(MARGIN_PX, -MARGIN_PX), slice(MARGIN_PX, -MARGIN_PX))
    steps = max(found[0].views.cols, found[0].views.rows) // 2
    disparity = np.stack([each.disparity_px() for each in found])[inner]
    sigma = np.stack([sigma_px(each) for each in found])[inner] / steps
    truth, moving, behind = (
        np.stack([getattr(shot, name) for shot in shown])[inner] for name in ("truth", "moving", "behind")
    )
    deviation, error = disparity.std(axis=0), (disparity - truth) / every
    flat = np.stack([~at_edges(shot.truth / np.float32(every)) for shot in shown])[inner]

    def bad(mask: Any) -> float:
        return 100.0 * float(np.mean(~(np.abs(error[mask]) <= BAD_PX))) if mask.any() else np.nan

    def mse(mask: Any) -> float:
        return 100.0 * float(np.nanmean(np.square(error[mask]))) if mask.any() else np.nan

    everywhere = np.ones_like(moving)
    return Scores(
        flicker=float(np.sqrt(np.nanmean(np.square(deviation)))),
        flicker_flat=float(np.sqrt(np.nanmean(np.square(deviation[flat.all(axis=0)])))),
        flicker_median=float(np.nanmedian(deviation)),
        jumps=100.0 * float(np.mean(np.abs(np.diff(disparity, axis=0)) * steps > JUMP_PX)),
        bad=bad(everywhere),
        mse=mse(everywhere),
        moving_mse=mse(moving),
        behind_bad=bad(behind),
        behind_mse=mse(behind),
        sigmas=float(np.nanmedian(np.abs(error * every)[flat] / sigma[flat])),
    )


@dataclass(frozen=True)
class Camera:
    """Whose noise, what pictures went through, and how depth is measured in them."""

    sensor: SensorModel
    passing: Passing
    quality: Quality


def compared(scene: HciScene, motion: Motion, every: int, count: int, camera: Camera) -> tuple[Scores, Scores]:
    """Scores of single frames, and of frames that are filtered in time."""
    views, truth = window_views(scene.light_field), scene.disparity_px
    assert truth is not None, "no truth in the scene's folder"
    weights = np.ones((views.rows, views.cols, HEIGHT_PX, WIDTH_PX), np.float32)
    nearest, farthest = float(np.nanmax(truth)) + NEARER_PX + 0.2, float(np.nanmin(truth)) - 0.2
    near, far = views.depth_mm_from_disparity(np.array([nearest, farthest])).tolist()
    random, temporal = np.random.default_rng(3), TemporalFilter(1)
    estimator: DepthEstimator | None = None
    found: tuple[list[DepthMap], list[DepthMap]] = ([], [])
    shown = []
    for number, shot in enumerate(shots(scene, motion, count)):
        frame = LightField.of(views, photographed(shot.samples, camera, random), weights)
        if estimator is None:
            estimator = DepthEstimator(frame, near_mm=near, far_mm=far, quality=camera.quality, workers=1)
        filtered = temporal.filtered(frame)
        if number >= SETTLED:
            shown.append(shot)
            found[0].append(estimator.estimate(frame))
            found[1].append(estimator.estimate(filtered))
    single, steady = (scores(each, shown, every) for each in found)
    return single, steady


COLUMNS = (
    *(("flicker", "flicker, px"), ("flicker_flat", "off edges"), ("flicker_median", "median"), ("jumps", "jumps %")),
    *(("bad", "BadPix %"), ("mse", "MSE"), ("moving_mse", "MSE inside"), ("behind_bad", "BadPix behind")),
    *(("behind_mse", "MSE behind"), ("sigmas", "|e|/sigma")),
)


def cells_of(single: Scores, filtered: Scores) -> list[str]:
    """Of each score that of single frames and that of filtered ones."""
    cells = []
    for field, _ in COLUMNS:
        one, two = getattr(single, field), getattr(filtered, field)
        digits = 3 if field.startswith("flicker") else 2
        cells.append(f"{one:.{digits}f} → {two:.{digits}f}" if np.isfinite(one) else "")
    return cells


def speed(frames: int = 60) -> None:
    """Print milliseconds a frame, of nine views of 400x240 px on one core, and memory after some and all frames."""
    random = np.random.default_rng(0)
    light_field = rendered_noise(random)
    estimator = DepthEstimator(light_field, quality="fast", workers=1)
    temporal, spent = TemporalFilter(1), []
    for number in range(frames):
        frame = rendered_noise(random)
        start = time.process_time()
        found = temporal.filtered(frame)
        spent.append(time.process_time() - start)
        if number in (frames // 3, frames - 1):
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            print(f"after {number + 1} frames: {peak:.0f} MiB at most")
    estimator.estimate(found)
    start = time.process_time()
    for _ in range(3):
        estimator.estimate(found)
    print(
        f"filter {1e3 * float(np.median(spent)):.1f} ms, depth (fast) {1e3 * (time.process_time() - start) / 3:.0f} ms"
    )


def rendered_noise(random: np.random.Generator) -> LightField:
    """Nine views of 400x240 px of a textured plane at the reference depth, with noise."""
    height, width = 240, 400
    geometry: dict[str, Any] = {
        "positions_mm": np.stack([*np.meshgrid([-20.0, 0.0, 20.0], [-20.0, 0.0, 20.0]), np.zeros((3, 3))], axis=-1),
        "focal_px": 400.0,
        "centre_px": np.array([(width - 1) / 2, (height - 1) / 2]),
        "width_px": width,
        "height_px": height,
        "reference_depth_mm": 375.0,
        "reference_view_in_rig_mm": np.zeros(3),
        "view_from_rig": np.eye(3),
        "layout_identity": "0" * 16,
    }
    plane = cv2.resize(texture(80), (width, height), interpolation=cv2.INTER_CUBIC)
    samples = np.broadcast_to(plane, (3, 3, height, width, 3)).astype(np.float32)
    camera = Camera(SENSORS["c920"], "raw", "fast")
    weights = np.ones((3, 3, height, width), np.float32)
    return LightField.of(Views(**geometry), photographed(samples, camera, random), weights)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", type=Path, metavar="SCENE", help="folders, or `speed`")
    parser.add_argument("--every", type=int, default=4, help="take every Nth view of a whole scene")
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--sensor", choices=sorted(SENSORS), default="c920", help="whose noise")
    parser.add_argument("--passing", choices=get_args(Passing), default="raw", help="what pictures went through")
    parser.add_argument("--only", default="", help="videos whose name contains this")
    parser.add_argument("--best", action="store_true")
    add_json_option(parser)
    options = parser.parse_args()
    if options.scenes == [Path("speed")]:
        speed()
        return
    camera = Camera(SENSORS[options.sensor], options.passing, "best" if options.best else "fast")
    rows = Rows("video: single → filtered", *(title for _, title in COLUMNS))
    for folder in options.scenes:
        scene = read_hci(folder, every=options.every)
        for motion in (motion for motion in MOTIONS if options.only in motion.name):
            found = compared(scene, motion, options.every, options.frames, camera)
            rows.add(f"{folder.name}, {motion.name}", *cells_of(*found))
    write_record(options.json, "light_field_video_depth", table=rows.table)


if __name__ == "__main__":
    main()
