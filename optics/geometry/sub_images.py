"""Sub-images by polygon clipping: fields of view, the region common to all views, and unvignetted parts.

Depths count from the pupil along the view axis. Regions at a depth are polygons in x and y of the view axes, mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror, reflect
from mirrorcam.optics.geometry.pupil import PINHOLE, Pupil, edge_clearance

POINTS_PER_EDGE = 32
MAX_FRACTION = 10.0
"""Limit on the shift of an unvignetted border, as a multiple of the distance from its edge to the outline's centre."""


def clipped(polygon: FloatArray, heights: FloatArray) -> FloatArray:
    """Clip a convex polygon (n, 2) to the positive side of a line, given signed distances (n,) of its corners.

    Returns (0, 2) if nothing remains.
    """
    points, is_corner = _clip(polygon, heights)
    return points[is_corner]


def clipped_polygons(polygons: FloatArray, heights: FloatArray) -> FloatArray:
    """Clip convex polygons (m, n, 2) to the positive sides of lines, given signed distances (m, n) of their corners.

    Returns (m, k, 2) with k from 3 to n + 1. Polygons with fewer corners repeat the last, in the input as in
    the result; all corners of an empty polygon are zero.
    """
    points, is_corner = _clip(polygons, heights)
    count = is_corner.sum(axis=1)
    order = np.argsort(~is_corner, axis=1, kind="stable")
    index = np.minimum(np.arange(max(count.max(), 3)), np.maximum(count - 1, 0)[:, None])
    parts = np.take_along_axis(points, np.take_along_axis(order, index, axis=1)[..., None], axis=1)
    return np.asarray(np.where((count > 0)[:, None, None], parts, 0.0))


