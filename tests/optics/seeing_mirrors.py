"""Mirrors and views that see a given part of the scene."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror, reflect

DEPTH_MM = 300.0


def mirror_seeing(rectangle: tuple[float, float, float, float], height_mm: float, across_mm: float = 0.0) -> Mirror:
    """A mirror with the virtual centre (across, -height, height) that sees just x0..x1, z0..z1 of the plane y = 300 mm.

    In the middle, where across is 0, it stands at 45 degrees and its image is upright.
    """
    x0, x1, z0, z1 = rectangle
    centre = np.array([across_mm, -height_mm, height_mm])
    scene = np.array([[x0, DEPTH_MM, z0], [x1, DEPTH_MM, z0], [x1, DEPTH_MM, z1], [x0, DEPTH_MM, z1]])
    image = reflect(scene, centre)
    normalized = image[:, :2] / image[:, 2:]
    rays = np.column_stack([normalized, np.ones(4)])
    outline = rays * (0.5 * centre @ centre / (rays @ centre))[:, None]
    return Mirror(virtual_centre_in_rig_mm=centre, outline_in_rig_mm=outline)


def two_rectangles() -> Layout:
    """Two parallel views from different heights whose fields share 50 mm x 15 mm."""
    upper = mirror_seeing((-40.0, 30.0, 90.0, 160.0), 80.0)
    lower = mirror_seeing((-20.0, 50.0, 20.0, 105.0), 100.0)
    return Layout(rows=2, cols=1, camera=Camera.c920(), mirrors=(lower, upper))
