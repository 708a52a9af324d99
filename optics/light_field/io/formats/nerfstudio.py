"""nerfstudio's `transforms.json` and pictures of the views, in metres.

The world is at the pupil: x right, y to the scene, z up.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam.optics.base.files import read_bytes, write_json
from mirrorcam.optics.base.pictures import read_image, write_image
from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.geometry.nerfstudio_frames import HALF_PIXEL, OPENCV_FROM_OPENGL, WORLD_FROM_VIEW, frame
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.optics.light_field.io.light_field_format import Format, single, without_depth
from mirrorcam.optics.light_field.io.pinholes import centres_in_rig_mm, view_name, views_of_pinholes
from mirrorcam.optics.light_field.io.view_images import check_size, light_field_of, rgb, weight_bytes
from mirrorcam.optics.light_field.io.views_file import VIEWS, read_views, write_views
from mirrorcam.optics.light_field.light_field import LightField

TRANSFORMS = "transforms.json"


def write_nerfstudio(folder: Path, light_field: LightField) -> None:
    """Write a light field as a dataset of nerfstudio; masks are 255 where there are samples."""
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


def read_nerfstudio(folder: Path) -> LightField:
    """The light field of such a dataset: of parallel, undistorted views named `..._ROW_COLUMN.png`.

    Without `views.json` the rig is nerfstudio's world in mm. Raises InputError in one line for any other dataset.
    """
    path = folder / TRANSFORMS
    try:
        dataset = json.loads(read_bytes(path))
        frames = {_index(each["file_path"]): {**dataset, **each} for each in dataset["frames"]}
        rows, cols = (1 + max(index[axis] for index in frames) for axis in (0, 1))
        order = [frames[index] for index in np.ndindex(rows, cols)]
        transforms = np.array([each["transform_matrix"] for each in order], np.float64)
        numbers = np.array([[float(each[key]) for key in ("fl_x", "fl_y", "cx", "cy")] for each in order])
        bent = max(abs(float(each.get(key, 0.0))) for each in order for key in ("k1", "k2", "k3", "p1", "p2"))
        size = int(order[0]["w"]), int(order[0]["h"])
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise InputError(f"{path}: not a dataset of a grid of views: {error!r}") from None
    if transforms.shape != (rows * cols, 4, 4) or np.abs(transforms[:, :3, :3] - transforms[0, :3, :3]).max() > 1e-6:
        raise InputError(f"{path}: cameras are turned differently, expected parallel views")
    if bent > 0.0:
        raise InputError(f"{path}: cameras have distortion, expected undistorted views")
    matrices = np.zeros((rows * cols, 3, 3))
    matrices[:, 0, 0], matrices[:, 1, 1], matrices[:, 2, 2] = numbers[:, 0], numbers[:, 1], 1.0
    matrices[:, :2, 2] = numbers[:, 2:] - HALF_PIXEL
    own = read_views(folder / VIEWS)
    views: Any = own[0] if own else None
    if views is None:
        centres_mm = 1000.0 * transforms[:, :3, 3].reshape(rows, cols, 3)
        view_from_world = (transforms[0, :3, :3] @ OPENCV_FROM_OPENGL[:3, :3]).T
        views = views_of_pinholes(centres_mm, view_from_world, matrices.reshape(rows, cols, 3, 3), size, str(path))
    pictures, masks = [], []
    for each in order:
        picture = read_image(folder / each["file_path"])
        check_size(folder / each["file_path"], picture, size)
        mask = np.full((size[1], size[0]), 255, np.uint8)
        if "mask_path" in each:
            mask = read_image(folder / each["mask_path"], grey=True)
            check_size(folder / each["mask_path"], mask, size)
        pictures.append(picture)
        masks.append(mask)
    shape = (rows, cols, size[1], size[0])
    channels = own[1]["channels"] if own else 3
    return light_field_of(views, np.stack(pictures).reshape(*shape, 3), np.stack(masks).reshape(shape), channels)


def _index(file: str) -> tuple[int, int]:
    """Row and column of a view by the name of its picture."""
    row, col = Path(file).stem.split("_")[-2:]
    return int(row), int(col)


FORMAT = Format(
    name="nerfstudio",
    ending="_nerfstudio",
    detect=lambda path: (path / TRANSFORMS).exists(),
    read=single(lambda path, assumed: read_nerfstudio(path)),
    write=without_depth(write_nerfstudio),
)