def _clip(polygons: FloatArray, heights: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Candidate corners (..., 2 n, 2) of clipped polygons (..., n, 2), in order, and the mask of actual corners."""
    previous, previous_heights = np.roll(polygons, 1, axis=-2), np.roll(heights, 1, axis=-1)
    inside = heights > 0.0
    crosses = (previous_heights > 0.0) != inside
    drop = np.where(crosses, previous_heights - heights, 1.0)
    crossings = previous + (polygons - previous) * previous_heights[..., None] / drop[..., None]
    points = np.stack([crossings, polygons], axis=-2).reshape(*polygons.shape[:-2], -1, 2)
    return points, np.stack([crosses, inside], axis=-1).reshape(*heights.shape[:-1], -1)


def _subdivided(polygon: FloatArray, per_edge: int = POINTS_PER_EDGE) -> FloatArray:
    fractions = np.linspace(0.0, 1.0, per_edge, endpoint=False)[None, :, None]
    following = np.roll(polygon, -1, axis=0)
    return (polygon[:, None] * (1.0 - fractions) + following[:, None] * fractions).reshape(-1, 2)


def vertices(polygon: Polygon) -> FloatArray:
    """Corners (n, 2) of a polygon without holes; (0, 2) if it is empty."""
    return np.array(polygon.exterior.coords).reshape(-1, 2)[:-1]


def _sensor_border(camera: Camera) -> FloatArray:
    """The sensor's border (n, 2) in normalized coordinates; not finite where the distortion is not monotonic."""
    w, h = camera.width_px - 0.5, camera.height_px - 0.5
    border = np.array([[-0.5, -0.5], [w, -0.5], [w, h], [-0.5, h]])
    return camera.normalized_from_pixels(border if camera.is_undistorted else _subdivided(border))


def covers_sensor(camera: Camera) -> bool:
    """Whether the lens is defined over the entire sensor, out to the edges of its outermost pixels."""
    return bool(np.isfinite(_sensor_border(camera)).all())


def sensor_polygon(camera: Camera) -> Polygon:
    """The sensor, out to the edges of its outermost pixels, in normalized (undistorted) coordinates.

    Raises InputError if the distortion is not monotonic on the sensor.
    """
    normalized = _sensor_border(camera)
    if not np.isfinite(normalized).all():
        raise InputError(
            f"camera {camera.name}: distortion {camera.distortion.tolist()} is not monotonic on the sensor"
        )
    return Polygon(normalized)


def sub_image_polygons(layout: Layout, pupil: Pupil = PINHOLE) -> list[Polygon]:
    """The part of each sub-image on the sensor that shows the scene unvignetted, in normalized coordinates."""
    sensor = sensor_polygon(layout.camera)
    parts = [sensor.intersection(Polygon(outline)) for outline in unvignetted_outlines_of(layout.mirrors, pupil)]
    return [part if isinstance(part, Polygon) else Polygon() for part in parts]


@dataclass(frozen=True)
class FieldsOfView:
    """Fields of view of all mirrors: the corner rays of their sub-images, in view axes.

    Attributes
    ----------
    layout : layout of the mirrors.
    mirror_depth_mm : maximum depth of the mirrors' solids.
    origins_mm : points (m, 3) where the rays leave their mirrors, mirror by mirror.
    directions : directions (m, 3) of the rays, not normalized.
    corner_slices : slices of the rays by mirror, for mirrors that show the scene.
    sub_images : part of each sub-image that shows the scene, see `sub_image_polygons`.
    """

    layout: Layout
    mirror_depth_mm: float
    origins_mm: FloatArray
    directions: FloatArray
    corner_slices: dict[int, slice]
    sub_images: tuple[Polygon, ...]
    _regions: dict[float, tuple[Polygon, list[Polygon]]] = field(default_factory=dict, init=False, repr=False)
    """The results of `common_region`, which many figures need at the same depths."""

    def footprints(self, depth_mm: float) -> list[Polygon]:
        """The region of the plane at a depth that each view sees; empty if it sees none.

        Raises InputError for a depth nearer than the mirrors.
        """
        if depth_mm <= self.mirror_depth_mm:
            raise InputError(
                f"depth {depth_mm:g} mm is nearer than the mirrors, which reach {self.mirror_depth_mm:.1f} mm"
            )
        steps = (depth_mm - self.origins_mm[:, 2]) / self.directions[:, 2]
        corners = (self.origins_mm + steps[:, None] * self.directions)[:, :2]
        counts = [part.stop - part.start for part in self.corner_slices.values()]
        rings = shapely.linearrings(corners, indices=np.repeat(np.arange(len(counts)), counts))
        footprints = [Polygon()] * len(self.layout.mirrors)
        for k, polygon in zip(self.corner_slices, shapely.polygons(rings), strict=True):
            footprints[k] = polygon
        return footprints

    def common_region(self, depth_mm: float) -> tuple[Polygon, list[Polygon]]:
        """The region of the plane at a depth that all views see, which may be empty, and the footprint of each."""
        if depth_mm not in self._regions:
            footprints = self.footprints(depth_mm)
            region = shapely.intersection_all(footprints)
            self._regions[depth_mm] = (region if isinstance(region, Polygon) else Polygon()), footprints
        return self._regions[depth_mm]

    def pixel_efficiency(self, region: Polygon, depth_mm: float) -> float:
        """Fraction of the sensor's pixels that see a region of the plane at a depth, over all sub-images."""
        return float(self.pixel_fractions(region, depth_mm).sum())

    def pixel_fractions(self, region: Polygon, depth_mm: float) -> FloatArray:
        """Fractions (m,) of the sensor's pixels that see a region of the plane at a depth, by sub-image."""
        if region.is_empty:
            return np.zeros(len(self.layout.mirrors))
        camera = self.layout.camera
        pixels = camera.project(images_in_rig(self.layout, region, depth_mm))
        following = np.roll(pixels, -1, axis=1)
        areas = (pixels[..., 0] * following[..., 1] - pixels[..., 1] * following[..., 0]).sum(axis=1) / 2.0
        return np.asarray(np.abs(areas) / (camera.width_px * camera.height_px))


def fields_of_view(layout: Layout, pupil: Pupil = PINHOLE) -> FieldsOfView:
    """The fields of view of a layout's unvignetted pixels.

    Rays that are not reflected towards the scene are omitted.
    """
    rig_from_view = layout.view_from_rig.T
    origins, directions, corner_slices = np.zeros((0, 3)), np.zeros((0, 3)), {}
    sub_images = tuple(sub_image_polygons(layout, pupil))
    for k, (mirror, sub_image) in enumerate(zip(layout.mirrors, sub_images, strict=True)):
        apparent = mirror.apparent
        corners, to_depth = vertices(sub_image), apparent.reflection @ layout.view_from_rig[2]
        forward = clipped(corners, corners @ to_depth[:2] + to_depth[2] - 1e-6)
        if len(forward) < 3:
            continue
        corner_slices[k] = slice(len(origins), len(origins) + len(forward))
        rays = np.column_stack([forward, np.ones(len(forward))])
        origins = np.concatenate([origins, apparent.intersect(forward) @ rig_from_view])
        directions = np.concatenate([directions, rays @ apparent.reflection @ rig_from_view])
    mirror_depth_mm = max(
        float((mirror.solid.corners_in_rig_mm @ rig_from_view)[:, 2].max()) for mirror in layout.mirrors
    )
    return FieldsOfView(layout, mirror_depth_mm, origins, directions, corner_slices, sub_images)


def _on_plane(layout: Layout, region: Polygon, depth_mm: float) -> FloatArray:
    """The outline (n, 3) in the rig frame of a region at a depth, with sampled edges if the lens distorts."""
    outline = vertices(region)
    if not layout.camera.is_undistorted:
        outline = _subdivided(outline)
    return np.column_stack([outline, np.full(len(outline), depth_mm)]) @ layout.view_from_rig


def images_in_rig(layout: Layout, region: Polygon, depth_mm: float) -> FloatArray:
    """Images (m, n, 3), mm, in the rig frame, in each mirror of the outline of a region at a depth."""
    return reflect(_on_plane(layout, region, depth_mm), layout.virtual_centres_in_rig_mm[:, None])


def region_outline_px(layout: Layout, region: Polygon, depth_mm: float, mirror_index: int) -> FloatArray:
    """The outline (n, 2) on the distorted sensor of a region of the plane at a depth, as one mirror shows it."""
    return layout.project(_on_plane(layout, region, depth_mm), mirror_index)


def common_region(layout: Layout, depth_mm: float) -> tuple[Polygon, list[Polygon]]:
    """The region of the plane at a depth that all views see, which may be empty, and the footprint of each view.

    Raises InputError for a depth nearer than the mirrors.
    """
    return fields_of_view(layout).common_region(depth_mm)


def pixel_efficiency(layout: Layout, depth_mm: float, pupil: Pupil = PINHOLE) -> float:
    """Fraction of the sensor's pixels that see the region common to all views at a depth, unvignetted."""
    views = fields_of_view(layout, pupil)
    region, _ = views.common_region(depth_mm)
    return views.pixel_efficiency(region, depth_mm)


def unvignetted_outline(mirror: Mirror, pupil: Pupil) -> FloatArray:
    """Corners (n, 2) of the unvignetted part of a sub-image, in normalized coordinates; (0, 2) if there is none."""
    return unvignetted_outlines_of([mirror], pupil)[0]


def unvignetted_outlines_of(mirrors: Sequence[Mirror], pupil: Pupil) -> list[FloatArray]:
    """The `unvignetted_outline` (n, 2) of each mirror, computed together."""
    outlines = [mirror.usable_normalized for mirror in mirrors]
    visible = [k for k, outline in enumerate(outlines) if len(outline)]
    if pupil.radius_mm == 0.0 or not visible:
        return outlines
    count = max(len(outlines[k]) for k in visible)
    corners = np.array([outlines[k][np.minimum(np.arange(count), len(outlines[k]) - 1)] for k in visible])
    normals = np.array([mirrors[k].apparent.normal_in_rig for k in visible])
    distances_mm = np.array([mirrors[k].apparent.distance_mm for k in visible])
    for k, outline in zip(visible, unvignetted_outlines(corners, normals, distances_mm, pupil), strict=True):
        outlines[k] = outline[(outline != np.roll(outline, 1, axis=0)).any(axis=1)]
    return outlines


def unvignetted_outlines(
    corners: FloatArray, normals: FloatArray, distances_mm: FloatArray, pupil: Pupil
) -> FloatArray:
    """The unvignetted parts of the sub-images of n mirrors, in normalized coordinates.

    Their nearly straight borders are replaced by chords inside them.

    Parameters
    ----------
    corners
        Corners (n, k, 2) of the parts visible from the centre of the pupil; shorter outlines repeat the last corner.
    normals, distances_mm
        Planes of the apparent mirrors: unit normals (n, 3) in the frame of the camera, and distances (n,).
    pupil
        Pupil of a lens with a finite aperture.

    Returns
    -------
    Corners (n, l, 2); shorter outlines repeat the last corner, and empty ones are all zero.
    """
    following = np.roll(corners, -1, axis=1)
    distinct = (following != corners).any(axis=2)
    centroids = (corners * distinct[..., None]).sum(axis=1) / np.maximum(distinct.sum(axis=1), 1)[:, None]
    ends = np.stack([corners, following], axis=2)
    inward = centroids[:, None, None] - ends
    fractions = _fractions_to_unvignetted(ends, centroids, normals, distances_mm, pupil)
    solved = ((fractions >= 0.0) & (fractions < MAX_FRACTION)).all(axis=2) | ~distinct
    borders = ends + np.where(solved[..., None], fractions, 0.0)[..., None] * inward
    edges = borders[:, :, 1] - borders[:, :, 0]
    normal = np.stack([-edges[..., 1], edges[..., 0]], axis=-1)
    normal *= np.sign((inward[:, :, 0] * normal).sum(axis=-1, keepdims=True))
    clipped_corners = corners * solved.all(axis=1)[:, None, None]
    for k in range(corners.shape[1]):
        heights = ((clipped_corners - borders[:, None, k, 0]) * normal[:, None, k]).sum(axis=-1)
        clipped_corners = clipped_polygons(clipped_corners, np.where(distinct[:, k, None], heights, 1.0))
    return clipped_corners


def _fractions_to_unvignetted(
    ends: FloatArray, centroids: FloatArray, normals: FloatArray, distances_mm: FloatArray, pupil: Pupil
) -> FloatArray:
    """Fractions (n, k, 2) of the lines from the ends of edges (n, k, 2, 2) to centroids (n, 2) where vignetting ends.

    Along these lines, constant and gradient of `edge_clearance` are linear. Vignetting ends where their quotient equals
    the pupil's radius: a quadratic equation. NaN if it has no solution.
    """
    centroids = np.broadcast_to(centroids[:, None, None], (*ends.shape[:2], 1, 2))
    chief = np.concatenate([ends, centroids], axis=2)
    rays = np.concatenate([chief, np.ones((*chief.shape[:3], 1))], axis=3)
    points = rays * (-distances_mm[:, None, None] / (rays @ normals[:, None, :, None])[..., 0])[..., None]
    edges = np.stack([points[:, :, None, 0], points[:, :, None, 1]])
    constants, gradients, _ = edge_clearance(edges, points[:, :, 2], rays, 1.0 / pupil.focus_mm)
    constant, gradient = constants[..., 0], pupil.radius_mm * gradients[..., 0, :]
    d_constant, d_gradient = constant[:, :, 2:] - constant[:, :, :2], gradient[:, :, 2:] - gradient[:, :, :2]
    constant, gradient = constant[:, :, :2], gradient[:, :, :2]
    quadratic, linear, absolute = (
        a * b - (first * second).sum(axis=-1)
        for a, b, first, second in (
            (d_constant, d_constant, d_gradient, d_gradient),
            (constant, d_constant, gradient, d_gradient),
            (constant, constant, gradient, gradient),
        )
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(-absolute / (linear + np.sqrt(linear**2 - quadratic * absolute)))
