"""Kinds of light fields that confidence has to hold on: each scene as it is, with noise, with a wrong range, and so on.

A scene is a folder of the 4D Light Field Benchmark, or a rectified pair with truth as Middlebury publishes it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.light_field_depth.rooms import FAR_MM, NEAR_MM, noise, room
from benchmarks.light_field_depth.scenes import truth_of
from benchmarks.light_field_depth.stereo import BORDER_PX
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.light_field.depth.estimate import DEFAULT_FAR, DEFAULT_NEAR
from mirrorcam.optics.light_field.io.formats.hci import read_hci
from mirrorcam.optics.light_field.light_field import LightField, Views
from mirrorcam.optics.light_field.render.linear_light import light_from_levels
from mirrorcam.render_scenes.sets.sensor_model import photograph
from mirrorcam.render_scenes.settings import SENSORS, SensorName

Floats = NDArray[np.float32]
PAIRS = {("im2.png", "im6.png", "disp2.pgm"): 4.0, ("view1.png", "view5.png", "disp1.png"): 3.0}
"""Names of left picture, right picture and left disparity in Middlebury's folders, and its units per px."""
PAIR_FOCAL_PX, PAIR_STEP_MM = 1000.0, 100.0
MAX_PAIR_PX = 80.0
NOISES = ((5.0, 0.0), (20.0, 0.0), (20.0, 1.0))
"""Standard deviations of white noise, grey levels, and of its blur, px: decoding and compression blur noise."""
WIDE = -1.0, 4.0
"""A wide search, as multiples of a scene's range: cameras do not know their scenes."""
CAMERAS: tuple[SensorName, ...] = ("c920", "webcam", "poor")
ROOM_NOISE_GREY = 0.5, 20.0
"""Least and most noise of a room, grey levels."""


