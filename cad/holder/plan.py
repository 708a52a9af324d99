"""What the mirror holder is made of, as plain numbers: slab, columns behind the mirrors, rims, holes, and the light.

The slab's back is flat: it lies on the print bed (every seat then looks up, nothing needs support), and the mount is
screwed to it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from shapely import Polygon, get_coordinates
from shapely.geometry.polygon import orient

from cad.hardware import Fastening, Hardware
from cad.holder.back import FrontSurface, mount_axes, place_mount
from cad.holder.rims import plan_rims
from cad.seats import Frustum, back_height_mm, keep_outs, outline_at
from optics.layout import Layout
from optics.mirror import Mirror
from optics.values import FloatArray, InputError


@dataclass(frozen=True)
class HolderPlan:
    """The solids of a mirror holder, in rig, mm.

    Material: `slab`, `cores` (right behind a mirror, their fronts the seats), `fillers` (in the gaps around and between
    the mirrors, a little further back) and `rims`. All of it gives way to `keep_outs` (of each mirror its pocket,
    camera cone and reflected beam).

    `rig_from_mount` (4, 4) is the frame of the flat back: origin amid the mount holes, x along the rig's x, z out of
    the back. `holes_in_mount_mm` (4, 2) are on it. `size_mm` is the part's along x, y and z of that frame.
    `cols` mirrors stand in a row.
    """

    slab: Frustum
    cores: tuple[Frustum, ...]
    fillers: tuple[Frustum, ...]
    rims: tuple[Frustum, ...]
    keep_outs: tuple[tuple[Frustum, ...], ...]
    rig_from_mount: FloatArray
    holes_in_mount_mm: FloatArray
    size_mm: tuple[float, float, float]
    cols: int
    screw: Fastening
    wall_mm: float


def plan_holder(layout: Layout, hardware: Hardware) -> HolderPlan:
    """Lay out the mirror holder; raises InputError with the measure that breaks where it cannot be made."""
    for index, mirror in enumerate(layout.mirrors):
        _check_sheet(index, mirror)
    axes = mount_axes(layout)
    away = axes[2]
    front = FrontSurface(layout, axes, hardware.fit.free_mm + hardware.holder.rim_mm)
    mount = place_mount(front, hardware)

    def down_from(polygon: FloatArray) -> Frustum:
        return Frustum(polygon + (mount.back_mm - polygon @ away)[:, None] * away, polygon)

    seats = [outline_at(mirror, back_height_mm(mirror)) for mirror in layout.mirrors]
    reach = mount.back_mm - min(float((polygon @ away).min()) for polygon in seats)
    reach += max(mirror.thickness_mm for mirror in layout.mirrors)
    volumes = keep_outs(layout, hardware)
    rims = plan_rims(layout, volumes, reach, hardware)
    nearest = min(float((polygon @ away).min()) for polygon in (*seats, *(rim.top for rim, _ in rims)))
    left, bottom, right, top = front.footprint.bounds
    size = (right - left, top - bottom, mount.back_mm - nearest)
    _check_bed(size, hardware)
    rig_from_mount = np.eye(4)
    rig_from_mount[:3, :3] = axes.T
    rig_from_mount[:3, 3] = mount.centre_mm @ axes[:2] + mount.back_mm * away
    hull = get_coordinates(orient(front.footprint))[:-1] @ axes[:2] + front.deepest_mm * away
    return HolderPlan(
        slab=down_from(hull),
        cores=tuple(down_from(polygon) for polygon in seats),
        fillers=tuple(down_from(polygon) for polygon in front.fillers),
        rims=tuple(solid for rim, ground in rims for solid in (rim, down_from(ground))),
        keep_outs=tuple(tuple(group) for group in volumes),
        rig_from_mount=rig_from_mount,
        holes_in_mount_mm=mount.holes_mm,
        size_mm=size,
        cols=layout.cols,
        screw=hardware.screw,
        wall_mm=hardware.printer.wall_mm,
    )


def _check_sheet(index: int, mirror: Mirror) -> None:
    """A laser needs features at least as wide as the sheet is thick."""
    rectangle = get_coordinates(Polygon(mirror.outline_in_plane_mm).minimum_rotated_rectangle)
    narrowest = np.linalg.norm(np.diff(rectangle[:3], axis=0), axis=1).min()
    if narrowest < mirror.thickness_mm:
        raise InputError(
            f"mirror {index} is {narrowest:.2f} mm across, expected at least its thickness, {mirror.thickness_mm:g} mm"
        )


def _check_bed(size_mm: tuple[float, float, float], hardware: Hardware) -> None:
    """The part lies on its back, turned so that its longer side follows the bed's longer side."""
    lengths = sorted(size_mm[:2], reverse=True)
    bed = (*sorted(hardware.printer.bed_mm[:2], reverse=True), hardware.printer.bed_mm[2])
    for name, length, room in zip(("long", "wide", "high"), (*lengths, size_mm[2]), bed, strict=True):
        if length > room:
            raise InputError(f"mirror holder is {length:.1f} mm {name}, expected at most {room:g} mm (printer bed)")
