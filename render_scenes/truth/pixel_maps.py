"""What every pixel truly shows: which mirror, where on the board, how far away. By rays, in float64, at pixel centres.

Shares nothing with the renderers but the layout and the shape of its mirrors: light is followed surface by surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Target
from mirrorcam.render_scenes.boards.printed_board import MARGIN_SQUARES
from mirrorcam.render_scenes.mirror_finish import MirrorFinish
from mirrorcam.render_scenes.truth.light_rays import reflected
from mirrorcam.render_scenes.truth.obstacles import Obstacles

NO_MIRROR = -1
CHANNELS = ("mirror", "board.x", "board.y", "path")


@dataclass(frozen=True)
class PixelRays:
    """How the ray of every pixel (h, w) goes on: what all frames through one device share.

    `mirror` is the index of the mirror that a pixel shows, `NO_MIRROR` without one; from `start` (h, w, 3) in rig, mm,
    its ray goes along the unit vector `direction` (h, w, 3), after `path_before_mm` from the pupil, for `free_mm` until
    something stops it, if anything does. NaN where the pixel shows neither the scene nor a mirror that shows it.
    """

    mirror: FloatArray
    start: FloatArray
    direction: FloatArray
    path_before_mm: FloatArray
    free_mm: FloatArray


def pixel_rays(
    layout: Layout,
    *,
    mirrors: bool,
    step: int = 1,
    finishes: Sequence[MirrorFinish] = (),
    obstacles: Obstacles | None = None,
) -> PixelRays:
    """The rays of a layout's pixels, or of those of some rows and columns, by its mirrors or by its camera alone.

    Without `finishes` its mirrors are flat; `obstacles` stand around them.
    """
    rays = _unit_rays(layout.camera, step)
    shape = rays.shape[:2]
    if not mirrors:
        nothing, endless = np.zeros(shape), np.full(shape, np.inf)
        return PixelRays(nothing + NO_MIRROR, np.zeros_like(rays), rays, nothing, endless)
    index, depth = np.full(shape, float(NO_MIRROR)), np.full(shape, np.inf)
    start, direction, before = np.full_like(rays, np.nan), np.full_like(rays, np.nan), np.full(shape, np.nan)
    for number, mirror in enumerate(layout.mirrors):
        window = _window(layout, number, step)
        entry, leaves, along, travelled = reflected(mirror, rays[window], finishes[number] if finishes else None)
        nearer = np.isfinite(entry) & (entry < depth[window])
        for target, values in (
            (depth, entry),
            (index, np.full(entry.shape, float(number))),
            (start, leaves),
            (direction, along),
            (before, travelled),
        ):
            target[window][nearer] = values[nearer]
    if obstacles is None:
        return PixelRays(index, start, direction, before, np.full(shape, np.inf))
    hidden = obstacles.free_from_pupil_mm(rays) < depth
    index[hidden] = NO_MIRROR
    for values in (start, direction, before):
        values[hidden] = np.nan
    return PixelRays(index, start, direction, before, obstacles.free_mm(start, direction))


def _unit_rays(camera: Camera, step: int) -> FloatArray:
    """Unit rays (h, w, 3) of pixel centres; NaN past the reach of the lens model."""
    x, y = np.arange(0.0, camera.width_px, step), np.arange(0.0, camera.height_px, step)
    rays = np.empty((len(y), len(x), 3))
    # A band of rows at a time: the solver needs many times the memory of its result.
    for row in range(0, len(y), 64):
        rays[row : row + 64] = camera.unproject(np.stack(np.meshgrid(x, y[row : row + 64]), axis=-1))
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def _window(layout: Layout, index: int, step: int) -> tuple[slice, slice]:
    """Rows and columns around the picture of a mirror."""
    mirror = layout.mirrors[index]
    corners = mirror.solid.corners_in_rig_mm if mirror.is_second_surface else mirror.outline_in_rig_mm
    px = layout.camera.project(corners)
    if not np.isfinite(px).all():
        return slice(None), slice(None)
    # Distortion bends edges by some pixels.
    left, top = np.maximum(px.min(axis=0) - 50.0, 0.0) // step
    right, bottom = np.maximum(px.max(axis=0) + 50.0, 0.0) // step
    return slice(int(top), int(bottom)), slice(int(left), int(right))


def path_lengths(rays: PixelRays, rig_from_board: FloatArray) -> FloatArray:
    """How far (h, w), mm, light has come from the plane of a board at a rigid 4x4 pose; NaN where it does not."""
    normal = rig_from_board[:3, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        length = (rig_from_board[:3, 3] - rays.start) @ normal / (rays.direction @ normal)
    return np.where(length > 0.0, rays.path_before_mm + length, np.nan)


def board_maps(rays: PixelRays, target: Target, rig_from_board: FloatArray) -> dict[str, FloatArray]:
    """What pixels (h, w) show of a board at a rigid 4x4 pose, by the names of `CHANNELS`.

    The index of the mirror, x and y on the board in mm and the way of the light from there to the pupil in mm; NaN, but
    for the mirror, where a pixel does not show the sheet's printed side.
    """
    board_from_rig, origin = rig_from_board[:3, :3].T, rig_from_board[:3, 3]
    start, direction = (rays.start - origin) @ board_from_rig.T, rays.direction @ board_from_rig.T
    with np.errstate(divide="ignore", invalid="ignore"):
        length = -start[..., 2] / direction[..., 2]
        x, y = (start[..., axis] + length * direction[..., axis] for axis in range(2))
        margin = MARGIN_SQUARES * target.square_mm
        width, height = target.size_mm
        shown = (length > 0.0) & (length < rays.free_mm) & (direction[..., 2] > 0.0)
        shown &= (x >= -margin) & (x <= width + margin) & (y >= -margin) & (y <= height + margin)
    values = (np.where(shown, value, np.nan) for value in (x, y, rays.path_before_mm + length))
    return dict(zip(CHANNELS, (rays.mirror, *values), strict=True))


def exr_bytes(maps: dict[str, FloatArray], header: dict[str, str]) -> bytes:
    """An EXR file, losslessly compressed, of maps (h, w) in single precision, with what its header is to say."""
    import OpenEXR

    channels = {name: values.astype(np.float32) for name, values in maps.items()}
    fields = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    # The library writes to named files alone.
    with TemporaryDirectory() as folder, OpenEXR.File(fields, channels) as file:
        path = Path(folder) / "maps.exr"
        file.write(str(path))
        return path.read_bytes()
