"""Light on the pixels of a sensor before mirrors, and what each of them shows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled, inlined
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.preview.mirror_views import (
    INDEX,
    LEAST_SHARE,
    WINDOW,
    MirrorViews,
    scene_ray,
    served_share,
    transmitted,
    turned_step,
)
from mirrorcam.render_scenes.preview.ray_colour import ray_colour
from mirrorcam.render_scenes.preview.traced_scene import KIND, TRIANGLES, TracedScene
from mirrorcam.render_scenes.preview.triangle_tree import NOTHING
from mirrorcam.render_scenes.preview.vectors import along, times
from mirrorcam.render_scenes.undistorted_pixels import undistorted_pixels

PARTS = 8
"""Parts of an object that are told apart."""


@dataclass(frozen=True, eq=False)
class SensorLight:
    """Light on the pixels of a sensor, and what they show by the mirror that serves most of the pupil there.

    Attributes
    ----------
    radiance
        (h, w, 3), float32.
    mirror
        (h, w): number of the mirror, or -1.
    thing
        (h, w): number of the object, or -1.
    depth_mm
        (h, w): depth of it along view z; infinite where there is nothing.
    along_axis_mm
        (h, w): how far away it seems, along the axis of the camera; infinite likewise.
    """

    radiance: NDArray[np.float32]
    mirror: NDArray[np.int32]
    thing: NDArray[np.int32]
    depth_mm: FloatArray
    along_axis_mm: FloatArray


def sensor_light(camera: Camera, mirrors: MirrorViews, scene: TracedScene) -> SensorLight:
    """Trace a ray for each pixel and mirror that it shows, and four where neighbours show different things."""
    normalized = rays_of_pixels(camera.model_dump_json())
    shape = normalized.shape[:2]
    radiance = np.zeros((*shape, 3), dtype=np.float32)
    mirror, thing = np.full(shape, NOTHING, np.int32), np.full(shape, NOTHING, np.int32)
    depth, along_axis = np.full(shape, np.inf), np.full(shape, np.inf)
    _trace(normalized, mirrors, scene, radiance, mirror, thing, depth, along_axis)
    return SensorLight(radiance, mirror, thing // PARTS, depth, along_axis)


@lru_cache(maxsize=4)
def rays_of_pixels(camera: str) -> FloatArray:
    """Normalized coordinates (h, w, 2) of the pixels of a camera, which is given as JSON; NaN where it has no rays."""
    lens = Camera.model_validate_json(camera)
    columns, rows = np.arange(lens.width_px, dtype=np.float64), np.arange(lens.height_px, dtype=np.float64)
    if lens.is_undistorted:
        return lens.normalized_from_pixels(np.stack(np.meshgrid(columns, rows), axis=-1))
    return undistorted_pixels(lens, columns, rows)


@compiled
def _trace(
    normalized: Any, mirrors: Any, scene: Any, radiance: Any, mirror: Any, thing: Any, depth: Any, along_axis: Any
) -> None:
    """Fill what `SensorLight` holds; `thing` with the part of the object."""
    height, width = mirror.shape
    free = np.ones((height, width))
    best = np.zeros((height, width))
    shown = np.empty((height, width), np.int32)
    colour = np.empty((height, width, 3), np.float32)
    weight = np.empty((height, width))
    for number in range(len(mirrors.table)):
        top, bottom = int(mirrors.table[number, WINDOW]), int(mirrors.table[number, WINDOW + 1])
        left, right = int(mirrors.table[number, WINDOW + 2]), int(mirrors.table[number, WINDOW + 3])
        for v in range(top, bottom):
            for u in range(left, right):
                x, y = normalized[v, u, 0], normalized[v, u, 1]
                shown[v, u] = NOTHING
                # NaN where the lens has no ray is not above the least share.
                share = min(served_share(mirrors, number, x, y), free[v, u])
                if not share > LEAST_SHARE:
                    weight[v, u] = 0.0
                    continue
                free[v, u] -= share
                light, slide = transmitted(mirrors, number, x, y)
                weight[v, u] = share * light
                start, direction, least = scene_ray(mirrors, number, x, y, slide)
                right_step, down_step = _steps(normalized, mirrors, number, v, u)
                seen, item, part, length = ray_colour(scene, start, direction, least, right_step, down_step)
                part = part % PARTS if item != NOTHING and int(scene.objects[item, KIND]) != TRIANGLES else 0
                shown[v, u] = item * PARTS + part
                colour[v, u, 0], colour[v, u, 1], colour[v, u, 2] = seen
                if share > best[v, u]:
                    best[v, u] = share
                    mirror[v, u] = int(mirrors.table[number, INDEX])
                    thing[v, u] = shown[v, u]
                    depth[v, u] = start[2] + length * direction[2] if item != NOTHING else np.inf
                    along_axis[v, u] = length
        for v in range(top, bottom):
            for u in range(left, right):
                if weight[v, u] == 0.0:
                    continue
                if _at_edge(shown, weight, v, u, top, bottom, left, right):
                    _smooth(normalized, mirrors, scene, number, v, u, colour)
                for channel in range(3):
                    radiance[v, u, channel] += weight[v, u] * colour[v, u, channel]


@inlined
def _steps(normalized: Any, mirrors: Any, number: Any, v: Any, u: Any) -> Any:
    """How the direction of the ray of a pixel changes to the next, to the right and down."""
    height, width = normalized.shape[:2]
    a, b = min(u, width - 2), min(v, height - 2)
    right = turned_step(
        mirrors,
        number,
        normalized[v, a + 1, 0] - normalized[v, a, 0],
        normalized[v, a + 1, 1] - normalized[v, a, 1],
    )
    down = turned_step(
        mirrors,
        number,
        normalized[b + 1, u, 0] - normalized[b, u, 0],
        normalized[b + 1, u, 1] - normalized[b, u, 1],
    )
    return right, down


@inlined
def _at_edge(shown: Any, weight: Any, v: Any, u: Any, top: Any, bottom: Any, left: Any, right: Any) -> Any:
    """Whether a neighbour of a pixel shows another part or object by the same mirror."""
    here = shown[v, u]
    for down, across in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        b, a = v + down, u + across
        if top <= b < bottom and left <= a < right and weight[b, a] > 0.0 and shown[b, a] != here:
            return True
    return False


@inlined
def _smooth(normalized: Any, mirrors: Any, scene: Any, number: Any, v: Any, u: Any, colour: Any) -> None:
    """Replace the colour of a pixel, that in its middle, by the mean with those of three places around."""
    x, y = normalized[v, u, 0], normalized[v, u, 1]
    _, slide = transmitted(mirrors, number, x, y)
    start, direction, least = scene_ray(mirrors, number, x, y, slide)
    right, down = _steps(normalized, mirrors, number, v, u)
    total = (float(colour[v, u, 0]), float(colour[v, u, 1]), float(colour[v, u, 2]))
    half_right, half_down = times(right, 0.5), times(down, 0.5)
    for across, below in ((0.0, -0.35), (0.3, 0.175), (-0.3, 0.175)):
        towards = along(along(direction, across, right), below, down)
        seen, _, _, _ = ray_colour(scene, start, towards, least, half_right, half_down)
        total = along(total, 1.0, seen)
    colour[v, u, 0], colour[v, u, 1], colour[v, u, 2] = times(total, 0.25)
