"""Arrays for plenpy and PlenoptiCam: folders with NumPy's .npy, and the views as pictures.

plenpy's `LightField(numpy.load(...))` is [u, v, s, t, channel] with u down and v right among the views: our order under
other names. So is PlenoptiCam's `vp_img_arr` [j, i, k, l, channel], on square grids only, which it also writes as
`viewpoints_Npx/00_00.png`, row and column. Values are 0 to 1 for plenpy, 0 to 65535 for PlenoptiCam.

plenpy's disparity is positive for what is nearer, and in its planes' fit, as in LFFiltShiftSum, px per view times
(N - 1) / N. PlenoptiCam's refocusing parameter a shifts by a px per view: it is our disparity.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np

from mirrorcam.optics.base.files import atomic, read_image, write_image
from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.light_field.io.formats.view_images import check_size, light_field_of, rgb
from mirrorcam.optics.light_field.io.formats.views_file import (
    NOTHING,
    VIEWS,
    Assumed,
    even_views,
    read_views,
    write_views,
)
from mirrorcam.optics.light_field.light_field import LightField

Tool = Literal["plenpy", "plenopticam"]
ARRAYS: dict[str, str] = {"plenpy": "light_field.npy", "plenopticam": "vp_img_arr.npy"}
LARGEST: dict[str, float] = {"plenpy": 1.0, "plenopticam": 65535.0}
WEIGHTS = "weights.npy"
VIEWPOINTS = "viewpoints_*px"


def write_arrays(folder: Path, light_field: LightField, tool: Tool) -> None:
    """Write the samples as float32 in the tool's order and range, and the weights beside them."""
    rows, cols = light_field.rows, light_field.cols
    samples: Any = light_field.samples.astype(np.float32)
    if light_field.samples.dtype == np.uint8:
        samples /= np.float32(255.0)
    if tool == "plenopticam":
        if rows != cols:
            raise InputError(f"{cols}x{rows} views, expected as many down as across for PlenoptiCam")
        for t, s in np.ndindex(rows, cols):
            picture = folder / VIEWPOINTS.replace("*", str(rows)) / f"{t:02d}_{s:02d}.png"
            write_image(picture, rgb(light_field.samples[t, s]))
    _save(folder / ARRAYS[tool], samples * np.float32(LARGEST[tool]))
    _save(folder / WEIGHTS, light_field.weights)
    write_views(folder / VIEWS, light_field, dtype=str(light_field.samples.dtype))


def _save(path: Path, array: np.ndarray) -> None:
    with atomic(path) as temporary:
        np.save(temporary, array, allow_pickle=False)


def _load(path: Path, dimensions: int) -> Any:
    try:
        array = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path}: not an .npy file that can be read: {' '.join(str(error).split())}") from None
    if not isinstance(array, np.ndarray) or array.ndim != dimensions or array.dtype.kind not in "fu":
        raise InputError(f"{path}: expected an array of {dimensions} dimensions of numbers")
    return array


def tool_of(folder: Path) -> Tool | None:
    """Whose arrays or viewpoints a folder has."""
    if (folder / ARRAYS["plenpy"]).exists():
        return "plenpy"
    return "plenopticam" if (folder / ARRAYS["plenopticam"]).exists() or any(folder.glob(VIEWPOINTS)) else None


def read_arrays(folder: Path, tool: Tool, assumed: Assumed = NOTHING) -> LightField:
    """The light field of such a folder, or of PlenoptiCam's folder of viewpoints alone.

    Without `views.json`, samples are float32 on an even grid, and the geometry is as assumed. Raises InputError in one
    line for arrays of other shapes, or values that are not finite.
    """
    path = folder / ARRAYS[tool]
    if not path.exists():
        return _viewpoints(next(iter(sorted(folder.glob(VIEWPOINTS)))), assumed)
    array, said = _load(path, 5), read_views(folder / VIEWS)
    largest = float(np.iinfo(array.dtype).max) if array.dtype.kind == "u" else LARGEST[tool]
    samples = array.astype(np.float32) / np.float32(largest)
    rows, cols, height, width = samples.shape[:4]
    if (folder / WEIGHTS).exists():
        weights = _load(folder / WEIGHTS, 4).astype(np.float32)
    else:
        weights = np.ones(samples.shape[:4], np.float32)
    if said is not None and said[1].get("dtype") == "uint8":
        if not np.isfinite(samples).all():
            raise InputError(f"{path}: holds a value that is NaN or infinite, expected finite numbers")
        samples = np.rint(np.clip(samples, 0.0, 1.0) * 255.0).astype(np.uint8)
    views = even_views(path, assumed, (rows, cols), (width, height)) if said is None else said[0]
    try:
        return LightField.of(views, samples, weights)
    except InputError as error:
        raise InputError(f"{folder}: {error}") from None


def _viewpoints(folder: Path, assumed: Assumed) -> LightField:
    found = {}
    for file in folder.glob("[0-9]*_[0-9]*.png"):
        row, _, col = file.stem.partition("_")
        if row.isdigit() and col.isdigit():
            found[int(row), int(col)] = file
    rows, cols = (1 + max((index[axis] for index in found), default=-1) for axis in (0, 1))
    if not found or len(found) != rows * cols:
        raise InputError(f"{folder}: {len(found)} views ROW_COLUMN.png, expected {max(rows * cols, 1)}")
    pictures = [read_image(found[index]) for index in np.ndindex(rows, cols)]
    size = (pictures[0].shape[1], pictures[0].shape[0])
    for index, picture in zip(np.ndindex(rows, cols), pictures, strict=True):
        check_size(found[index], picture, size)
    samples = np.stack(pictures).reshape(rows, cols, size[1], size[0], 3)
    views = even_views(folder, assumed, (rows, cols), size)
    return light_field_of(views, samples, np.full(samples.shape[:4], 255, np.uint8))