@dataclass(frozen=True, eq=False)
class Case:
    """A light field, the true disparity (v, u) of its reference view at the longest baseline, and the search range.

    `kind` is what makes it difficult. The disparity is relative to the reference plane, in multiples of
    `truth_step_px`; NaN where unknown. Depths are in mm; None for the default.
    """

    name: str
    kind: str
    light_field: LightField
    truth_px: Floats
    near_mm: float | None
    far_mm: float | None
    truth_step_px: float = 0.0

    def noisy(self, grey: float, seed: int, blur_px: float = 0.0) -> Case:
        """Return the case with white noise of a standard deviation in grey levels, blurred by another in px."""
        samples: Any = self.light_field.samples
        random = np.random.default_rng(seed)
        changed = np.empty_like(samples)
        for index in np.ndindex(samples.shape[:2]):
            noisy = samples[index] + noise(random, samples.shape[2:], grey, blur_px)
            changed[index] = np.rint(np.clip(noisy, 0, 255))
        name = f"noise {grey:g}" + (f" blurred by {blur_px:g} px" if blur_px else "")
        return self._with("noise", name, LightField.of(self.light_field, changed, self.light_field.weights))

    def photographed(self, sensor: SensorName, seed: int) -> Case:
        """Return the case as a camera sees it: soft, with noise by brightness, processed and compressed."""
        views, model = self.light_field, SENSORS[sensor].replaced(tone_curve="srgb")
        width_px, height_px, focal_px = views.width_px, views.height_px, views.focal_px
        camera = Camera(
            width_px=width_px,
            height_px=height_px,
            fx_px=focal_px,
            fy_px=focal_px,
            cx_px=(width_px - 1) / 2.0,
            cy_px=(height_px - 1) / 2.0,
        )
        quality = [cv2.IMWRITE_JPEG_QUALITY, model.jpeg_quality or 100]
        random = np.random.default_rng(seed)
        samples: Any = views.samples
        changed = np.empty_like(samples)
        for index in np.ndindex(samples.shape[:2]):
            picture = photograph(light_from_levels(samples[index]), 1, camera, model, random)
            encoded = cv2.imencode(".jpg", picture[..., ::-1], quality)[1]
            decoded: Any = cv2.imdecode(encoded, cv2.IMREAD_COLOR)
            changed[index] = decoded[..., ::-1]
        return self._with("photographed", f"by {sensor}", LightField.of(views, changed, views.weights))

    def within(self, kind: str, name: str, start: float, end: float) -> Case:
        """Return the case searched over another range of inverse depth, from fraction `start` to `end` of its own."""
        reference = self.light_field.reference_depth_mm
        near, far = self.near_mm or DEFAULT_NEAR * reference, self.far_mm or DEFAULT_FAR * reference
        low, width = 1.0 / far, 1.0 / near - 1.0 / far
        low, high = low + start * width, low + end * width
        return replace(
            self,
            name=f"{self.name}, {name}",
            kind=kind,
            near_mm=1.0 / high,
            far_mm=1.0 / low if low > 0 else float("inf"),
        )

    def exchanged(self, seed: int) -> Case:
        """Return the case with all views but the reference view in a wrong order."""
        light_field = self.light_field
        count = light_field.rows * light_field.cols
        others = np.delete(np.arange(count), count // 2)
        order = np.arange(count)
        order[others] = np.random.default_rng(seed).permutation(others)
        samples: Any = light_field.samples.reshape(count, *light_field.samples.shape[2:])[order]
        changed = np.ascontiguousarray(samples.reshape(light_field.samples.shape))
        return self._with("wrong order", "wrong order", LightField.of(light_field, changed, light_field.weights))

    def some_views(self, rows: int, cols: int) -> Case:
        """Return the case with `rows` x `cols` of its 3 x 3 views: the central one and those around or after it."""
        light_field = self.light_field
        part = tuple(slice(0, 3) if count == 3 else slice(1, 1 + count) for count in (rows, cols))
        views = replace(
            Views(**{field.name: getattr(light_field, field.name) for field in fields(Views)}),
            positions_mm=light_field.positions_mm[part],
        )
        samples: Any = np.ascontiguousarray(light_field.samples[part])
        weights = np.ascontiguousarray(light_field.weights[part])
        return self._with("few views", f"{rows} x {cols} views", LightField.of(views, samples, weights))

    def _with(self, kind: str, change: str, light_field: LightField) -> Case:
        return replace(self, name=f"{self.name}, {change}", kind=kind, light_field=light_field)


def read_case(text: str, step: int) -> Case:
    """Read a scene given as FOLDER or FOLDER=TRUTH.pfm.

    `step` is the number of steps of the full grid between views; the truth of a scene is in px per view step, and of a
    separate file in px per step of the full grid.
    """
    folder, _, truth = text.partition("=")
    path = Path(folder)
    for names, units in PAIRS.items():
        if all((path / name).exists() for name in names):
            return _read_pair(path, names, units)
    scene = read_hci(path)
    light_field = scene.light_field
    disparity = truth_of(scene, Path(truth) if truth else None, step)
    inner = (slice(BORDER_PX, -BORDER_PX),) * 2
    truth_px = np.full_like(disparity, np.nan)
    truth_px[inner] = disparity[inner] * np.float32(max(light_field.rows, light_field.cols) // 2)
    return Case(path.name, "rendered", light_field, truth_px, *(scene.depth_range_mm or (None, None)))


def _read_pair(folder: Path, names: tuple[str, str, str], units: float) -> Case:
    left, right, stored = (cv2.imread(str(folder / name), cv2.IMREAD_UNCHANGED) for name in names)
    assert left is not None and right is not None and stored is not None
    pair: Any = [np.ascontiguousarray(picture[..., ::-1]) for picture in (left, right)]
    light_field = LightField.from_views(pair, step_mm=PAIR_STEP_MM, focal_px=PAIR_FOCAL_PX)
    truth = np.where(stored > 0, stored / np.float32(units), np.nan).astype(np.float32)
    return Case(
        folder.name, "real pair", light_field, truth, PAIR_FOCAL_PX * PAIR_STEP_MM / MAX_PAIR_PX, np.inf, 1.0 / units
    )


def variants(case: Case, seed: int) -> Iterator[Case]:
    """Yield a scene as it is, with noise, as cameras see it, with wrong ranges or order of views, with fewer views."""
    yield case
    for number, (grey, blur_px) in enumerate(NOISES):
        yield case.noisy(grey, seed + number, blur_px)
    for number, sensor in enumerate(CAMERAS):
        photographed = case.photographed(sensor, seed + number)
        yield photographed
        yield photographed.within("wide range", "wide range", *WIDE)
    yield case.within("wrong range", "range too near", 0.6, 1.0)
    yield case.within("wrong range", "range too far", 0.0, 0.4)
    if case.light_field.rows == case.light_field.cols == 3:
        yield case.exchanged(seed)
        for rows, cols in ((1, 2), (1, 3), (2, 2)):
            yield case.noisy(1.0 + seed % 3, seed).some_views(rows, cols)


def rooms(first_seed: int, count: int) -> Iterator[Case]:
    """Yield rooms with bare walls and noise of any kind: every third unfurnished, half of these with a ramp."""
    for seed in range(first_seed, first_seed + count):
        random = np.random.default_rng(seed)
        grey = float(np.exp(random.uniform(*np.log(ROOM_NOISE_GREY))))
        blur_px, ramp_grey = random.choice([0.0, 1.0]), random.choice([0.0, 30.0])
        furnished = seed % 3 > 0
        light_field, truth = room(seed, grey, blur_px, furnished=furnished, ramp_grey=None if furnished else ramp_grey)
        name = "room" if furnished else "wall with a ramp" if ramp_grey else "bare wall"
        blurred = f" blurred by {blur_px:g} px" if blur_px else ""
        yield Case(f"{name} {seed}, noise {grey:.1f}{blurred}", "bare walls", light_field, truth, NEAR_MM, FAR_MM)
