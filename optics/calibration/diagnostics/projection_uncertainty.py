"""Propagation of a calibration's covariance to the pixels of each view and to triangulated depth.

After mrcal's projection uncertainty (Kogan). The rig frame is that of the camera: pinhole, optical axis and pixel
axes define it, and the board's poses, free in the fit, are marginalised. The pose of the rig frame is thus determined,
and a point can be fixed in it while camera and mirrors vary. An error common to all views counts in full there (an
error of the principal point is nearly a rotation of all mirrors); relative to the reference view, on which depth
depends, it cancels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, contains_xy

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, global_names, residuals_with_jacobians
from mirrorcam.optics.geometry.layout import Layout, Uncertainty

NEGLIGIBLE_PX = 1e-4
"""Insignificant difference: below the precision of any detected corner."""
GRID = 9
"""Points of a map along the longer side of a sub-image."""


@dataclass(frozen=True)
class ProjectedPoints:
    """Projections of points by one view, with derivatives.

    Attributes
    ----------
    pixels
        (n, 2).
    d_parameter
        Derivatives (n, 2, g) with respect to the parameters, in the order of the layout's uncertainty.
    d_point
        Derivatives (n, 2, 3) with respect to the points in the rig frame, px/mm.
    """

    pixels: FloatArray
    d_parameter: FloatArray
    d_point: FloatArray


@dataclass(frozen=True)
class ProjectionMap:
    """Projection uncertainty of one view for points at one distance.

    Attributes
    ----------
    view
        Mirror index, or DIRECT.
    range_mm
        Distance of the points from the view's virtual centre, mm.
    pixels
        Pixels (n, 2) of the points.
    in_rig
        Covariance (n, 2, 2), px^2, of the pixel of a point fixed in the rig frame.
    against_reference
        The same for a point fixed in the reference view, for which it is zero; of a bare camera, apart from the
        rotation of the camera that compensates most of it.
    """

    view: int
    range_mm: float
    pixels: FloatArray
    in_rig: FloatArray
    against_reference: FloatArray

    @cached_property
    def in_rig_px(self) -> FloatArray:
        """Standard deviations (n,) along the worst direction."""
        return worst_sigmas(self.in_rig)

    @cached_property
    def against_reference_px(self) -> FloatArray:
        """Standard deviations (n,) along the worst direction."""
        return worst_sigmas(self.against_reference)


def worst_sigmas(covariances: FloatArray) -> FloatArray:
    """Standard deviations (...) along the direction of largest variance of covariances (..., k, k)."""
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(covariances)[..., -1], 0.0)))


def uncertainty_of(layout: Layout) -> Uncertainty:
    """Return the covariance of a calibrated layout; raises ValueError if it has none."""
    if layout.uncertainty is None:
        raise ValueError("the layout has no uncertainty, expected a calibrated layout")
    return layout.uncertainty


def project_points(layout: Layout, view: int | NDArray[np.int64], points_in_rig: FloatArray) -> ProjectedPoints:
    """Project points (n, 3), rig frame, mm, in one view (a mirror, or DIRECT) or each in its own view (n,).

    The model is the solver's. A layout without covariance has no parameters.
    """
    parameters = () if layout.uncertainty is None else layout.uncertainty.parameters
    count = len(points_in_rig)
    estimate = Estimate.of(layout.camera, layout.mirrors, np.eye(4)[None])
    frame = np.zeros(count, dtype=np.int64)
    rows = Observations(frame, np.broadcast_to(view, count), np.arange(count), np.zeros((count, 2)))
    pixels, d_global, d_frame = residuals_with_jacobians(estimate, rows, Board.rigid(points_in_rig))
    names = global_names(layout.camera.intrinsic_names, len(layout.mirrors), 0)
    column = {name: k for k, name in enumerate(names)}
    return ProjectedPoints(pixels, d_global[:, :, [column[name] for name in parameters]], d_frame[:, :, 3:6])


def virtual_centre(layout: Layout, view: int) -> FloatArray:
    """Centre of projection (3,) of a view, rig frame, mm: the apparent mirror's, or the pupil itself if DIRECT."""
    return np.zeros(3) if view == DIRECT else layout.mirrors[view].apparent.virtual_centre_in_rig_mm


def points_at_pixels(layout: Layout, view: int, pixels: FloatArray, range_mm: float) -> FloatArray:
    """Return points (n, 3), rig frame, mm, at pixels (n, 2) of a view, `range_mm` from its centre of projection.

    Plates and bent mirrors are approximated by their apparent flat first-surface mirrors.
    """
    rays = layout.camera.unproject(pixels)
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    points = range_mm * rays
    return points if view == DIRECT else layout.mirrors[view].apparent.reflect(points)


