"""Fields of view of many devices as built, by polygon clipping.

Coordinates are in the view axes of the holder, with the nominal pupil as origin: depth is z, and moving the camera
leaves the plane at a depth fixed. Regions are polygons in x and y, mm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.perturbations import Devices, Perturbations, perturbed_camera, perturbed_mirrors
from mirrorcam.optics.geometry.plate import rise_mm, solve_tangent_in_air, tangent_in_glass
from mirrorcam.optics.geometry.pupil import Pupil
from mirrorcam.optics.geometry.sub_images import POINTS_PER_EDGE, sensor_polygon, unvignetted_outlines

Polygons = NDArray[np.object_]
Indices = NDArray[np.int64]

MIN_FORWARD = 1e-6
FAR_NORMALIZED = 1e3


@dataclass(frozen=True)
class BuiltViews:
    """The views of n devices of m mirrors, in the view axes of their holders, mm.

    Attributes
    ----------
    layout
        The design.
    cameras
        The camera of each device; the same object if it is not perturbed.
    pupils_mm
        Positions of the pupils (n, 3).
    view_from_camera
        Rotations of the cameras (n, 3, 3).
    normals
        Unit normals (n, m, 3) of the apparent mirrors (`Mirror.apparent`).
    centres_mm
        Virtual camera centres (n, m, 3).
    outlines
        The mirrors' outlines (n, m) in each camera's normalized coordinates.
    usable
        The part (n, m) of each outline that shows the scene.
    sub_images
        The part (n, m) of `usable` that lies on the sensor and whose rays are reflected towards the scene.

    `unvignetted` restricts the last two to unvignetted pixels.
    """

    layout: Layout
    cameras: tuple[Camera, ...]
    pupils_mm: FloatArray
    view_from_camera: FloatArray
    normals: FloatArray
    centres_mm: FloatArray
    outlines: Polygons
    usable: Polygons
    sub_images: Polygons

    def unvignetted(self, pupil: Pupil) -> BuiltViews:
        """The same devices, restricted to the pixels that are unvignetted for a pupil."""
        if pupil.radius_mm == 0.0:
            return self
        flat = self.usable.ravel()
        present = ~shapely.is_empty(flat)
        normals = (self.normals @ self.view_from_camera).reshape(-1, 3)[present]
        distances = np.linalg.norm(self.centres_mm - self.pupils_mm[:, None], axis=-1).ravel()[present] / 2.0
        parts = np.full(flat.shape, Polygon(), dtype=np.object_)
        parts[present] = shapely.polygons(unvignetted_outlines(_corners(flat[present]), normals, distances, pupil))
        usable = _with_area(parts.reshape(self.usable.shape))
        return replace(self, usable=usable, sub_images=_with_area(shapely.intersection(usable, self.sub_images)))

    def pixels(self, points: FloatArray, device: Indices, mirror: Indices) -> FloatArray:
        """Pixels (..., 2) of points (..., 3) via mirrors (...) of devices (...); NaN for invisible points."""
        normals, offsets = self.normals[device, mirror], points - self.pupils_mm[device]
        distances = self._distances(device, mirror)
        reflected = offsets - 2.0 * (np.sum(offsets * normals, axis=-1) + distances)[..., None] * normals
        in_camera = (reflected[..., None, :] @ self.view_from_camera[device])[..., 0, :]
        if len(set(map(id, self.cameras))) == 1:
            return self.cameras[0].project(in_camera)
        devices = np.broadcast_to(device, in_camera.shape[:-1])
        pixels = np.empty((*in_camera.shape[:-1], 2))
        for number, camera in enumerate(self.cameras):
            pixels[devices == number] = camera.project(in_camera[devices == number])
        return pixels

    def _distances(self, device: Indices, mirror: Indices) -> FloatArray:
        return np.linalg.norm(self.centres_mm - self.pupils_mm[:, None], axis=-1)[device, mirror] / 2.0

    def points_at_depth(self, normalized: FloatArray, device: Indices, mirror: Indices, depth_mm: float) -> FloatArray:
        """Points (..., 2) where rays (..., 2) via mirrors (...) of devices (...) meet the plane at a depth."""
        rays = np.concatenate([normalized, np.ones((*normalized.shape[:-1], 1))], axis=-1)
        incoming = (self.view_from_camera[device] @ rays[..., None])[..., 0]
        normals, centres = self.normals[device, mirror], self.centres_mm[device, mirror]
        reflected = incoming - 2.0 * np.sum(incoming * normals, axis=-1, keepdims=True) * normals
        return centres[..., :2] + reflected[..., :2] * ((depth_mm - centres[..., 2:]) / reflected[..., 2:])

    def common_regions(self, depth_mm: float) -> tuple[Polygons, Polygons]:
        """The region (n,) of the plane at a depth that all views of each device see, and all footprints (n, m)."""
        count = self.sub_images.shape[1]
        footprints = _mapped(
            self.sub_images, lambda points, owner: self.points_at_depth(points, owner // count, owner % count, depth_mm)
        )
        return _with_area(shapely.intersection_all(footprints, axis=1)), footprints

    def pixel_count(self, regions: Polygons, depth_mm: float) -> FloatArray:
        """Number (n, m) of sensor pixels of each sub-image that see a region (n,) of the plane at a depth."""
        start, end, owner = _edges(regions)
        if not all(camera.is_undistorted for camera in self.cameras):
            fractions = np.linspace(0.0, 1.0, POINTS_PER_EDGE + 1)[:, None]
            points = start[:, None] * (1.0 - fractions) + end[:, None] * fractions
            start, end = points[:, :-1].reshape(-1, 2), points[:, 1:].reshape(-1, 2)
            owner = np.repeat(owner, POINTS_PER_EDGE)
        mirrors = np.arange(self.sub_images.shape[1])
        depths = np.full((len(start), 1), depth_mm)
        first, second = (self.pixels(np.hstack([p, depths])[:, None], owner[:, None], mirrors) for p in (start, end))
        crosses = (first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]) / 2.0
        areas = np.zeros(self.sub_images.shape)
        np.add.at(areas, owner, crosses)
        return np.abs(areas)

    def pixel_efficiency(self, regions: Polygons, depth_mm: float) -> FloatArray:
        """Fraction (n,) of the sensor's pixels that see a region (n,) of the plane at a depth, over all sub-images."""
        sensor_px = self.layout.camera.width_px * self.layout.camera.height_px
        return np.asarray(self.pixel_count(regions, depth_mm).sum(axis=1) / sensor_px)

    def hidden(self) -> NDArray[np.bool_]:
        """Mask (n,) of the devices in which one mirror hides part of another from the camera: outlines overlap."""
        count = self.outlines.shape[1]
        first, second = np.triu_indices(count, 1)
        low, high = shapely.bounds(self.outlines).reshape(-1, count, 2, 2).transpose(2, 0, 1, 3)
        near = ((low[:, first] < high[:, second]) & (low[:, second] < high[:, first])).all(axis=-1)
        device, pair = np.nonzero(near)
        shared = shapely.intersection(self.outlines[device, first[pair]], self.outlines[device, second[pair]])
        hidden = np.zeros(len(self.outlines), dtype=np.bool_)
        hidden[device[shapely.area(shared) > 1e-12]] = True
        return hidden


