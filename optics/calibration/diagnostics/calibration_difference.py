"""The difference of two calibrations of one device, in pixels of each view, and its prediction by their covariances.

After mrcal's projection difference with an implied transformation (Kogan). Two calibrations may place the rig
differently in space: a common motion of all mirrors, or a shift of the principal point, is hardly distinguishable from
a motion of the scene. So the rigid motion that best aligns the projections by B with the projections by A, over points
in the working volume, is removed; the rest is the difference that affects a measurement.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import (
    ProjectedPoints,
    grid_px,
    outline_px,
    points_at_pixels,
    project_points,
    propagate,
)
from mirrorcam.optics.calibration.solver.observations import DIRECT, IntArray
from mirrorcam.optics.calibration.solver.residuals import global_names
from mirrorcam.optics.geometry.layout import VOLUME_FACTORS, Layout
from mirrorcam.optics.geometry.transforms import rigid, transform

NOISE_RATIO = 2.5
"""Ratio of difference to sigma that noise alone exceeds in the worst view of at most 1 % of comparisons."""
OUTLIER_RATIO = 3.0
"""Multiple of the median view's difference above which a view gets little weight in the motion."""
MAX_STEPS, CONVERGED_MM, ROUNDING_PX = 100, 1e-8, 1e-9
ProjectPoints = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Maps points (n, 3), mm, each in its own view, to pixels (n, 2) and their derivatives (n, 2, 3), px/mm."""


@dataclass(frozen=True)
class ViewDifference:
    """The difference in one view, B minus A.

    Attributes
    ----------
    view
        Mirror index, or DIRECT.
    pixels
        Pixels (n, 2) at which A shows the points.
    difference_px
        Pixels (n, 2) at which B shows the same points, minus `pixels`.
    difference_mm
        Shortest shift (n,) of the point that has the same effect in A.
    covariance_px
        Predicted covariance (n, 2, 2) of `difference_px`; zero if neither calibration has one.
    sigma_mm
        Predicted root mean square (n,) of `difference_mm`.
    """

    view: int
    pixels: FloatArray
    difference_px: FloatArray
    difference_mm: FloatArray
    covariance_px: FloatArray
    sigma_mm: FloatArray

    @cached_property
    def length_px(self) -> FloatArray:
        """Lengths (n,) of the differences."""
        return np.asarray(np.linalg.norm(self.difference_px, axis=1))

    @cached_property
    def sigma_px(self) -> FloatArray:
        """Predicted root mean squares (n,) of the lengths: roots of the summed variances in x and y."""
        return np.asarray(np.sqrt(np.maximum(np.trace(self.covariance_px, axis1=1, axis2=2), 0.0)))


@dataclass(frozen=True)
class CalibrationDifference:
    """The differences in all views.

    Attributes
    ----------
    views
        Mirrors in order, then the direct view if the device has one.
    range_mm
        Distance of the points from the centre of projection of each view.
    b_from_a
        The removed rigid motion (4, 4) from A's rig frame to B's, mm.
    rotation_deg
        Its rotation vector (3,), degrees.
    shift_mm
        Its displacement (3,) of the points' centroid, mm.
    predicted
        Whether A and B each have a covariance.
    """

    views: tuple[ViewDifference, ...]
    range_mm: float
    b_from_a: FloatArray
    rotation_deg: FloatArray
    shift_mm: FloatArray
    predicted: tuple[bool, bool]

    def metrics(self, views: Sequence[ViewDifference]) -> dict[str, Metric]:
        """Rms and largest difference over some views; with a covariance, also sigma and their ratio."""
        rms, sigma = _rms([view.length_px for view in views]), _rms([view.sigma_px for view in views])
        metrics = {
            "rms_px": (rms, "px"),
            "max_px": (max(float(view.length_px.max()) for view in views), "px"),
            "rms_mm": (_rms([view.difference_mm for view in views]), "mm"),
            "max_mm": (max(float(view.difference_mm.max()) for view in views), "mm"),
        }
        if any(self.predicted):
            metrics["sigma_px"] = (sigma, "px")
            metrics["sigma_mm"] = (_rms([view.sigma_mm for view in views]), "mm")
        if sigma > 0.0:
            metrics["ratio"] = (rms / sigma, "1")
        return {name: Metric(value=_rounded_to_zero(value), unit=unit) for name, (value, unit) in metrics.items()}

    @property
    def worst(self) -> tuple[ViewDifference, float] | None:
        """The view with the largest ratio of difference to sigma, and that ratio; None without a covariance."""
        ratios = [(view, metrics["ratio"].value) for view in self.views if "ratio" in (metrics := self.metrics([view]))]
        return max(ratios, key=lambda pair: pair[1], default=None)

    @property
    def motion(self) -> dict[str, Metric]:
        """Size and components of the removed motion."""
        metrics = {}
        for name, unit, vector in (("turn_deg", "deg", self.rotation_deg), ("shift_mm", "mm", self.shift_mm)):
            metrics[f"motion_{name}"] = Metric(value=_rounded_to_zero(float(np.linalg.norm(vector))), unit=unit)
            stem = name.removesuffix(f"_{unit}")
            for axis, value in zip("xyz", vector.tolist(), strict=True):
                metrics[f"motion_{stem}_{axis}_{unit}"] = Metric(value=_rounded_to_zero(value), unit=unit)
        return metrics


def _rounded_to_zero(value: float) -> float:
    """Return a figure, or 0 if rounding alone explains it."""
    return value if abs(value) > ROUNDING_PX else 0.0


def _rms(parts: Sequence[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def calibration_difference(a: Layout, b: Layout, *, range_mm: float) -> CalibrationDifference:
    """Compare two calibrations of one device.

    Parameters
    ----------
    a, b
        The layouts. Their noise is assumed independent, so covariances add.
    range_mm
        Distance of the points of the map from each view's centre of projection, mm.

    Raises
    ------
    InputError
        If the layouts belong to different devices, or B does not show the points that A shows.
    """
    _check_same_device(a, b)
    points = _Points.in_volume(a, b, range_mm)
    b_from_a, weights = _rigid_motion(a, b, points)
    visible = _visible(b, points.view, transform(b_from_a, points.in_a))
    points, weights = points.where(visible), weights[visible]
    in_b = transform(b_from_a, points.in_a)
    projected_a, projected_b = project_points(a, points.view, points.in_a), project_points(b, points.view, in_b)
    motion_columns = motion_jacobian(projected_b.d_point, in_b, range_mm)
    covariance = sum(
        (
            _predicted(layout, projected, motion_columns, weights)
            for layout, projected in ((a, projected_a), (b, projected_b))
        ),
        start=np.zeros((len(in_b), 2, 2)),
    )
    rows = [(view, points.on_map & (points.view == view)) for view in _views(a)]
    difference, centroid = projected_b.pixels - projected_a.pixels, points.in_a.mean(axis=0)
    return CalibrationDifference(
        views=tuple(
            _view_difference(
                view, points.pixels[in_view], difference[in_view], projected_a.d_point[in_view], covariance[in_view]
            )
            for view, in_view in rows
        ),
        range_mm=range_mm,
        b_from_a=b_from_a,
        rotation_deg=np.degrees(Rotation.from_matrix(b_from_a[:3, :3]).as_rotvec()),
        shift_mm=transform(b_from_a, centroid) - centroid,
        predicted=(a.uncertainty is not None, b.uncertainty is not None),
    )


def _predicted(layout: Layout, projected: ProjectedPoints, columns: FloatArray, weights: FloatArray) -> FloatArray:
    """Covariances (n, 2, 2) of the differences due to one layout, motion refitted; zero without a covariance."""
    if layout.uncertainty is None:
        return np.zeros((len(weights), 2, 2))
    derivatives = remove_motion(projected.d_parameter, columns, weights)
    return propagate(derivatives, layout.uncertainty.covariance)


def _view_difference(
    view: int, pixels: FloatArray, difference: FloatArray, d_point: FloatArray, covariance: FloatArray
) -> ViewDifference:
    """Build the difference in one view, also as shifts of the points, given A's derivatives `d_point` of pixels."""
    d_pixel: FloatArray = np.linalg.pinv(d_point).astype(np.float64)
    shifts = np.linalg.norm(np.einsum("nij,nj->ni", d_pixel, difference), axis=1)
    variances = np.trace(propagate(d_pixel, covariance), axis1=1, axis2=2)
    return ViewDifference(view, pixels, difference, shifts, covariance, np.sqrt(np.maximum(variances, 0.0)))


