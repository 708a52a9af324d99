"""What a maker can expect: the figures of many devices that stray from a design, drawn at random (Monte Carlo)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import harmonic_mean

import numpy as np
import shapely

from optics.as_built import draw_strays, workmanship
from optics.design.built_views import BuiltViews, Polygons, built_views
from optics.design.overlap import views_of
from optics.layout import Layout
from optics.tolerances import Tolerances
from optics.values import FloatArray, InputError

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
    "fov_x_deg": "deg",
    "fov_y_deg": "deg",
    "off_sensor": "of the sub-images",
    "uncalibrated_error": "px",
    "misregistration": "px",
    "usable_window": "of the window",
}


@dataclass(frozen=True)
class Spread:
    """One figure over many devices: of the design, then the median and the range that 90 % of the devices lie in."""

    nominal: float
    low: float
    median: float
    high: float
    unit: str


@dataclass(frozen=True)
class Study:
    """What becomes of a layout at given tolerances.

    Attributes:
        tolerances: those that `spreads[1.0]` holds for.
        devices: how many were drawn.
        spreads: by accuracy (a factor on what printing and assembling decides; the camera's own tolerances stay), then
            by figure.
        hidden: by accuracy, the part of the devices in which a mirror hides a part of another from the camera.
        shares: by cause, then by figure: the mean square departure from the design with that tolerance alone, as part
            of the sum over causes. Of a figure that departs in proportion, that is the share of its variance.
    """

    tolerances: Tolerances
    devices: int
    spreads: dict[float, dict[str, Spread]]
    hidden: dict[float, float]
    shares: dict[str, dict[str, float]]


@dataclass(frozen=True)
class _Probe:
    """Points of the scene in which the projection of a device is held against that of the design.

    Triangle by triangle of the region that all views of the design share at a depth, the three points and equal
    weights that integrate squares of affine functions over it exactly (Strang and Fix, degree 2).
    """

    depth_mm: float
    points: FloatArray  # (q, 3) in the holder's frame
    weights: FloatArray  # (q,), sum 1
    pixels: FloatArray  # (m, q, 2) by way of the design
    landings: FloatArray  # (m, q, 2) where the design takes those pixels to lie on the plane: the points, rounded
    px_per_mm: float  # of the median sub-image, on the plane at this depth


def study(
    layout: Layout, tolerances: Tolerances, depths_mm: Sequence[float], *, devices: int = DEVICES, seed: int = 0
) -> Study:
    """Draw devices at each accuracy and with each cause alone, always the same ones but for their size.

    Raises InputError where views share nothing at a depth, or where what is drawn could not be built: also at the
    coarsest accuracy, twice the tolerances.
    """
    reference_mm = harmonic_mean(depths_mm)
    for depth_mm in (*depths_mm, reference_mm):
        if views_of(layout).common_region(depth_mm)[0].is_empty:
            raise InputError(f"the views share nothing at {depth_mm:g} mm, expected a layout whose views overlap")
    design = _drawn(layout, Tolerances.none(), 1, seed)
    probes = [_probe(design, depth_mm) for depth_mm in depths_mm]
    window = shapely.envelope(design.common_regions(reference_mm)[0][0])

    def figures(views: BuiltViews) -> dict[str, FloatArray]:
        return _figures(views, design, probes, reference_mm, window)

    nominal = {name: float(values[0]) for name, values in figures(design).items()}
    spreads, hidden, squares = {}, {}, {}
    for accuracy in ACCURACIES:
        views = _drawn(layout, tolerances, devices, seed, accuracy)
        spreads[accuracy] = {name: _spread(name, nominal[name], values) for name, values in figures(views).items()}
        hidden[accuracy] = float(views.hidden().mean())
    for cause, names in CAUSES.items():
        alone = tolerances.only(*names)
        if alone != Tolerances.none():
            drawn = figures(_drawn(layout, alone, devices, seed))
            squares[cause] = {name: float(np.mean((drawn[name] - nominal[name]) ** 2)) for name in nominal}
    return Study(tolerances, devices, spreads, hidden, _shares(squares))


def _drawn(layout: Layout, tolerances: Tolerances, devices: int, seed: int, accuracy: float = 1.0) -> BuiltViews:
    random = np.random.default_rng(seed)
    try:
        return built_views(layout, draw_strays(tolerances.times(accuracy), len(layout.mirrors), devices, random))
    except InputError as error:
        times = "" if accuracy == 1.0 else f", {accuracy:g} times that"
        raise InputError(f"tolerances {workmanship(tolerances)}{times}: {error}") from None


def _spread(name: str, nominal: float, values: FloatArray) -> Spread:
    low, median, high = (float(v) for v in np.percentile(values, [LOW, 50.0, HIGH]))
    return Spread(nominal, low, median, high, UNITS[re.sub(r"_[0-9.e+]+mm$", "", name)])


def _shares(squares: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    figures = next(iter(squares.values()), {})
    total = {name: sum(of_cause[name] for of_cause in squares.values()) for name in figures}
    return {
        cause: {name: value / total[name] if total[name] > 0 else 0.0 for name, value in of_cause.items()}
        for cause, of_cause in squares.items()
    }


def _probe(design: BuiltViews, depth_mm: float) -> _Probe:
    regions, _ = design.common_regions(depth_mm)
    corners = shapely.get_coordinates(regions[0])[:-1]
    triangles = np.stack([np.broadcast_to(corners[0], corners[1:-1].shape), corners[1:-1], corners[2:]], axis=1)
    sides = triangles[:, 1:] - triangles[:, :1]
    areas = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]) / 2.0
    inside = (np.full((3, 3), 1.0) + 3.0 * np.eye(3)) / 6.0
    across = (inside @ triangles).reshape(-1, 2)
    points = np.stack([across[:, 0], np.full(len(across), depth_mm), across[:, 1]], axis=1)
    mirrors = np.arange(design.sub_images.shape[1])[:, None]
    pixels = design.pixels(points, np.array(0), mirrors)
    return _Probe(
        depth_mm=depth_mm,
        points=points,
        weights=np.repeat(areas / areas.sum() / 3.0, 3),
        pixels=pixels,
        landings=_landings(design, pixels, depth_mm),
        px_per_mm=float(np.median(np.sqrt(design.seen_px(regions, depth_mm)[0] / areas.sum()))),
    )


def _figures(
    views: BuiltViews, design: BuiltViews, probes: Sequence[_Probe], reference_mm: float, window: shapely.Polygon
) -> dict[str, FloatArray]:
    """Every figure (n,) of the devices, in the order of a report.

    As those of `optics.design.metrics`, but in the frame of the holder, whose planes y = depth do not move when the
    camera does: grid error, pixel efficiency, overlap, field of view (at the farthest depth) and baselines. Besides:

    - `off_sensor`: part of the mirrors' pictures that falls beside the sensor.
    - `uncalibrated_error`: who decodes with the design instead of calibrating looks for a point of the scene so far
      from its pixel; rms over the region that all views of the design share, and over views.
    - `misregistration`: what of that differs from view to view, and so blurs a refocused picture and falsifies depth:
      where the design takes the pixel to lie on the plane, less the mean over views; in px of a decoded view.
    - `usable_window`: after calibration, the part of the window of the decoded views (the box around what all views of
      the design share, midway in disparity between the depths) that all views of the device see.

    Light that one mirror takes from another is not subtracted.
    """
    sensor_px = views.layout.camera.width_px * views.layout.camera.height_px
    figures = _grids(views)
    for depth_mm in (probe.depth_mm for probe in probes):
        regions, footprints = views.common_regions(depth_mm)
        unions = shapely.area(shapely.union_all(footprints, axis=1))
        figures[f"pixel_efficiency_{depth_mm:g}mm"] = views.seen_px(regions, depth_mm).sum(axis=1) / sensor_px
        figures[f"overlap_iou_{depth_mm:g}mm"] = shapely.area(regions) / np.where(unions > 0, unions, 1.0)
        if depth_mm == max(probe.depth_mm for probe in probes):
            fields = _fields_of_view_deg(views, regions, depth_mm)
    figures |= {f"fov_{axis}_deg": field for axis, field in zip("xy", fields.T, strict=True)}
    shown, pictured = (shapely.area(parts).sum(axis=1) for parts in (views.sub_images, views.shown))
    figures["off_sensor"] = np.maximum(1.0 - shown / pictured, 0.0)
    for probe in probes:
        error, misregistration = _decode_errors_px(views, design, probe)
        figures[f"uncalibrated_error_{probe.depth_mm:g}mm"] = error
        figures[f"misregistration_{probe.depth_mm:g}mm"] = misregistration
    regions, _ = views.common_regions(reference_mm)
    figures["usable_window"] = shapely.area(shapely.intersection(regions, window)) / window.area
    return figures


def _grids(views: BuiltViews) -> dict[str, FloatArray]:
    """Grid error and baselines (n,), as `optics.design.metrics.fitted_grid` has them of one layout."""
    rows, cols = views.layout.rows, views.layout.cols
    centres = (views.centres @ views.layout.view_from_rig.T).reshape(-1, rows, cols, 3)
    left = centres - centres.mean(axis=(1, 2), keepdims=True)
    spacings = {}
    for name, axis, count in (("x", 0, cols), ("y", 1, rows)):
        steps = np.arange(count) - (count - 1) / 2.0
        if count > 1:
            spacing = left[..., axis].mean(axis=1 + axis) @ steps / (steps @ steps)
            left[..., axis] -= spacing[:, None, None] * (steps[None, :] if axis == 0 else steps[:, None])
            spacings[name] = np.abs(spacing)
    errors = np.sqrt(np.mean(np.sum(left**2, axis=-1), axis=(1, 2)))
    figures = {"grid_error": errors / np.exp(np.mean(np.log([*spacings.values()]), axis=0))}
    counts = {"x": cols, "y": rows}
    return figures | {f"baseline_{name}_mm": value * (counts[name] - 1) for name, value in spacings.items()}


def _fields_of_view_deg(views: BuiltViews, regions: Polygons, depth_mm: float) -> FloatArray:
    """Angles (n, 2) that regions (n,) of the plane y = depth span at the mean virtual centre; 0 of empty ones."""
    points, of = shapely.get_coordinates(regions, return_index=True)
    middles = views.centres.mean(axis=1)[of]
    angles = np.degrees(np.arctan2(points - middles[:, [0, 2]], (depth_mm - middles[:, 1])[:, None]))
    low, high = (np.full((len(regions), 2), start) for start in (np.inf, -np.inf))
    np.minimum.at(low, of, angles)
    np.maximum.at(high, of, angles)
    return np.maximum(high - low, 0.0)


def _decode_errors_px(views: BuiltViews, design: BuiltViews, probe: _Probe) -> tuple[FloatArray, FloatArray]:
    """`uncalibrated_error` and `misregistration` (n,) at one depth, without points that a lens model cannot see."""
    devices, mirrors = np.arange(len(views.pupils))[:, None, None], np.arange(views.centres.shape[1])[:, None]
    pixels = views.pixels(probe.points, devices, mirrors)
    error = _rms(pixels - probe.pixels, probe.weights)
    taken = _landings(design, pixels, probe.depth_mm) - probe.landings
    return error, probe.px_per_mm * _rms(taken - np.nanmean(taken, axis=1, keepdims=True), probe.weights)


def _landings(design: BuiltViews, pixels: FloatArray, depth_mm: float) -> FloatArray:
    """Where the design takes pixels (..., m, q, 2) of its sub-images to lie on the plane y = depth, in (x, z)."""
    normalized = design.cameras[0].normalized_from_pixels(pixels)
    return design.landing(normalized, np.array(0), np.arange(design.centres.shape[1])[:, None], depth_mm)


def _rms(errors: FloatArray, weights: FloatArray) -> FloatArray:
    """Root mean square length (n,) of errors (n, m, q, 2) at weights (q,), of those that are numbers."""
    squares = np.sum(errors**2, axis=-1)
    known = weights * np.isfinite(squares)
    return np.sqrt(np.sum(known * np.nan_to_num(squares), axis=(1, 2)) / np.sum(known, axis=(1, 2)))
