"""Seats, pockets and light beams of a layout, in the rig frame: where material must be, and where light must pass.

Pure geometry without a CAD kernel: every volume is a `Frustum`, a convex solid between two polygons.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.polygon import orient

from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.pupil import Pupil
from mirrorcam.optics.geometry.transforms import transform

# Height over the reflecting plane at which light volumes start, so that they end in no seat's plane.
LIGHT_START_MM = 0.05


@dataclass(frozen=True)
class Frustum:
    """Convex solid between two polygons with corresponding corners and parallel edges, or a polygon and an apex.

    `base` (n, 3) and `top`, (n, 3) or (1, 3), are in the rig frame, mm.
    """

    base: FloatArray
    top: FloatArray

    @property
    def faces(self) -> list[FloatArray]:
        """The flat faces as loops of corners, counter-clockwise seen from outside."""
        base, top = self.base, self.top
        axis = top.mean(axis=0) - base.mean(axis=0)
        if newell_normal(base) @ axis < 0:
            base, top = base[::-1], top[::-1]
        pairs = [(i, (i + 1) % len(base)) for i in range(len(base))]
        if len(top) == 1:
            return [base[::-1], *(np.array([base[i], base[j], top[0]]) for i, j in pairs)]
        return [base[::-1], top, *(np.array([base[i], base[j], top[j], top[i]]) for i, j in pairs)]

    @cached_property
    def half_spaces(self) -> tuple[FloatArray, FloatArray]:
        """Outward unit normals (m, 3) and offsets (m,): a point x is inside if normals @ x <= offsets."""
        return planes_of(self.faces)

    def stretched(self, base_shift_mm: FloatArray, top_shift_mm: FloatArray) -> Frustum:
        """The solid with its base and its top each shifted by a vector (3,) along its sides."""
        return Frustum(self.base + base_shift_mm, self.top + top_shift_mm)

    def contains(self, points: FloatArray) -> NDArray[np.bool_]:
        """Mask (...) of the points (..., 3) that lie inside."""
        normals, offsets = self.half_spaces
        inside: NDArray[np.bool_] = np.all(points @ normals.T < offsets, axis=-1)
        return inside

    def may_touch_ball(self, point: FloatArray, radius_mm: float) -> bool:
        """Return False only if a ball about a point (3,) certainly misses the solid."""
        normals, offsets = self.half_spaces
        return bool((normals @ point - offsets).max() < radius_mm)


def planes_of(loops: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Unit normals (m, 3) and offsets (m,) of the planes of flat loops (n, 3): normals @ x = offsets."""
    normals = np.array([newell_normal(loop) for loop in loops])
    return normals, np.array([(loop @ normal).mean() for loop, normal in zip(loops, normals, strict=True)])


def newell_normal(loop: FloatArray) -> FloatArray:
    """Unit normal (3,) of a flat loop (n, 3), which runs counter-clockwise about it; robust against short edges."""
    centred = loop - loop.mean(axis=0)
    normal = np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    return normal / np.linalg.norm(normal)


def seat_height_mm(mirror: Mirror, hardware: Hardware) -> float:
    """Height of a seat over the reflecting plane: below the pads on which the mirror rests."""
    return pad_height_mm(mirror, hardware) - hardware.holder.bond_mm


def pad_height_mm(mirror: Mirror, hardware: Hardware) -> float:
    """Height over the reflecting plane of the tops of a seat's three pads, on which the mirror or its tape rests.

    A second-surface mirror is coated on its back, which is in the layout's (reflecting) plane. A first-surface mirror
    is coated on its front, so its back is one mirror thickness behind that plane.
    """
    return mirror.back_mm - hardware.holder.on_pads_mm


def seat_distance_mm(mirror: Mirror, hardware: Hardware) -> float:
    """Distance d of the seat's plane from the pupil: n.x = -d, with the mirror's normal n."""
    return mirror.distance_mm - seat_height_mm(mirror, hardware)


def outline_at(mirror: Mirror, height_mm: float, margin_mm: float = 0.0, *, bevelled: bool = False) -> FloatArray:
    """A mirror's outline, enlarged by a margin, at a height over the reflecting plane: (m, 3) in the rig frame, mm.

    The sides of a mirror are normal to its faces. The outline is counter-clockwise seen from the pupil. The margin cuts
    off corners sharper than 60 deg, or all corners if `bevelled`, so m may exceed the number of corners.
    """
    polygon = Polygon(mirror.outline_in_plane_mm)
    if margin_mm > 0.0:
        polygon = polygon.buffer(margin_mm, join_style="bevel" if bevelled else "mitre", mitre_limit=2.0)
    corners = np.array(orient(polygon).exterior.coords)[:-1]
    local = np.column_stack([corners, np.full(len(corners), height_mm)])
    return transform(mirror.rig_from_plane, local)


