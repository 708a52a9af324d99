"""Cameras in any poses as a light field: arranged in rows and columns, and rectified to parallel views.

Rectification turns every picture to the mean orientation of the cameras, removes its distortion and samples it at one
focal length. The plane of zero disparity lies where the optical axes come closest, so views that look inwards keep most
of their field of view.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera

MAX_UNEVENNESS = 0.5
"""Maximum RMS deviation of views from an even grid, as a fraction of the smaller grid step."""
MAX_TURN_DEG = 45.0
"""Maximum angle between a camera and the mean orientation: beyond it, views share little and are stretched."""
MAX_VIEWS = 2000
NEGLIGIBLE_DEG = 1e-4
NEGLIGIBLE_MM = 1e-6
NEGLIGIBLE_PX = 1e-6
"""Negligible differences of principal points and focal lengths, for zero disparity at infinity."""
TOLERANCE_PX = 0.01
"""Tolerance of principal points and focal lengths for views that share a plane of zero disparity."""
_NEAREST = 0.5
"""Part of the distance of the reference plane before which no scene is expected."""
_LOST_STEPS = 96
"""Number of rays along each side of a picture that measure how much of it lies in the common frame."""

_FULL = 0.999
"""Minimum share of pixels with a sample, of those that a resampled one is interpolated from; below 1 by rounding."""

Picture = NDArray[Any]


class PosedCamera(NamedTuple):
    """A camera and its pose world_from_camera (4, 4), mm, in OpenCV's axes; `name` is for messages."""

    name: str
    camera: Camera
    world_from_camera: FloatArray


class Rectified(NamedTuple):
    """Parallel views of cameras: fields of `Views`, samples (t, s, v, u, c), weights (t, s, v, u), and what was done.

    `note` is None if the views were parallel, and their pictures are used as they are.
    """

    geometry: dict[str, Any]
    samples: Picture
    weights: NDArray[np.float32]
    note: str | None


def even_grid(positions: FloatArray) -> tuple[FloatArray, float]:
    """Fit an even grid to positions (t, s, 2); also return the RMS deviation as a fraction of its smaller step.

    The steps (k, 2) are those along s and t, without an axis that has one view only. A single view deviates by 0.
    """
    t, s = np.indices(positions.shape[:2]).reshape(2, -1)
    points = positions.reshape(-1, 2) - positions.reshape(-1, 2).mean(axis=0)
    indices = [index - index.mean() for index in (s, t) if index.any()]
    if not indices:
        return np.zeros((0, 2)), 0.0
    steps = np.array([(index @ points) / (index @ index) for index in indices])
    rms = float(np.sqrt(((points - np.array(indices).T @ steps) ** 2).sum(axis=1).mean()))
    smaller = float(np.linalg.norm(steps, axis=1).min())
    return steps, rms / smaller if smaller > 0 else np.inf


def arrangement(positions: FloatArray) -> NDArray[np.int_]:
    """Return the numbers (t, s) of positions (n, 2), x and y, in the rows and columns that they fit best.

    Rows run along x, columns along y. Positions of another pattern are listed in one row, in the given order.
    """
    count = len(positions)
    best, least = np.arange(count)[None], MAX_UNEVENNESS
    for rows in (rows for rows in range(1, count + 1) if count % rows == 0):
        by_y = np.argsort(positions[:, 1], kind="stable").reshape(rows, -1)
        order = np.take_along_axis(by_y, np.argsort(positions[by_y, 0], axis=1, kind="stable"), axis=1)
        steps, unevenness = even_grid(positions[order])
        axes = [axis for axis, length in ((0, order.shape[1]), (1, rows)) if length > 1]
        along = all(abs(step[axis]) >= abs(step[1 - axis]) for step, axis in zip(steps, axes, strict=True))
        if along and unevenness < least:
            best, least = order, unevenness
    return best


