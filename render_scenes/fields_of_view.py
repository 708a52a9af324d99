"""Fields of view of a layout's mirrors on a plane parallel to the views, by their virtual pinholes."""

from __future__ import annotations

import numpy as np
import shapely

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout


def fields(layout: Layout, depth_mm: float) -> list[shapely.Polygon]:
    """Return the field of view of each mirror on the plane at a depth, in view x and y, mm."""
    polygons = []
    for mirror in layout.mirrors:
        centre = layout.view_from_rig @ mirror.virtual_centre_in_rig_mm
        rays = mirror.outline_in_rig_mm @ layout.view_from_rig.T - centre
        polygons.append(shapely.Polygon((centre + rays * ((depth_mm - centre[2]) / rays[:, 2])[:, None])[:, :2]))
    return polygons


def common_bounds(layout: Layout, depth_mm: float) -> FloatArray:
    """Return the bounds [[low x, low y], [high x, high y]] of the common field at a depth, in view x and y, mm.

    Without a common field, they are the median of the mirrors' bounds.
    """
    polygons = fields(layout, depth_mm)
    common = shapely.intersection_all(polygons)
    bounds = np.median([polygon.bounds for polygon in polygons], axis=0) if common.is_empty else np.array(common.bounds)
    return bounds.reshape(2, 2)
