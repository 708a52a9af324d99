"""Figures of merit of a layout. They share no code with the constraints of the optimiser."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from scipy.optimize import brentq
from shapely import Polygon, union_all

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.design.assess.chief_rays import apparent_offset_mm
from mirrorcam.optics.design.assess.depth_sigma import GRID_POINTS, depth_sigma_metrics
from mirrorcam.optics.design.assess.focus import focus_metrics
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror_gaps import area_mm2, edges_mm, smallest_gap_mm
from mirrorcam.optics.geometry.sub_images import FieldsOfView, fields_of_view, vertices

MIN_RELATIVE_EFFICIENCY = 0.5
"""Views overlap at depths where the pixel efficiency is at least this fraction of that at the best working depth."""

MAX_DEPTH_MM = 1e5
"""Far limit of the search for the depth range: for a webcam, 100 m is practically infinity."""

MIN_DEPTH_MM = 1.0
"""Near limit of the search for the depth range, where mirrors fold light past the pupil."""

DEPTH_STEP, CROSSING_PRECISION = 1.15, 1e-4
SMALL_SHIFT_PX = 0.25


def fitted_grid(layout: Layout) -> tuple[FloatArray, FloatArray]:
    """Best-fitting grid or pattern (rows, cols, 3) to the virtual centres in view axes, and its two spacings, mm.

    It is aligned with the view axes; its origin (3,) and two spacings are fitted by least squares. The spacing along an
    axis with a single row or column is 0.
    """
    grid, spacings = layout.arrangement.fitted(layout.virtual_centres_in_view_mm.reshape(-1, 3))
    return grid.reshape(layout.rows, layout.cols, 3), spacings


def grid_error(layout: Layout) -> float:
    """RMS distance of virtual centres to the best-fitting grid, divided by the geometric mean of its spacings.

    Raises InputError if a spacing is 0: coincident views do not form a grid.
    """
    grid, spacings = fitted_grid(layout)
    if layout.rows * layout.cols < 2:
        return 0.0
    distances = np.linalg.norm(layout.virtual_centres_in_view_mm - grid, axis=-1)
    nonzero = np.abs(spacings[layout.arrangement.extent > 0])
    if nonzero.min() < 1e-6:
        raise InputError(f"virtual centres are {nonzero.min():.2g} mm apart along an axis of the grid, expected a grid")
    return float(np.sqrt(np.mean(distances**2)) / np.exp(np.mean(np.log(nonzero))))


def _grid_error(layout: Layout) -> Metric:
    try:
        return Metric(value=grid_error(layout), unit="grid spacings")
    except InputError as error:
        return Metric(value=np.nan, unit="grid spacings", reason=str(error))


def depth_range_mm(views: FieldsOfView, depths_mm: Sequence[float]) -> tuple[float, float] | None:
    """Nearest and farthest depth, mm, between which the views overlap; None if they overlap at none of `depths_mm`.

    As for a depth of field, this is the full width at half maximum: contiguous depths around the best working depth
    with at least half its pixel efficiency. It measures how quickly the overlap is lost, not how good it is. The limits
    are bracketed in steps of 15 %, then solved to a relative 1e-4 by Brent's method. A farthest depth of `MAX_DEPTH_MM`
    stands for infinity.
    """

    @cache
    def efficiency(depth_mm: float) -> float:
        return views.pixel_efficiency(views.common_region(depth_mm)[0], depth_mm)

    nearest_mm = farthest_mm = max(depths_mm, key=efficiency)
    best = efficiency(nearest_mm)
    if best <= 0.0:
        return None

    def margin(depth_mm: float) -> float:
        return efficiency(depth_mm) - MIN_RELATIVE_EFFICIENCY * best

    def crossing(inside_mm: float, outside_mm: float) -> float:
        return float(brentq(margin, inside_mm, outside_mm, rtol=CROSSING_PRECISION, xtol=CROSSING_PRECISION))

    while farthest_mm < MAX_DEPTH_MM:
        farther_mm = min(farthest_mm * DEPTH_STEP, MAX_DEPTH_MM)
        if margin(farther_mm) < 0.0:
            farthest_mm = crossing(farthest_mm, farther_mm)
            break
        farthest_mm = farther_mm
    limit_mm = max(views.mirror_depth_mm * (1.0 + 1e-6), MIN_DEPTH_MM)
    while nearest_mm > limit_mm:
        nearer_mm = max(nearest_mm / DEPTH_STEP, limit_mm)
        if margin(nearer_mm) < 0.0:
            nearest_mm = crossing(nearest_mm, nearer_mm)
            break
        nearest_mm = nearer_mm
    return nearest_mm, farthest_mm


def _overlap(views: FieldsOfView, depth_mm: float) -> dict[str, Metric]:
    region, footprints = views.common_region(depth_mm)
    union = union_all(footprints).area
    efficiency, iou = views.pixel_efficiency(region, depth_mm), region.area / union if union else 0.0
    return {
        f"pixel_efficiency_{depth_mm:g}mm": Metric(value=efficiency, unit="of the sensor", lower_is_better=False),
        f"overlap_iou_{depth_mm:g}mm": Metric(value=iou, unit="of the union", lower_is_better=False),
    }


def _usable(views: FieldsOfView, pinhole: FieldsOfView, depths_mm: Sequence[float]) -> dict[str, Metric]:
    """Pixel efficiency of unvignetted pixels, and their fraction of the sub-images; empty for a pinhole."""
    camera = views.layout.camera
    if camera.aperture_mm == 0.0:
        return {}
    unvignetted_px, all_px = (sum(_area_px(camera, part) for part in v.sub_images) for v in (views, pinhole))
    metrics = {"whole_pupil": Metric(value=unvignetted_px / all_px, unit="of the views", lower_is_better=False)}
    for depth_mm in depths_mm:
        efficiency = views.pixel_efficiency(views.common_region(depth_mm)[0], depth_mm)
        metrics[f"usable_efficiency_{depth_mm:g}mm"] = Metric(
            value=efficiency, unit="of the sensor", lower_is_better=False
        )
    return metrics


def _area_px(camera: Camera, normalized: Polygon) -> float:
    """Area, px^2, of a polygon in normalized coordinates, with distorted corners and straight edges."""
    return 0.0 if normalized.is_empty else Polygon(camera.pixels_from_normalized(vertices(normalized))).area


def _field_of_view(views: FieldsOfView, depth_mm: float) -> dict[str, Metric]:
    """Horizontal and vertical angle that the common region at a depth subtends at the mean virtual centre."""
    region, _ = views.common_region(depth_mm)
    angles = np.zeros(2)
    if not region.is_empty:
        x, y, z = views.layout.virtual_centres_in_view_mm.mean(axis=(0, 1))
        angles = np.ptp(np.degrees(np.arctan2(vertices(region) - [x, y], depth_mm - z)), axis=0)
    return {
        f"fov_{axis}_deg": Metric(value=float(angle), unit="deg", lower_is_better=False)
        for axis, angle in zip("xy", angles, strict=True)
    }


def _depth_range(views: FieldsOfView, depths_mm: Sequence[float]) -> dict[str, Metric]:
    """Metrics of the depth range; empty if the views have no common region at any working depth."""
    limits = depth_range_mm(views, depths_mm)
    if limits is None:
        return {}
    nearest_mm, farthest_mm = limits
    return {
        "depth_nearest_mm": Metric(value=nearest_mm, unit="mm"),
        "depth_farthest_mm": Metric(
            value=farthest_mm, unit="mm" if farthest_mm < MAX_DEPTH_MM else "mm or more", lower_is_better=False
        ),
    }


def _disparities(layout: Layout, depths_mm: Sequence[float]) -> dict[str, Metric]:
    """Disparity and depth resolution at each depth, for the central view at the resolution of the sensor.

    One view step b shifts a point at the distance D from the central view by f b / D px relative to infinity
    (docs/conventions.md, with the reference plane at infinity); the disparity between two depths is the difference of
    their shifts. A shift of p px between the outermost views, B apart, corresponds to a change of depth of
    p D^2 / (f B), given for the axis with the better resolution.
    """
    _, spacings = fitted_grid(layout)
    steps_mm = np.abs(spacings)
    extent = layout.arrangement.extent
    focal_px = np.array([layout.camera.fx_px, layout.camera.fy_px])
    central_z_mm = float(layout.virtual_centres_in_view_mm.reshape(-1, 3)[layout.central_index, 2])
    best = float((focal_px * steps_mm * extent).max())
    figures = {}
    for depth_mm in depths_mm:
        distance_mm = depth_mm - central_z_mm
        for axis, size, shift_px in zip("st", extent, focal_px * steps_mm / distance_mm, strict=True):
            if size > 0:
                figures[f"disparity_{axis}_{depth_mm:g}mm"] = Metric(
                    value=float(shift_px), unit="px per view", lower_is_better=False
                )
        if best > 0.0:
            for name, shift in (("", 1.0), ("_fine", SMALL_SHIFT_PX)):
                figures[f"depth_resolution{name}_{depth_mm:g}mm"] = Metric(
                    value=shift * distance_mm**2 / best, unit=f"mm for {shift:g} px"
                )
    return figures


def _sizes(layout: Layout) -> dict[str, Metric]:
    edges = np.concatenate([edges_mm(mirror) for mirror in layout.mirrors])
    areas = [area_mm2(mirror) for mirror in layout.mirrors]
    sizes = {
        "shortest_edge_mm": Metric(value=float(edges.min()), unit="mm", lower_is_better=False),
        "longest_edge_mm": Metric(value=float(edges.max()), unit="mm"),
        "smallest_area_mm2": Metric(value=min(areas), unit="mm²", lower_is_better=False),
        "largest_area_mm2": Metric(value=max(areas), unit="mm²"),
    }
    if len(layout.mirrors) > 1:
        sizes["smallest_gap_mm"] = Metric(value=smallest_gap_mm(layout.mirrors), unit="mm", lower_is_better=False)
    return sizes


def _plate_offsets(layout: Layout, depths_mm: Sequence[float]) -> dict[str, Metric]:
    """Ray offsets between second-surface mirrors and their apparent mirrors; empty without second-surface mirrors."""
    if not any(mirror.is_second_surface for mirror in layout.mirrors):
        return {}
    offset_mm = max(apparent_offset_mm(mirror) for mirror in layout.mirrors)
    nearest_mm = min(depths_mm) - float(layout.virtual_centres_in_view_mm[..., 2].max())
    focal_px = max(layout.camera.fx_px, layout.camera.fy_px)
    return {
        "slab_stray_mm": Metric(value=offset_mm, unit="mm"),
        "slab_stray_px": Metric(value=focal_px * offset_mm / nearest_mm, unit="px"),
    }


def evaluate(
    layout: Layout,
    depths_mm: Sequence[float],
    unvignetted: FieldsOfView | None = None,
    *,
    grid_points: int = GRID_POINTS,
) -> dict[str, Metric]:
    """Figures of merit of a layout, as defined in docs/conventions.md.

    Parameters
    ----------
    layout : layout of any kind.
    depths_mm : working depths; the field of view is measured at the farthest.
    unvignetted : the layout's `fields_of_view` for its camera's pupil, if already computed.
    grid_points : points along each side of the grid over which the standard deviation of depth is averaged.

    Returns
    -------
    Figures by name, as in `metrics.json`.

    Raises
    ------
    InputError : a depth is nearer than the mirrors.
    """
    views = fields_of_view(layout)
    usable = fields_of_view(layout, layout.camera.pupil) if unvignetted is None else unvignetted
    metrics = {"grid_error": _grid_error(layout)}
    for depth_mm in depths_mm:
        metrics |= _overlap(views, depth_mm)
    metrics |= _usable(usable, views, depths_mm)
    metrics |= _field_of_view(views, max(depths_mm))
    _, spacings = fitted_grid(layout)
    for axis, baseline_mm in zip("xy", np.abs(spacings) * layout.arrangement.extent, strict=True):
        metrics[f"baseline_{axis}_mm"] = Metric(value=float(baseline_mm), unit="mm", lower_is_better=False)
    metrics |= _depth_range(views, depths_mm)
    metrics |= focus_metrics(views, depths_mm)
    metrics |= _disparities(layout, depths_mm)
    metrics |= depth_sigma_metrics(usable, depths_mm, grid_points)
    metrics |= _sizes(layout)
    return metrics | _plate_offsets(layout, depths_mm)
