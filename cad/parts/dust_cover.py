"""The dust cover: a cap over the mirrors while the device is not in use, snapped onto the flange of their holder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from shapely import Polygon, get_coordinates
from shapely import box as shapely_box
from shapely.geometry.polygon import orient

from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.cuts import bed_lengths_mm
from mirrorcam.cad.plan.dimension import Length, length
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import Frustum, mirror_prism
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import inverse, rigid, transform

# Clearance of the cover over the mirrors, and on either side of the mount.
CLEAR_MM = 1.0
# Projection of a catch over the flange's back edge, with both sides at 45 deg, its length, and its depth in the wall.
CATCH_MM, CATCH_LENGTH_MM = 0.45, 12.0
EMBEDDED_MM = 0.3


@dataclass(frozen=True)
class CoverPlan:
    """A cover in the rig frame, mm: material between `outer` and `inner`, a `notch` in it for the mount, and `catches`.

    `rig_from_front` (4, 4) is the frame of its flat front, z out of the part. `rim_mm` is the distance of its rim
    behind the plane of the holder's back; `way_mm` (2, 3) are the successive moves by which the cover is taken off.
    """

    outer: Frustum
    inner: Frustum
    notch: Frustum
    catches: tuple[Frustum, ...]
    rig_from_front: FloatArray
    rim_mm: float
    way_mm: FloatArray

    @property
    def dimensions(self) -> tuple[Length, ...]:
        """Thickness of floor and wall, and the gap for the mount."""
        x_axis, y_axis, back = self.rig_from_front[:3, :3].T
        sides = np.roll(self.outer.base, -1, axis=0) - self.outer.base
        # The side most parallel to the gap; its inner face is parallel to it.
        side = int(np.argmax(np.abs(sides @ x_axis) / np.linalg.norm(sides, axis=1)))
        middle = self.outer.base[side] + sides[side] / 2.0
        normal = np.cross(sides[side], back) / np.linalg.norm(sides[side])
        wall = (self.inner.base - middle) @ normal
        wall_mm = float(wall[np.abs(wall).argmin()])
        corner = self.notch.base[np.argmin(self.notch.base @ x_axis)]
        corner = corner + y_axis * ((middle - corner) @ y_axis)
        rim = self.outer.top[0] @ back
        return (
            length(self.outer.base[0], self.inner.base[0], "floor", back),
            length(middle, middle + wall_mm * normal, "wall"),
            length(corner, corner + np.ptp(self.notch.base @ x_axis) * x_axis, "gap", x_axis),
            length(corner + (rim - corner @ back) * back, corner, "gap", back),
        )


def plan_cover(layout: Layout, holder: HolderPlan, mount: MountPlan, hardware: Hardware) -> CoverPlan | None:
    """Lay out the cover round the flange and everything on it; None if it does not fit the bed.

    Its rim extends behind the flange, onto which its catches snap. At the mount, the rim ends in front of the flange.
    """
    mount_from_rig = inverse(holder.rig_from_mount)
    flange = Polygon(transform(mount_from_rig, holder.flange.base)[:, :2])
    fronts = np.vstack([mirror_prism(mirror).top for mirror in layout.mirrors] + [holder.corners_in_rig])
    highest = -float(transform(mount_from_rig, fronts)[:, 2].min()) + CLEAR_MM
    wall, slide = hardware.printer.wall_mm, hardware.fit.slide_mm
    inside, outside = (flange.buffer(margin, join_style="mitre") for margin in (slide, slide + wall))
    left, low, right, high = outside.bounds
    bed = bed_lengths_mm((right - left, high - low), hardware)
    if right - left > bed[0] or high - low > bed[1] or highest + wall > hardware.printer.bed_mm[2]:
        return None
    rim = 3.0 * CATCH_MM
    back_normal = holder.rig_from_mount[:3, 2]
    scene = layout.view_from_rig[2]
    lateral = scene - (scene @ back_normal) * back_normal
    if np.linalg.norm(lateral) < 1e-3:
        # The view is normal to the back: slide the cover off away from the camera.
        lateral = holder.rig_from_mount[:3, 1] * -np.sign(mount_from_rig[1, 3])
    return CoverPlan(
        outer=_prism(outside, -(highest + wall), rim, holder.rig_from_mount),
        inner=_prism(inside, -highest, rim + 1.0, holder.rig_from_mount),
        notch=_notch(flange, mount.half_width_mm, hardware, holder),
        catches=_catches(inside, mount.half_width_mm, holder.rig_from_mount),
        rig_from_front=holder.rig_from_mount @ rigid(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, -(highest + wall)]),
        rim_mm=rim,
        way_mm=np.array([-(highest + wall + CLEAR_MM) * back_normal, 2.0 * high * lateral / np.linalg.norm(lateral)]),
    )


def _prism(area: Polygon, from_mm: float, to_mm: float, rig_from_mount: FloatArray) -> Frustum:
    """The prism on a convex area of the back, between two z coordinates in the mount's frame."""
    corners = get_coordinates(orient(area))[:-1]
    base, top = (
        transform(rig_from_mount, np.column_stack([corners, np.full(len(corners), z)])) for z in (from_mm, to_mm)
    )
    return Frustum(base, top)


def _notch(flange: Polygon, half_width_mm: float, hardware: Hardware, holder: HolderPlan) -> Frustum:
    """The gap in the rim for the mount, through both sides, since the mount may extend beyond the far side."""
    far = float(np.abs(np.array(flange.bounds)).max()) + 10.0
    half = half_width_mm + CLEAR_MM
    return _prism(shapely_box(-half, -far, half, far), -hardware.holder.floor_mm, 20.0, holder.rig_from_mount)


def _catches(inside: Polygon, half_width_mm: float, rig_from_mount: FloatArray) -> tuple[Frustum, ...]:
    """A wedge on the longest inner face to the left and to the right of the mount, over the flange's back edge."""
    corners = get_coordinates(orient(inside))
    sides = np.stack([corners[:-1], corners[1:]], axis=1)
    wedges = []
    for sign in (-1.0, 1.0):
        clear = [side for side in sides if (sign * side[:, 0] > half_width_mm).all()]
        if not clear:
            continue
        start, end = max(clear, key=lambda side: float(np.linalg.norm(side[1] - side[0])))
        length = float(np.linalg.norm(end - start))
        direction = (end - start) / length
        inward = np.array([-direction[1], direction[0]])
        half = min(CATCH_LENGTH_MM, 0.8 * length) / 2.0
        # Coordinates along the wall's normal and z. The wedge meets the flange's edge halfway up its own lower slope.
        profile = np.array([(-EMBEDDED_MM, -0.1), (0.0, -0.1), (CATCH_MM, CATCH_MM - 0.1), (0.0, 2.0 * CATCH_MM - 0.1)])
        profile = np.vstack([profile, [(-EMBEDDED_MM, 2.0 * CATCH_MM - 0.1)]])
        ends = [
            transform(
                rig_from_mount,
                np.column_stack(
                    [(start + end) / 2.0 + side * half * direction + profile[:, :1] * inward, profile[:, 1]]
                ),
            )
            for side in (-1.0, 1.0)
        ]
        wedges.append(Frustum(ends[0], ends[1]))
    return tuple(wedges)