def views_of(layout: Layout) -> tuple[int, ...]:
    """The views of a layout's mirrors; the direct view for a bare camera."""
    return tuple(range(len(layout.mirrors))) or (DIRECT,)


def outline_px(layout: Layout, view: int) -> FloatArray:
    """Outline (n, 2) of a view's sub-image on the sensor; the complete sensor if DIRECT."""
    if view != DIRECT:
        return layout.outline_px(view)
    return np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * [layout.camera.width_px, layout.camera.height_px] - 0.5


def grid_px(layout: Layout, view: int) -> FloatArray:
    """Pixels (n, 2) of a uniform grid over a view's sub-image."""
    outline = outline_px(layout, view)
    low, high = outline.min(axis=0), outline.max(axis=0)
    step = (high - low).max() / GRID
    counts = np.maximum(np.rint((high - low) / step), 1).astype(int)
    u, v = (low[k] + (np.arange(counts[k]) + 0.5) * (high[k] - low[k]) / counts[k] for k in range(2))
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    return pixels[contains_xy(Polygon(outline), pixels[:, 0], pixels[:, 1])]


def grid_points(layout: Layout, view: int, range_mm: float) -> tuple[FloatArray, FloatArray]:
    """Pixels (n, 2) of a uniform grid over a view's sub-image, and points (n, 3) that they show, as `points_at_pixels`.

    Pixels beyond the limits of the lens model are left out.
    """
    pixels = grid_px(layout, view)
    points = points_at_pixels(layout, view, pixels, range_mm)
    seen = np.isfinite(points).all(axis=1)
    pixels, points = pixels[seen], points[seen]
    seen = np.isfinite(project_points(layout, view, points).pixels).all(axis=1)
    return pixels[seen], points[seen]


def derivatives_in_reference(layout: Layout, reference: int, points_in_rig: FloatArray) -> FloatArray:
    """Derivatives (n, 3, g), mm, of points (n, 3) fixed in the reference view, with respect to the parameters.

    Their pixels in the reference view and their distances from its virtual centre are fixed.
    """
    projected = project_points(layout, reference, points_in_rig)
    line_of_sight = points_in_rig - virtual_centre(layout, reference)
    line_of_sight = line_of_sight / np.linalg.norm(line_of_sight, axis=1, keepdims=True)
    d_centre = centre_derivatives(layout, reference)
    system = np.concatenate([projected.d_point, line_of_sight[:, None, :]], axis=1)
    rhs = np.concatenate([-projected.d_parameter, np.einsum("ni,ig->ng", line_of_sight, d_centre)[:, None, :]], axis=1)
    return np.asarray(np.linalg.solve(system, rhs))


def relative_derivatives(
    layout: Layout, reference: int, points_in_rig: FloatArray, projected: ProjectedPoints
) -> FloatArray:
    """Derivatives (n, 2, g) of projections of points (n, 3) that are fixed in the reference view.

    A bare camera has no other view to compare with, and its own pictures determine its orientation wherever it is used:
    the rotation that compensates most of each derivative is removed (after mrcal, for points at infinity).
    """
    if layout.mirrors:
        return projected.d_parameter + projected.d_point @ derivatives_in_reference(layout, reference, points_in_rig)
    d_rotation = projected.d_point @ np.cross(np.eye(3), points_in_rig[:, None, :]).swapaxes(1, 2)
    basis, _ = np.linalg.qr(d_rotation.reshape(-1, 3))
    flat = projected.d_parameter.reshape(len(basis), -1)
    return np.asarray((flat - basis @ (basis.T @ flat)).reshape(projected.d_parameter.shape))


def centre_derivatives(layout: Layout, view: int) -> FloatArray:
    """Derivatives (3, g) of a view's virtual centre with respect to the parameters.

    The distance between apparent mirror and coating is treated as fixed. It varies with the plate's thickness, but the
    position of a ray's origin on the ray is a convention that no picture determines.
    """
    names = uncertainty_of(layout).parameters
    derivatives = np.zeros((3, len(names)))
    for k, axis in enumerate("xyz"):
        name = f"mirror {view} {axis}_mm"
        if name in names:
            derivatives[k, names.index(name)] = 1.0
    return derivatives


