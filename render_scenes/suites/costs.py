"""What a set costs, said before it is rendered: processor time and bytes, from rates that were measured.

`python -m benchmarks.suite_scale rates` compares them with what sets take. The rates are of one core of a machine that
does `yardstick` in `YARDSTICK_S`; another machine, or one that is busy with other work, is as much slower at both.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.render_scenes.settings import SensorModel
from mirrorcam.render_scenes.suites.recipe import SetRecipe

YARDSTICK_S = 0.030
SET_S = 3.0
"""Seconds of a set besides its pictures: plan, truth and compiled kernels."""
PLAN_S = 0.003
"""Seconds that planning takes per picture and mirror."""
FAST_S, SAMPLE_S, MAP_S, PROCESSING_S = 0.06, 0.033, 1.5, 0.3
"""Seconds per megapixel: of the fast renderer, of a sample of the reference, of maps, of a webcam's processing."""
MIRROR_S = 0.12
"""Seconds of a design, per mirror."""
START_S = 4.0
"""Seconds until a worker has loaded its libraries."""
QUALITIES, JPEG_BYTES = (25.0, 70.0, 85.0, 95.0, 100.0), (0.05, 0.095, 0.24, 0.365, 0.8)
"""Bytes per pixel of a JPEG of a quality."""
PNG_BYTES, NOISE_BYTES, MAP_BYTES = 0.49, 0.3, 7.9
"""Bytes per pixel of a PNG, of its noise per grey level, and of the maps."""
BASE_SHARE = 0.5
"""Bytes of a picture by the bare camera, of one through the mirrors."""
TRUTH_BYTES = 300_000


@dataclass(frozen=True)
class Cost:
    """Processor seconds of the machine of the rates, bytes on the disk, and pictures."""

    seconds: float
    stored_bytes: float
    pictures: int


def set_cost(recipe: SetRecipe) -> Cost:
    """The cost of rendering a set, without that of its design."""
    camera, sensor = recipe.camera, recipe.sensor
    px = camera.width_px * camera.height_px
    light = FAST_S if recipe.renderer == "fast" else SAMPLE_S * recipe.spp
    processing = PROCESSING_S if sensor.bayer or sensor.denoising_grey > 0.0 else 0.0
    per_megapixel = light + processing + MAP_S * recipe.maps
    seconds = SET_S + recipe.pictures * (PLAN_S * recipe.mirrors + per_megapixel * px / 1e6)
    shown = recipe.frames + BASE_SHARE * recipe.base_frames
    stored = TRUTH_BYTES + px * (_picture_bytes(sensor) * shown + MAP_BYTES * recipe.maps * recipe.pictures)
    return Cost(seconds, stored, recipe.pictures)


def design_seconds(spec: DesignSpec) -> float:
    """Processor seconds of solving a design."""
    return MIRROR_S * len(spec.arrangement.steps)


def _picture_bytes(sensor: SensorModel) -> float:
    """Bytes per pixel of a picture through the mirrors."""
    if sensor.jpeg_quality is not None:
        return float(np.interp(sensor.jpeg_quality, QUALITIES, JPEG_BYTES))
    return PNG_BYTES + NOISE_BYTES * min(sensor.read_noise_grey, 2.0)


def elapsed_s(seconds: Sequence[float], workers: int, slowness: float) -> float:
    """Time until workers, each on a core of its own, have done work of these processor seconds.

    `slowness` is how much longer this machine takes than that of the rates.
    """
    if not seconds:
        return 0.0
    busy = min(workers, len(seconds))
    return slowness * (START_S + max(*seconds, sum(seconds) / busy))


def slowness() -> float:
    """How much longer a core of this machine takes than one of the machine of the rates; measured within a second."""
    return min(yardstick() for _ in range(3)) / YARDSTICK_S


def yardstick() -> float:
    """Processor seconds of a fixed piece of work on one core."""
    numbers = np.random.default_rng(0).random((1080, 1920))
    started = time.process_time()
    grey = (255.0 * np.exp(-numbers)).astype(np.uint8)
    for _ in range(4):
        cv2.imencode(".jpg", grey)
    return time.process_time() - started
