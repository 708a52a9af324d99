"""Ground-truth maps: the mirror, board point and path length of every pixel centre, by ray tracing in float64.

They share only the layout and the shape of its mirrors with the renderers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.boards import margin_mm
from mirrorcam.render_scenes.mirror_finish import MirrorFinish
from mirrorcam.render_scenes.truth.light_rays import Obstacles, chief_rays, trace_via_mirror

NO_MIRROR = -1
CHANNELS = ("mirror", "board.x", "board.y", "path")


@dataclass(frozen=True)
class PixelRays:
    """Rays of all pixels (h, w) after reflection at the mirrors, shared by all frames of one device.

    Attributes
    ----------
    mirror
        Index (h, w) of the mirror at a pixel; `NO_MIRROR` without one.
    start, direction
        Origin (h, w, 3), mm, and unit vector (h, w, 3), in the rig frame, of the ray that leaves the mirror or the bare
        camera. NaN where a pixel shows neither the scene nor a mirror that reflects it.
    path_before_mm
        Path length (h, w) from the pupil to `start`.
    distance_to_body_mm
        Distance (h, w) from `start` along the ray to an obstacle; infinite without one.
    """

    mirror: FloatArray
    start: FloatArray
    direction: FloatArray
    path_before_mm: FloatArray
    distance_to_body_mm: FloatArray


def pixel_rays(
    layout: Layout,
    *,
    mirrors: bool,
    step: int = 1,
    finishes: Sequence[MirrorFinish] = (),
    obstacles: Obstacles | None = None,
) -> PixelRays:
    """Trace the rays of a layout's pixels from the centre of its pupil.

    Parameters
    ----------
    layout
        The device as built.
    mirrors
        Whether rays go via the mirrors, or directly from the bare camera.
    step
        Trace only every `step`-th row and column.
    finishes
        Surface finishes of the mirrors; by default they are flat.
    obstacles
        Bodies around the mirrors, if any.
    """
    origin, rays = _unit_rays(layout.camera, step)
    shape = rays.shape[:2]
    if not mirrors:
        zero, infinite = np.zeros(shape), np.full(shape, np.inf)
        return PixelRays(zero + NO_MIRROR, origin, rays, zero, infinite)
    index, depth = np.full(shape, float(NO_MIRROR)), np.full(shape, np.inf)
    start, direction, path_before_mm = np.full_like(rays, np.nan), np.full_like(rays, np.nan), np.full(shape, np.nan)
    for number, mirror in enumerate(layout.mirrors):
        window = _window(layout, number, step)
        finish = finishes[number] if finishes else None
        entry, exit_point, exit_direction, path_mm = trace_via_mirror(mirror, rays[window], finish, origin[window])
        nearer = np.isfinite(entry) & (entry < depth[window])
        for board, values in (
            (depth, entry),
            (index, np.full(entry.shape, float(number))),
            (start, exit_point),
            (direction, exit_direction),
            (path_before_mm, path_mm),
        ):
            board[window][nearer] = values[nearer]
    if obstacles is None:
        return PixelRays(index, start, direction, path_before_mm, np.full(shape, np.inf))
    hidden = obstacles.distance_from_pupil_mm(rays) < depth
    index[hidden] = NO_MIRROR
    for values in (start, direction, path_before_mm):
        values[hidden] = np.nan
    return PixelRays(index, start, direction, path_before_mm, obstacles.distance_to_body_mm(start, direction))


def _unit_rays(camera: Camera, step: int) -> tuple[FloatArray, FloatArray]:
    """Return start points and unit vectors (h, w, 3) of pixel centres; NaN beyond the lens model's domain."""
    x, y = np.arange(0.0, camera.width_px, step), np.arange(0.0, camera.height_px, step)
    start, rays = np.empty((len(y), len(x), 3)), np.empty((len(y), len(x), 3))
    # Batches of rows, because the solver needs many times the memory of its result.
    for row in range(0, len(y), 64):
        pixels = np.stack(np.meshgrid(x, y[row : row + 64]), axis=-1)
        start[row : row + 64], rays[row : row + 64] = chief_rays(camera, pixels)
    return start, rays


def _window(layout: Layout, index: int, step: int) -> tuple[slice, slice]:
    """Return the rows and columns of a window around a sub-image."""
    mirror = layout.mirrors[index]
    corners = mirror.solid.corners_in_rig_mm if mirror.is_second_surface else mirror.outline_in_rig_mm
    px = layout.camera.project(corners)
    if not np.isfinite(px).all():
        return slice(None), slice(None)
    # Distortion bends edges by some pixels.
    left, top = np.maximum(px.min(axis=0) - 50.0, 0.0) // step
    right, bottom = np.maximum(px.max(axis=0) + 50.0, 0.0) // step
    return slice(int(top), int(bottom)), slice(int(left), int(right))


def board_maps(rays: PixelRays, board: CalibrationBoard, rig_from_board: FloatArray) -> dict[str, FloatArray]:
    """Return the maps (h, w) of a board at a rigid pose (4, 4), by the names of `CHANNELS`.

    They are the index of the mirror, x and y on the board, mm, and the path length from there to the pupil, mm. All but
    the index are NaN where a pixel does not show the printed side of the board.
    """
    board_from_rig, origin = rig_from_board[:3, :3].T, rig_from_board[:3, 3]
    start, direction = (rays.start - origin) @ board_from_rig.T, rays.direction @ board_from_rig.T
    with np.errstate(divide="ignore", invalid="ignore"):
        length = -start[..., 2] / direction[..., 2]
        x, y = (start[..., axis] + length * direction[..., axis] for axis in range(2))
        margin = margin_mm(board)
        width, height = board.size_mm
        visible = (length > 0.0) & (length < rays.distance_to_body_mm) & (direction[..., 2] > 0.0)
        visible &= (x >= -margin) & (x <= width + margin) & (y >= -margin) & (y <= height + margin)
    values = (np.where(visible, value, np.nan) for value in (x, y, rays.path_before_mm + length))
    return dict(zip(CHANNELS, (rays.mirror, *values), strict=True))


def exr_bytes(maps: dict[str, FloatArray], header: dict[str, str]) -> bytes:
    """Encode maps (h, w) as a losslessly compressed EXR file in single precision, with additional header fields."""
    import OpenEXR

    channels = {name: values.astype(np.float32) for name, values in maps.items()}
    fields = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    # The library can only write to named files.
    with TemporaryDirectory() as folder, OpenEXR.File(fields, channels) as file:
        path = Path(folder) / "maps.exr"
        file.write(str(path))
        return path.read_bytes()
