"""A textured relief with cards before it, traced ray by ray: scenes with exact truth, without a renderer.

A matte surface of any roughness is lit from one side; flat cards may stand before it. All views of a light field look
at it from any pose; the truth is the depth of the central view. Rays meet the relief by iteration, cards directly.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import LightField, Views

CELLS = 2048
ROUNDS = 24
ROW = 512
Floats = NDArray[np.float32]


def even_views(count: int, step_mm: float, **changes: Any) -> Views:
    """Return a nearly even grid of count x count views, with the middle one at the origin of rig."""
    across = (np.arange(count) - count // 2) * step_mm
    positions = np.zeros((count, count, 3))
    positions[..., 0], positions[..., 1] = across, across[:, None]
    positions += np.random.default_rng(5).uniform(-0.03, 0.03, positions.shape) * step_mm
    given: dict[str, Any] = {
        "positions_mm": positions - positions[count // 2, count // 2],
        "focal_px": 500.0,
        "centre_px": np.array([159.5, 119.5]),
        "width_px": 320,
        "height_px": 240,
        "reference_depth_mm": 500.0,
        "reference_view_in_rig_mm": np.zeros(3),
        "view_from_rig": np.eye(3),
        "layout_identity": "",
    }
    return Views(**(given | changes))


def blobs(seed: int, sizes_mm: tuple[tuple[float, float], ...], cell_mm: float) -> Floats:
    """Return a field with a period of CELLS cells: a sum of blobs, each with a size in mm and a standard deviation."""
    random = np.random.default_rng(seed)
    total = np.zeros((CELLS, CELLS))
    for size_mm, deviation in sizes_mm:
        layer = gaussian_filter(random.standard_normal((CELLS, CELLS)), size_mm / cell_mm, mode="wrap")
        total += deviation / layer.std() * layer
    return total.astype(np.float32)


@dataclass(frozen=True, eq=False)
class Card:
    """A flat rectangle that faces z: its depth and its (left, top, right, bottom), mm."""

    depth_mm: float
    bounds_mm: tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class Relief:
    """The scene in the world: x right, y down, z away from the viewer, mm.

    Attributes
    ----------
    depth_mm
        Mean depth of the relief.
    heights_mm
        Blobs of the relief: sizes and standard deviations.
    slants
        Mean slopes of the relief along x and y.
    texture_mm
        Blobs of the texture: sizes and shares of its contrast.
    contrast
        Standard deviation of the texture around the mean of 110 grey levels.
    light
        Direction to the light; only the relief is shaded by it.
    """

    seed: int = 0
    depth_mm: float = 500.0
    heights_mm: tuple[tuple[float, float], ...] = ((10.0, 8.0), (32.0, 30.0))
    slants: tuple[float, float] = (0.1, -0.2)
    texture_mm: tuple[tuple[float, float], ...] = ((0.6, 1.0), (1.5, 1.0), (4.0, 1.0))
    contrast: float = 25.0
    light: tuple[float, float, float] = (0.4, -0.3, -0.85)
    cards: tuple[Card, ...] = ()
    cell_mm: float = 0.5
    texel_mm: float = 0.25
    _fields: tuple[Floats, Floats] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        heights = blobs(self.seed + 100, self.heights_mm, self.cell_mm)
        texture = self.contrast * blobs(self.seed + 200, self.texture_mm, self.texel_mm)
        object.__setattr__(self, "_fields", (heights, texture))

    def lit_from(self, light: tuple[float, float, float]) -> Relief:
        return replace(self, light=light)

    def surface_mm(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """z of the relief at (x, y)."""
        return self.depth_mm + self.slants[0] * x + self.slants[1] * y + _at(self._fields[0], x, y, self.cell_mm)

    def seen(self, start_mm: FloatArray, ways: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return grey levels (...) and lengths (...) of rays from points (..., 3) along directions (..., 3)."""
        along = (self.depth_mm - start_mm[..., 2]) / ways[..., 2]
        for _ in range(ROUNDS):
            points = start_mm + ways * along[..., None]
            along = along + 0.7 * (self.surface_mm(points[..., 0], points[..., 1]) - points[..., 2]) / ways[..., 2]
        points = start_mm + ways * along[..., None]
        grey = self._painted(points, 0.0) * self._shade(points)
        for number, card in enumerate(self.cards, start=1):
            to_card = (card.depth_mm - start_mm[..., 2]) / ways[..., 2]
            at = start_mm + ways * to_card[..., None]
            left, top, right, bottom = card.bounds_mm
            hit = (at[..., 0] > left) & (at[..., 0] < right) & (at[..., 1] > top) & (at[..., 1] < bottom)
            hit &= to_card < along
            if not hit.any():
                continue
            grey[hit] = self._painted(at[hit], 97.0 * number)
            along[hit] = to_card[hit]
        return grey, along

    def _painted(self, points: FloatArray, moved_mm: float) -> FloatArray:
        return np.clip(
            110.0 + _at(self._fields[1], points[..., 0] + moved_mm, points[..., 1], self.texel_mm), 5.0, 400.0
        )

    def _shade(self, points: FloatArray) -> FloatArray:
        x, y, near = points[..., 0], points[..., 1], self.cell_mm
        down_x = (self.surface_mm(x + near, y) - self.surface_mm(x - near, y)) / (2.0 * near)
        down_y = (self.surface_mm(x, y + near) - self.surface_mm(x, y - near)) / (2.0 * near)
        light = np.array(self.light) / np.linalg.norm(self.light)
        facing = (light[0] * down_x + light[1] * down_y - light[2]) / np.sqrt(1.0 + down_x**2 + down_y**2)
        return np.clip(facing, 0.05, 1.0)


