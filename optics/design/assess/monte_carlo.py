"""Tolerance analysis by Monte Carlo: figures of many randomly perturbed devices of a design."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import harmonic_mean

import numpy as np
import shapely

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.as_built_views import BuiltViews, Polygons, built_views
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.perturbations import draw_perturbations, workmanship
from mirrorcam.optics.geometry.sub_images import fields_of_view
from mirrorcam.optics.geometry.tolerances import Tolerances

DEVICES = 200
ACCURACIES = (0.25, 0.5, 1.0, 2.0)
LOW, HIGH = 5.0, 95.0
CAUSES: dict[str, tuple[str, ...]] = {
    "mirror tilt": ("tilt_deg",),
    "mirror offset": ("offset_mm",),
    "sheet thickness": ("sheet_thickness_mm",),
    "camera offset": ("camera_offset_mm",),
    "camera turn": ("camera_turn_deg",),
    "camera itself": ("focal_percent", "centre_px", "distortion_mean", "distortion_sigma"),
}
UNITS = {
    "grid_error": "grid spacings",
    "baseline_x_mm": "mm",
    "baseline_y_mm": "mm",
    "pixel_efficiency": "of the sensor",
    "overlap_iou": "of the union",
    "usable_efficiency": "of the sensor",
    "fov_x_deg": "deg",
    "fov_y_deg": "deg",
    "off_sensor": "of the sub-images",
    "uncalibrated_error": "px",
    "misregistration": "px",
    "usable_window": "of the window",
}


@dataclass(frozen=True)
class Spread:
    """Distribution of a figure over devices: value of the design, median, and the range of 90 % of the devices."""

    nominal: float
    low: float
    median: float
    high: float
    unit: str


@dataclass(frozen=True)
class Study:
    """The tolerance analysis of a layout.

    Attributes
    ----------
    tolerances
        The tolerances of `spreads[1.0]`.
    devices
        Number of sampled devices.
    spreads
        Spread by accuracy, then by figure. The accuracy is a factor on the tolerances of printing and assembly; the
        camera's are not scaled.
    hidden
        Fraction of devices in which one mirror hides part of another from the camera, by accuracy.
    cause_fractions
        Mean square deviation from the design caused by one tolerance, as a fraction of the sum over causes, by cause,
        then by figure. For a figure with a linear dependence, it is the fraction of the variance.
    """

    tolerances: Tolerances
    devices: int
    spreads: dict[float, dict[str, Spread]]
    hidden: dict[float, float]
    cause_fractions: dict[str, dict[str, float]]


def study(
    layout: Layout, tolerances: Tolerances, depths_mm: Sequence[float], *, devices: int = DEVICES, seed: int = 0
) -> Study:
    """Sample devices at each accuracy and with each single cause, always from the same random numbers.

    Parameters
    ----------
    layout : the design.
    tolerances : standard deviations.
    depths_mm : working depths.
    devices : number of devices.
    seed : seed of the random generator.

    Raises
    ------
    InputError : views have no common region at a depth, or a sampled device is impossible, at any accuracy up to twice
        the tolerances.
    """
    reference = design_reference(layout, depths_mm)
    nominal = {name: float(values[0]) for name, values in reference.figures(reference.design).items()}
    spreads, hidden, squares = {}, {}, {}
    for accuracy in ACCURACIES:
        views = _sampled(layout, tolerances, devices, seed, accuracy)
        spreads[accuracy] = {
            name: _spread(name, nominal[name], values) for name, values in reference.figures(views).items()
        }
        hidden[accuracy] = float(views.hidden().mean())
    for cause, names in CAUSES.items():
        single = tolerances.only(*names)
        if single != Tolerances.none():
            figures = reference.figures(_sampled(layout, single, devices, seed))
            squares[cause] = {name: float(np.mean((figures[name] - nominal[name]) ** 2)) for name in nominal}
    return Study(tolerances, devices, spreads, hidden, _cause_fractions(squares))


def _sampled(layout: Layout, tolerances: Tolerances, devices: int, seed: int, accuracy: float = 1.0) -> BuiltViews:
    random = np.random.default_rng(seed)
    try:
        return built_views(layout, draw_perturbations(tolerances.times(accuracy), len(layout.mirrors), devices, random))
    except InputError as error:
        times = "" if accuracy == 1.0 else f", {accuracy:g} times that"
        raise InputError(f"tolerances {workmanship(tolerances)}{times}: {error}") from None


def _spread(name: str, nominal: float, values: FloatArray) -> Spread:
    low, median, high = (float(v) for v in np.percentile(values, [LOW, 50.0, HIGH]))
    return Spread(nominal, low, median, high, UNITS[re.sub(r"_[0-9.e+]+mm$", "", name)])


def _cause_fractions(squares: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    figures = next(iter(squares.values()), {})
    total = {name: sum(by_figure[name] for by_figure in squares.values()) for name in figures}
    return {
        cause: {name: value / total[name] if total[name] > 0 else 0.0 for name, value in by_figure.items()}
        for cause, by_figure in squares.items()
    }


@dataclass(frozen=True)
class Probe:
    """Points of the scene at which the projection of a device is compared with the design's.

    The region that all views of the design share at a depth is divided into triangles. Each triangle has three points
    with equal weights, which integrate squares of affine functions exactly (Strang and Fix, degree 2).
    """

    depth_mm: float
    points_mm: FloatArray  # (q, 3)
    weights: FloatArray  # (q,), sum 1
    pixels: FloatArray  # (m, q, 2), predicted by the design
    points_in_plane_mm: FloatArray  # (m, q, 2), those pixels mapped back to the plane: the points up to rounding
    px_per_mm: float  # on the plane at this depth, for the median sub-image


@dataclass(frozen=True)
class DesignReference:
    """A design and the points at which devices are compared with it.

    Attributes
    ----------
    design
        Views of the design as a single device (n = 1).
    probes
        Comparison points, one `Probe` per working depth.
    reference_mm
        Depth of the reference plane of decoding, midway in disparity between the working depths.
    window
        Part of the reference plane in decoded views: the bounding box of the region common to all views of the design.
    """

    design: BuiltViews
    probes: tuple[Probe, ...]
    reference_mm: float
    window: shapely.Polygon

    def figures(self, views: BuiltViews) -> dict[str, FloatArray]:
        """The figures (n,) of the devices, in the order of a report.

        Grid error, baselines, pixel efficiency, overlap, usable efficiency (except for a pinhole) and field of view (at
        the farthest depth) are as in `layout_metrics`, but in the view axes of the holder, where moving the camera
        leaves the plane at a depth fixed. In addition:

        - `off_sensor`: fraction of the sub-images outside the sensor.
        - `uncalibrated_error`: distance between the pixel of a scene point and the pixel predicted by the design, as
          in decoding without calibration; RMS over views and the region that all views of the design share.
        - `misregistration`: the part of this error that differs between views, which blurs refocused pictures and
          falsifies depth. It is the point on the plane to which the design maps the pixel, minus the mean over views,
          in px of a decoded view.
        - `usable_window`: fraction of `window` that all views of the device see, after calibration.

        Light that one mirror blocks from another is not subtracted.
        """
        figures = _grids(views)
        for depth_mm in (probe.depth_mm for probe in self.probes):
            regions, footprints = views.common_regions(depth_mm)
            unions = shapely.area(shapely.union_all(footprints, axis=1))
            figures[f"pixel_efficiency_{depth_mm:g}mm"] = views.pixel_efficiency(regions, depth_mm)
            figures[f"overlap_iou_{depth_mm:g}mm"] = shapely.area(regions) / np.where(unions > 0, unions, 1.0)
            if depth_mm == max(probe.depth_mm for probe in self.probes):
                fields = _fields_of_view_deg(views, regions, depth_mm)
        figures |= self._usable(views)
        figures |= {f"fov_{axis}_deg": field for axis, field in zip("xy", fields.T, strict=True)}
        on_sensor, total = (shapely.area(parts).sum(axis=1) for parts in (views.sub_images, views.usable))
        figures["off_sensor"] = np.maximum(1.0 - on_sensor / total, 0.0)
        for probe in self.probes:
            error, misregistration = _decode_errors_px(views, self.design, probe)
            figures[f"uncalibrated_error_{probe.depth_mm:g}mm"] = error
            figures[f"misregistration_{probe.depth_mm:g}mm"] = misregistration
        regions, _ = views.common_regions(self.reference_mm)
        figures["usable_window"] = shapely.area(shapely.intersection(regions, self.window)) / self.window.area
        return figures

    def _usable(self, views: BuiltViews) -> dict[str, FloatArray]:
        """Pixel efficiency (n,) of unvignetted pixels; empty for a pinhole."""
        pupil = views.layout.camera.pupil
        if pupil.radius_mm == 0.0:
            return {}
        unvignetted, depths_mm = views.unvignetted(pupil), [probe.depth_mm for probe in self.probes]
        return {
            f"usable_efficiency_{depth_mm:g}mm": unvignetted.pixel_efficiency(
                unvignetted.common_regions(depth_mm)[0], depth_mm
            )
            for depth_mm in depths_mm
        }


def design_reference(layout: Layout, depths_mm: Sequence[float]) -> DesignReference:
    """The reference of a design at working depths, mm. Raises InputError if its views have no common region."""
    reference_mm = harmonic_mean(depths_mm)
    for depth_mm in (*depths_mm, reference_mm):
        if fields_of_view(layout).common_region(depth_mm)[0].is_empty:
            raise InputError(
                f"the views have no common region at {depth_mm:g} mm, expected a layout whose views overlap"
            )
    exact = draw_perturbations(Tolerances.none(), len(layout.mirrors), 1, np.random.default_rng(0))
    design = built_views(layout, exact)
    return DesignReference(
        design=design,
        probes=tuple(_probe(design, depth_mm) for depth_mm in depths_mm),
        reference_mm=reference_mm,
        window=shapely.envelope(design.common_regions(reference_mm)[0][0]),
    )


def _probe(design: BuiltViews, depth_mm: float) -> Probe:
    regions, _ = design.common_regions(depth_mm)
    corners = shapely.get_coordinates(regions[0])[:-1]
    triangles = np.stack([np.broadcast_to(corners[0], corners[1:-1].shape), corners[1:-1], corners[2:]], axis=1)
    sides = triangles[:, 1:] - triangles[:, :1]
    areas = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]) / 2.0
    barycentric = (np.full((3, 3), 1.0) + 3.0 * np.eye(3)) / 6.0
    xy = (barycentric @ triangles).reshape(-1, 2)
    points = np.column_stack([xy, np.full(len(xy), depth_mm)])
    mirrors = np.arange(design.sub_images.shape[1])[:, None]
    pixels = design.pixels(points, np.array(0), mirrors)
    return Probe(
        depth_mm=depth_mm,
        points_mm=points,
        weights=np.repeat(areas / areas.sum() / 3.0, 3),
        pixels=pixels,
        points_in_plane_mm=_points_at_depth(design, pixels, depth_mm),
        px_per_mm=float(np.median(np.sqrt(design.pixel_count(regions, depth_mm)[0] / areas.sum()))),
    )


def _grids(views: BuiltViews) -> dict[str, FloatArray]:
    """Grid error and baselines (n,); see `layout_metrics.fitted_grid` for a single layout."""
    arrangement = views.layout.arrangement
    grid, spacings = arrangement.fitted(views.centres_mm)
    has_extent = arrangement.extent > 0
    errors = np.sqrt(np.mean(np.sum((views.centres_mm - grid) ** 2, axis=-1), axis=1))
    baselines_mm = np.abs(spacings) * arrangement.extent
    figures = {"grid_error": errors / np.exp(np.mean(np.log(np.abs(spacings[:, has_extent])), axis=1))}
    return figures | {f"baseline_{name}_mm": baselines_mm[:, k] for k, name in enumerate("xy") if has_extent[k]}


def _fields_of_view_deg(views: BuiltViews, regions: Polygons, depth_mm: float) -> FloatArray:
    """Angles (n, 2) that regions (n,) at a depth subtend at the mean virtual centre; 0 for empty regions."""
    points, region_index = shapely.get_coordinates(regions, return_index=True)
    centres = views.centres_mm.mean(axis=1)[region_index]
    angles = np.degrees(np.arctan2(points - centres[:, :2], depth_mm - centres[:, 2:]))
    low, high = (np.full((len(regions), 2), start) for start in (np.inf, -np.inf))
    np.minimum.at(low, region_index, angles)
    np.maximum.at(high, region_index, angles)
    return np.maximum(high - low, 0.0)


def _decode_errors_px(views: BuiltViews, design: BuiltViews, probe: Probe) -> tuple[FloatArray, FloatArray]:
    """`uncalibrated_error` and `misregistration` (n,) at one depth, without points beyond the lens model."""
    devices, mirrors = np.arange(len(views.pupils_mm))[:, None, None], np.arange(views.centres_mm.shape[1])[:, None]
    pixels = views.pixels(probe.points_mm, devices, mirrors)
    error = _rms(pixels - probe.pixels, probe.weights)
    shifts = _points_at_depth(design, pixels, probe.depth_mm) - probe.points_in_plane_mm
    return error, probe.px_per_mm * _rms(shifts - _mean_over_views(shifts), probe.weights)


def _points_at_depth(design: BuiltViews, pixels: FloatArray, depth_mm: float) -> FloatArray:
    """Points (..., m, q, 2), mm, on the plane at a depth seen by pixels of the design's sub-images."""
    normalized = design.cameras[0].normalized_from_pixels(pixels)
    return design.points_at_depth(normalized, np.array(0), np.arange(design.centres_mm.shape[1])[:, None], depth_mm)


def _rms(errors: FloatArray, weights: FloatArray) -> FloatArray:
    """RMS length (n,) of errors (n, m, q, 2) with weights (q,), ignoring NaN."""
    squares = np.sum(errors**2, axis=-1)
    valid = weights * np.isfinite(squares)
    return np.sqrt(np.sum(valid * np.nan_to_num(squares), axis=(1, 2)) / np.sum(valid, axis=(1, 2)))


def _mean_over_views(errors: FloatArray) -> FloatArray:
    """Mean (n, 1, q, 2) of errors (n, m, q, 2), ignoring NaN; 0 if all are NaN."""
    valid = np.isfinite(errors)
    return np.where(valid, errors, 0.0).sum(axis=1, keepdims=True) / np.maximum(valid.sum(axis=1, keepdims=True), 1)
