"""Expected standard deviation of depth: the Cramér-Rao bound of matching all views of a textured plane.

A change dz of the depth moves the texture seen by a view at the distance D along the view axis by m dz,
m = (x - c) / D, where x is the point and c the view's centre, both normal to that axis. Let the texture be unknown with
the power spectrum S, sampled by n px per mm^2 with the contrast H and noise of variance v. The Fisher information on
the depth per mm^2 is

    I = sum over frequencies k of S(k) sum_i w_i (2 pi k . (m_i - mean of m))^2,    w_i = |H_i(k)|^2 n_i / v_i

where the mean is weighted by w, too: motion common to all views determines the texture, not the depth. It is the bound
for an unknown, deterministic signal (P. Stoica and A. Nehorai, IEEE Trans. ASSP 37(5), 1989), without prior knowledge
of the texture. For equal views of a plane normal to their axis it becomes

    sigma = D^2 / (f sqrt(sum_i |b_i - mean of b|^2)) * noise / (slope sqrt(N))

with baselines b, the RMS slope of the pictures along an axis, and N px per view.
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
"""Noise of a C920 at half its range: 8000 electrons, 0.8 grey levels read noise, 8 bits."""

SLOPE_GREY = 5.0
"""RMS slope along an axis of the picture of a texture in focus, grey levels per px.

The slope is the same at each frequency, as for edges (a power spectrum of 1 / k^2), so that the texture looks alike
from any distance; blur and coarser sampling reduce it.
"""

WINDOW_PX = 25.0
"""Pixels of the central view that share one depth."""

GRID_POINTS = 9
"""Number of points along each side of the box around the common region at which the bound is computed."""

ANGLES, RADII, MAX_RADIUS = 16, 24, 3.5
"""Directions and lengths of frequencies; greatest length, in standard deviations of sharp pixels' contrast."""


DEPTH_UNKNOWN = "it would exceed the depth itself: the views are too blurred, or too close together, to measure depth"


def depth_sigma_metrics(views: FieldsOfView, depths_mm: Sequence[float]) -> dict[str, Metric]:
    """Expected standard deviation of depth at each depth: the mean over the region common to all views.

    `views` are the unvignetted fields of view. Depths at which they share nothing are omitted; a standard deviation
    greater than the depth is unknown.
    """
    found = {depth_mm: mean_depth_sigma_mm(views, depth_mm) for depth_mm in depths_mm}
    return {
        f"depth_sigma_{depth_mm:g}mm": Metric(
            value=sigma, unit="mm", reason="" if math.isfinite(sigma) else DEPTH_UNKNOWN
        )
        for depth_mm, sigma in found.items()
        if sigma is not None
    }


def mean_depth_sigma_mm(views: FieldsOfView, depth_mm: float) -> float | None:
    """Mean of the expected standard deviation of depth, mm, over the common region; None if that is empty.

    None also for a single view, which shows no depth. Infinite if it would exceed the depth, because the bound holds
    only for small errors and is astronomical for blurred views.
    """
    points = _points(views, depth_mm)
    if len(points) == 0 or len(views.layout.mirrors) == 1:
        return None
    sigma = float(depth_sigma_mm(views.layout, points).mean())
    return sigma if sigma <= depth_mm else math.inf


def depth_sigma_mm(layout: Layout, points_in_view_mm: FloatArray) -> FloatArray:
    """Expected standard deviation (n,) of depth at points (n, 3), in view axes, of a plane normal to the view axis.

    Infinite if the views are too blurred to show texture or lie in the same place.
    """
    motions, jacobians, variances = _motions(layout, points_in_view_mm)
    density = np.abs(np.linalg.det(jacobians))
    steps = np.linalg.inv(jacobians)
    blur = variances[..., None, None] * (steps @ np.swapaxes(steps, -1, -2))
    central = layout.central_index
    unit = np.sqrt(density[:, central] / SHARP_VARIANCE_PX2)
    angles = np.pi * (np.arange(ANGLES) + 0.5) / ANGLES
    radii = MAX_RADIUS * (np.arange(RADII) + 0.5) / RADII
    information = np.zeros(len(points_in_view_mm))
    for along in np.column_stack([np.cos(angles), np.sin(angles)]):
        spread = np.einsum("i,nmij,j->nm", along, blur, along) * unit[:, None] ** 2
        along_motions = motions @ along
        along_motions -= along_motions.mean(axis=1, keepdims=True)
        powers = np.stack([density, density * along_motions, density * along_motions**2], axis=1)
        # Contrasts relative to the sharpest view's. Only that one may underflow to 0; then there is nothing to match.
        sharpest = spread.min(axis=1, keepdims=True)
        relative = np.exp(-(spread - sharpest)[..., None] * radii**2)
        total, first, second = np.moveaxis(powers @ relative, 1, 0)
        information += (np.exp(-sharpest * radii**2) * np.maximum(second - first**2 / total, 0.0)) @ radii
    # The sharp picture of a slope spectrum C k dk has the mean square slope C / (4 SHARP_VARIANCE_PX2) along an axis.
    strength = SLOPE_GREY**2 * 4.0 * SHARP_VARIANCE_PX2 / NOISE_GREY**2
    cell = unit**2 * (MAX_RADIUS / RADII) / ANGLES
    per_mm2 = strength * cell * information
    known = per_mm2 > 0.0
    sigma = np.full(len(known), np.inf)
    sigma[known] = 1.0 / np.sqrt(per_mm2[known] * WINDOW_PX / density[known, central])
    return sigma


def _points(views: FieldsOfView, depth_mm: float) -> FloatArray:
    """Points (n, 3) of the common region at a depth, in view axes."""
    region, _ = views.common_region(depth_mm)
    if region.is_empty:
        return np.zeros((0, 3))
    left, low, right, high = region.bounds
    fractions = (np.arange(GRID_POINTS) + 0.5) / GRID_POINTS
    x, y = (grid.ravel() for grid in np.meshgrid(left + fractions * (right - left), low + fractions * (high - low)))
    inside = shapely.contains_xy(region, x, y)
    return np.column_stack([x, y, np.full(len(x), depth_mm)])[inside]


def _motions(layout: Layout, points_in_view_mm: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Motion m (n, views, 2) of the texture, Jacobian (n, views, 2, 2), px per mm, and blur variance (n, views), px^2.

    All at points (n, 3), in view axes. The variance of a circle of confusion is (diameter / 4)^2.
    """
    camera = layout.camera
    centres = layout.virtual_centres_in_view_mm.reshape(-1, 3)
    offsets = points_in_view_mm[:, None] - centres
    motions = offsets[..., :2] / offsets[..., 2:]

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
    return motions, np.stack(columns, axis=-1), SHARP_VARIANCE_PX2 + (circles / 4.0) ** 2
