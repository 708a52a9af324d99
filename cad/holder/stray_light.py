"""Stray light: a baffle round the mirrors that hides the surroundings from the camera, and the light that passes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from manifold3d import Manifold, OpType
from numpy.typing import NDArray
from shapely import Polygon, contains_xy, get_coordinates, union_all
from shapely.geometry.polygon import orient

from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import Frustum, outline_at
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout

# Limit of the fraction of pixels that see the surroundings past all parts. Their veiling glare is at most one of 255
# grey levels if they are five times as bright as the scene, and the lens scatters 3 % of the light over the picture
# (ISO 9358).
MAX_STRAY_LIGHT = 1.0 / 255.0 / (5.0 * 0.03)
STEP_PX = 24
FAR_MM = 2000.0


def viewing_rays(camera: Camera) -> FloatArray:
    """Rays (n, 2), in normalized coordinates, through every `STEP_PX`-th pixel of the camera in both directions."""
    columns, rows = (np.arange(STEP_PX / 2.0 - 0.5, size, STEP_PX) for size in (camera.width_px, camera.height_px))
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    rays = camera.normalized_from_pixels(pixels)
    return np.asarray(rays[np.isfinite(rays).all(axis=1)])


def rays_past_mirrors(layout: Layout) -> FloatArray:
    """The viewing rays (n, 2) that meet no mirror."""
    rays = viewing_rays(layout.camera)
    mirrors = union_all([Polygon(mirror.apparent.outline_normalized) for mirror in layout.mirrors])
    return np.asarray(rays[~contains_xy(mirrors, rays[:, 0], rays[:, 1])])


def stray_light(layout: Layout, holder: Manifold, mirrors: Sequence[Manifold]) -> float:
    """Fraction of the camera's pixels that see past the solids of holder and mirrors, from rays through the pupil."""
    unblocked = sum(
        _is_unblocked([holder, *mirrors], np.array([*ray, 1.0]) * FAR_MM) for ray in rays_past_mirrors(layout)
    )
    return unblocked / len(viewing_rays(layout.camera))


def _is_unblocked(bodies: Sequence[Manifold], end: FloatArray) -> bool:
    return not any(body.ray_cast(np.zeros(3), end) for body in bodies)


@dataclass(frozen=True)
class Baffle:
    """A closed wall on the holder's slab that keeps stray light from the lens.

    The outer and inner side, each at foot and crest, are loops of corresponding corners (n, 3) in the rig frame, mm,
    round the mirrors, counter-clockwise seen from behind.
    """

    outer_foot: FloatArray
    inner_foot: FloatArray
    outer_crest: FloatArray
    inner_crest: FloatArray

    @property
    def faces(self) -> list[FloatArray]:
        """The flat faces as loops of corners, counter-clockwise seen from outside."""
        strips = (
            (self.outer_crest, self.outer_foot),
            (self.inner_foot, self.inner_crest),
            (self.outer_foot, self.inner_foot),
            (self.inner_crest, self.outer_crest),
        )
        return [
            np.array(triangle)
            for left, right in strips
            for a, b, c, d in zip(left, np.roll(left, -1, axis=0), np.roll(right, -1, axis=0), right, strict=True)
            for triangle in ((a, b, c), (a, c, d))
        ]


def plan_baffle(
    layout: Layout,
    border: Polygon,
    rig_from_mount: FloatArray,
    light: Sequence[Frustum],
    foot_mm: float,
    hardware: Hardware,
) -> Baffle:
    """Lay out the baffle along a convex border, as high as the adjacent light permits.

    The crest consists of short straight pieces, clear of all light. It is high enough to hide what the camera would see
    past the mirrors or, as a hood, `hood_mm` above the highest mirror. Where the baffle may not rise above `foot_mm`,
    it ends inside the slab.

    Parameters
    ----------
    layout : Layout
        Camera and mirrors.
    border : Polygon
        Outline of the baffle's outer side, in the mount's x and y, mm.
    rig_from_mount : (4, 4)
        Frame of the holder's flat back, z out of the back.
    light : sequence of Frustum
        Solids in the rig frame, mm, that the baffle must not enter.
    foot_mm : float
        Height of the flange, on which the baffle stands, over the back.
    hardware : Hardware
        Dimensions of the baffle, and fits.
    """
    outside, inside = _sides(border, hardware)
    mount_from_rig = np.linalg.inv(rig_from_mount)[:3]
    hulls = [Manifold.hull_points(np.vstack([volume.base, volume.top])) for volume in light]
    beams = Manifold.batch_boolean(hulls, OpType.Add).transform(mount_from_rig)
    view = (_field_of_view(layout.camera) - _hidden_space(layout, hardware)).transform(mount_from_rig)
    hood_mm = 0.0
    if hardware.holder.hood_mm > 0.0:
        fronts = np.vstack([outline_at(mirror, mirror.front_mm) for mirror in layout.mirrors])
        highest_mm = -float((fronts @ mount_from_rig[2, :3] + mount_from_rig[2, 3]).min())
        hood_mm = highest_mm + hardware.holder.hood_mm
    crest = _crest_mm(outside, inside, beams, view, hood_mm, hardware)
    inside_slab = foot_mm - 1.0
    crest = np.where(crest > foot_mm + hardware.holder.shade_mm, crest, inside_slab - 0.5)
    foot = np.full(len(outside), 0.5 * inside_slab)
    loops = (_in_rig(rig_from_mount, *corners) for corners in product((foot, crest), (outside, inside)))
    return Baffle(*loops)


