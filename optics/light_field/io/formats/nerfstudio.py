"""nerfstudio's `transforms.json` with pictures of the views, in metres.

The world's origin is the pupil: x right, y towards the scene, z up.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ConfigDict

from mirrorcam.core.disk.array_files import as_input_error
from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, inside, read_json, write_json
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.values import Matrix4, Value
from mirrorcam.optics.geometry.sfm_rigs import HALF_PIXEL, OPENCV_FROM_OPENGL, WORLD_FROM_VIEW, frame
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.optics.light_field.io.light_field_format import Format, depthless_writer, single_reader
from mirrorcam.optics.light_field.io.pinholes import centres_in_rig_mm, row_by_row, view_name, views_of_pinholes
from mirrorcam.optics.light_field.io.view_images import check_size, common_size, light_field_of, rgb, weight_bytes
from mirrorcam.optics.light_field.io.views_file import VIEWS, read_views, write_views
from mirrorcam.optics.light_field.light_field import LightField

TRANSFORMS = "transforms.json"
MAX_FRAMES = 20_000


def write_nerfstudio(folder: Path, light_field: LightField) -> None:
    """Write a light field as a nerfstudio dataset; masks are 255 for samples of full weight."""
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
    write_json(folder / TRANSFORMS, {"camera_model": "OPENCV", "frames": frames})


class _Frame(Value):
    """Fields that are read from a frame, or from the values common to all frames."""

    model_config = ConfigDict(extra="ignore")

    file_path: str
    mask_path: str | None = None
    transform_matrix: Matrix4
    fl_x: float
    fl_y: float
    cx: float
    cy: float
    w: float
    h: float
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0


def read_nerfstudio(folder: Path) -> LightField:
    """Read a dataset of parallel, undistorted views named `..._ROW_COLUMN.png`.

    Without `views.json`, the rig is nerfstudio's world in mm. Raises a one-line InputError for any other dataset.
    """
    path = folder / TRANSFORMS
    dataset = read_json(path, LARGEST_LAYOUT_BYTES)
    with as_input_error(path, "a dataset of a grid of views"):
        frames, common = {}, {name: dataset[name] for name in _Frame.model_fields if name in dataset}
        if len(dataset["frames"]) > MAX_FRAMES:
            raise ValueError(f"more than {MAX_FRAMES} frames")
        for fields in dataset["frames"]:
            frame = _Frame.model_validate({**common, **fields}, strict=True)
            frames[_index(frame.file_path)] = frame
        (rows, cols), order = row_by_row(frames)
    transforms = np.array([frame.transform_matrix for frame in order])
    numbers = np.array([[frame.fl_x, frame.fl_y, frame.cx, frame.cy] for frame in order])
    distortion = max(abs(k) for frame in order for k in (frame.k1, frame.k2, frame.k3, frame.p1, frame.p2))
    if np.abs(transforms[:, :3, :3] - transforms[0, :3, :3]).max() > 1e-6:
        raise InputError(f"{path}: cameras have different orientations, expected parallel views")
    if distortion > 0.0:
        raise InputError(f"{path}: cameras have distortion, expected undistorted views")
    matrices = np.zeros((rows * cols, 3, 3))
    matrices[:, 0, 0], matrices[:, 1, 1], matrices[:, 2, 2] = numbers[:, 0], numbers[:, 1], 1.0
    matrices[:, :2, 2] = numbers[:, 2:] - HALF_PIXEL
    files = [inside(folder, frame.file_path) for frame in order]
    size, stated = common_size(files), read_views(folder / VIEWS)
    if size != (order[0].w, order[0].h):
        raise InputError(f"{files[0]}: {size[0]}x{size[1]} px, expected {order[0].w:g}x{order[0].h:g}")
    views: Any = stated[0] if stated else None
    if views is None:
        centres_mm = 1000.0 * transforms[:, :3, 3].reshape(rows, cols, 3)
        view_from_world = (transforms[0, :3, :3] @ OPENCV_FROM_OPENGL[:3, :3]).T
        views = views_of_pinholes(centres_mm, view_from_world, matrices.reshape(rows, cols, 3, 3), size, str(path))
    pictures, masks = [], []
    for frame, file in zip(order, files, strict=True):
        picture = read_image(file)
        check_size(file, picture, size)
        mask = np.full((size[1], size[0]), 255, np.uint8)
        if frame.mask_path is not None:
            mask_path = inside(folder, frame.mask_path)
            mask = read_image(mask_path, grey=True)
            check_size(mask_path, mask, size)
        pictures.append(picture)
        masks.append(mask)
    shape = (rows, cols, size[1], size[0])
    channels = stated[1].channels if stated else 3
    return light_field_of(views, np.stack(pictures).reshape(*shape, 3), np.stack(masks).reshape(shape), channels)


def _index(file: str) -> tuple[int, int]:
    """Return row and column of a view from its picture's name."""
    row, col = Path(file).stem.split("_")[-2:]
    return int(row), int(col)


FORMAT = Format(
    name="nerfstudio",
    ending="_nerfstudio",
    detect=lambda path: (path / TRANSFORMS).exists(),
    read=single_reader(lambda path, assumed: read_nerfstudio(path)),
    write=depthless_writer(write_nerfstudio),
)