def built_views(layout: Layout, perturbations: Perturbations) -> BuiltViews:
    """The views of perturbed devices of a layout.

    Raises InputError if a device is impossible: a mirror without thickness or behind its camera, or a lens whose
    distortion is not monotonic on the sensor.
    """
    devices = perturbed_mirrors(layout, perturbations)
    cameras = tuple(
        perturbed_camera(layout.camera, perturbations, device) for device in range(len(perturbations.focal))
    )
    heights = (devices.pupils_mm[:, None] - devices.centroids_mm)[..., None, :] @ devices.normals[..., None]
    distances, thicknesses = heights[..., 0, 0], devices.thicknesses_mm
    if (thicknesses <= 0).any():
        raise InputError(f"a sampled mirror is {thicknesses.min():.3g} mm thick, reduce the tolerances")
    is_second_surface = np.array([mirror.is_second_surface for mirror in layout.mirrors])
    if (distances <= np.where(is_second_surface, thicknesses, 0.0)).any():
        raise InputError("a sampled mirror reaches past the pupil, reduce the tolerances")
    rises, outlines, usable = _apparent_outlines(layout, devices, distances)
    distances = distances - rises
    sensors = {id(camera): sensor_polygon(camera) for camera in cameras}
    sensor = np.array([sensors[id(camera)] for camera in cameras])
    view_from_holder = layout.view_from_rig
    pupils, normals = devices.pupils_mm @ view_from_holder.T, devices.normals @ view_from_holder.T
    view_from_camera = view_from_holder @ devices.holder_from_camera
    return BuiltViews(
        layout=layout,
        cameras=cameras,
        pupils_mm=pupils,
        view_from_camera=view_from_camera,
        normals=normals,
        centres_mm=pupils[:, None] - 2.0 * distances[..., None] * normals,
        outlines=outlines,
        usable=usable,
        sub_images=_forward(_with_area(shapely.intersection(usable, sensor[:, None])), normals, view_from_camera),
    )


