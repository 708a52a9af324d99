"""COLMAP: the views as one rig of pinholes, in metres, with a sparse model of one frame without points.

COLMAP drops cameras whose principal point lies outside their picture, which is common for views in mirrors, so
pictures get margins, which the masks exclude.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mirrorcam.core.disk.array_files import as_input_error
from mirrorcam.core.disk.files import inside, read_lines, write_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.optics.geometry.sfm_rigs import HALF_PIXEL, SfmCamera, rig_config, sparse_model
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.optics.light_field.depth.parallax import reference_index
from mirrorcam.optics.light_field.io.light_field_format import Format, depthless_writer, single_reader
from mirrorcam.optics.light_field.io.pinholes import centres_in_rig_mm, row_by_row, view_name, views_of_pinholes
from mirrorcam.optics.light_field.io.view_images import check_size, common_size, light_field_of, rgb, weight_bytes
from mirrorcam.optics.light_field.io.views_file import VIEWS, read_views, write_views
from mirrorcam.optics.light_field.light_field import LightField, Views

PICTURE = "0000.png"
EDGE_PX = 1.0
"""Minimum distance of principal points from the border."""
_FIELDS = 10
"""Number of fields in a picture's line of `images.txt`."""


def margins(views: Views) -> tuple[int, int, int, int]:
    """Return the px to add to every view (left, top, right, bottom) so that all principal points lie inside."""
    centres = views.matrices[..., :2, 2].reshape(-1, 2)
    size = np.array([views.width_px, views.height_px])
    before = np.ceil(np.maximum(0.0, EDGE_PX - centres.min(axis=0))).astype(int)
    after = np.ceil(np.maximum(0.0, centres.max(axis=0) + EDGE_PX - (size - 1))).astype(int)
    return int(before[0]), int(before[1]), int(after[0]), int(after[1])


def write_colmap(folder: Path, light_field: LightField) -> None:
    """Write `images/VIEW/0000.png`, `masks/`, `rig_config.json` and `sparse/`; the world is the rig frame.

    Numbers follow COLMAP's database: cameras and images from 1 in the order of names, then the joint rig and
    frame. `colmap point_triangulator` adds points to the model.
    """
    views = light_field
    left, top, right, bottom = margins(views)
    padding = ((top, bottom), (left, right))
    size = views.width_px + left + right, views.height_px + top + bottom
    rotation, centres = views.view_from_rig, centres_in_rig_mm(views)
    cameras = []
    for t, s in np.ndindex(views.rows, views.cols):
        name, matrix = view_name(t, s), views.matrices[t, s]
        weights = np.pad(weight_bytes(views.weights[t, s]), padding)
        write_image(folder / "images" / name / PICTURE, np.pad(rgb(views.samples[t, s]), (*padding, (0, 0))))
        write_image(folder / "masks" / name / f"{PICTURE}.png", np.where(weights > 0, 255, 0).astype(np.uint8))
        cx, cy = matrix[0, 2] + left + HALF_PIXEL, matrix[1, 2] + top + HALF_PIXEL
        parameters = [float(value) for value in (matrix[0, 0], matrix[1, 1], cx, cy)]
        camera_from_rig = rigid(rotation, -rotation @ centres[t, s])
        cameras.append(SfmCamera(name, "PINHOLE", *size, parameters, camera_from_rig))
    t, s = reference_index(views)
    reference = t * views.cols + s
    write_text(folder / "rig_config.json", rig_config(cameras, reference))
    for name, text in sparse_model(cameras, reference, PICTURE).items():
        write_text(folder / "sparse" / name, text)
    write_views(folder / VIEWS, views, channels=views.samples.shape[-1], margins=[left, top, right, bottom])


def is_colmap(folder: Path) -> bool:
    """Return whether a folder has a text model, as laid out by `write_colmap` and `colmap model_converter`."""
    return (folder / "sparse" / "cameras.txt").exists() and (folder / "sparse" / "images.txt").exists()


