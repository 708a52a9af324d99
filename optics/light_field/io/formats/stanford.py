"""Folders with one picture per view, like the Stanford Light Field Archive's gantry: `out_ROW_COLUMN_Y_X_.png`.

Rows and columns count from the top left view, with two digits, so sorted names are row by row. Y and X are the camera's
position, y down and x right, in the gantry's unit in the archive, and in mm here. Pictures are rectified to a plane of
zero disparity. `masks/` holds the weights of views with missing samples.

Such folders are read with any name before ROW, with any picture type, and without Y and X: `2067_01_01.jpg`. They may
be a block of a larger grid, or every second view of it, and have the focal length and the sensor width, mm, at the end:
`Original Camera_11_11_61.5_61.5_30_36.jpg`. All names together show which numbers are ROW and COLUMN, and the pictures
show which of the two is the row: `IMG_0001_002_01_02.png`. With rows or columns assumed, pictures of any other names
are the views row by row in natural order: `view0.png`, ..., `view10.png`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirrorcam.core.disk.array_files import as_input_error
from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.images.pictures import is_picture, read_image, write_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.io.light_field_format import NOTHING, Assumed, Contents, Format, depthless_writer
from mirrorcam.optics.light_field.io.view_images import check_size, common_size, light_field_of, rgb, weight_bytes
from mirrorcam.optics.light_field.io.view_order import named_views
from mirrorcam.optics.light_field.io.views_file import VIEWS, even_views, read_views, write_views
from mirrorcam.optics.light_field.light_field import LightField, Views

MASKS = "masks"


def write_stanford(folder: Path, light_field: LightField) -> None:
    """Write a light field as a folder of 8-bit pictures."""
    if max(light_field.rows, light_field.cols) > 100:
        raise InputError(f"{light_field.cols}x{light_field.rows} views, expected at most 100 rows and columns")
    for t, s in np.ndindex(light_field.rows, light_field.cols):
        # Adding zero removes the sign of a negative zero.
        x, y = light_field.positions_mm[t, s, :2].round(6) + 0.0
        name = f"out_{t:02d}_{s:02d}_{y:.6f}_{x:.6f}_.png"
        write_image(folder / name, rgb(light_field.samples[t, s]))
        if light_field.weights.min() < 1.0:
            write_image(folder / MASKS / name, weight_bytes(light_field.weights[t, s]))
    write_views(folder / VIEWS, light_field, channels=light_field.samples.shape[-1])


def is_stanford(folder: Path) -> bool:
    """Return whether a folder has several pictures."""
    return folder.is_dir() and sum(is_picture(file) for file in folder.iterdir()) > 1


def read_stanford(folder: Path, assumed: Assumed = NOTHING) -> Contents:
    """Read the light field of a folder, with a note on pictures that are not views of the grid.

    Without `views.json`, positions are read from the names, in mm or, given a step, scaled so that it is the mean step
    of columns (for one column, of rows): the archive's own unit is unknown. Names without positions mean an even grid,
    whose step must be assumed. Focal length and reference depth must be assumed.

    Raises a one-line InputError if a view is missing or has a different size, or the geometry is unknown.
    """
    with as_input_error(folder, "pictures of a grid of views"):
        pictures_in_folder = [file for file in sorted(folder.iterdir()) if is_picture(file)]
        named = named_views(folder, pictures_in_folder, (assumed.rows, assumed.cols))
    files, positions_mm, (rows, cols) = named.files, named.positions, named.grid
    size, stated = common_size(files), read_views(folder / VIEWS)
    if stated is not None:
        size = (stated[0].width_px, stated[0].height_px)
    pictures = [read_image(file) for file in files]
    for file, picture in zip(files, pictures, strict=True):
        check_size(file, picture, size)
    channels = 3
    if stated is not None:
        views, channels = stated[0], stated[1].channels
        if (views.rows, views.cols) != (rows, cols):
            raise InputError(f"{folder / VIEWS}: {views.cols}x{views.rows} views, but {cols}x{rows} pictures")
    elif positions_mm is None:
        views = even_views(folder, assumed, (rows, cols), size)
    else:
        if assumed.step_mm is not None:
            positions_mm *= assumed.step_mm / _mean_step(folder, positions_mm)
        if assumed.focal_px is None and named.focal_widths is not None:
            assumed = assumed.replaced(focal_px=named.focal_widths * size[0])
        focal_px, distance_mm = assumed.need(folder, "focal_px", "reference_depth_mm")
        views = Views.parallel(positions_mm, size, focal_px, distance_mm)
    opacity = np.full((rows, cols, size[1], size[0]), 255, np.uint8)
    for index, file in zip(np.ndindex(rows, cols), files, strict=True):
        mask = folder / MASKS / file.name
        if mask.exists():
            grey = read_image(mask, grey=True)
            check_size(mask, grey, size)
            opacity[index] = grey
    samples = np.stack(pictures).reshape(rows, cols, size[1], size[0], 3)
    left_out = sorted(set(pictures_in_folder) - set(files))
    notes: tuple[str, ...] = ()
    if left_out:
        pictures_text = count_text(len(left_out), "picture")
        notes = (f"{pictures_text} left out, not named as one of the {cols}x{rows} views, such as {left_out[0].name}",)
    return Contents((light_field_of(views, samples, opacity, channels),), notes=notes)


def _mean_step(folder: Path, positions_mm: FloatArray) -> float:
    """Return the mean step of positions (t, s, 2): of x along columns, or of y along rows for a single column."""
    rows, cols = positions_mm.shape[:2]
    if rows * cols == 1:
        raise InputError(f"{folder}: only one view, expected at least two for a step")
    ends = positions_mm[:, [0, -1], 0] if cols > 1 else positions_mm[[0, -1], :, 1].T
    step = float(np.diff(ends).mean()) / (max(cols, 2) - 1 if cols > 1 else rows - 1)
    if step == 0.0:
        raise InputError(f"{folder}: the names give all views the same position, expected different ones")
    return step


FORMAT = Format(
    name="stanford",
    ending="_stanford",
    detect=is_stanford,
    read=read_stanford,
    write=depthless_writer(write_stanford),
    needs_grid=True,
)
