"""COLMAP: the views as one rig of pinholes, in metres, with a sparse model of one frame and the points of its depth.

COLMAP drops cameras whose principal point lies outside their picture, which is common for views in mirrors, so
pictures get margins, which the masks exclude.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.files import inside, is_inside, write_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.read.colmap import (
    ColmapCamera,
    ColmapImage,
    ColmapModel,
    matrix_of,
    model_folder,
    projection_of,
    read_model,
)
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.sfm_rigs import HALF_PIXEL, SfmCamera, rig_config, sparse_model
from mirrorcam.optics.geometry.transforms import inverse, rigid
from mirrorcam.optics.light_field.camera_array import PosedCamera
from mirrorcam.optics.light_field.depth.parallax import reference_index
from mirrorcam.optics.light_field.io.formats.ply import point_cloud
from mirrorcam.optics.light_field.io.light_field_format import NOTHING, Assumed, Contents, Format, KnownDepth
from mirrorcam.optics.light_field.io.pinholes import centres_in_rig_mm, view_name
from mirrorcam.optics.light_field.io.posed_pictures import PosedPicture, read_posed
from mirrorcam.optics.light_field.io.view_images import check_size, common_size, light_field_of, rgb, weight_bytes
from mirrorcam.optics.light_field.io.views_file import VIEWS, ViewsFile, read_views, write_views
from mirrorcam.optics.light_field.light_field import LightField, Views

PICTURE = "0000.png"
EDGE_PX = 1.0
"""Minimum distance of principal points from the border."""
MM_PER_UNIT = 1000.0
"""A model has no unit; ours are in metres."""


def margins(views: Views) -> tuple[int, int, int, int]:
    """Return the px to add to every view (left, top, right, bottom) so that all principal points lie inside."""
    centres = views.matrices[..., :2, 2].reshape(-1, 2)
    size = np.array([views.width_px, views.height_px])
    before = np.ceil(np.maximum(0.0, EDGE_PX - centres.min(axis=0))).astype(int)
    after = np.ceil(np.maximum(0.0, centres.max(axis=0) + EDGE_PX - (size - 1))).astype(int)
    return int(before[0]), int(before[1]), int(after[0]), int(after[1])


def write_colmap(folder: Path, light_field: LightField, depth: KnownDepth | None = None) -> None:
    """Write `images/VIEW/0000.png`, `masks/`, `rig_config.json` and `sparse/`; the world is the rig frame.

    Numbers follow COLMAP's database: cameras and images from 1 in the order of names, then the joint rig and
    frame. With a depth, `points3D.txt` has its points, without tracks: splats start from them. Without, `colmap
    point_triangulator` adds points to the model.
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
    if depth is not None:
        write_text(folder / "sparse" / "points3D.txt", _points(*point_cloud(light_field, depth.depth_mm)))
    write_views(folder / VIEWS, views, channels=views.samples.shape[-1], margins=[left, top, right, bottom])


def _points(points_in_rig: FloatArray, colours: NDArray[np.uint8]) -> str:
    """Format points (n, 3), mm, with colours (n, 3); -1 is COLMAP's mark for an error that was not computed."""
    lines = ["# POINT3D_ID X Y Z R G B ERROR TRACK[]\n"]
    for number, (point, colour) in enumerate(zip(points_in_rig / MM_PER_UNIT, colours.tolist(), strict=True), start=1):
        lines.append(f"{number} {point[0]:.7g} {point[1]:.7g} {point[2]:.7g} {colour[0]} {colour[1]} {colour[2]} -1\n")
    return "".join(lines)


def is_colmap(folder: Path) -> bool:
    """Return whether a folder has a sparse model, as text or binary, in the places where COLMAP's tools write it."""
    model = model_folder(folder) if folder.is_dir() else None
    return model is not None and any((model / f"images{suffix}").is_file() for suffix in (".bin", ".txt"))


