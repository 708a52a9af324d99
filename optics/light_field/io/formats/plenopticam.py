"""A folder with `vp_img_arr.npy` for PlenoptiCam, [j, i, k, l, channel] from 0 to 65535, on square grids only.

Its j, i, k, l are our t, s, v, u. It also writes the views as pictures, `viewpoints_Npx/00_00.png`, row and column. Its
refocusing parameter a shifts by a px per view: it is our disparity.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirrorcam.optics.base.pictures import is_picture, read_image, write_image
from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.light_field.io.light_field_format import NOTHING, Assumed, Format, single, without_depth
from mirrorcam.optics.light_field.io.view_arrays import read_arrays, write_arrays
from mirrorcam.optics.light_field.io.view_images import check_size, common_size, light_field_of, rgb
from mirrorcam.optics.light_field.io.views_file import even_views
from mirrorcam.optics.light_field.light_field import LightField

ARRAY = "vp_img_arr.npy"
LARGEST = 65535.0
VIEWPOINTS = "viewpoints_*px"


def is_plenopticam(path: Path) -> bool:
    """Return whether a folder has its array, or its folder of viewpoints."""
    return (path / ARRAY).exists() or any(path.glob(VIEWPOINTS))


def write_plenopticam(folder: Path, light_field: LightField) -> None:
    """Write the array and the viewpoints."""
    rows, cols = light_field.rows, light_field.cols
    if rows != cols:
        raise InputError(f"{cols}x{rows} views, expected as many down as across for PlenoptiCam")
    for t, s in np.ndindex(rows, cols):
        picture = folder / VIEWPOINTS.replace("*", str(rows)) / f"{t:02d}_{s:02d}.png"
        write_image(picture, rgb(light_field.samples[t, s]))
    write_arrays(folder / ARRAY, light_field, LARGEST)


def read_plenopticam(folder: Path, assumed: Assumed = NOTHING) -> LightField:
    """The light field of such a folder, or of its folder of viewpoints alone."""
    if (folder / ARRAY).exists():
        return read_arrays(folder / ARRAY, LARGEST, assumed)
    return _viewpoints(next(iter(sorted(folder.glob(VIEWPOINTS)))), assumed)


def _viewpoints(folder: Path, assumed: Assumed) -> LightField:
    found = {}
    for file in folder.iterdir():
        row, _, col = file.stem.partition("_")
        if is_picture(file) and row.isdecimal() and col.isdecimal():
            found[int(row), int(col)] = file
    rows, cols = (1 + max((index[axis] for index in found), default=-1) for axis in (0, 1))
    if not found or len(found) != rows * cols:
        raise InputError(f"{folder}: {len(found)} views ROW_COLUMN.png, expected {max(rows * cols, 1)}")
    size = common_size(list(found.values()))
    pictures = [read_image(found[index]) for index in np.ndindex(rows, cols)]
    for index, picture in zip(np.ndindex(rows, cols), pictures, strict=True):
        check_size(found[index], picture, size)
    samples = np.stack(pictures).reshape(rows, cols, size[1], size[0], 3)
    views = even_views(folder, assumed, (rows, cols), size)
    return light_field_of(views, samples, np.full(samples.shape[:4], 255, np.uint8))


FORMAT = Format(
    name="plenopticam",
    ending="_plenopticam",
    detect=is_plenopticam,
    read=single(read_plenopticam),
    write=without_depth(write_plenopticam),
    needs_grid=True,
)
