"""Expected standard deviation of depth: the Cramér-Rao bound of matching all views of a textured plane.

In a view at the distance D along the view axis, a change dz of depth shifts the texture by m dz with the parallax
m = (x - c) / D, where x is the point and c the view's centre, both normal to that axis. Let the texture be unknown with
the power spectrum S, sampled by n px per mm^2 with the MTF H and noise of variance v. The Fisher information about the
depth per mm^2 is

    I = sum over frequencies k of S(k) sum_i w_i (2 pi k . (m_i - mean of m))^2,    w_i = |H_i(k)|^2 n_i / v_i

where the mean is weighted by w, too: a shift common to all views determines the texture, not the depth. It is the bound
for an unknown, deterministic signal (P. Stoica and A. Nehorai, IEEE Trans. ASSP 37(5), 1989), without prior knowledge
of the texture. For equal views of a plane normal to their axis it becomes

    sigma = D^2 / (f sqrt(sum_i |b_i - mean of b|^2)) * noise / (gradient sqrt(N))

with baselines b, the RMS gradient of the pictures along an axis, and N px per view.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely

from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import reflect
from mirrorcam.optics.geometry.pupil import SHARP_VARIANCE_PX2
from mirrorcam.optics.geometry.sub_images import FieldsOfView

NOISE_GREY = 2.2
"""Noise of a C920 at mid-grey: full well of 8000 electrons, read noise of 0.8 grey levels, 8 bits."""

GRADIENT_GREY = 5.0
"""RMS gradient along an axis of the picture of a texture in focus, grey levels per px.