def central_view(rows: int, cols: int) -> tuple[int, int]:
    """Return the index (t, s) of the central view of a grid; of a stereo pair, the left one, as is usual."""
    return (0, 0) if (rows, cols) == (1, 2) else (rows // 2, cols // 2)


def pinhole_geometry(
    centres_mm: FloatArray, view_from_world: FloatArray, matrices: FloatArray, size: tuple[int, int], where: str
) -> dict[str, Any]:
    """Return the fields of `Views` of parallel pinholes at positions (t, s, 3) with matrices (t, s, 3, 3).

    The world becomes the rig, and the central view the reference. The plane of zero disparity follows from the
    principal points, which shift by f x / Z0, and the focal lengths, f (1 - z / Z0). Raises InputError if they are
    inconsistent.
    """
    rows, cols = centres_mm.shape[:2]
    central = central_view(rows, cols)
    positions = (centres_mm - centres_mm[central]) @ view_from_world.T
    positions[central] = 0.0
    focal_px, centre = float(matrices[central][0, 0]), matrices[central][:2, 2]
    offsets = np.concatenate([matrices[..., :2, 2] - centre, matrices[..., :1, 0] - focal_px], axis=-1)
    shifts = focal_px * positions * [1.0, 1.0, -1.0]
    inverse_distance = float((offsets * shifts).sum() / max(np.square(shifts).sum(), np.finfo(float).tiny))
    if float(np.abs(offsets).max()) < NEGLIGIBLE_PX:
        inverse_distance = 0.0
    error_px = float(np.abs(offsets - inverse_distance * shifts).max())
    anisotropy_px = float(np.abs(matrices[..., 1, 1] - matrices[..., 0, 0]).max())
    if inverse_distance < 0 or max(error_px, anisotropy_px) > TOLERANCE_PX:
        reason = (
            f"off by {max(error_px, anisotropy_px):.3g} px"
            if inverse_distance >= 0
            else "there is none in front of them"
        )
        raise InputError(f"{where}: views do not share a plane of zero disparity, {reason}")
    distance_mm = 1.0 / inverse_distance if inverse_distance else np.inf
    return _geometry(positions, focal_px, centre, size, distance_mm, centres_mm[central], view_from_world)


def _geometry(
    positions_mm: FloatArray,
    focal_px: float,
    centre_px: FloatArray,
    size: tuple[int, int],
    distance_mm: float,
    reference_in_world_mm: FloatArray,
    view_from_world: FloatArray,
) -> dict[str, Any]:
    return {
        "positions_mm": positions_mm,
        "focal_px": focal_px,
        "centre_px": centre_px,
        "width_px": size[0],
        "height_px": size[1],
        "reference_depth_mm": distance_mm + float(view_from_world[2] @ reference_in_world_mm),
        "reference_view_in_rig_mm": reference_in_world_mm,
        "view_from_rig": view_from_world,
        "layout_identity": "",
    }


def rectified(
    cameras: Sequence[PosedCamera],
    picture_of: Callable[[int], tuple[Picture, NDArray[np.float32] | None]],
    where: str = "",
    reference_depth_mm: float | None = None,
) -> Rectified:
    """Return the light field of cameras in any poses.

    Parameters
    ----------
    cameras
        Cameras in any order. The world becomes the rig; an origin so far in front of the views that depths may not be
        positive is moved back to the central view along its axis.
    picture_of
        Returns picture (h, w, c) and weights (h, w), or None for full weight, of a camera by its number.
    where
        Beginning of messages: the file and a colon, or empty.
    reference_depth_mm
        Depth of the plane of zero disparity from the views; by default, where the optical axes come closest.

    Raises
    ------
    InputError
        In one line, for cameras that look in too different directions, or share no field of view.
    """
    view_from_world, turn_deg = common_orientation(cameras, where)
    worlds = np.array([camera.world_from_camera for camera in cameras])
    positions = worlds[:, :3, 3] @ view_from_world.T
    order = arrangement(positions[:, :2])
    grid, flat = order.shape, order.ravel()
    ordered = [cameras[number] for number in flat.tolist()]
    geometry = None
    if reference_depth_mm is None and turn_deg < NEGLIGIBLE_DEG:
        geometry = _of_parallel(ordered, worlds[flat, :3, 3].reshape(*grid, 3), view_from_world)
    is_exact = geometry is not None
    if geometry is None:
        geometry = _common_frame(ordered, view_from_world, grid, reference_depth_mm, where)
    shape = (*grid, geometry["height_px"], geometry["width_px"])
    samples, weights = None, np.ones(shape, np.float32)
    matrices = _matrices(geometry)
    lost = []
    for index, number, camera in zip(np.ndindex(*grid), flat.tolist(), ordered, strict=True):
        picture, opacity = picture_of(number)
        if not is_exact:
            camera_from_view = camera.world_from_camera[:3, :3].T @ view_from_world.T
            picture, opacity = _resampled(picture, opacity, camera.camera, matrices[index], camera_from_view, shape[2:])
            lost.append(_lost(camera.camera, matrices[index], camera_from_view, shape[2:]))
        if samples is None:
            samples = np.zeros((*shape, picture.shape[-1]), picture.dtype)
        if opacity is not None:
            weights[index] = opacity
        if not weights[index].any():
            raise InputError(f"{where}{camera.name} shows nothing of the field of view of the other cameras")
        samples[index] = np.where(weights[index][..., None] > 0, picture, 0) if opacity is not None else picture
    note = None
    if not is_exact:
        note = (
            f"rectified: cameras turned by up to {turn_deg:.2g} deg, {np.mean(lost):.1%} of their fields of "
            f"view lost, {1.0 - (weights > 0).mean():.1%} of the views without a sample"
        )
    behind_mm = -float(view_from_world[2] @ geometry["reference_view_in_rig_mm"])
    distance_mm = geometry["reference_depth_mm"] + behind_mm
    if behind_mm > (_NEAREST * distance_mm if np.isfinite(distance_mm) else NEGLIGIBLE_MM):
        geometry["reference_view_in_rig_mm"] = geometry["reference_view_in_rig_mm"] + behind_mm * view_from_world[2]
        geometry["reference_depth_mm"] += behind_mm
        moved = f"the origin of the world lies {behind_mm:.4g} mm before the views: moved to their plane"
        note = moved if note is None else f"{note}; {moved}"
    assert samples is not None
    return Rectified(geometry, samples, weights, note)


def common_orientation(cameras: Sequence[PosedCamera], where: str = "") -> tuple[FloatArray, float]:
    """Return the mean view_from_world (3, 3) of cameras, and the largest angle of a camera from it, degrees.

    Raises InputError, beginning with `where`, for cameras that are turned too far apart for a light field.
    """
    if not 1 <= len(cameras) <= MAX_VIEWS:
        raise InputError(f"{where}{len(cameras)} views, expected 1 to {MAX_VIEWS}")
    rotations = np.array([camera.world_from_camera[:3, :3] for camera in cameras])
    view_from_world, turns_deg = _mean_orientation(rotations)
    widest = int(np.argmax(turns_deg))
    if turns_deg[widest] > MAX_TURN_DEG:
        raise InputError(
            f"{where}{cameras[widest].name} is turned by {turns_deg[widest]:.0f} deg from the mean of all cameras, "
            f"expected at most {MAX_TURN_DEG:g}: not the views of a light field"
        )
    return view_from_world, float(turns_deg[widest])


def _mean_orientation(world_from_cameras: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean view_from_world (3, 3) of rotations (n, 3, 3), and the angle of each from it, degrees."""
    u, _, vt = np.linalg.svd(world_from_cameras.sum(axis=0))
    mean = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    chords = np.linalg.norm(world_from_cameras - mean, axis=(1, 2)) / np.sqrt(8.0)
    # Parallel cameras keep their exact rotation.
    if chords.max() < np.radians(NEGLIGIBLE_DEG) / 2.0:
        mean = world_from_cameras[0]
    return mean.T, np.degrees(2.0 * np.arcsin(np.clip(chords, 0.0, 1.0)))


def _of_parallel(
    cameras: Sequence[PosedCamera], centres_mm: FloatArray, view_from_world: FloatArray
) -> dict[str, Any] | None:
    """Return the geometry of cameras that are parallel views already; None if their pictures must be resampled."""
    lenses = [camera.camera for camera in cameras]
    sizes = {(lens.width_px, lens.height_px) for lens in lenses}
    if len(sizes) > 1 or not all(lens.is_undistorted for lens in lenses):
        return None
    matrices = np.array([lens.matrix for lens in lenses]).reshape(*centres_mm.shape[:2], 3, 3)
    try:
        return pinhole_geometry(centres_mm, view_from_world, matrices, sizes.pop(), "")
    except InputError:
        return None


def _common_frame(
    cameras: Sequence[PosedCamera],
    view_from_world: FloatArray,
    grid: tuple[int, ...],
    reference_depth_mm: float | None,
    where: str,
) -> dict[str, Any]:
    """Return the geometry of rectified views: focal length and size are those of the central camera.

    Rays through the middle of the pictures meet the middle of the views on average.
    """
    central = (grid[0] // 2) * grid[1] + grid[1] // 2
    worlds = np.array([camera.world_from_camera for camera in cameras])
    positions = (worlds[:, :3, 3] - worlds[central, :3, 3]) @ view_from_world.T
    positions[central] = 0.0
    rays = np.array([_middle_ray(camera, view_from_world, where) for camera in cameras])
    slopes = rays[:, :2] / rays[:, 2:]
    offsets = positions[:, :2] - positions[:, :2].mean(axis=0)
    spread = float(np.square(offsets).sum())
    # Axes at slope d from x meet at the inverse distance q for which all d + q x are equal.
    inverse = -float((offsets * slopes).sum()) / spread if spread > 0 else 0.0
    if reference_depth_mm is not None:
        inverse = 1.0 / reference_depth_mm
    elif inverse * positions[:, 2].max() >= 0.5 or inverse < 0:
        inverse = 0.0
    if inverse * positions[:, 2].max() >= 1.0:
        raise InputError(f"{where}the plane of zero disparity at {reference_depth_mm} mm lies behind a camera")
    middle = cameras[central].camera
    focal_px = float(np.sqrt(middle.fx_px * middle.fy_px))
    focal = focal_px * (1.0 - inverse * positions[:, 2:])
    size = (middle.width_px, middle.height_px)
    met = focal * slopes + focal_px * inverse * positions[:, :2]
    centre = (np.array(size) - 1.0) / 2.0 - met.mean(axis=0)
    distance = 1.0 / inverse if inverse else np.inf
    reference = worlds[central, :3, 3]
    return _geometry(positions.reshape(*grid, 3), focal_px, centre, size, distance, reference, view_from_world)


def _middle_ray(camera: PosedCamera, view_from_world: FloatArray, where: str) -> FloatArray:
    """Return the ray (3,) through the middle of a camera's picture, in the view frame."""
    lens = camera.camera
    ray = lens.unproject(np.array([[(lens.width_px - 1) / 2.0, (lens.height_px - 1) / 2.0]]))[0]
    in_view = np.asarray(view_from_world @ camera.world_from_camera[:3, :3] @ ray)
    if not np.isfinite(in_view).all() or in_view[2] <= 0:
        raise InputError(f"{where}{camera.name}: its lens does not describe the middle of its picture")
    return in_view


def _matrices(geometry: dict[str, Any]) -> FloatArray:
    """Return focal length and principal point (t, s, 3) of the views."""
    positions, focal_px = geometry["positions_mm"], geometry["focal_px"]
    distance = geometry["reference_depth_mm"] - float(
        geometry["view_from_rig"][2] @ geometry["reference_view_in_rig_mm"]
    )
    inverse = 1.0 / distance
    focal = focal_px * (1.0 - inverse * positions[..., 2:])
    return np.concatenate([focal, geometry["centre_px"] + focal_px * inverse * positions[..., :2]], axis=-1)


def _resampled(
    picture: Picture,
    opacity: NDArray[np.float32] | None,
    camera: Camera,
    pinhole: FloatArray,
    camera_from_view: FloatArray,
    shape: tuple[int, ...],
) -> tuple[Picture, NDArray[np.float32]]:
    """Return a picture and its weights as a pinhole (f, cx, cy) sees it, without samples outside the picture."""
    import cv2

    v, u = np.indices(shape, dtype=np.float64)
    rays = np.stack([(u - pinhole[1]) / pinhole[0], (v - pinhole[2]) / pinhole[0], np.ones(shape)], axis=-1)
    pixels = camera.project(rays @ camera_from_view.T)
    with np.errstate(invalid="ignore"):
        inside = (pixels >= 0).all(axis=-1) & (pixels[..., 0] <= camera.width_px - 1)
        inside &= pixels[..., 1] <= camera.height_px - 1
    maps = np.where(inside[..., None], pixels, -1.0).astype(np.float32)
    # A finer picture is blurred to the pixels of the view, so that it does not alias.
    ratio = float(np.sqrt(camera.fx_px * camera.fy_px)) / pinhole[0]
    if ratio > 1.0:
        picture = cv2.GaussianBlur(picture, (0, 0), max(0.5 * np.sqrt(ratio**2 - 1.0), 1e-3))
    moved = cv2.remap(picture, maps[..., 0], maps[..., 1], cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE)
    if moved.dtype == np.float32:
        moved = np.clip(moved, 0.0, 1.0)
    weights = inside.astype(np.float32)
    if opacity is not None:
        # No sample mixes in pixels without one.
        has_sample = (opacity > 0).astype(np.float32)
        near, full = (
            cv2.remap(array, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for array in (opacity, has_sample)
        )
        weights *= np.where(full > _FULL, near, 0.0)
    return moved.reshape(*shape, -1), weights


def _lost(camera: Camera, pinhole: FloatArray, camera_from_view: FloatArray, shape: tuple[int, ...]) -> float:
    """Return the fraction of a camera's pixels that lie outside the view."""
    steps = (np.arange(_LOST_STEPS) + 0.5) / _LOST_STEPS
    sides = [steps * length - 0.5 for length in (camera.width_px, camera.height_px)]
    rays = camera.unproject(np.stack(np.meshgrid(*sides), axis=-1)).reshape(-1, 3) @ camera_from_view
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = (pinhole[0] * rays[:, :2] / rays[:, 2:] + pinhole[1:]).T
        seen = (rays[:, 2] > 0) & (np.abs(u - (shape[1] - 1) / 2) <= shape[1] / 2)
        seen &= np.abs(v - (shape[0] - 1) / 2) <= shape[0] / 2
    return 1.0 - float(seen.mean())
