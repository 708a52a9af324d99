"""Line pairs that refocusing at twice the resolution resolves: `python -m benchmarks.light_field_super`.

A chart of sine waves in closed form, across and down, on a plane that nine views see with shifts of parts of a pixel;
pixels integrate light over their area, are coded as sRGB, and have noise of one grey level. A frequency is resolved
where the wave keeps a tenth of its contrast, in phase, and more than what else is there (root mean square).
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.light_field_images import plain
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.render.linear_light import levels_from_light, light_from_levels
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, homography, refocus

SCALE, DEPTH_MM, CONTRAST, NOISE, INNER_PX = 2, 407.0, 0.4, 1.0 / 255.0, 40
FREQUENCIES = np.arange(0.30, 0.96, 0.025)
"""Line pairs per pixel of a view: it samples .5 without aliasing."""

Picture = NDArray[np.float32]


def views_of(frequency: float, axis: int) -> LightField:
    """Nine views of a wave along u (axis 0) or v (1)."""
    empty = plain(3, 3, 200, 200)
    plane, random = FocalPlane.at_depth(empty, DEPTH_MM), np.random.default_rng(1)
    grid = np.concatenate([empty.pixel_grid(), np.ones((200, 200, 1))], axis=-1)
    samples = np.empty((3, 3, 200, 200, 1), np.float32)
    for index in np.ndindex(3, 3):
        seen = grid @ np.linalg.inv(homography(empty, index, plane)).T
        wave = np.cos(2.0 * np.pi * frequency * seen[..., axis] / seen[..., 2])
        light = (0.5 + CONTRAST * np.sinc(frequency) * wave).astype(np.float32)
        samples[index] = (levels_from_light(light) + random.normal(0.0, NOISE, light.shape))[..., None]
    return LightField.of(empty, samples, empty.weights)


def enlarged(how: int) -> Callable[[LightField], Picture]:
    """Enlargement of the central view alone."""

    def made(light_field: LightField) -> Picture:
        size = light_field.width_px * SCALE, light_field.height_px * SCALE
        central = light_from_levels(light_field.samples[1, 1])
        return np.asarray(cv2.resize(central, size, interpolation=how), dtype=np.float32)

    return made


def shift_and_add(light_field: LightField) -> Picture:
    """Each sample on the nearest pixel of the fine grid, means of those, the rest from the central view enlarged."""
    height, width = light_field.height_px * SCALE, light_field.width_px * SCALE
    total, count = np.zeros((2, height * width))
    plane = FocalPlane.at_depth(light_field, DEPTH_MM)
    grid = np.concatenate([light_field.pixel_grid(), np.ones((*light_field.weights.shape[2:], 1))], axis=-1)
    for index in np.ndindex(3, 3):
        seen = grid @ np.linalg.inv(homography(light_field, index, plane)).T
        u, v = (np.rint(SCALE * seen[..., k] / seen[..., 2] + (SCALE - 1) / 2).astype(int) for k in (0, 1))
        there = (u >= 0) & (v >= 0) & (u < width) & (v < height)
        cells = v[there] * width + u[there]
        np.add.at(total, cells, light_from_levels(light_field.samples[index])[..., 0][there])
        np.add.at(count, cells, 1)
    rest = enlarged(cv2.INTER_CUBIC)(light_field).ravel()
    return np.where(count > 0, total / np.maximum(count, 1), rest).astype(np.float32).reshape(height, width)


def ours(light_field: LightField) -> Picture:
    """Refocused at twice the resolution."""
    picture = refocus(light_field, FocalPlane.at_depth(light_field, DEPTH_MM), scale=SCALE)
    return light_from_levels(picture.image)[..., 0]


def kept(picture: Picture, frequency: float, axis: int) -> tuple[float, float]:
    """Contrast in phase of a wave in a picture, and what else there is, both as parts of the chart's contrast."""
    fine = (np.arange(picture.shape[0]) - (SCALE - 1) / 2) / SCALE
    wave = 2.0 * np.pi * frequency * (fine[None] if axis == 0 else fine[:, None]) + 0.0 * picture
    inner = slice(INNER_PX, -INNER_PX), slice(INNER_PX, -INNER_PX)
    basis = np.stack([np.ones_like(wave), np.cos(wave), np.sin(wave)], axis=-1)[inner].reshape(-1, 3)
    values = picture[inner].ravel().astype(np.float64)
    fit = np.linalg.lstsq(basis, values, rcond=None)[0]
    rest = np.sqrt(np.mean(np.square(values - basis[:, :2] @ fit[:2])) * 2.0)
    return float(fit[1]) / CONTRAST, float(rest) / CONTRAST


METHODS: dict[str, Callable[[LightField], Picture]] = {
    "bicubic": enlarged(cv2.INTER_CUBIC),
    "Lanczos": enlarged(cv2.INTER_LANCZOS4),
    "shift and add": shift_and_add,
    "refocus --scale 2": ours,
}


def main() -> None:
    """Print the highest frequency up to which each method resolves all, and contrasts on the way."""
    print("line pairs per px of a view: across, down   contrast at .40 / .50 / .60 / .70 across")
    for name, method in METHODS.items():
        highest, shown = [], ""
        for axis in (0, 1):
            found = [kept(method(views_of(float(each), axis)), float(each), axis) for each in FREQUENCIES]
            failing = [not (signal > 0.1 and signal > rest) for signal, rest in found]
            first = failing.index(True) if any(failing) else len(failing)
            highest.append(float(FREQUENCIES[first - 1]) if first else 0.0)
            if axis == 0:
                shown = " ".join(f"{found[each][0]:5.2f}" for each in (4, 8, 12, 16))
        print(f"{name:18s} {highest[0]:.3f} {highest[1]:.3f}   {shown}")


if __name__ == "__main__":
    main()
