"""The effect of idealisations on pictures: on corners found in them, calibrations by these, and decoded views."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.idealised_corners import Calibrated, Effect, Setup, beside
from mirrorcam.core.images.pictures import encoded_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.detect_boards import direct_view, sub_images
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.render_scenes.fast.analytic_scene import FastScene
from mirrorcam.render_scenes.sets.sensor_model import photograph
from mirrorcam.render_scenes.sets.video import as_key_frame
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, SensorModel
from mirrorcam.render_scenes.tabletop.tabletop import arrange_tabletop
from mirrorcam.render_scenes.tabletop.tabletop_scene import TabletopScene
from mirrorcam.render_scenes.tabletop.tabletop_set import default_depths_mm

PLAIN = SensorModel(aperture_mm=SENSORS["c920"].aperture_mm, read_noise_grey=0.0)
"""Lens and pupil of a webcam, without any other flaw but eight bits."""
CUT = 2
WHITE = 255.0

Radiance = NDArray[np.float32]
Photo = NDArray[np.uint8]


def unchanged(light: Radiance) -> Radiance:
    return light


@dataclass(frozen=True)
class Flaw:
    """What a picture has that one of `PLAIN` has not.

    Attributes
    ----------
    sensor
        The sensor, its compression included.
    light
        Changes the light before it is exposed.
    as_linear
        Makes levels of decoded views (..., from 0 to 1) linear again, as who knows the flaw could.
    """

    sensor: SensorModel
    light: Callable[[Radiance], Radiance] = field(default=unchanged)
    as_linear: Callable[[FloatArray], FloatArray] = field(default=np.asarray)

    def taken(self, radiance: Radiance, setup: Setup, seed: int) -> Photo:
        """The picture as it leaves the camera."""
        camera, random = setup.built.camera, np.random.default_rng(seed)
        picture = photograph(self.light(radiance), CUT, camera, self.sensor, random)
        if self.sensor.jpeg_quality is not None:
            data = np.frombuffer(encoded_image(picture, ".jpg", self.sensor.jpeg_quality), np.uint8)
            how = cv2.IMREAD_GRAYSCALE if picture.ndim == 2 else cv2.IMREAD_COLOR_RGB
            return np.asarray(cv2.imdecode(data, how), dtype=np.uint8)
        return picture if self.sensor.h264_crf is None else as_key_frame(picture, self.sensor.h264_crf)


def ghosted(light: Radiance) -> Radiance:
    """A reflection between sensor and lens: a thousandth of the picture, turned about its middle."""
    return light + np.float32(1e-3) * np.ascontiguousarray(light[::-1, ::-1])


def shaded(light: Radiance) -> Radiance:
    """Light that falls from one side of the picture to the other by 30 %."""
    ramp = np.linspace(1.15, 0.85, light.shape[1], dtype=np.float32)
    return light * (ramp if light.ndim == 2 else ramp[:, None])


def without_tone(coded: FloatArray) -> FloatArray:
    """The inverse of sRGB's tone curve."""
    return np.asarray(np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4))


def corners_in(setup: Setup, flaws: Mapping[str, Flaw]) -> dict[str, Observations]:
    """Corners found in all frames, rendered once by formula, with each flaw."""
    settings = RenderSettings(renderer="fast", sensor=PLAIN, maps=False)
    target, layout = setup.request.target, setup.request.layout
    scenes = [FastScene(setup.built.camera, mirrors, target, settings) for mirrors in (setup.built.mirrors, ())]
    found: dict[str, list[Observations]] = {name: [] for name in flaws}
    for number, pose in enumerate(setup.poses):
        direct = number >= setup.request.frames
        scenes[direct].place_board(pose)
        radiance = scenes[direct].render()
        for name, flaw in flaws.items():
            picture = flaw.taken(radiance, setup, number)
            grey = picture if picture.ndim == 2 else np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8)
            seen = direct_view(grey, target) if direct else sub_images(grey, layout, target).corners
            found[name].append(seen.shifted(number))
    return {name: Observations.join(parts) for name, parts in found.items()}