def mirror_prism(mirror: Mirror) -> Frustum:
    """The mirror as cut: a right prism from its back to its front."""
    back = mirror.back_mm
    return Frustum(outline_at(mirror, back), outline_at(mirror, back + mirror.thickness_mm))


def pocket(mirror: Mirror, hardware: Hardware) -> Frustum:
    """The space for a mirror with its gap: from the plane of its seat to one gap in front of the mirror.

    Only the pads of the mirror's own seat extend into it.
    """
    gap = hardware.fit.free_mm
    front = mirror.back_mm + mirror.thickness_mm + gap
    return Frustum(outline_at(mirror, seat_height_mm(mirror, hardware), gap), outline_at(mirror, front, gap))


def working_distance_mm(layout: Layout, hardware: Hardware) -> float:
    """Depth up to which the reflected light must be unblocked: the farthest depth of the design."""
    return max(layout.spec.depths_mm) if layout.spec else hardware.holder.depth_without_spec_mm


def light_start_mm(mirror: Mirror) -> float:
    """Height over the reflecting plane up to which light stays within the mirror's outline.

    Light enters and leaves a second-surface mirror through its front, which has the same outline as its back.
    """
    return mirror.front_mm if mirror.is_second_surface else LIGHT_START_MM


def camera_cone(mirror: Mirror, pupil: Pupil, hardware: Hardware) -> Frustum:
    """Light between the mirror and the full pupil, enlarged by the gap for light; a pyramid for a pinhole."""
    outline = outline_at(mirror, 0.0, hardware.fit.light_mm)
    at_pupil = _polygon_around_pupil(mirror, pupil, outline)
    fraction = light_start_mm(mirror) / mirror.distance_mm
    return Frustum(outline + (at_pupil - outline) * fraction, at_pupil)


def _polygon_around_pupil(mirror: Mirror, pupil: Pupil, outline: FloatArray) -> FloatArray:
    """Polygon (n, 3) about the pupil with edges parallel to those of a mirror's outline (n, 3); (1, 3) for a pinhole.

    It circumscribes a circle large enough for planes through corresponding edges to touch or miss the pupil's ball.
    """
    if pupil.radius_mm == 0.0:
        return np.zeros((1, 3))
    flat = outline @ mirror.rig_from_plane[:3, :2]
    edges = np.roll(flat, -1, axis=0) - flat
    outwards = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    lateral = (outwards * flat).sum(axis=1)
    tilt = np.arctan2(mirror.distance_mm, lateral) - np.arccos(pupil.radius_mm / np.hypot(mirror.distance_mm, lateral))
    radius = float((pupil.radius_mm / np.cos(tilt)).max())
    # Adjacent edges with normals a and b, both at distance r from the centre, meet at r (a + b) / (1 + a.b).
    previous = np.roll(outwards, 1, axis=0)
    corners = radius * (previous + outwards) / (1.0 + (previous * outwards).sum(axis=1))[:, None]
    return np.asarray(corners @ mirror.rig_from_plane[:3, :2].T)


def reflected_beam(layout: Layout, index: int, hardware: Hardware) -> Frustum:
    """Light between a mirror and the scene, enlarged by the gap for light, up to the working distance.

    It spreads in straight lines from the virtual centre through the outline, as for a first-surface mirror. Raises
    InputError if the mirror does not face the scene.
    """
    mirror = layout.mirrors[index]
    centre = mirror.virtual_centre_in_rig_mm
    rays = outline_at(mirror, 0.0, hardware.fit.light_mm) - centre
    forward = layout.view_from_rig[2]
    depth = working_distance_mm(layout, hardware)
    forward_of_rays = rays @ forward
    factors = np.divide(
        depth - centre @ forward, forward_of_rays, out=np.full(len(forward_of_rays), -1.0), where=forward_of_rays > 0
    )
    if (factors <= 1.0).any():
        raise InputError(
            f"mirror {layout.mirror_names[index]} does not reflect every ray to the plane {depth:g} mm ahead, expected "
            "a mirror that faces the scene"
        )
    near = centre + rays * (1.0 + light_start_mm(mirror) / mirror.distance_mm)
    return Frustum(near, centre + rays * factors[:, None])


def keep_outs(layout: Layout, hardware: Hardware) -> list[list[Frustum]]:
    """Volumes that no part may enter, for each mirror: pocket, camera cone and reflected beam, in the rig frame, mm."""
    return [
        [
            pocket(mirror, hardware),
            camera_cone(mirror, layout.camera.pupil, hardware),
            reflected_beam(layout, index, hardware),
        ]
        for index, mirror in enumerate(layout.mirrors)
    ]