def _apparent_outlines(
    layout: Layout, devices: Devices, distances: FloatArray
) -> tuple[FloatArray, Polygons, Polygons]:
    """Heights (n, m) of apparent mirrors above reflecting surfaces, outlines (n, m), and their usable parts (n, m)."""
    rises = np.zeros(distances.shape)
    shifts: dict[int, FloatArray] = {}
    for k, mirror in enumerate(layout.mirrors):
        if not mirror.is_second_surface:
            continue
        index, glass = mirror.refractive_index, devices.thicknesses_mm[:, k]
        offsets = devices.centroids_mm[:, k] - devices.pupils_mm + distances[:, k, None] * devices.normals[:, k]
        lengths = np.linalg.norm(offsets, axis=1)
        cases = zip(lengths, distances[:, k] - glass, glass, strict=True)
        tangents = np.array([solve_tangent_in_air(float(a), float(b), float(c), index) for a, b, c in cases])
        rises[:, k] = glass * rise_mm(tangents, 1.0, index)
        # Light enters the front this far before the point of reflection and leaves it this far beyond.
        in_plane = offsets * (glass * tangent_in_glass(tangents, index) / np.maximum(lengths, 1e-12))[:, None]
        shifts[k] = (in_plane[:, None] @ devices.axes[:, k])[:, 0]
    raised = devices.outlines_mm + (rises[..., None] * devices.normals)[..., None, :]
    outlines = shapely.polygons(_normalized(raised, devices))
    usable = outlines.copy()
    for k, shift in shifts.items():
        outline = layout.mirrors[k].outline_in_plane_mm
        inside = shapely.intersection(*(shapely.polygons(outline + sign * shift[:, None]) for sign in (1.0, -1.0)))
        centroids = devices.centroids_mm[:, k] + rises[:, k, None] * devices.normals[:, k]

        def to_camera(points: FloatArray, owner: Indices, k: int = k, centroids: FloatArray = centroids) -> FloatArray:
            corners = centroids[owner] + (devices.axes[owner, k] @ points[..., None])[..., 0]
            in_camera = ((corners - devices.pupils_mm[owner])[:, None] @ devices.holder_from_camera[owner])[:, 0]
            return in_camera[:, :2] / in_camera[:, 2:]

        usable[:, k] = _mapped(_with_area(inside), to_camera)
    return rises, outlines, usable


def _normalized(points: FloatArray, devices: Devices) -> FloatArray:
    """Normalized coordinates (n, m, k, 2) of points (n, m, k, 3) of each device in its own camera."""
    in_camera = (points - devices.pupils_mm[:, None, None]) @ devices.holder_from_camera[:, None]
    if (in_camera[..., 2] <= 0).any():
        raise InputError("a sampled mirror reaches behind the camera, reduce the tolerances")
    return in_camera[..., :2] / in_camera[..., 2:]


def _forward(polygons: Polygons, normals: FloatArray, view_from_camera: FloatArray) -> Polygons:
    """Clip polygons (n, m) in normalized coordinates to rays that are reflected towards the scene."""
    reflected_z = np.array([0.0, 0.0, 1.0]) - 2.0 * normals[..., 2:] * normals
    slopes = (reflected_z[..., None, :] @ view_from_camera[:, None])[..., 0, :].reshape(-1, 3)
    flat = polygons.ravel().copy()
    points, owner = shapely.get_coordinates(flat, return_index=True)
    heights = np.sum(points * slopes[owner, :2], axis=1) + slopes[owner, 2]
    for number in np.unique(owner[heights <= MIN_FORWARD]):
        a, b, c = slopes[number]
        length = np.hypot(a, b)
        up = np.array([a, b]) / length
        start, side = up * (MIN_FORWARD - c) / length, FAR_NORMALIZED * np.array([-up[1], up[0]])
        end = start + FAR_NORMALIZED * up
        flat[number] = shapely.intersection(flat[number], Polygon([start - side, start + side, end + side, end - side]))
    return _with_area(flat.reshape(polygons.shape))


def _with_area(shapes: Polygons) -> Polygons:
    """Replace shapes without area (points or lines where polygons touch) by empty polygons."""
    has_area = (shapely.get_type_id(shapes) == shapely.GeometryType.POLYGON) & (shapely.area(shapes) > 0)
    return np.where(has_area, shapes, Polygon())


def _mapped(polygons: Polygons, mapping: Callable[[FloatArray, Indices], FloatArray]) -> Polygons:
    """Map the corners of polygons (...) by `mapping(corners (c, 2), index of their polygon (c,)) -> (c, 2)`."""
    flat = polygons.ravel()
    points, owner = shapely.get_coordinates(flat, return_index=True)
    mapped = np.full(flat.shape, Polygon(), dtype=np.object_)
    if len(points):
        present, ring = np.unique(owner, return_inverse=True)
        mapped[present] = shapely.polygons(shapely.linearrings(mapping(points, owner), indices=ring))
    return mapped.reshape(polygons.shape)


def _corners(polygons: Polygons) -> FloatArray:
    """Corners (n, k, 2) of nonempty polygons (n,), where k is the maximum; those with fewer repeat the last corner."""
    points, owner = shapely.get_coordinates(polygons, return_index=True)
    first, count = np.searchsorted(owner, np.arange(len(polygons))), np.bincount(owner) - 1
    return np.asarray(points[first[:, None] + np.minimum(np.arange(count.max()), count[:, None] - 1)])


def _edges(polygons: Polygons) -> tuple[FloatArray, FloatArray, Indices]:
    """Start (e, 2) and end (e, 2) of the edges of polygons (n,), and the index (e,) of each edge's polygon."""
    points, owner = shapely.get_coordinates(polygons, return_index=True)
    is_edge = owner[1:] == owner[:-1]
    return points[:-1][is_edge], points[1:][is_edge], owner[:-1][is_edge]
