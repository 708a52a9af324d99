"""nerfstudio's `transforms.json` with pictures of the views, in metres.

The world's origin is the pupil: x right, y towards the scene, z up.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ConfigDict

from mirrorcam.core.disk.array_files import as_input_error
from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, inside, read_json, write_json
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import is_picture, picture_size, read_image, write_image
from mirrorcam.core.values import Matrix4, Value
from mirrorcam.optics.camera_files.camera_rig import camera_of, orthogonal, size_of
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.sfm_rigs import HALF_PIXEL, OPENCV_FROM_OPENGL, WORLD_FROM_VIEW, frame
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.optics.light_field.camera_array import MAX_VIEWS, PosedCamera
from mirrorcam.optics.light_field.io.formats.ply import point_cloud, write_ply
from mirrorcam.optics.light_field.io.light_field_format import NOTHING, Assumed, Contents, Format, KnownDepth
from mirrorcam.optics.light_field.io.pinholes import centres_in_rig_mm, view_name
from mirrorcam.optics.light_field.io.posed_pictures import PosedPicture, read_posed
from mirrorcam.optics.light_field.io.view_images import check_size, common_size, light_field_of, rgb, weight_bytes
from mirrorcam.optics.light_field.io.views_file import VIEWS, ViewsFile, read_views, write_views
from mirrorcam.optics.light_field.light_field import LightField, Views

TRANSFORMS, POINTS = "transforms.json", "points.ply"
MAX_FRAMES = 20_000
MM_PER_UNIT = 1000.0
"""A data set has no unit; ours are in metres."""
LENSES = {
    **dict.fromkeys(("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE"), "brown_conrady"),
    "OPENCV_FISHEYE": "fisheye",
}
"""Families of lenses by `camera_model`."""


def write_nerfstudio(folder: Path, light_field: LightField, depth: KnownDepth | None = None) -> None:
    """Write a light field as a nerfstudio dataset; masks are 255 for samples of full weight.

    With a depth, `points.ply` has its points in the world, in metres: splats start from them.
    """
    views, frames = light_field, []
    centres_mm = centres_in_rig_mm(views) @ views.view_from_rig.T @ WORLD_FROM_VIEW.T
    for t, s in np.ndindex(views.rows, views.cols):
        name, matrix = view_name(t, s), views.matrices[t, s]
        write_image(folder / "images" / f"{name}.png", rgb(views.samples[t, s]))
        write_image(folder / "masks" / f"{name}.png", weight_bytes(views.weights[t, s]))
        focal, centre = (matrix[0, 0], matrix[1, 1]), (matrix[0, 2], matrix[1, 2])
        world_from_camera = rigid(WORLD_FROM_VIEW, centres_mm[t, s])
        undistorted = dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0)
        frames.append(frame(name, (views.width_px, views.height_px), focal, centre, world_from_camera, undistorted))
    write_views(folder / VIEWS, views, channels=views.samples.shape[-1])
    dataset: dict[str, Any] = {"camera_model": "OPENCV", "frames": frames}
    if depth is not None:
        points_in_rig, colours = point_cloud(light_field, depth.depth_mm)
        in_world = points_in_rig @ views.view_from_rig.T @ WORLD_FROM_VIEW.T / MM_PER_UNIT
        write_ply(folder / POINTS, in_world, colours, comment="metres, world of transforms.json")
        dataset["ply_file_path"] = POINTS
    write_json(folder / TRANSFORMS, dataset)


class _Frame(Value):
    """Fields that are read from a frame, or from the values common to all frames.

    Sizes may be left out, and `camera_angle_x` be given in place of the focal length, as in the data sets of NeRF.
    """

    model_config = ConfigDict(extra="ignore")

    file_path: str
    mask_path: str | None = None
    transform_matrix: Matrix4
    camera_model: str = "OPENCV"
    is_fisheye: bool = False
    camera_angle_x: float | None = None
    fl_x: float | None = None
    fl_y: float | None = None
    cx: float | None = None
    cy: float | None = None
    w: float | None = None
    h: float | None = None
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    p1: float = 0.0
    p2: float = 0.0


def read_nerfstudio(folder: Path, assumed: Assumed = NOTHING) -> Contents:
    """Read a dataset of any cameras with pictures of any names, in any order.

    Without `views.json`, the rig is nerfstudio's world in mm, if the world is in metres; a step that is assumed scales
    it. Raises a one-line InputError for cameras that are not the views of a light field.
    """
    path = folder / TRANSFORMS
    dataset, saved = read_json(path, LARGEST_LAYOUT_BYTES), read_views(folder / VIEWS)
    with as_input_error(path, "a dataset of views"):
        common = {name: dataset[name] for name in _Frame.model_fields if name in dataset}
        if len(dataset["frames"]) > MAX_FRAMES:
            raise ValueError(f"more than {MAX_FRAMES} frames")
        frames = [_Frame.model_validate({**common, **fields}, strict=True) for fields in dataset["frames"]]
        if not frames:
            raise ValueError("no frames")
    frames.sort(key=lambda frame: frame.file_path)
    if len(frames) > MAX_VIEWS:
        raise InputError(f"{path}: {len(frames)} frames, expected at most {MAX_VIEWS} views of a light field")
    files = [_picture(folder, frame.file_path) for frame in frames]
    masks = [None if frame.mask_path is None else inside(folder, frame.mask_path) for frame in frames]
    if saved is not None:
        return Contents((_own(path, saved, frames, files, masks),))
    size = picture_size(files[0])
    pictures = []
    for stated, file, mask in zip(frames, files, masks, strict=True):
        where = f"{path}: {stated.file_path[:80]}"
        world_from_camera = rigid(orthogonal(stated.transform_matrix[:3, :3], where), stated.transform_matrix[:3, 3])
        world_from_camera[:3, :3] = world_from_camera[:3, :3] @ OPENCV_FROM_OPENGL[:3, :3]
        if np.linalg.det(world_from_camera[:3, :3]) < 0:
            raise InputError(f"{where}: transform_matrix is a reflection, expected a rotation")
        world_from_camera[:3, 3] *= MM_PER_UNIT
        posed = PosedCamera(stated.file_path[:80], _camera(where, stated, size), world_from_camera)
        pictures.append(PosedPicture(file, mask, posed))
    return read_posed(path, pictures, assumed)


def _picture(folder: Path, name: str) -> Path:
    """Return the picture of a frame; names may lack the ending, as in the data sets of NeRF."""
    file = inside(folder, name)
    endings = (".png", ".jpg", ".jpeg", ".JPG")
    if is_picture(file) or file.exists():
        return file
    return next((found for ending in endings if (found := inside(folder, name + ending)).is_file()), file)


def _camera(where: str, frame: _Frame, picture_px: tuple[int, int]) -> Camera:
    """Return the camera of a frame; a size that is not stated is that of the first picture."""
    if frame.camera_model not in LENSES:
        raise InputError(f"{where}: camera_model {frame.camera_model[:40]!r}, expected one of {', '.join(LENSES)}")
    width, height = size_of([frame.w or picture_px[0], frame.h or picture_px[1]], where)
    focal = frame.fl_x
    if focal is None and frame.camera_angle_x is not None and 0 < frame.camera_angle_x < np.pi:
        focal = width / 2.0 / np.tan(frame.camera_angle_x / 2.0)
    if focal is None:
        raise InputError(f"{where}: has no fl_x, expected a focal length in px")
    centre = (width / 2.0 if frame.cx is None else frame.cx, height / 2.0 if frame.cy is None else frame.cy)
    core = [focal, frame.fl_y or focal, centre[0] - HALF_PIXEL, centre[1] - HALF_PIXEL]
    lens = "fisheye" if frame.is_fisheye else LENSES[frame.camera_model]
    distortion = [frame.k1, frame.k2, frame.p1, frame.p2, frame.k3]
    if lens == "fisheye":
        distortion = [frame.k1, frame.k2, frame.k3, frame.k4]
    elif frame.k4:
        raise InputError(f"{where}: has a coefficient k4, expected k1, k2, k3, p1 and p2")
    return camera_of(where, core, lens, distortion, (width, height))


def _own(
    path: Path,
    saved: tuple[Views, ViewsFile],
    frames: Sequence[_Frame],
    files: Sequence[Path],
    masks: Sequence[Path | None],
) -> LightField:
    """Read the pictures of the views in `views.json`, whose sorted names are row by row."""
    views = saved[0]
    if len(files) != views.rows * views.cols:
        raise InputError(
            f"{path}: not a dataset of a grid of views: {len(files)} views, expected {views.rows}x{views.cols}"
        )
    size = common_size(files)
    other = next((stated for stated in frames if (stated.w, stated.h) != size), None)
    if other is not None:
        raise InputError(f"{files[0]}: {size[0]}x{size[1]} px, expected {other.w or 0:g}x{other.h or 0:g}")
    pictures, opacities = [], []
    for file, mask in zip(files, masks, strict=True):
        picture = read_image(file)
        check_size(file, picture, size)
        opacity = np.full((size[1], size[0]), 255, np.uint8)
        if mask is not None:
            opacity = read_image(mask, grey=True)
            check_size(mask, opacity, size)
        pictures.append(picture)
        opacities.append(opacity)
    shape = (views.rows, views.cols, size[1], size[0])
    colours = np.stack(pictures).reshape(*shape, 3)
    return light_field_of(views, colours, np.stack(opacities).reshape(shape), saved[1].channels)


FORMAT = Format(
    name="nerfstudio",
    ending="_nerfstudio",
    detect=lambda path: (path / TRANSFORMS).exists(),
    read=read_nerfstudio,
    write=write_nerfstudio,
    has_points=True,
)
