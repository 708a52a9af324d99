"""Focus of the base camera over the working depths: circles of confusion in each mirror, and the best focus."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import FieldsOfView, images_in_rig

CIRCLE_LIMIT_PX = 2.0
"""Diameter up to which a circle of confusion counts as sharp.

It adds 0.5 px RMS per axis to the blur of a webcam in focus, about 0.8 px. The first zero of its MTF,
1.22 / diameter, is at 0.61 periods per px, beyond the Nyquist frequency of 0.5.
"""


def inverse_depths_per_mm(views: FieldsOfView, depth_mm: float) -> FloatArray:
    """Minimum and maximum 1/z (mirrors, 2) of the region common to all views at a depth; NaN if there is none.

    z is the depth along the camera's axis of the region's images in each mirror.
    """
    region, _ = views.common_region(depth_mm)
    if region.is_empty:
        return np.full((len(views.layout.mirrors), 2), np.nan)
    # The images are plane polygons, whose 1/z is extreme at corners.
    inverse_depths = 1.0 / images_in_rig(views.layout, region, depth_mm)[..., 2]
    return np.stack([inverse_depths.min(axis=1), inverse_depths.max(axis=1)], axis=1)


def circles_px(camera: Camera, inverse_depths: FloatArray, focus_mm: float) -> FloatArray:
    """Largest diameter (...), px, of circles of confusion between two values of 1/z (..., 2): f A |1/z - 1/focus|."""
    focal_px = max(camera.fx_px, camera.fy_px)
    return np.asarray(focal_px * camera.aperture_mm * np.abs(inverse_depths - 1.0 / focus_mm).max(axis=-1))


def best_focus_mm(inverse_depths: FloatArray) -> float:
    """Focus that minimises the largest circle between values of 1/z (..., 2): the mean of the extreme 1/z."""
    return float(2.0 / (inverse_depths.min() + inverse_depths.max()))


def focus_metrics(views: FieldsOfView, depths_mm: Sequence[float]) -> dict[str, Metric]:
    """Largest circle of confusion at each depth, the best focus for all depths, and its largest circle.

    Depths at which the views have no common region are omitted. Empty for a pinhole, and if no depth remains.
    """
    camera = views.layout.camera
    if camera.aperture_mm == 0.0:
        return {}
    at_depths = {depth_mm: inverse_depths_per_mm(views, depth_mm) for depth_mm in depths_mm}
    at_depths = {
        depth_mm: inverse_depths for depth_mm, inverse_depths in at_depths.items() if np.isfinite(inverse_depths).all()
    }
    if not at_depths:
        return {}
    metrics = {
        f"circle_of_confusion_{depth_mm:g}mm": Metric(
            value=float(circles_px(camera, inverse_depths, camera.focus_mm).max()), unit="px"
        )
        for depth_mm, inverse_depths in at_depths.items()
    }
    all_inverse_depths = np.concatenate(list(at_depths.values()))
    best_mm = best_focus_mm(all_inverse_depths)
    metrics["best_focus_mm"] = Metric(value=best_mm, unit="mm")
    smallest_px = float(circles_px(camera, all_inverse_depths, best_mm).max())
    metrics["circle_at_best_focus_px"] = Metric(value=smallest_px, unit="px", limit=CIRCLE_LIMIT_PX)
    return metrics


def focus_figures(layout: Layout) -> dict[str, Metric]:
    """The metrics of a layout that describe the camera's focus; empty for a pinhole."""
    return {name: metric for name, metric in layout.metrics.items() if name.startswith(("circle", "best_focus"))}


def out_of_focus(layout: Layout) -> str:
    """Advice if a circle of confusion at a working depth exceeds the limit; "" if none does."""
    figures = focus_figures(layout)
    if not figures:
        return ""
    smallest = figures["circle_at_best_focus_px"]
    worst = max(metric.value for name, metric in figures.items() if name.startswith("circle_of_confusion"))
    if smallest.limit is None or worst <= smallest.limit or not all(metric.known for metric in figures.values()):
        return ""
    problem = f"with the focus at {layout.camera.focus_mm:g} mm, circles of confusion reach {worst:.3g} px"
    best = f"the focus at {figures['best_focus_mm'].value:.0f} mm reduces them to {smallest.value:.3g} px"
    smaller_mm = layout.camera.aperture_mm * smallest.limit / smallest.value
    advice = (
        best
        if smallest.passed
        else f"{best}, and an aperture of {smaller_mm:.3g} mm would reduce them to {smallest.limit:g} px"
    )
    return f"{problem}, more than {smallest.limit:g} px: {advice}"