def projection_map(layout: Layout, view: int, *, reference: int, range_mm: float) -> ProjectionMap:
    """Return the projection uncertainty over a view's sub-image, for points `range_mm` from the view's centre."""
    pixels, points = grid_points(layout, view, range_mm)
    covariance = uncertainty_of(layout).covariance
    projected = project_points(layout, view, points)
    relative = relative_derivatives(layout, reference, points, projected)
    return ProjectionMap(
        view=view,
        range_mm=range_mm,
        pixels=pixels,
        in_rig=propagate(projected.d_parameter, covariance),
        against_reference=propagate(relative, covariance),
    )


def propagate(derivatives: FloatArray, covariance: FloatArray) -> FloatArray:
    """Propagate a covariance (g, g) through derivatives (..., k, g) to covariances (..., k, k)."""
    return np.asarray(derivatives @ covariance @ np.swapaxes(derivatives, -1, -2))


def median_distance_mm(layout: Layout, points_in_rig: FloatArray, views: NDArray[np.int64]) -> float:
    """Median distance of observed points (n, 3), mm, from the virtual centres of their views (n,)."""
    centres = np.array([virtual_centre(layout, view) for view in (*range(len(layout.mirrors)), DIRECT)])
    return float(np.median(np.linalg.norm(points_in_rig - centres[views], axis=1)))


@dataclass(frozen=True)
class DepthUncertainty:
    """Standard deviations of the distance of a triangulated point from the reference view.

    Attributes
    ----------
    range_mm
        Distances (k,) of the point, mm.
    matching_mm
        Standard deviations (k,) from matching noise; NaN if fewer than two views show the point.
    calibration_mm
        Standard deviations (k,) from the calibration; NaN in the same cases.
    views
        Number of views (k,) that show the point.
    pixel
        Pixel (2,) of the reference view at which the point appears.
    matching_px
        Standard deviation of the matching noise, per axis and view.
    """

    range_mm: FloatArray
    matching_mm: FloatArray
    calibration_mm: FloatArray
    views: NDArray[np.int64]
    pixel: FloatArray
    matching_px: float

    @property
    def total_mm(self) -> FloatArray:
        """Root sum of squares (k,) of both, which are independent."""
        return np.hypot(self.matching_mm, self.calibration_mm)


def depth_uncertainty(
    layout: Layout, ranges_mm: FloatArray, *, reference: int, pixel: FloatArray, matching_px: float
) -> DepthUncertainty:
    """Propagate matching noise and a calibration's covariance to triangulated distances.

    Least squares over the pixels q of all views: dX = -(J^T J)^-1 J^T (noise + G dp) with J = dq/dX and G = dq/dp. The
    distance is measured from the virtual centre of the reference view, so a motion of the entire rig has no effect.

    Parameters
    ----------
    layout
        A calibrated layout, with covariance.
    ranges_mm
        Distances (k,), mm.
    reference
        The reference view: a mirror's index, or DIRECT.
    pixel
        Pixel (2,) of the reference view at which the points appear.
    matching_px
        Standard deviation of the matching noise, per axis and view.
    """
    used_views = sorted({reference, *range(len(layout.mirrors))})
    outlines = [Polygon(outline_px(layout, view)) for view in used_views]
    points = np.concatenate([points_at_pixels(layout, reference, pixel[None], float(r)) for r in ranges_mm])
    projected = [project_points(layout, view, points) for view in used_views]
    centre, d_centre = virtual_centre(layout, reference), centre_derivatives(layout, reference)
    covariance = uncertainty_of(layout).covariance
    matching, calibration, views = [], [], []
    for k, point in enumerate(points):
        visible = [s for s, outline in zip(projected, outlines, strict=True) if contains_xy(outline, *s.pixels[k])]
        views.append(len(visible))
        if len(visible) < 2:
            matching.append(np.nan)
            calibration.append(np.nan)
            continue
        d_point = np.concatenate([s.d_point[k] for s in visible])
        d_parameter = np.concatenate([s.d_parameter[k] for s in visible])
        line_of_sight = (point - centre) / np.linalg.norm(point - centre)
        d_pixels = line_of_sight @ np.linalg.pinv(d_point)
        d_calibration = -d_pixels @ d_parameter - line_of_sight @ d_centre
        matching.append(matching_px * float(np.linalg.norm(d_pixels)))
        calibration.append(float(np.sqrt(d_calibration @ covariance @ d_calibration)))
    return DepthUncertainty(
        range_mm=np.array(ranges_mm, dtype=np.float64),
        matching_mm=np.array(matching),
        calibration_mm=np.array(calibration),
        views=np.array(views),
        pixel=pixel,
        matching_px=matching_px,
    )
