"""Ground truth of the pupil, by ray tracing: its unvignetted part via each mirror in every pixel.

It shares only the shape of mirrors with the renderers, and nothing with `optics.geometry.pupil`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import Pupil
from mirrorcam.render_scenes.mirror_finish import MirrorFinish
from mirrorcam.render_scenes.truth.light_rays import Obstacles, trace_via_mirror
from mirrorcam.render_scenes.truth.pixel_maps import NO_MIRROR

SAMPLES = 100
"""Number of rays in a pixel that may show more than one surface; all other pixels need one ray."""
RIM = 12
"""Number of rays from the rim of the pupil in the search for these pixels."""
BLOCK_PX = 4
"""Side length of the blocks of pixels in this search."""
GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
CHANNELS = tuple(f"{rank}.{name}" for rank in ("first", "second") for name in ("mirror", "share", "x", "y"))


@dataclass(frozen=True)
class PupilTracer:
    """Traces rays from points of the pupil of a device as built.

    Attributes
    ----------
    layout
        The device.
    pupil
        Pupil of its camera.
    finishes
        Surface finishes of the mirrors; if empty, they are flat.
    obstacles
        Bodies around the mirrors, if any.
    """

    layout: Layout
    pupil: Pupil
    finishes: Sequence[MirrorFinish] = ()
    obstacles: Obstacles | None = None

    def reflecting_mirrors(
        self, chief_rays: FloatArray, pupil_point: FloatArray, mirrors: Sequence[int]
    ) -> NDArray[np.int64]:
        """Return the index (n,) of the mirror that reflects each ray, or `NO_MIRROR` if there is none.

        The rays start at `pupil_point` (2,), in units of the pupil's radius. Only `mirrors` are tested.
        """
        origin = self.pupil.radius_mm * np.array([*pupil_point, 0.0])
        walk_mm = self.pupil.walk_mm * np.square(chief_rays[:, :2]).sum(axis=1, keepdims=True)
        origin = origin + walk_mm * np.array([0.0, 0.0, 1.0])
        rays = self.pupil.focus_mm * chief_rays - origin
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        index, depth = np.full(len(rays), NO_MIRROR), np.full(len(rays), np.inf)
        for number in mirrors:
            finish = self.finishes[number] if self.finishes else None
            entry, _, _, path = trace_via_mirror(self.layout.mirrors[number], rays, finish, origin)
            nearer = entry < depth
            depth[nearer] = entry[nearer]
            index[nearer] = np.where(np.isfinite(path[nearer]), number, NO_MIRROR)
        if self.obstacles is not None:
            index[self.obstacles.distance_to_body_mm(origin, rays) < depth] = NO_MIRROR
        return index

    def pupil_parts(self, chief_rays: FloatArray, mirrors: Sequence[int]) -> tuple[FloatArray, ...]:
        """Return the `CHANNELS` (n,) of chief rays (n, 3); see `reflecting_mirrors`."""
        # Rows for a second mirror even if there is none.
        sums = np.zeros((3, max(len(mirrors), 2), len(chief_rays)))
        for pupil_point in sunflower(SAMPLES):
            mirror_at = self.reflecting_mirrors(chief_rays, pupil_point, mirrors)
            for row, number in enumerate(mirrors):
                hit = mirror_at == number
                for total, amount in zip(sums, (1.0, *pupil_point), strict=True):
                    total[row] += amount * hit
        count, *moments = sums
        numbers, columns = np.array([*mirrors, NO_MIRROR, NO_MIRROR]), np.arange(len(chief_rays))
        channels: list[FloatArray] = []
        for row in np.argsort(-count, axis=0, kind="stable")[:2]:
            rays = count[row, columns]
            divisor = np.where(rays > 0.0, rays, np.nan)
            centroid = [self.pupil.radius_mm * moment[row, columns] / divisor for moment in moments]
            channels += [np.where(rays > 0.0, numbers[row], NO_MIRROR), rays / SAMPLES, *centroid]
        return tuple(channels)


def sunflower(count: int) -> FloatArray:
    """Return points (count, 2) spread evenly over the unit disc (Vogel's spiral)."""
    number = np.arange(count)
    radius, angle = np.sqrt((number + 0.5) / count), GOLDEN_ANGLE * number
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def pupil_maps(tracer: PupilTracer) -> dict[str, FloatArray]:
    """Return maps (h, w) of the two mirrors that fill most of the pupil in each pixel, by names in `CHANNELS`.

    Each of the two mirrors has its index (`NO_MIRROR` without one), its fraction of the pupil, 0 to 1, and the centroid
    x, y of its part of the pupil, mm, from the pupil's centre (NaN without one).
    """
    camera = tracer.layout.camera
    rows, columns = np.arange(camera.height_px), np.arange(camera.width_px)
    # Classify blocks of pixels by the surfaces that rays from the pupil's rim meet at their corners.
    node_px = [np.append(np.arange(0, len(axis) - 1, BLOCK_PX), len(axis) - 1) for axis in (rows, columns)]
    nodes = camera.unproject(np.stack(np.meshgrid(node_px[1], node_px[0]), axis=-1).reshape(-1, 2).astype(np.float64))
    angles = 2.0 * np.pi * np.arange(RIM) / RIM
    indices = range(len(tracer.layout.mirrors))
    mirror_at = np.stack([tracer.reflecting_mirrors(nodes, np.array([np.cos(a), np.sin(a)]), indices) for a in angles])
    mirror_at = mirror_at.reshape(RIM, len(node_px[0]), len(node_px[1]))
    corners = np.concatenate(
        [mirror_at[:, i : len(node_px[0]) - 1 + i, k : len(node_px[1]) - 1 + k] for i in (0, 1) for k in (0, 1)]
    )
    mixed = corners.min(axis=0) != corners.max(axis=0)
    block = np.ix_(
        np.minimum(rows // BLOCK_PX, mixed.shape[0] - 1), np.minimum(columns // BLOCK_PX, mixed.shape[1] - 1)
    )
    index = corners[0][block].astype(np.float64)
    reflects = index != NO_MIRROR
    centre, nan = np.where(reflects, 0.0, np.nan), np.full(index.shape, np.nan)
    single = (
        index,
        reflects * 1.0,
        centre,
        centre,
        np.full(index.shape, float(NO_MIRROR)),
        0.0 * index,
        nan,
        nan,
    )
    maps = {name: values.copy() for name, values in zip(CHANNELS, single, strict=True)}
    # Blocks whose rays may hit the same set of mirrors are processed together.
    may_show = np.stack([_dilate((corners == number).any(axis=0)) for number in indices], axis=-1)
    mirror_sets, set_index = np.unique(may_show[mixed], axis=0, return_inverse=True)
    block_set = np.full(mixed.shape, -1)
    block_set[mixed] = set_index.ravel()
    for number, mirrors in enumerate(mirror_sets):
        row, column = np.nonzero((block_set == number)[block])
        chief_rays = camera.unproject(np.column_stack([column, row]).astype(np.float64))
        parts = tracer.pupil_parts(chief_rays, np.flatnonzero(mirrors).tolist())
        for name, values in zip(CHANNELS, parts, strict=True):
            maps[name][row, column] = values
    return maps


def _dilate(blocks: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Dilate a mask of blocks (rows, columns) by one block."""
    padded = np.pad(blocks, 1)
    rows, columns = blocks.shape
    return np.logical_or.reduce([padded[i : i + rows, k : k + columns] for i in range(3) for k in range(3)])