def _in_rig(rig_from_mount: FloatArray, heights: FloatArray, flat: FloatArray) -> FloatArray:
    """Points (n, 3) in the rig frame from points (n, 2) on the back and heights (n,) above it."""
    return np.asarray(np.column_stack([flat, -heights]) @ rig_from_mount[:3, :3].T + rig_from_mount[:3, 3])


def _sides(border: Polygon, hardware: Hardware) -> tuple[FloatArray, FloatArray]:
    """Corners (n, 2) of the baffle's outer and inner side, which are divided into pieces of about `shade_step_mm`."""
    corners = get_coordinates(orient(border))[:-1]
    inner = _offset_inwards(corners, hardware.holder.shade_mm)
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    counts = np.ceil(lengths / hardware.holder.shade_step_mm).astype(int)
    return _subdivided(corners, counts), _subdivided(inner, counts)


def _crest_mm(
    outside: FloatArray, inside: FloatArray, beams: Manifold, view: Manifold, hood_mm: float, hardware: Hardware
) -> FloatArray:
    """Heights (n,) of the corners above the back: at each corner, the height of the lower of its two pieces."""
    heights = []
    for i in range(len(outside)):
        piece = np.array([outside[i - 1], outside[i], inside[i], inside[i - 1]])
        heights.append(_free_height_mm(piece, beams, view, hood_mm, hardware))
    return np.minimum(heights, np.roll(heights, -1))


def _offset_inwards(corners: FloatArray, distance: float) -> FloatArray:
    """Corners (n, 2) of a convex polygon, counter-clockwise, with every side moved inwards by a distance."""
    sides = np.roll(corners, -1, axis=0) - corners
    inward = np.column_stack([-sides[:, 1], sides[:, 0]]) / np.linalg.norm(sides, axis=1, keepdims=True)
    previous = np.roll(inward, 1, axis=0)
    return np.asarray(
        corners + distance * (inward + previous) / (1.0 + np.sum(inward * previous, axis=1, keepdims=True))
    )


def _subdivided(corners: FloatArray, counts: NDArray[np.int64]) -> FloatArray:
    """A closed polygon's corners (n, 2), with every side divided into a given number of equal pieces."""
    ends = np.roll(corners, -1, axis=0)
    return np.vstack(
        [
            start + (end - start) * np.arange(count)[:, None] / count
            for start, end, count in zip(corners, ends, counts, strict=True)
        ]
    )


def _field_of_view(camera: Camera) -> Manifold:
    """The camera's field of view, as a pyramid from the pupil."""
    columns, rows = (np.array([0.0, 0.5, 1.0]) * (size - 1) for size in (camera.width_px, camera.height_px))
    rays = camera.normalized_from_pixels(np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2))
    ends = np.column_stack([rays, np.ones(len(rays))]) * FAR_MM
    return Manifold.hull_points(np.vstack([np.zeros((1, 3)), ends]))


def _hidden_space(layout: Layout, hardware: Hardware) -> Manifold:
    """The space hidden from the camera by mirrors wherever they are in their pockets."""
    loops = [outline_at(mirror, mirror.back_mm, hardware.fit.free_mm) for mirror in layout.mirrors]
    shadows = [Manifold.hull_points(np.vstack([loop, loop * FAR_MM / loop[:, 2].min()])) for loop in loops]
    return Manifold.batch_boolean(shadows, OpType.Add)


def _free_height_mm(piece: FloatArray, beams: Manifold, view: Manifold, hood_mm: float, hardware: Hardware) -> float:
    """Height above the back of a wall on a convex piece (n, 2): as high as needed, as far as light permits.

    At the needed height, at least `hood_mm`, the wall hides the surroundings from the camera. Without a hood it is 0 if
    the camera cannot see the wall.
    """
    highest = hardware.printer.bed_mm[2]
    visible = _column(piece, highest) ^ view
    needed = hood_mm if visible.is_empty() else max(hood_mm, -visible.bounding_box()[2])
    if needed == 0.0:
        return 0.0
    enlarged = Polygon(piece).buffer(hardware.fit.light_mm, join_style="mitre")
    overlap = _column(get_coordinates(enlarged), highest) ^ beams
    free = highest if overlap.is_empty() else -overlap.bounding_box()[5] - hardware.fit.light_mm
    return min(free, needed)


def _column(flat: FloatArray, height_mm: float) -> Manifold:
    """The prism on a convex area (n, 2) of the back."""
    return Manifold.hull_points(np.vstack([np.column_stack([flat, np.full(len(flat), z)]) for z in (0.0, -height_mm)]))