The gradient is the same at each frequency, as for edges (a power spectrum of 1 / k^2), so the texture looks the
same from any distance; blur and coarser sampling reduce it.
"""

WINDOW_PX = 25.0
"""Pixels of the central view that share one depth."""

GRID_POINTS = 9
"""Number of points along each side of the box around the common region at which the bound is computed."""

ANGLES, RADII, MAX_RADIUS = 16, 24, 3.5
"""Directions and magnitudes of spatial frequencies; largest magnitude, in standard deviations of the sharp MTF."""


DEPTH_UNKNOWN = "it would exceed the depth itself: the views are too blurred, or too close together, to measure depth"


def depth_sigma_metrics(
    views: FieldsOfView, depths_mm: Sequence[float], grid_points: int = GRID_POINTS
) -> dict[str, Metric]:
    """Expected standard deviation of depth at each depth: the mean over the region common to all views.

    The mean is taken over a square grid of points, `grid_points` along each side. `views` are the unvignetted fields of
    view. Depths at which they have no common region are omitted; a standard deviation greater than the depth is
    reported as unknown.
    """
    sigmas = {depth_mm: mean_depth_sigma_mm(views, depth_mm, grid_points) for depth_mm in depths_mm}
    return {
        f"depth_sigma_{depth_mm:g}mm": Metric(
            value=sigma, unit="mm", reason="" if math.isfinite(sigma) else DEPTH_UNKNOWN
        )
        for depth_mm, sigma in sigmas.items()
        if sigma is not None
    }


def mean_depth_sigma_mm(views: FieldsOfView, depth_mm: float, grid_points: int = GRID_POINTS) -> float | None:
    """Mean of the expected standard deviation of depth, mm, over the common region; None if that is empty.

    None also for a single view, which shows no depth. Infinite if it would exceed the depth, because the bound holds
    only for small errors and is astronomical for blurred views.
    """
    points = _points(views, depth_mm, grid_points)
    if len(points) == 0 or len(views.layout.mirrors) == 1:
        return None
    sigma = float(depth_sigma_mm(views.layout, points).mean())
    return sigma if sigma <= depth_mm else math.inf


def depth_sigma_mm(layout: Layout, points_in_view_mm: FloatArray) -> FloatArray:
    """Expected standard deviation (n,) of depth at points (n, 3), in view axes, of a plane normal to the view axis.

    Infinite if the views are too blurred to show texture or have the same centre.
    """
    parallax, jacobians, variances = _parallax(layout, points_in_view_mm)
    density = np.abs(np.linalg.det(jacobians))
    mm_per_px = np.linalg.inv(jacobians)
    blur = variances[..., None, None] * (mm_per_px @ np.swapaxes(mm_per_px, -1, -2))
    central = layout.central_index
    unit = np.sqrt(density[:, central] / SHARP_VARIANCE_PX2)
    angles = np.pi * (np.arange(ANGLES) + 0.5) / ANGLES
    radii = MAX_RADIUS * (np.arange(RADII) + 0.5) / RADII
    information = np.zeros(len(points_in_view_mm))
    for direction in np.column_stack([np.cos(angles), np.sin(angles)]):
        spread = np.einsum("i,nmij,j->nm", direction, blur, direction) * unit[:, None] ** 2
        component = parallax @ direction
        component -= component.mean(axis=1, keepdims=True)
        moments = np.stack([density, density * component, density * component**2], axis=1)
        # MTFs relative to the sharpest view's. Only that one may underflow to 0: then nothing can be matched.
        sharpest = spread.min(axis=1, keepdims=True)
        relative = np.exp(-(spread - sharpest)[..., None] * radii**2)
        total, first, second = np.moveaxis(moments @ relative, 1, 0)
        information += (np.exp(-sharpest * radii**2) * np.maximum(second - first**2 / total, 0.0)) @ radii
    # A sharp picture with the gradient spectrum C k dk has a mean square gradient C / (4 SHARP_VARIANCE_PX2) per axis.
    strength = GRADIENT_GREY**2 * 4.0 * SHARP_VARIANCE_PX2 / NOISE_GREY**2
    cell = unit**2 * (MAX_RADIUS / RADII) / ANGLES
    per_mm2 = strength * cell * information
    valid = per_mm2 > 0.0
    sigma = np.full(len(valid), np.inf)
    sigma[valid] = 1.0 / np.sqrt(per_mm2[valid] * WINDOW_PX / density[valid, central])
    return sigma


def _points(views: FieldsOfView, depth_mm: float, grid_points: int) -> FloatArray:
    """Points (n, 3) of the common region at a depth, in view axes."""
    region, _ = views.common_region(depth_mm)
    if region.is_empty:
        return np.zeros((0, 3))
    left, low, right, high = region.bounds
    fractions = (np.arange(grid_points) + 0.5) / grid_points
    x, y = (grid.ravel() for grid in np.meshgrid(left + fractions * (right - left), low + fractions * (high - low)))
    inside = shapely.contains_xy(region, x, y)
    return np.column_stack([x, y, np.full(len(x), depth_mm)])[inside]


def _parallax(layout: Layout, points_in_view_mm: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Parallax m (n, views, 2), Jacobian (n, views, 2, 2), px per mm, and blur variance (n, views), px^2.

    All at points (n, 3), in view axes. The variance of a circle of confusion is (diameter / 4)^2.
    """
    camera = layout.camera
    centres = layout.virtual_centres_in_view_mm.reshape(-1, 3)
    offsets = points_in_view_mm[:, None] - centres
    parallax = offsets[..., :2] / offsets[..., 2:]

    def projected(points: FloatArray) -> tuple[FloatArray, FloatArray]:
        images = reflect((points @ layout.view_from_rig)[:, None], layout.virtual_centres_in_rig_mm)
        return camera.project(images), images[..., 2]

    step = 1e-3
    _, z = projected(points_in_view_mm)
    columns = [
        (projected(points_in_view_mm + change)[0] - projected(points_in_view_mm - change)[0]) / (2.0 * step)
        for change in step * np.eye(3)[:2]
    ]
    circles = max(camera.fx_px, camera.fy_px) * camera.aperture_mm * np.abs(1.0 / z - 1.0 / camera.focus_mm)
    return parallax, np.stack(columns, axis=-1), SHARP_VARIANCE_PX2 + (circles / 4.0) ** 2
