"""Rooms with bare walls: plain or posted walls, with rods, cables and cards in front, as light fields with truth.

Their walls are what depth estimation cannot measure: without texture, or with a slow brightness ramp only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.light_field import LightField

Floats = NDArray[np.float64]
VIEWS, WIDTH_PX, HEIGHT_PX, FOCAL_PX, STEP_MM = 3, 400, 300, 500.0, 20.0
SUBPIXELS = 2
TEXELS = 512
NEAR_MM, FAR_MM = 300.0, 1200.0
"""Depths that a search of a room covers; walls are 450 to 800 mm away."""


@dataclass(frozen=True)
class Object:
    """A flat object that faces the cameras: rod, cable (a wavy rod) or card.

    `texture` (TEXELS, TEXELS) is added to its colour, in grey levels.
    """

    depth_mm: float
    centre_mm: tuple[float, float]
    half_size_mm: tuple[float, float]
    angle: float
    wave_mm: float
    colour: Floats
    texture: NDArray[np.float32]

    def inside(self, x_mm: Floats, y_mm: Floats) -> tuple[NDArray[np.bool_], Floats, Floats]:
        """Return the mask of points in its plane that it covers, and their coordinates along its sides."""
        dx, dy = x_mm - self.centre_mm[0], y_mm - self.centre_mm[1]
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        along, across = cos * dy - sin * dx, cos * dx + sin * dy
        across = across - self.wave_mm * np.sin(along * (2.0 * np.pi / 70.0))
        return (np.abs(across) < self.half_size_mm[0]) & (np.abs(along) < self.half_size_mm[1]), across, along


def noise(
    random: np.random.Generator, shape: tuple[int, ...], deviation_grey: float, blur_px: float
) -> NDArray[np.float32]:
    """Return white noise (v, u, 3) of a standard deviation in grey levels, blurred by another in px."""
    white = np.float32(deviation_grey) * random.standard_normal(shape, np.float32)
    return np.asarray(cv2.GaussianBlur(white, (0, 0), blur_px), np.float32) if blur_px else white


def _texture(random: np.random.Generator, grey: float) -> NDArray[np.float32]:
    coarse = random.uniform(-grey, grey, (28, 28)).astype(np.float32)
    return np.asarray(cv2.resize(coarse, (TEXELS, TEXELS), interpolation=cv2.INTER_CUBIC), np.float32)


def _objects(random: np.random.Generator, wall_mm: float) -> list[Object]:
    """Return up to five objects in front of a wall, the farthest first."""
    found = []
    for _ in range(random.integers(1, 6)):
        kind = random.choice(["rod", "cable", "card", "plain card"])
        is_card = "card" in kind
        found.append(
            Object(
                depth_mm=random.uniform(320.0, 0.9 * wall_mm),
                centre_mm=(random.uniform(-150, 150), random.uniform(-110, 110)),
                half_size_mm=tuple(random.uniform(15, 60, 2)) if is_card else (random.uniform(0.5, 3.0), 400.0),
                angle=random.uniform(-0.6, 0.6),
                wave_mm=20.0 if kind == "cable" else 0.0,
                colour=random.uniform(20, 230, 3),
                texture=_texture(random, random.uniform(1.0, 60.0) if kind == "card" else 0.0),
            )
        )
    return sorted(found, key=lambda item: -item.depth_mm)


def room(
    seed: int, noise_grey: float, noise_blur_px: float = 0.0, *, furnished: bool = True, ramp_grey: float | None = None
) -> tuple[LightField, NDArray[np.float32]]:
    """Return 3 x 3 views of a room, and the true disparity (v, u) at the longest baseline, px, of the central view.

    Parameters
    ----------
    seed
        Seed of the room and of the noise.
    noise_grey, noise_blur_px
        Standard deviations of white noise, grey levels, and of its blur, px.
    furnished
        Whether objects stand in front of the wall, and a poster may hang on it.
    ramp_grey
        Change of the wall's brightness over its width, grey levels; at random, up to 25, by default.
    """
    random = np.random.default_rng(seed)
    positions_mm = STEP_MM * (np.arange(VIEWS) - VIEWS // 2)
    centre_u, centre_v = (WIDTH_PX - 1) / 2.0, (HEIGHT_PX - 1) / 2.0
    wall_mm = random.uniform(450.0, 800.0)
    slant = random.uniform(-0.4, 0.4), random.uniform(-0.2, 0.2)
    wall_colour, ramp_angle = random.uniform(90.0, 200.0, 3), random.uniform(0.0, 2.0 * np.pi)
    ramp = (random.uniform(0.0, 25.0) if ramp_grey is None else ramp_grey) / 480.0
    poster = Object(
        wall_mm,
        (random.uniform(-150, 150), random.uniform(-100, 100)),
        (random.uniform(20, 80), random.uniform(20, 60)),
        0.0,
        0.0,
        wall_colour,
        _texture(random, 50.0 * (random.random() < 0.6)),
    )
    objects = _objects(random, wall_mm) if furnished else []
    v, u = np.mgrid[: HEIGHT_PX * SUBPIXELS, : WIDTH_PX * SUBPIXELS]
    u, v = ((values + 0.5) / SUBPIXELS - 0.5 for values in (u, v))
    ray_x, ray_y = (u - centre_u) / FOCAL_PX, (v - centre_v) / FOCAL_PX
    samples = np.empty((VIEWS, VIEWS, HEIGHT_PX, WIDTH_PX, 3), np.uint8)
    for index in np.ndindex(VIEWS, VIEWS):
        eye_x, eye_y = positions_mm[index[1]], positions_mm[index[0]]
        depth = (wall_mm + slant[0] * eye_x + slant[1] * eye_y) / (1.0 - slant[0] * ray_x - slant[1] * ray_y)
        x, y = eye_x + ray_x * depth, eye_y + ray_y * depth
        picture: Any = wall_colour + (ramp * (x * np.cos(ramp_angle) + y * np.sin(ramp_angle)))[..., None]
        if furnished:
            picture = _painted(picture, poster, x, y)[0]
        for item in objects:
            picture, covered = _painted(picture, item, eye_x + ray_x * item.depth_mm, eye_y + ray_y * item.depth_mm)
            depth = np.where(covered, item.depth_mm, depth)
        small = cv2.resize(picture, (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_AREA)
        noisy = small + noise(random, small.shape, noise_grey, noise_blur_px)
        samples[index] = np.rint(np.clip(noisy, 0, 255))
        if index == (VIEWS // 2, VIEWS // 2):
            truth = FOCAL_PX * STEP_MM / depth[::SUBPIXELS, ::SUBPIXELS]
    return LightField.from_views(samples, step_mm=STEP_MM, focal_px=FOCAL_PX), truth.astype(np.float32)


def _painted(picture: Any, item: Object, x_mm: Floats, y_mm: Floats) -> tuple[Any, NDArray[np.bool_]]:
    """Return the picture (v, u, 3) with an object at points (v, u) of its plane, and the mask of its pixels."""
    covered, across, along = item.inside(x_mm, y_mm)
    columns, rows = ((values * 3.0 + TEXELS / 2).astype(np.float32) for values in (across, along))
    texture = cv2.remap(item.texture, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return np.where(covered[..., None], item.colour + texture[..., None], picture), covered
