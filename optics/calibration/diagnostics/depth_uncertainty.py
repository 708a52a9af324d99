"""Uncertainty of triangulated depth against range, separately from matching noise and from the calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, contains_xy

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import (
    centre_derivatives,
    outline_px,
    points_at_pixels,
    project,
    uncertainty_of,
    virtual_centre,
)
from mirrorcam.optics.geometry.layout import Layout


@dataclass(frozen=True)
class DepthUncertainty:
    """Standard deviations of the distance of a triangulated point from the reference view.

    Attributes
    ----------
    range_mm
        Distances (k,) of the point.
    matching_mm
        Standard deviations (k,) by matching noise; NaN where fewer than two views show the point.
    calibration_mm
        Standard deviations (k,) by the calibration; NaN likewise.
    views
        Number of views (k,) that show the point.
    at_px
        Pixel (2,) of the reference view at which the point appears.
    matching_px
        Standard deviation of the matching noise, per axis and view.
    """

    range_mm: FloatArray
    matching_mm: FloatArray
    calibration_mm: FloatArray
    views: NDArray[np.int64]
    at_px: FloatArray
    matching_px: float

    @property
    def total_mm(self) -> FloatArray:
        """Both together (k,), as the two are independent."""
        return np.hypot(self.matching_mm, self.calibration_mm)


def depth_uncertainty(
    layout: Layout, ranges_mm: FloatArray, *, reference: int, at_px: FloatArray, matching_px: float
) -> DepthUncertainty:
    """Propagate matching noise and a calibration's covariance to triangulated distances.

    Least squares over the pixels q of all views: dX = -(J^T J)^-1 J^T (noise + G dp) with J = dq/dX and G = dq/dp. The
    distance is measured from the virtual centre of the reference view, so that a motion of the whole rig changes
    nothing.

    Parameters
    ----------
    layout
        A calibrated layout, with covariance.
    ranges_mm
        Distances (k,).
    reference
        The reference view: a mirror's index, or DIRECT.
    at_px
        Pixel (2,) of the reference view at which the points appear.
    matching_px
        Standard deviation of the matching noise, per axis and view.
    """
    which = sorted({reference, *range(len(layout.mirrors))})
    outlines = [Polygon(outline_px(layout, view)) for view in which]
    points = np.concatenate([points_at_pixels(layout, reference, at_px[None], float(r)) for r in ranges_mm])
    shown = [project(layout, view, points) for view in which]
    centre, by_centre = virtual_centre(layout, reference), centre_derivatives(layout, reference)
    covariance = uncertainty_of(layout).covariance
    matching, calibration, views = [], [], []
    for k, point in enumerate(points):
        seen = [s for s, outline in zip(shown, outlines, strict=True) if contains_xy(outline, *s.pixels[k])]
        views.append(len(seen))
        if len(seen) < 2:
            matching.append(np.nan)
            calibration.append(np.nan)
            continue
        by_point = np.concatenate([s.by_point[k] for s in seen])
        by_parameter = np.concatenate([s.by_parameter[k] for s in seen])
        along = (point - centre) / np.linalg.norm(point - centre)
        by_pixels = along @ np.linalg.pinv(by_point)
        by_calibration = -by_pixels @ by_parameter - along @ by_centre
        matching.append(matching_px * float(np.linalg.norm(by_pixels)))
        calibration.append(float(np.sqrt(by_calibration @ covariance @ by_calibration)))
    return DepthUncertainty(
        range_mm=np.array(ranges_mm, dtype=np.float64),
        matching_mm=np.array(matching),
        calibration_mm=np.array(calibration),
        views=np.array(views),
        at_px=at_px,
        matching_px=matching_px,
    )