def view_label(layout: Layout, view: int) -> str:
    """Name of a view for messages."""
    return "direct view" if view == DIRECT else f"mirror {layout.mirror_names[view]}"


def _views(layout: Layout) -> tuple[int, ...]:
    """The mirrors, and the direct view if the scene lies in front of the camera itself."""
    mirrors = tuple(range(len(layout.mirrors)))
    return (*mirrors, DIRECT) if np.array_equal(layout.view_from_rig, np.eye(3)) else mirrors


def _check_same_device(a: Layout, b: Layout) -> None:
    """Raise InputError if two layouts cannot be calibrations of one device."""
    sizes = [f"{layout.camera.width_px}x{layout.camera.height_px} px" for layout in (a, b)]
    if sizes[0] != sizes[1]:
        raise InputError(f"the second layout's pictures are {sizes[1]}, expected {sizes[0]} as in the first")
    if (a.rows, a.cols, a.pattern) != (b.rows, b.cols, b.pattern):
        raise InputError(
            f"the second layout has {b.arrangement.text} mirrors, expected {a.arrangement.text} as in the first"
        )
    for layout, which in ((a, "first"), (b, "second")):
        parameters = () if layout.uncertainty is None else layout.uncertainty.parameters
        unknown = set(parameters).difference(global_names(layout.camera.intrinsic_names, len(layout.mirrors), 0))
        if unknown:
            raise InputError(
                f"the {which} layout's covariance has the parameter {min(unknown)[:40]!r}, "
                "expected those of its camera and mirrors"
            )
    for view in range(len(a.mirrors)):
        (low, high), other = _extent(a, view), _extent(b, view)
        centre, other_centre = (low + high) / 2.0, other.mean(axis=0)
        if (np.abs(other_centre - centre) > (high - low) / 2.0).any():
            positions = [f"({x:.0f}, {y:.0f})" for x, y in (centre, other_centre)]
            raise InputError(
                f"{view_label(a, view)} is at pixel {positions[0]} in the first layout and at {positions[1]} in the "
                "second, expected two calibrations of one device"
            )


