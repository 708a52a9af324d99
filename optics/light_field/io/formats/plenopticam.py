"""A folder with `vp_img_arr.npy` for PlenoptiCam, [j, i, k, l, channel] from 0 to 65535, for square grids only.

Its j, i, k, l are our t, s, v, u. PlenoptiCam also writes the views as pictures, `viewpoints_Npx/00_00.png`, row and
column. Its refocusing parameter a shifts by a px per view, which is our disparity.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import is_picture, read_image, write_image
from mirrorcam.optics.light_field.io.light_field_format import NOTHING, Assumed, Format, depthless_writer, single_reader
from mirrorcam.optics.light_field.io.view_arrays import read_arrays, write_arrays
from mirrorcam.optics.light_field.io.view_images import check_size, common_size, light_field_of, rgb
from mirrorcam.optics.light_field.io.view_order import named_views
from mirrorcam.optics.light_field.io.views_file import even_views
from mirrorcam.optics.light_field.light_field import LightField

ARRAY = "vp_img_arr.npy"
FULL_SCALE = 65535.0
VIEWPOINTS = "viewpoints_*px"


def is_plenopticam(path: Path) -> bool:
    """Return whether a folder has PlenoptiCam's array, or its folder of viewpoints."""
    return (path / ARRAY).exists() or bool(_folders(path))


def _folders(path: Path) -> list[Path]:
    """Return the folders of viewpoints; PlenoptiCam writes one."""
    return sorted(folder for folder in path.glob(VIEWPOINTS) if folder.is_dir())


def write_plenopticam(folder: Path, light_field: LightField) -> None:
    """Write the array and the viewpoints."""
    rows, cols = light_field.rows, light_field.cols
    if rows != cols:
        raise InputError(f"{cols}x{rows} views, expected a square grid for PlenoptiCam")
    for t, s in np.ndindex(rows, cols):
        picture = folder / VIEWPOINTS.replace("*", str(rows)) / f"{t:02d}_{s:02d}.png"
        write_image(picture, rgb(light_field.samples[t, s]))
    write_arrays(folder / ARRAY, light_field, FULL_SCALE)


def read_plenopticam(folder: Path, assumed: Assumed = NOTHING) -> LightField:
    """Read the light field of a folder with the array, or with viewpoints alone."""
    if (folder / ARRAY).exists():
        return read_arrays(folder / ARRAY, FULL_SCALE, assumed)
    return _viewpoints(_folders(folder)[0], assumed)


def _viewpoints(folder: Path, assumed: Assumed) -> LightField:
    named = named_views(folder, [file for file in sorted(folder.iterdir()) if is_picture(file)])
    rows, cols = named.grid
    size = common_size(named.files)
    pictures = [read_image(file) for file in named.files]
    for file, picture in zip(named.files, pictures, strict=True):
        check_size(file, picture, size)
    samples = np.stack(pictures).reshape(rows, cols, size[1], size[0], 3)
    views = even_views(folder.parent, assumed, (rows, cols), size)
    return light_field_of(views, samples, np.full(samples.shape[:4], 255, np.uint8))


FORMAT = Format(
    name="plenopticam",
    ending="_plenopticam",
    detect=is_plenopticam,
    read=single_reader(read_plenopticam),
    write=depthless_writer(write_plenopticam),
    needs_grid=True,
)
