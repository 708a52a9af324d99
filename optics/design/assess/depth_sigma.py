"""Expected standard deviation of depth: the Cramér-Rao bound of matching all views of a textured plane.

Where a view looks from the distance D along the view axis, a change dz of the depth moves the texture that its pixels
show by m dz, m = (x - c) / D, with x the point and c the view's centre across that axis. Of an unknown texture with the
power spectrum S that n px per mm^2 show with the contrast H and noise of the variance v, matching learns per mm^2

    I = sum over frequencies k of S(k) sum_i w_i (2 pi k . (m_i - mean of m))^2,    w_i = |H_i(k)|^2 n_i / v_i

with the mean weighted by w as well: the part that all views share determines the texture, not the depth. It is the
bound for an unknown, fixed signal (P. Stoica and A. Nehorai, IEEE Trans. ASSP 37(5), 1989), without prior knowledge of
the texture. Of equal views of a plane square to them it becomes

    sigma = D^2 / (f sqrt(sum_i |b_i - mean of b|^2)) * noise / (slope sqrt(N))

with baselines b, the RMS slope of the pictures along an axis and N px a view.
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

The texture has as much slope at each frequency, as edges have (a power spectrum of 1 / k^2), so that it looks alike
from any distance; blur and coarser sampling take from it.
"""

WINDOW_PX = 25.0
"""Pixels of the central view that take one depth."""

PLACES = 9
"""Places along each side of the box around the common region at which the bound is computed."""

ANGLES, RADII, LARGEST_RADIUS = 16, 24, 3.5
"""Directions and lengths of frequencies; the largest length in standard deviations of the contrast of sharp pixels."""


DEPTH_UNKNOWN = "it would exceed the depth itself: the views are too blurred, or too close together, to measure depth"


def depth_sigma_metrics(views: FieldsOfView, depths_mm: Sequence[float]) -> dict[str, Metric]:
    """Expected standard deviation of depth at each depth: the mean over the region that all views show.

    Views are those of whole pupils, for the pixels that the camera can use. A depth at which they share nothing is left
    out; where it would exceed the depth, the figure is none.
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
    """Expected standard deviation of depth, mm, averaged over what all views show; None where that is nothing.

    None as well for a single view, which shows no depth. Infinite where it would exceed the depth: the bound is that of
    small errors, and blurred views have contrasts at which it is astronomical.
    """
    places = _places(views, depth_mm)
    if len(places) == 0 or len(views.layout.mirrors) == 1:
        return None
    sigma = float(depth_sigma_mm(views.layout, places).mean())
    return sigma if sigma <= depth_mm else math.inf


def depth_sigma_mm(layout: Layout, points_in_view_mm: FloatArray) -> FloatArray:
    """Expected standard deviation (n,) of the depth of a plane square to the views, around points (n, 3), view axes.

    Infinite where the views show nothing of the texture or lie in one place.
    """
    moves, jacobians, variances = _shifts(layout, points_in_view_mm)
    density = np.abs(np.linalg.det(jacobians))
    steps = np.linalg.inv(jacobians)
    blur = variances[..., None, None] * (steps @ np.swapaxes(steps, -1, -2))
    central = layout.central_index
    unit = np.sqrt(density[:, central] / SHARP_VARIANCE_PX2)
    angles = np.pi * (np.arange(ANGLES) + 0.5) / ANGLES
    radii = LARGEST_RADIUS * (np.arange(RADII) + 0.5) / RADII
    information = np.zeros(len(points_in_view_mm))
    for along in np.column_stack([np.cos(angles), np.sin(angles)]):
        spread = np.einsum("i,nmij,j->nm", along, blur, along) * unit[:, None] ** 2
        moved = moves @ along
        moved -= moved.mean(axis=1, keepdims=True)
        powers = np.stack([density, density * moved, density * moved**2], axis=1)
        # Contrasts relative to the sharpest view's, which alone may underflow: to 0, as there is nothing to match then.
        sharpest = spread.min(axis=1, keepdims=True)
        relative = np.exp(-(spread - sharpest)[..., None] * radii**2)
        total, first, second = np.moveaxis(powers @ relative, 1, 0)
        information += (np.exp(-sharpest * radii**2) * np.maximum(second - first**2 / total, 0.0)) @ radii
    # The picture of a spectrum of slopes C k dk has the mean square slope C / (4 SHARP_VARIANCE_PX2) along an axis.
    strength = SLOPE_GREY**2 * 4.0 * SHARP_VARIANCE_PX2 / NOISE_GREY**2
    cell = unit**2 * (LARGEST_RADIUS / RADII) / ANGLES
    per_mm2 = strength * cell * information
    known = per_mm2 > 0.0
    sigma = np.full(len(known), np.inf)
    sigma[known] = 1.0 / np.sqrt(per_mm2[known] * WINDOW_PX / density[known, central])
    return sigma


def _places(views: FieldsOfView, depth_mm: float) -> FloatArray:
    """Points (n, 3) of the common region at a depth, in view axes."""
    region, _ = views.common_region(depth_mm)
    if region.is_empty:
        return np.zeros((0, 3))
    left, low, right, high = region.bounds
    parts = (np.arange(PLACES) + 0.5) / PLACES
    x, y = (grid.ravel() for grid in np.meshgrid(left + parts * (right - left), low + parts * (high - low)))
    inside = shapely.contains_xy(region, x, y)
    return np.column_stack([x, y, np.full(len(x), depth_mm)])[inside]


def _shifts(layout: Layout, points_in_view_mm: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of points (n, 3) in each view: moves (n, m, 2), px per mm across (n, m, 2, 2), variances (n, m) of blur, px^2.

    A circle of confusion has the variance of its diameter / 4 squared.
    """
    camera, turn = layout.camera, layout.view_from_rig
    centres = layout.virtual_centres_in_view_mm.reshape(-1, 3)
    away = points_in_view_mm[:, None] - centres
    moves = away[..., :2] / away[..., 2:]

    def seen(points: FloatArray) -> tuple[FloatArray, FloatArray]:
        images = reflect((points @ turn)[:, None], layout.virtual_centres_in_rig_mm)
        return camera.project(images), images[..., 2]

    step = 1e-3
    _, z = seen(points_in_view_mm)
    columns = [
        (seen(points_in_view_mm + by)[0] - seen(points_in_view_mm - by)[0]) / (2.0 * step)
        for by in step * np.eye(3)[:2]
    ]
    circles = max(camera.fx_px, camera.fy_px) * camera.aperture_mm * np.abs(1.0 / z - 1.0 / camera.focus_mm)
    return moves, np.stack(columns, axis=-1), SHARP_VARIANCE_PX2 + (circles / 4.0) ** 2
