"""The layout's light, cast at meshes: an independent proof that nothing stands in its way."""

from __future__ import annotations

import manifold3d
import numpy as np
from shapely import Polygon, contains_xy, get_coordinates

from cad.hardware import Hardware
from cad.seats import sheet, working_distance_mm
from optics.layout import Layout
from optics.values import FloatArray

# Rays stop this far from the mirror that they leave: the rounding of the STL's 32-bit numbers is 1e-5 mm.
SURFACE_MM = 1e-3
RAY_STEP_MM = 1.0


def light_rays(layout: Layout, index: int, hardware: Hardware, *, outline: bool = True) -> FloatArray:
    """Segments (2, n, 2, 3) in rig, mm, of one mirror, to the pupil and to the scene: from a grid and the outline.

    The reflection is the layout's own, not the cones that the part was cut with.
    """
    mirror = layout.mirrors[index]
    area = Polygon(mirror.outline_in_plane_mm)
    left, bottom, right, top = area.bounds
    columns, rows = (np.arange(low, high, RAY_STEP_MM) for low, high in ((left, right), (bottom, top)))
    flat = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    flat = flat[contains_xy(area, flat[:, 0], flat[:, 1])]
    if outline:
        flat = np.concatenate([flat, get_coordinates(area.exterior.segmentize(RAY_STEP_MM))])
    points = flat @ mirror.rig_from_plane[:3, :2].T + mirror.rig_from_plane[:3, 3]
    outgoing = points @ mirror.reflection.T
    forward = layout.view_from_rig[2]
    reach = (working_distance_mm(layout, hardware) - points @ forward) / (outgoing @ forward)
    far = np.stack([np.zeros_like(points), points + reach[:, None] * outgoing])
    direction = (far - points) / np.linalg.norm(far - points, axis=-1, keepdims=True)
    return np.stack([points + SURFACE_MM * direction, far], axis=-2)


def shade_of_sheets(layout: Layout, hardware: Hardware) -> float:
    """Share of the worst mirror's area whose light the *other* mirrors' sheets stand in: what thick sheets cost."""
    corners = [np.vstack([volume.base, volume.top]) for volume in (sheet(mirror) for mirror in layout.mirrors)]
    sheets = [manifold3d.Manifold.hull_points(points) for points in corners]
    worst = 0.0
    for index in range(len(sheets)):
        others = manifold3d.Manifold.compose([other for place, other in enumerate(sheets) if place != index])
        to_pupil, to_scene = light_rays(layout, index, hardware, outline=False)
        shaded = [
            bool(others.ray_cast(*a)) or bool(others.ray_cast(*b)) for a, b in zip(to_pupil, to_scene, strict=True)
        ]
        worst = max(worst, float(np.mean(shaded)))
    return worst