def difference_px(seen: Observations, plain: Observations) -> float:
    """RMS per axis of what corners that both have differ by."""
    keys = [np.column_stack([o.frame, o.view, o.corner]) for o in (seen, plain)]
    places = [{tuple(key): row for row, key in enumerate(k.tolist())} for k in keys]
    common = sorted(places[0].keys() & places[1].keys())
    rows = [[place[key] for key in common] for place in places]
    return float(np.sqrt(np.mean((seen.pixels[rows[0]] - plain.pixels[rows[1]]) ** 2)))


def effects(setup: Setup, flaws: Mapping[str, Flaw]) -> dict[str, Effect]:
    """Effect of each flaw on found corners and on a calibration by them."""
    seen = corners_in(setup, {"": Flaw(PLAIN), **flaws})
    plain = setup.calibrated(seen[""])
    return {name: _effect(setup, seen[name], seen[""], plain) for name in flaws}


def _effect(setup: Setup, seen: Observations, without: Observations, plain: Calibrated) -> Effect:
    return beside(plain, setup.calibrated(seen), difference_px(seen, without))


class Table:
    """A tabletop scene through the device, and its views as the camera without flaws shows them."""

    def __init__(self, setup: Setup, spp: int) -> None:
        self.setup = setup
        tabletop = arrange_tabletop(setup.request.layout, default_depths_mm(setup.request.layout), 0, ())
        scene = TabletopScene(setup.built, tabletop, 0.92)
        self.radiance = scene.photograph(PLAIN.pupil, spp=max(spp // CUT**2, 1), subpixels=CUT, seed=0)
        self.decoder = Decoder(setup.built)
        self.plain = self.views(Flaw(PLAIN))

    def views(self, flaw: Flaw) -> FloatArray:
        """Levels from 0 to 1 of all views, where they are valid: (n, 3)."""
        field_ = self.decoder.decode(flaw.taken(self.radiance, self.setup, 0))
        levels = np.asarray(field_.samples, dtype=np.float64)[np.asarray(field_.weights) > 0.0] / WHITE
        return flaw.as_linear(levels)

    def db(self, flaw: Flaw) -> float:
        """PSNR of views with a flaw against those without."""
        return psnr_db(float(np.mean((self.views(flaw) - self.plain) ** 2)))

    def shifted_db(self, rms_px: float) -> float:
        """PSNR of views whose pixels are off by so much, per axis, by the slopes of the views without flaws."""
        field_ = self.decoder.decode(Flaw(PLAIN).taken(self.radiance, self.setup, 0))
        levels = np.asarray(field_.samples, dtype=np.float64) / WHITE
        valid = np.asarray(field_.weights) > 0.0
        energy = 0.0
        for axis in (2, 3):
            slope = (np.roll(levels, -1, axis) - np.roll(levels, 1, axis)) / 2.0
            inner = valid & np.roll(valid, 1, axis) & np.roll(valid, -1, axis)
            energy += float(np.mean(slope[inner] ** 2))
        return psnr_db(rms_px**2 * energy)


def psnr_db(mean_square: float) -> float:
    """Of an error whose mean square is that of white."""
    return -10.0 * float(np.log10(max(mean_square, 1e-20)))


def frame_s(setup: Setup, sensor: SensorModel, repeats: int = 5) -> float:
    """Processor time, s, that a frame of boards takes from its light to its picture."""
    radiance = np.full((CUT * setup.built.camera.height_px, CUT * setup.built.camera.width_px), 0.5, dtype=np.float32)
    times = []
    for seed in range(repeats):
        started = time.process_time()
        photograph(radiance, CUT, setup.built.camera, sensor, np.random.default_rng(seed))
        times.append(time.process_time() - started)
    return float(np.median(times))
