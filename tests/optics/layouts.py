"""Layouts made without the optimiser, for tests and benchmarks."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror


def faceted_parabola(camera: Camera, spec: DesignSpec, fill: float) -> Layout:
    """Facets of the parabola with focus at the pupil and directrix y = -scale; each fills part of its image cell."""
    half = np.array([(camera.width_px - 1) / 2 / camera.fx_px, (camera.height_px - 1) / 2 / camera.fy_px])
    cell = 2 * half / [spec.cols, spec.rows]
    mirrors = []
    for row in reversed(range(spec.rows)):
        for col in range(spec.cols):
            u, v = -half + cell * [col + 0.5, row + 0.5]
            t = spec.scale_mm / (np.sqrt(1 + u * u + v * v) - v)
            centre = np.array([t * u, -spec.scale_mm, t])
            corners = np.array([u, v]) + fill * cell / 2 * [[-1, -1], [1, -1], [1, 1], [-1, 1]]
            rays = np.column_stack([corners, np.ones(4)])
            points = rays * (centre @ centre / 2 / (rays @ centre))[:, None]
            mirrors.append(Mirror(virtual_centre_in_rig_mm=centre, outline_in_rig_mm=points))
    return Layout(rows=spec.rows, cols=spec.cols, camera=camera, mirrors=tuple(mirrors), spec=spec)
