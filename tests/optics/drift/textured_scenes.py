"""Pictures of textured scenes through a layout, traced pixel by pixel; for tests and benchmarks of drift."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.light_field.photographs import reflected_rays

Picture = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Sheet:
    """A flat picture in the scene: centre and axes (3, 3; right, down, into it) in view axes, mm per texel."""

    middle: FloatArray
    axes: FloatArray
    picture: Picture
    texel_mm: float

    def met(self, start: FloatArray, ray: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far along rays (n, 3) it is met, infinite beside it, and the grey levels there (n,), 0 to 1."""
        ahead = ray @ self.axes[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            far = ((self.middle - start) @ self.axes[2]) / ahead
            flat = (start + far[:, None] * ray - self.middle) @ self.axes[:2].T / self.texel_mm
        size = np.array(self.picture.shape[::-1]) / 2.0
        inside = (far > 0.0) & (np.abs(flat) < size - 1.0).all(axis=1)
        where: Any = np.resize((flat + size)[inside].astype(np.float32), (int(inside.sum()) // 1024 + 1, 1024, 2))
        grey = np.zeros(len(ray))
        if inside.any():
            shown: Any = cv2.remap(
                self.picture, where[..., 0].copy(), where[..., 1].copy(), cv2.INTER_LINEAR
            )  # row by row: remap limits the length
            grey[inside] = shown.ravel()[: int(inside.sum())]
        return np.where(inside, far, np.inf), grey


@dataclass(frozen=True)
class Shot:
    """Imaging conditions: noise in grey levels, JPEG quality (0: uncompressed), and blur of the lens, px.

    Attributes
    ----------
    shift_mm, turn_rad
        How the scene moves, in view axes, from the first row of the sensor to the last.
    gains
        Differences of the mirrors' brightness, their standard deviation.
    """

    noise: float = 1.5
    jpeg: int = 0
    blur_px: float = 0.7
    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gains: float = 0.03


def fractal(random: np.random.Generator, side: int = 700, slope: float = 1.2) -> Picture:
    """A random picture whose amplitudes fall as frequency to the power of `slope`, without the finest detail."""
    at = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side)[None])
    amplitude = np.exp(-((at / 0.22) ** 2)) / np.maximum(at, 3.0 / side) ** slope
    waves = np.fft.irfft2(amplitude * np.exp(2j * np.pi * random.random(at.shape)), (side, side))
    return np.clip(0.5 + 0.2 * waves / waves.std(), 0.02, 0.98).astype(np.float32)


def scene(
    random: np.random.Generator, depths_mm: tuple[float, float], pictures: list[Picture], focal_px: float
) -> list[Sheet]:
    """A wall and eight sheets before it, turned at random, with some of the pictures on them."""
    near, far = depths_mm
    sheets = []
    for number in range(9):
        depth = far * random.uniform(1.0, 1.6) if number == 0 else random.uniform(near, far)
        turn = Rotation.from_euler("xyz", random.normal(0.0, 12.0 if number == 0 else 25.0, 3), degrees=True)
        picture = pictures[int(random.integers(len(pictures)))]
        texel = depth / focal_px * random.uniform(0.8, 1.6)
        if number == 0:
            texel = max(texel, 2.2 * depth / max(picture.shape))
            middle = np.array([0.0, 0.0, depth])
        else:
            middle = np.array([*(random.uniform(-0.35, 0.35, 2) * depth), depth])
            side = int(random.uniform(0.1, 0.3) * focal_px)
            top = [int(random.integers(max(length - side, 1))) for length in picture.shape]
            picture = picture[top[0] : top[0] + side, top[1] : top[1] + side]
        sheets.append(Sheet(middle, turn.as_matrix().T, picture, texel))
    return sheets


def photograph(layout: Layout, sheets: list[Sheet], shot: Shot, random: np.random.Generator) -> NDArray[np.uint8]:
    """The picture (h, w, 3) that the camera takes of sheets via the mirrors of a layout."""
    height, width = layout.camera.height_px, layout.camera.width_px
    frame = np.zeros((height, width), np.float32)
    gains = np.random.default_rng(len(layout.mirrors)).normal(1.0, shot.gains, len(layout.mirrors))
    for gain, (hit, start, ray) in zip(gains, reflected_rays(layout), strict=True):
        when = np.broadcast_to(np.arange(height)[:, None] / height - 0.5, hit.shape)[hit][:, None]
        # The scene moves relative to the camera: rays move in the opposite direction.
        back = Rotation.from_rotvec(-when * np.array(shot.turn_rad))
        start, ray = back.apply(start - when * np.array(shot.shift_mm)), back.apply(ray)
        nearest, grey = np.full(len(ray), np.inf), np.full(len(ray), 0.3)
        for sheet in sheets:
            far, shown = sheet.met(start, ray)
            grey = np.where(far < nearest, shown, grey)
            nearest = np.minimum(nearest, far)
        frame[hit] = gain * grey
    seen: Any = cv2.GaussianBlur(frame, (0, 0), shot.blur_px) * 230.0
    seen = np.clip(seen + random.normal(0.0, shot.noise, seen.shape), 0.0, 255.0).round().astype(np.uint8)
    if shot.jpeg:
        seen = cv2.imdecode(cv2.imencode(".jpg", seen, [cv2.IMWRITE_JPEG_QUALITY, shot.jpeg])[1], cv2.IMREAD_GRAYSCALE)
    return np.repeat(np.asarray(seen)[..., None], 3, axis=2)
