"""What a layout is worth, measured by polygon clipping. Shares no code with the constraints of the optimiser."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy.optimize import nnls
from shapely import Polygon, intersection_all, union_all

from optics.camera import Camera
from optics.layout import Layout
from optics.mirror import Mirror
from optics.values import FloatArray, InputError, Metric

POINTS_PER_EDGE = 32


def _subdivided(polygon: FloatArray, per_edge: int = POINTS_PER_EDGE) -> FloatArray:
    along = np.linspace(0.0, 1.0, per_edge, endpoint=False)[None, :, None]
    following = np.roll(polygon, -1, axis=0)
    return (polygon[:, None] * (1.0 - along) + following[:, None] * along).reshape(-1, 2)


def _vertices(polygon: Polygon) -> FloatArray:
    return np.array(polygon.exterior.coords)[:-1]


def sensor_polygon(camera: Camera) -> Polygon:
    """The sensor, out to the edges of its outermost pixels, in normalized (undistorted) coordinates."""
    w, h = camera.width_px - 0.5, camera.height_px - 0.5
    border = np.array([[-0.5, -0.5], [w, -0.5], [w, h], [-0.5, h]])
    if camera.distortion.any():
        border = _subdivided(border)
    normalized = camera.normalized_from_pixels(border)
    if not np.isfinite(normalized).all():
        raise InputError(f"camera {camera.name}: distortion {camera.distortion.tolist()} folds inside the sensor")
    return Polygon(normalized)


def sub_images(layout: Layout) -> list[Polygon]:
    """Each mirror's outline in normalized coordinates, as far as the sensor sees it."""
    sensor = sensor_polygon(layout.camera)
    return [sensor.intersection(Polygon(mirror.outline_normalized)) for mirror in layout.mirrors]


def _clip_forward(polygon: FloatArray, slope: FloatArray) -> FloatArray:
    """The part of a convex polygon (n, 2) whose rays (u, v, 1) have slope . ray > 0: those that head for the scene."""
    heights = polygon @ slope[:2] + slope[2] - 1e-6
    kept: list[FloatArray] = []
    for k in range(len(polygon)):
        here, following = heights[k - 1], heights[k]
        if (here > 0) != (following > 0):
            kept.append(polygon[k - 1] + (polygon[k] - polygon[k - 1]) * here / (here - following))
        if following > 0:
            kept.append(polygon[k])
    return np.array(kept).reshape(-1, 2)


def footprint(mirror: Mirror, sub_image: Polygon, depth_mm: float) -> Polygon:
    """What one view sees of the plane y_rig = depth_mm: a polygon in (x_rig, z_rig), mm."""
    if sub_image.is_empty:
        return Polygon()
    forward = _clip_forward(_vertices(sub_image), mirror.reflection[1])
    if len(forward) < 3:
        return Polygon()
    rays = np.column_stack([forward, np.ones(len(forward))])
    leaving = mirror.cut(forward)
    directions = rays @ mirror.reflection
    steps = (depth_mm - leaving[:, 1]) / directions[:, 1]
    return Polygon((leaving + steps[:, None] * directions)[:, [0, 2]])


def common_region(layout: Layout, depth_mm: float) -> tuple[Polygon, list[Polygon]]:
    """The region of the plane y_rig = depth_mm that all views see, and what each view sees; polygons in (x, z), mm.

    The region is empty where there is none. Raises InputError for a depth nearer than the mirrors.
    """
    reach_mm = max(float(mirror.outline_in_rig_mm[:, 1].max()) for mirror in layout.mirrors)
    if depth_mm <= reach_mm:
        raise InputError(f"depth {depth_mm:g} mm is nearer than the mirrors, which reach {reach_mm:.1f} mm")
    footprints = [
        footprint(mirror, sub_image, depth_mm)
        for mirror, sub_image in zip(layout.mirrors, sub_images(layout), strict=True)
    ]
    region = intersection_all(footprints)
    return (region if isinstance(region, Polygon) else Polygon()), footprints


def seen_px(layout: Layout, region: Polygon, depth_mm: float, mirror_index: int) -> FloatArray:
    """The outline (n, 2) of a region of the plane y_rig = depth_mm, in (x, z), as it lies on the distorted sensor."""
    vertices = _vertices(region)
    if layout.camera.distortion.any():
        vertices = _subdivided(vertices)
    points = np.column_stack([vertices[:, 0], np.full(len(vertices), depth_mm), vertices[:, 1]])
    return layout.project(points, mirror_index)


def pixel_efficiency(layout: Layout, depth_mm: float) -> float:
    """Sensor pixels, over all sub-images, that see the region common to all views at y_rig = depth_mm / all pixels."""
    region, _ = common_region(layout, depth_mm)
    if region.is_empty:
        return 0.0
    areas = [Polygon(seen_px(layout, region, depth_mm, k)).area for k in range(len(layout.mirrors))]
    return float(sum(areas)) / (layout.camera.width_px * layout.camera.height_px)


