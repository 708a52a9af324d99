"""Undistorted pixels of a whole sensor, by a spline between nodes at which they are exact."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import RectBivariateSpline

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera

GRID_PX = 8.0  # spacing of exact undistortion; a quintic spline between the nodes is good to 1e-7 px


def undistorted_pixels(camera: Camera, u: FloatArray, v: FloatArray) -> FloatArray:
    """Normalized coordinates (n_v, n_u, 2) of the pixels with columns u and rows v, both increasing."""
    # Nodes up to the edge of the sensor, beyond which the lens model may have no rays.
    nodes = [
        np.linspace(-0.5, length - 0.5, int(length / GRID_PX) + 2) for length in (camera.height_px, camera.width_px)
    ]
    exact = camera.normalized_from_pixels(np.stack(np.meshgrid(nodes[1], nodes[0]), axis=-1))
    splines = [RectBivariateSpline(*nodes, exact[..., axis], kx=5, ky=5) for axis in range(2)]
    return np.stack([spline(v, u) for spline in splines], axis=-1)