def light_field_of(
    scene: Relief,
    views: Views,
    *,
    noise_grey: float = 1.0,
    gain: float = 1.0,
    world_from_view: FloatArray | None = None,
    seed: int = 0,
    subsamples: int = 2,
) -> tuple[LightField, FloatArray]:
    """The 8-bit light field of a scene from a pose (4, 4), and the true distance (v, u) along z of the central view."""
    pose = np.eye(4) if world_from_view is None else world_from_view
    shape = (views.rows, views.cols, views.height_px, views.width_px)
    grey = np.zeros(shape)
    parts = (np.arange(subsamples) + 0.5) / subsamples - 0.5
    for t, s in np.ndindex(views.rows, views.cols):
        start = pose[:3, :3] @ views.positions_mm[t, s] + pose[:3, 3]
        for within in np.stack(np.meshgrid(parts, parts), axis=-1).reshape(-1, 2):
            ways = _ways(views, (t, s), views.pixel_grid() + within) @ pose[:3, :3].T
            grey[t, s] += scene.seen(start, ways)[0] / subsamples**2
    middle = (views.rows // 2, views.cols // 2)
    true_mm = scene.seen(pose[:3, 3], _ways(views, middle, views.pixel_grid()) @ pose[:3, :3].T)[1]
    noisy = gain * grey + np.random.default_rng(seed).normal(0.0, noise_grey, shape)
    samples = np.repeat(np.rint(np.clip(noisy, 0.0, 255.0)).astype(np.uint8)[..., None], 3, axis=-1)
    return LightField.of(views, samples, np.ones(shape, np.float32)), true_mm


def _ways(views: Views, view: tuple[int, int], pixels: FloatArray) -> FloatArray:
    homogeneous = np.concatenate([pixels, np.ones((*pixels.shape[:-1], 1))], axis=-1)
    return np.asarray(homogeneous @ np.linalg.inv(views.matrices[view]).T)


def _at(values: Floats, x: FloatArray, y: FloatArray, cell_mm: float) -> FloatArray:
    """Interpolate a periodic field bilinearly at places in mm from its middle."""
    # In rows of a length that OpenCV accepts.
    padding = -x.size % ROW
    across, down = (
        np.pad((each.ravel() / cell_mm + CELLS / 2) % CELLS, (0, padding)).astype(np.float32).reshape(-1, ROW)
        for each in (x, y)
    )
    found = cv2.remap(values, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.asarray(found.ravel()[: x.size], dtype=np.float64).reshape(x.shape)
