"""Subjects of previews, arranged for a layout: the tabletop scene, or a calibration board."""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Target
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.optics.light_field.decoder import default_reference_depth_mm
from mirrorcam.render_scenes.fields_of_view import common_bounds
from mirrorcam.render_scenes.tabletop.tabletop import LEAST_ROOM, Tabletop, arrange_tabletop, nearest_mm
from mirrorcam.render_scenes.tabletop.tabletop_set import default_depths_mm
from mirrorcam.render_scenes.tabletop.textures import TextureName

Subject = Literal["tabletop", "board"]

TEXTURE_PX: dict[TextureName, tuple[int, int]] = {
    "poster": (1152, 768),
    "wood": (1536, 960),
    "page": (384, 516),
    "label": (432, 240),
    "cover": (144, 144),
    "globe": (240, 120),
}
"""Columns and rows of textures: as many as nine views of a picture of 1000 px show, about."""
BOARD_TURNED_DEG = (-12.0, 18.0)
"""Turns of the board about x and y."""


def arranged_tabletop(layout: Layout, seed: int, sized_for: Layout | None = None) -> Tabletop:
    """The tabletop scene of a layout, with textures of the same size for every layout.

    With `sized_for`, that of another layout as a whole, its middle where the field of `layout` has its own.

    Textures are random numbers that depend on their size: of one size, they stay the same while a design, or the size
    of its picture, changes. The depths are those that the layout was designed for, or as near as objects have room
    before the mirrors.
    """
    filled = layout if sized_for is None else sized_for
    least = nearest_mm(filled) / (1.0 - LEAST_ROOM) + 1.0
    depths = tuple(sorted({max(depth, least) for depth in default_depths_mm(filled)}))
    found = arrange_tabletop(filled, depths, seed)
    middle = depths[len(depths) // 2]
    shift = np.append(_middle_mm(layout, middle) - _middle_mm(filled, middle), 0.0)
    objects = tuple(
        item.replaced(
            view_from_object=rigid(np.eye(3), shift) @ item.view_from_object,
            texture_px=None if item.texture is None else TEXTURE_PX[item.texture],
        )
        for item in found.objects
    )
    return Tabletop(objects, found.lit_in_view + shift, found.reach_mm)


def view_from_board(layout: Layout, target: Target) -> FloatArray:
    """Rigid 4x4 of a board in view axes, mm: turned a little, in the middle of the common field at the middle depth."""
    depth = max(default_reference_depth_mm(layout), nearest_mm(layout) + 0.5 * float(np.linalg.norm(target.size_mm)))
    turn = Rotation.from_euler("XY", BOARD_TURNED_DEG, degrees=True).as_matrix()
    middle = np.append(_middle_mm(layout, depth), depth)
    return rigid(turn, middle - turn @ np.array([*target.size_mm, 0.0]) / 2.0)


def _middle_mm(layout: Layout, depth_mm: float) -> FloatArray:
    """Middle (2,) of the common field at a depth, in view x and y."""
    return np.asarray(common_bounds(layout, depth_mm).mean(axis=0))
