"""Layouts of the devices in the CAD tests and benchmarks."""

from __future__ import annotations

from typing import Literal

import numpy as np

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror

Surface = Literal["first", "second"]


def parabola(
    rows: int,
    cols: int,
    *,
    scale_mm: float = 80.0,
    gap_mm: float = 1.2,
    surface: Surface = "first",
    thickness_mm: float = 1.0,
) -> Layout:
    """Facets tangent to the parabola with its focus in the pupil and the directrix y = -scale, tiling the sensor."""
    camera = Camera.c920()
    half_u, half_v = 0.95 * 960.0 / camera.fx_px, 0.95 * 540.0 / camera.fy_px
    us, vs = np.linspace(-half_u, half_u, cols + 1), np.linspace(half_v, -half_v, rows + 1)
    gap = gap_mm / scale_mm / 2.0
    mirrors = []
    for t in range(rows):
        for s in range(cols):
            u, v = (us[s] + us[s + 1]) / 2.0, (vs[t] + vs[t + 1]) / 2.0
            distance = scale_mm / (np.sqrt(1.0 + u * u + v * v) - v)
            centre = np.array([distance * u, -scale_mm, distance])
            left, right, low, high = us[s] + gap, us[s + 1] - gap, vs[t + 1] + gap, vs[t] - gap
            rays = np.array([[left, high, 1.0], [right, high, 1.0], [right, low, 1.0], [left, low, 1.0]])
            outline = rays * (centre @ centre / 2.0 / (rays @ centre))[:, None]
            mirrors.append(
                Mirror(
                    virtual_centre_in_rig_mm=centre,
                    outline_in_rig_mm=outline,
                    surface=surface,
                    thickness_mm=thickness_mm,
                )
            )
    return Layout(rows=rows, cols=cols, camera=camera, mirrors=tuple(mirrors))