def read_colmap(folder: Path) -> LightField:
    """Read the light field of a model of parallel PINHOLE cameras, with pictures named `..._ROW_COLUMN/NAME`.

    Without `views.json`, the rig is COLMAP's world in mm, and pictures keep their margins. Raises InputError
    for any other model.
    """
    model = folder / "sparse"
    with as_input_error(model, "a model of a grid of views"):
        (rows, cols), order = row_by_row(_named_views(model))
        poses, numbers = (np.array([view[part] for view in order]) for part in (0, 1))
        if poses.shape[1:] != (7,) or numbers.shape[1:] != (6,) or not np.isfinite([poses.sum(), numbers.sum()]).all():
            raise ValueError("numbers are missing or not finite")
        rotations = Rotation.from_quat(poses[:, :4], scalar_first=True).as_matrix()
    if np.abs(rotations - rotations[0]).max() > 1e-6 or np.ptp(numbers[:, :2], axis=0).any():
        raise InputError(f"{model}: cameras have different orientations or sizes, expected parallel views")
    files = [inside(folder / "images", name) for _, _, name in order]
    size = common_size(files)
    if size != tuple(numbers[0, :2]):
        raise InputError(f"{files[0]}: {size[0]}x{size[1]} px, expected {numbers[0, :2].tolist()} as for its camera")
    saved = read_views(folder / VIEWS)
    left, top, right, bottom = saved[1].margins if saved else (0, 0, 0, 0)
    if saved:
        views = saved[0]
        if size != (views.width_px + left + right, views.height_px + top + bottom):
            raise InputError(
                f"{folder / VIEWS}: views of {views.width_px}x{views.height_px} px, but pictures of {size[0]}x{size[1]}"
            )
    else:
        matrices = np.zeros((rows * cols, 3, 3))
        matrices[:, 0, 0], matrices[:, 1, 1], matrices[:, 2, 2] = numbers[:, 2], numbers[:, 3], 1.0
        matrices[:, :2, 2] = numbers[:, 4:] - HALF_PIXEL
        centres_mm = (-1000.0 * poses[:, 4:] @ rotations[0]).reshape(rows, cols, 3)
        views = views_of_pinholes(centres_mm, rotations[0], matrices.reshape(rows, cols, 3, 3), size, str(model))
    inner = (slice(top, size[1] - bottom), slice(left, size[0] - right))
    shape = (rows, cols, views.height_px, views.width_px)
    colours, opacity = np.empty((*shape, 3), np.uint8), np.full(shape, 255, np.uint8)
    for index, file, (_, _, name) in zip(np.ndindex(rows, cols), files, order, strict=True):
        picture = read_image(file)
        check_size(file, picture, size)
        colours[index] = picture[inner]
        mask = inside(folder / "masks", f"{name}.png")
        if mask.exists():
            grey = read_image(mask, grey=True)
            check_size(mask, grey, size)
            opacity[index] = grey[inner]
    return light_field_of(views, colours, opacity, saved[1].channels if saved else 3)


_View = tuple[NDArray[np.float64], list[float], str]


def _named_views(where: Path) -> dict[tuple[int, int], _View]:
    """Return pose, intrinsics and picture of each view by row and column, from the pictures' names."""
    cameras, views = {}, dict[tuple[int, int], _View]()
    for words in _lines(where / "cameras.txt"):
        if words[1] != "PINHOLE":
            raise InputError(f"{where / 'cameras.txt'}: camera {words[0]} is {words[1]}, expected PINHOLE"[:300])
        cameras[words[0]] = [float(word) for word in words[2:8]]
    for words in _lines(where / "images.txt"):
        # Lines of points do not have ten words ending in a picture's name.
        if len(words) == _FIELDS and "/" in words[9]:
            row, col = (int(word) for word in words[9].split("/")[0].split("_")[-2:])
            views[row, col] = np.array(words[1:8], np.float64), cameras[words[8]], words[9]
    return views


def _lines(path: Path) -> Iterator[list[str]]:
    """Yield the first words (the rest as one) of each line that is neither empty nor a comment."""
    for raw in read_lines(path):
        line = raw.decode("utf-8")
        if line.strip() and not line.startswith("#"):
            yield line.split(maxsplit=_FIELDS)


FORMAT = Format(
    name="colmap",
    ending="_colmap",
    detect=is_colmap,
    read=single_reader(lambda path, assumed: read_colmap(path)),
    write=depthless_writer(write_colmap),
)