def fitted_grid(layout: Layout) -> tuple[FloatArray, FloatArray]:
    """Best-fitting rectangular grid (rows, cols, 3) to the virtual centres in view axes, and its two spacings, mm.

    The grid's axes are those of the view; its origin (3) and two spacings are fitted by least squares. An axis with a
    single row or column has spacing 0.
    """
    centres = layout.virtual_centres_in_view_mm
    grid = np.broadcast_to(centres.mean(axis=(0, 1)), centres.shape).copy()
    spacings = np.zeros(2)
    for axis, count in ((0, layout.cols), (1, layout.rows)):
        steps = np.arange(count) - (count - 1) / 2.0
        if count == 1:
            continue
        along = centres[..., axis].mean(axis=axis)
        spacings[axis] = steps @ along / (steps @ steps)
        grid[..., axis] += (steps[None, :] if axis == 0 else steps[:, None]) * spacings[axis]
    return grid, spacings


def grid_error(layout: Layout) -> float:
    """Root mean square distance of virtual centres to the best-fitting grid / geometric mean of its spacings.

    Raises InputError where a spacing is 0: views in one place are no grid.
    """
    grid, spacings = fitted_grid(layout)
    if layout.rows * layout.cols < 2:
        return 0.0
    distances = np.linalg.norm(layout.virtual_centres_in_view_mm - grid, axis=-1)
    used = np.abs(spacings[[layout.cols > 1, layout.rows > 1]])
    if used.min() < 1e-6:
        raise InputError(f"virtual centres are {used.min():.2g} mm apart along an axis of the grid, expected a grid")
    return float(np.sqrt(np.mean(distances**2)) / np.exp(np.mean(np.log(used))))


def sheet_in_rig_mm(mirror: Mirror) -> FloatArray:
    """Corners (2n, 3) of the mirror's sheet: the reflecting face, then the other one."""
    side = -1.0 if mirror.surface == "first" else 1.0
    face = mirror.outline_in_rig_mm
    return np.concatenate([face, face + side * mirror.thickness_mm * mirror.normal_in_rig])


def hull_distance(first: FloatArray, second: FloatArray) -> float:
    """Distance between the convex hulls of two point sets (n, 3) and (m, 3); 0 where they meet.

    Lawson and Hanson's least-distance programming: with D all pairwise differences, the w >= 0 that minimises
    |D w|^2 + (1 - sum w)^2 points at the point of hull(D) nearest to the origin, and leaves d^2 / (1 + d^2).
    """
    differences = (first[:, None] - second[None, :]).reshape(-1, 3).T
    size = float(np.abs(differences).max())
    system = np.vstack([differences / size, np.ones(differences.shape[1])])
    weights, _ = nnls(system, np.array([0.0, 0.0, 0.0, 1.0]))
    return float(np.linalg.norm(differences @ weights) / weights.sum())


def smallest_gap_mm(layout: Layout) -> float:
    """Smallest distance between the sheets of any two mirrors, mm; 0 where two meet."""
    sheets = [sheet_in_rig_mm(mirror) for mirror in layout.mirrors]
    return min((hull_distance(a, b) for a, b in combinations(sheets, 2)), default=float("inf"))


def _field_of_view_deg(layout: Layout, depth_mm: float) -> tuple[float, float]:
    """Angles that the common region at a depth spans at the mean virtual centre, across and upwards, degrees."""
    region, _ = common_region(layout, depth_mm)
    if region.is_empty:
        return 0.0, 0.0
    x, y, z = layout.virtual_centres_in_rig_mm.mean(axis=0)
    angles = np.degrees(np.arctan2(_vertices(region) - [x, z], depth_mm - y))
    across, upwards = np.ptp(angles, axis=0)
    return float(across), float(upwards)


def evaluate(layout: Layout, depths_mm: Sequence[float]) -> dict[str, Metric]:
    """The figures of a layout at depths y_rig, mm; the field of view is that of the common region at the farthest."""
    metrics = {"grid_error": Metric(value=grid_error(layout), unit="grid spacings")}
    for depth_mm in depths_mm:
        region, footprints = common_region(layout, depth_mm)
        union = union_all(footprints).area
        metrics[f"pixel_efficiency_{depth_mm:g}mm"] = Metric(
            value=pixel_efficiency(layout, depth_mm), unit="of the sensor", lower_is_better=False
        )
        metrics[f"overlap_iou_{depth_mm:g}mm"] = Metric(
            value=region.area / union if union else 0.0, unit="of the union", lower_is_better=False
        )
    across, upwards = _field_of_view_deg(layout, max(depths_mm))
    _, spacings = fitted_grid(layout)
    baselines = np.abs(spacings) * [layout.cols - 1, layout.rows - 1]
    metrics["fov_x_deg"] = Metric(value=across, unit="deg", lower_is_better=False)
    metrics["fov_y_deg"] = Metric(value=upwards, unit="deg", lower_is_better=False)
    metrics["baseline_x_mm"] = Metric(value=float(baselines[0]), unit="mm", lower_is_better=False)
    metrics["baseline_y_mm"] = Metric(value=float(baselines[1]), unit="mm", lower_is_better=False)
    if len(layout.mirrors) > 1:
        metrics["smallest_gap_mm"] = Metric(value=smallest_gap_mm(layout), unit="mm", lower_is_better=False)
    return metrics
