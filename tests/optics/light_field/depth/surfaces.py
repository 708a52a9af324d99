"""Light fields and depths of textured planes in closed form, by exact pinholes at the views' positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import FOLD_90_VIEW_FROM_RIG
from mirrorcam.optics.light_field.depth.sweep import Volume
from mirrorcam.optics.light_field.light_field import LightField, Views

SUBPIXELS = 2
TEXELS, TEXEL_MM = 512, 0.5


@cache
def pattern(seed: int, grain_mm: float) -> NDArray[np.float32]:
    """Colours (TEXELS, TEXELS, 3) with mean zero and variance one: periodic noise in grains of several sizes."""
    random = np.random.default_rng(seed)
    total = np.zeros((TEXELS, TEXELS, 3))
    for octave in (1.0, 2.0, 4.0):
        grains = random.normal(size=total.shape)
        soft = gaussian_filter(grains, (octave * grain_mm / TEXEL_MM,) * 2 + (0.0,), mode="wrap")
        total += soft / soft.std()
    return (total / total.std()).astype(np.float32)


@dataclass(frozen=True)
class Surface:
    """The plane Z = distance + slope . (X, Y) in the view frame, mm, within `bounds` (left, top, right, bottom).

    Its brightness is `mean` and a pattern of the given contrast.
    """

    distance_mm: float
    slope: tuple[float, float] = (0.0, 0.0)
    bounds: tuple[float, float, float, float] = (-np.inf, -np.inf, np.inf, np.inf)
    seed: int = 0
    mean: float = 0.5
    contrast: float = 0.12
    grain_mm: float = 1.0

    def colours(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Brightness (n, 3) at places (n,) on the surface."""
        wrapped = np.pad(pattern(self.seed, self.grain_mm), ((0, 1), (0, 1), (0, 0)), mode="wrap")
        columns, rows = (np.mod(place / TEXEL_MM, TEXELS).astype(np.float32)[None] for place in (x, y))
        # The longest side that cv2.remap takes.
        parts = [slice(start, start + 2**14) for start in range(0, len(x), 2**14)]
        shown = [cv2.remap(wrapped, columns[:, part], rows[:, part], cv2.INTER_LINEAR)[0] for part in parts]
        return self.mean + self.contrast * np.concatenate([np.zeros((0, 3)), *shown])


def grid_views(rows: int = 3, cols: int = 3, *, step_mm: float = 20.0, uneven: bool = True, **changes: Any) -> Views:
    """Return views of 120x90 px like a mirror camera's, the reference view 80 mm behind and 90 above the pupil."""
    s, t = np.meshgrid(np.arange(cols) - cols // 2, np.arange(rows) - rows // 2)
    positions = np.stack([s, t, 0 * s], axis=-1) * step_mm
    if uneven:
        positions += np.random.default_rng(8).uniform(-1, 1, positions.shape) * [2.0, 2.0, 1.5]
    positions[rows // 2, cols // 2] = 0.0
    given: dict[str, Any] = {
        "positions_mm": positions,
        "focal_px": 400.0,
        "centre_px": np.array([58.0, 46.5]),
        "width_px": 120,
        "height_px": 90,
        "reference_depth_mm": 375.0,
        "reference_view_in_rig_mm": np.array([0.0, -80.0, 90.0]),
        "view_from_rig": np.array(FOLD_90_VIEW_FROM_RIG),
        "layout_identity": "0123456789abcdef",
    }
    return Views(**(given | changes))


def met(views: Views, index: tuple[int, int], pixels: FloatArray, surfaces: Sequence[Surface]) -> tuple[Any, Any, Any]:
    """Return the nearest surface at pixels (..., 2) of a view: colours (..., 3), distance Z (...) and number (...)."""
    place = views.positions_mm[index]
    ahead = (pixels - views.centre_px) * (views.reference_distance_mm / views.focal_px)
    way = np.concatenate([ahead, np.full((*ahead.shape[:-1], 1), views.reference_distance_mm)], axis=-1) - place
    nearest, number = np.full(way.shape[:-1], np.inf), np.full(way.shape[:-1], -1)
    colours = np.zeros((*way.shape[:-1], 3))
    for count, surface in enumerate(surfaces):
        normal = np.array([-surface.slope[0], -surface.slope[1], 1.0])
        reach = (surface.distance_mm - normal @ place) / (way @ normal)
        x, y = np.moveaxis((place + reach[..., None] * way)[..., :2], -1, 0)
        left, top, right, bottom = surface.bounds
        hit = (reach > 0) & (reach < nearest) & (x >= left) & (x <= right) & (y >= top) & (y <= bottom)
        nearest[hit], number[hit] = reach[hit], count
        colours[hit] = surface.colours(x[hit], y[hit])
    return colours, place[2] + nearest * way[..., 2], number


def photograph(
    views: Views, surfaces: Sequence[Surface], *, noise: float = 0.004, gains: FloatArray | None = None, seed: int = 5
) -> tuple[LightField, FloatArray, NDArray[np.int64]]:
    """Return the light field in 8-bit colour, and depth from the pupil and surface number in the reference view.

    `gains` (t, s) brighten views as mirrors do.
    """
    inner = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
    shifts = np.stack(np.meshgrid(inner, inner), axis=-1).reshape(-1, 2)
    random = np.random.default_rng(seed)
    shape = (views.rows, views.cols, views.height_px, views.width_px)
    samples = np.empty((*shape, 3), np.uint8)
    for index in np.ndindex(views.rows, views.cols):
        light = np.mean([met(views, index, views.pixel_grid() + shift, surfaces)[0] for shift in shifts], axis=0)
        light = light * (1.0 if gains is None else gains[index]) + random.normal(scale=noise, size=light.shape)
        samples[index] = np.rint(255.0 * np.clip(light, 0.0, 1.0))
    centre = (views.rows // 2, views.cols // 2)
    distance, number = met(views, centre, views.pixel_grid(), surfaces)[1:]
    depth = distance + views.reference_view_depth_mm
    return LightField.of(views, samples, np.ones(shape, np.float32)), depth, number


def everywhere(volume: Volume) -> NDArray[np.uint16]:
    """Costs (v, u, n) of a volume where all pixels have the same range of n planes."""
    return volume.costs.reshape(*volume.ranges.low.shape, -1)