def _extent(layout: Layout, view: int) -> FloatArray:
    """Lowest and highest pixel (2, 2) of a sub-image."""
    outline = outline_px(layout, view)
    return np.array([outline.min(axis=0), outline.max(axis=0)])


@dataclass(frozen=True)
class _Points:
    """Points of the working volume: views (n,), pixels (n, 2), and positions (n, 3) in A's and B's rig frames, mm."""

    view: IntArray
    pixels: FloatArray
    in_a: FloatArray
    in_b: FloatArray
    on_map: NDArray[np.bool_]

    @classmethod
    def in_volume(cls, a: Layout, b: Layout, range_mm: float) -> _Points:
        """Sample points in the views of A; B's points have the same pixels and distances."""
        parts = []
        for view in _views(a):
            pixels = grid_px(a, view)
            for factor in VOLUME_FACTORS:
                in_a, in_b = (points_at_pixels(layout, view, pixels, factor * range_mm) for layout in (a, b))
                parts.append((np.full(len(pixels), view), pixels, in_a, in_b, np.full(len(pixels), factor == 1.0)))
        points = cls(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
        points = points.where(_visible(a, points.view, points.in_a) & _visible(b, points.view, points.in_b))
        for view in _views(a):
            if not (points.on_map & (points.view == view)).any():
                raise InputError(f"{view_label(a, view)} shows nothing {range_mm:g} mm away in both layouts")
        return points

    def where(self, mask: NDArray[np.bool_]) -> _Points:
        """Select the points of a boolean mask (n,)."""
        return _Points(self.view[mask], self.pixels[mask], self.in_a[mask], self.in_b[mask], self.on_map[mask])


def _visible(layout: Layout, view: IntArray, points_in_rig: FloatArray) -> NDArray[np.bool_]:
    """Mask of points (n, 3) that their views (n,) show: in front of mirror and camera, and within the lens's range."""
    visible = np.array(np.isfinite(project_points(layout, view, points_in_rig).pixels).all(axis=1))
    for index in np.unique(view):
        in_view = view == index
        points = points_in_rig[in_view]
        pixels = layout.camera.project(points) if index == DIRECT else layout.project(points, index)
        visible[in_view] &= np.isfinite(pixels).all(axis=1)
    return visible


def _rigid_motion(a: Layout, b: Layout, points: _Points) -> tuple[FloatArray, FloatArray]:
    """Return the motion b_from_a (4, 4) that best aligns the projections, and the weights (n,) of the points in it.

    It starts from the motion that best aligns the points themselves.
    """
    view = points.view

    def project_in_b(points: FloatArray) -> tuple[FloatArray, FloatArray]:
        projected = project_points(b, view, points)
        return projected.pixels, projected.d_point

    pixels_in_a = project_points(a, view, points.in_a).pixels
    return best_motion(pixels_in_a, view, points.in_a, project_in_b, _nearest_motion(points))


def _nearest_motion(points: _Points) -> FloatArray:
    """Return the rigid motion b_from_a (4, 4) that aligns the points of A with the points of B by least squares."""
    centroid_a, centroid_b = points.in_a.mean(axis=0), points.in_b.mean(axis=0)
    rotation = Rotation.align_vectors(points.in_b - centroid_b, points.in_a - centroid_a)[0].as_matrix()
    return rigid(rotation, centroid_b - rotation @ centroid_a)


def best_motion(
    pixels_in_a: FloatArray,
    view: NDArray[np.int64],
    points_in_a: FloatArray,
    project_in_b: ProjectPoints,
    start: FloatArray,
    *,
    scaled: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Return the motion b_from_a (4, 4) with which B best projects points (n, 3) to A's pixels, and weights (n,).

    Weighted least squares of pixels by Gauss-Newton. Geman-McClure weights of the views' rms differences limit the
    effect of a moved mirror to its own view.

    Parameters
    ----------
    pixels_in_a
        Pixels (n, 2) at which A shows the points.
    view
        The view (n,) of each point.
    points_in_a
        Points (n, 3) in A's rig frame, mm.
    project_in_b
        B's projection of points in its own rig frame, each in its own view; NaN where B does not show one.
    start
        Motion (4, 4) to start from.
    scaled
        Whether B's scale is free, so the motion is a similarity.
    """
    b_from_a, weights = start, np.ones(len(pixels_in_a))
    lever_mm = float(np.linalg.norm(points_in_a - points_in_a.mean(axis=0), axis=1).max())
    for _ in range(MAX_STEPS):
        points_in_b = transform(b_from_a, points_in_a)
        pixels, d_point = project_in_b(points_in_b)
        residuals = pixels - pixels_in_a
        finite = np.isfinite(residuals).all(axis=1) & np.isfinite(d_point).all(axis=(1, 2))
        residuals[~finite], d_point[~finite] = 0.0, 0.0  # during iterations, points may lie behind a mirror
        weights = view_weights(residuals, view)
        root_weights = np.sqrt(weights)[:, None]
        columns = motion_jacobian(d_point, points_in_b, lever_mm, scaled=scaled)
        system = (root_weights[:, :, None] * columns).reshape(-1, columns.shape[2])
        step = np.linalg.lstsq(system, -(root_weights * residuals).ravel(), rcond=None)[0]
        rotation, centroid = Rotation.from_rotvec(step[:3] / lever_mm).as_matrix(), points_in_b.mean(axis=0)
        if scaled:
            rotation *= np.exp(step[6] / lever_mm)
        b_from_a = rigid(rotation, centroid + step[3:6] - rotation @ centroid) @ b_from_a
        if np.abs(step).max() < CONVERGED_MM:
            break
    return b_from_a, weights


def view_weights(residuals_px: FloatArray, view: NDArray[np.int64]) -> FloatArray:
    """Weights (n,) of points with differences (n, 2); all points of a view have the same weight."""
    views, row = np.unique(view, return_inverse=True)
    rms = np.array([np.sqrt(np.mean(residuals_px[view == index] ** 2)) for index in views])
    scale = OUTLIER_RATIO * max(float(np.median(rms)), ROUNDING_PX)
    return np.asarray((1.0 / (1.0 + (rms / scale) ** 2) ** 2)[row])


def motion_jacobian(d_point: FloatArray, points: FloatArray, lever_mm: float, *, scaled: bool = False) -> FloatArray:
    """Derivatives (n, 2, 6) of pixels with respect to a motion of their points (n, 3), px/mm; (n, 2, 7) with a scale.

    The first three columns rotate about the points' centroid, the next three shift, and the last scales about the
    centroid. Rotation and scale are in mm of displacement at the lever arm `lever_mm`.
    """
    from_centroid = (points - points.mean(axis=0)) / lever_mm
    d_rotation = np.cross(from_centroid[:, None, :], d_point)  # J (w x p) = w . (p x J)
    parts = [d_rotation, d_point]
    if scaled:
        parts.append(np.einsum("nij,nj->ni", d_point, from_centroid)[:, :, None])
    return np.concatenate(parts, axis=2)


def remove_motion(d_parameter: FloatArray, columns: FloatArray, weights: FloatArray) -> FloatArray:
    """Derivatives (n, 2, g) of differences with respect to parameters, with the motion (n, 2, 6 or 7) refitted."""
    root_weights = np.repeat(np.sqrt(weights), 2)[:, None]
    flat = d_parameter.reshape(-1, d_parameter.shape[-1])
    refit = np.linalg.lstsq(root_weights * columns.reshape(-1, columns.shape[-1]), root_weights * flat, rcond=None)[0]
    return d_parameter - columns @ refit