def read_colmap(folder: Path, assumed: Assumed = NOTHING) -> Contents:
    """Read the light field of a model of any cameras with pictures of any names.

    Without `views.json`, the rig is COLMAP's world in mm, if the world is in metres; a step that is assumed scales it.
    Of several frames of a rig, the first complete one is read. Raises InputError for cameras that are not the views of
    a light field.
    """
    where = model_folder(folder)
    if where is None:
        raise InputError(f"{folder}: no sparse model, expected cameras.bin or cameras.txt")
    model, saved = read_model(where), read_views(folder / VIEWS)
    images, note = _one_frame(model.images)
    if not images:
        raise InputError(f"{where}: no pictures, expected those of a light field")
    unknown = next((image for image in images if image.camera_id not in model.cameras), None)
    if unknown is not None:
        raise InputError(f"{where}: {unknown.name[:80]} refers to camera {unknown.camera_id}, which is missing")
    if saved is not None:
        return Contents((_own(folder, saved, images, model),))
    cameras = {number: _camera(f"{where}: camera {number}", model.cameras[number]) for number in _ids(images)}
    root = next((name for name in ("images", ".") if _has(folder / name, images[0].name)), "images")
    pictures = []
    for image in images:
        file, mask = inside(folder / root, image.name), inside(folder / "masks", f"{image.name}.png")
        world_from_camera = inverse(matrix_of(image.pose))
        world_from_camera[:3, 3] *= MM_PER_UNIT
        posed = PosedCamera(image.name[:80], cameras[image.camera_id], world_from_camera)
        pictures.append(PosedPicture(file, mask if mask.exists() else None, posed))
    contents = read_posed(where, pictures, assumed)
    return contents if note is None else replace(contents, notes=(note, *contents.notes))


def _ids(images: Sequence[ColmapImage]) -> set[int]:
    return {image.camera_id for image in images}


def _has(folder: Path, name: str) -> bool:
    return is_inside(folder, name) and (folder / name).is_file()


def _one_frame(images: Sequence[ColmapImage]) -> tuple[list[ColmapImage], str | None]:
    """Return pictures taken at one time, by name, and a note if there are others.

    In a rig, each camera has a folder, and pictures of one time have one name.
    """
    ordered = sorted(images, key=lambda image: image.name)
    frames: dict[str, list[ColmapImage]] = {}
    for image in ordered:
        frames.setdefault(PurePosixPath(image.name).name, []).append(image)
    folders = {PurePosixPath(image.name).parent for image in ordered}
    complete = [name for name, members in frames.items() if len(members) == len(folders)]
    if len(folders) < 2 or len(frames) < 2 or not complete:
        return ordered, None
    return frames[complete[0]], f"{complete[0]} of each camera read, of {len(frames)} pictures"


def _camera(where: str, camera: ColmapCamera) -> Camera:
    lens = projection_of(camera, where)
    if not isinstance(lens, Camera):
        raise InputError(f"{where}: {camera.model}, expected a pinhole with a lens")
    return lens


def _own(folder: Path, saved: tuple[Views, ViewsFile], images: Sequence[ColmapImage], model: ColmapModel) -> LightField:
    """Read the pictures of the views in `views.json`, whose sorted names are row by row, without their margins."""
    views, (left, top, right, bottom) = saved[0], saved[1].margins
    rows, cols = views.rows, views.cols
    if len(images) != rows * cols:
        raise InputError(f"{folder}: not a model of a grid of views: {len(images)} views, expected {rows}x{cols}")
    files = [inside(folder / "images", image.name) for image in images]
    size = common_size(files)
    stated = model.cameras[images[0].camera_id]
    if size != (stated.width_px, stated.height_px):
        raise InputError(
            f"{files[0]}: {size[0]}x{size[1]} px, expected {stated.width_px}x{stated.height_px} as for its camera"
        )
    if size != (views.width_px + left + right, views.height_px + top + bottom):
        raise InputError(
            f"{folder / VIEWS}: views of {views.width_px}x{views.height_px} px, but pictures of {size[0]}x{size[1]}"
        )
    inner = (slice(top, size[1] - bottom), slice(left, size[0] - right))
    shape = (rows, cols, views.height_px, views.width_px)
    colours, opacity = np.empty((*shape, 3), np.uint8), np.full(shape, 255, np.uint8)
    for index, file, image in zip(np.ndindex(rows, cols), files, images, strict=True):
        picture = read_image(file)
        check_size(file, picture, size)
        colours[index] = picture[inner]
        mask = inside(folder / "masks", f"{image.name}.png")
        if mask.exists():
            grey = read_image(mask, grey=True)
            check_size(mask, grey, size)
            opacity[index] = grey[inner]
    return light_field_of(views, colours, opacity, saved[1].channels)


FORMAT = Format(
    name="colmap",
    ending="_colmap",
    detect=is_colmap,
    read=read_colmap,
    write=write_colmap,
    has_points=True,
)
