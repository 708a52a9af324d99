"""All formats of light fields by name: which one a file or folder is in, and how each is written."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.light_field.io.formats.arrays import read_arrays, tool_of, write_arrays
from mirrorcam.optics.light_field.io.formats.colmap_scene import is_colmap, read_colmap, write_colmap
from mirrorcam.optics.light_field.io.formats.eslf import read_mosaic, write_mosaic
from mirrorcam.optics.light_field.io.formats.hci import PARAMETERS, read_hci, write_hci
from mirrorcam.optics.light_field.io.formats.lftoolbox import read_lftoolbox, write_lftoolbox
from mirrorcam.optics.light_field.io.formats.nerfstudio_scene import TRANSFORMS, read_nerfstudio, write_nerfstudio
from mirrorcam.optics.light_field.io.formats.ply import point_cloud, write_ply
from mirrorcam.optics.light_field.io.formats.stanford import is_stanford, read_stanford, write_stanford
from mirrorcam.optics.light_field.io.formats.views_file import NOTHING, Assumed
from mirrorcam.optics.light_field.io.npz import read_light_field, save_npz
from mirrorcam.optics.light_field.light_field import LightField

Format = Literal[
    "npz",
    "zarr",
    "lftoolbox",
    "hci",
    "stanford",
    "eslf",
    "tiles",
    "plenpy",
    "plenopticam",
    "colmap",
    "nerfstudio",
    "ply",
]
FORMATS: tuple[str, ...] = get_args(Format)
ENDINGS = {
    **{name: f"_{name}" for name in FORMATS},
    "npz": ".npz",
    "zarr": ".zarr",
    "lftoolbox": ".mat",
    "eslf": "_eslf.png",
    "tiles": "_tiles.png",
    "ply": ".ply",
}
"""What names end in; those without a suffix are of folders."""
Depth = NDArray[np.float32]


def write_zarr(path: Path, light_field: LightField) -> None:
    """Write one light field as a recording of one frame in Zarr."""
    from mirrorcam.optics.light_field.io.frames import Frame
    from mirrorcam.optics.light_field.io.recording import Recording, about
    from mirrorcam.optics.light_field.io.zarr_store import ZarrSink

    recording = Recording(path, about(light_field, {"file": path.stem}), ZarrSink())
    if recording.complete:
        raise InputError(f"{path}: exists, expected a new name")
    recording.add(Frame(0, 0.0, np.empty((0, 0, 3), np.uint8)), light_field)
    recording.finish()


_WRITERS: dict[str, Callable[[Path, LightField], None]] = {
    "npz": save_npz,
    "zarr": write_zarr,
    "lftoolbox": write_lftoolbox,
    "stanford": write_stanford,
    "eslf": partial(write_mosaic, order="eslf"),
    "tiles": partial(write_mosaic, order="tiles"),
    "plenpy": partial(write_arrays, tool="plenpy"),
    "plenopticam": partial(write_arrays, tool="plenopticam"),
    "colmap": write_colmap,
    "nerfstudio": write_nerfstudio,
}


def write_any(path: Path, light_field: LightField, to: Format, depth_mm: Depth | None = None) -> None:
    """Write a light field in a format; `depth_mm` (v, u), from the pupil, is what HCI may and PLY must have.

    Raises InputError for a folder that exists and has something in it, whose files would mix with the new ones.
    """
    if "." not in ENDINGS[to] and path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise InputError(f"{path}: exists, expected a new or empty folder")
    if to == "ply":
        if depth_mm is None:
            raise InputError(f"{path}: a point cloud needs the depth of the central view")
        write_ply(path, *point_cloud(light_field, depth_mm))
    elif to == "hci":
        write_hci(path, light_field, depth_mm)
    else:
        _WRITERS[to](path, light_field)


def named(path: Path) -> str:
    """The name of a light field by that of its file or folder, without what the format adds."""
    name = path.resolve().name if path.is_dir() else path.name
    ending = max((each for each in ENDINGS.values() if name.endswith(each)), key=len, default=path.suffix)
    return name.removesuffix(ending) or name


def format_of(path: Path) -> Format:
    """The format of a file or folder, by its name and by what a folder holds; InputError for none that can be read."""
    if path.is_dir():
        tool = tool_of(path)
        if (path / PARAMETERS).exists():
            return "hci"
        if (path / TRANSFORMS).exists():
            return "nerfstudio"
        if is_colmap(path):
            return "colmap"
        if tool is not None:
            return tool
        if is_stanford(path):
            return "stanford"
        if (path / "zarr.json").exists() or path.name.endswith((".zarr", ".zarr.partial")):
            return "zarr"
        raise InputError(f"{path}: a folder of no known format, expected one of {', '.join(FORMATS)}")
    suffix = path.suffix.lower()
    if suffix == ".png":
        return "eslf" if path.stem.lower().endswith("eslf") else "tiles"
    by_suffix: dict[str, Format] = {".npz": "npz", ".mat": "lftoolbox"}
    if suffix not in by_suffix:
        raise InputError(f"{path}: no light field by its name, expected .npz, .mat, .png, .zarr or a folder")
    return by_suffix[suffix]


def read_any(path: Path, assumed: Assumed = NOTHING, frame: int = 0) -> tuple[LightField, Depth | None]:
    """The light field of a file or folder in any format, and the depth (v, u) of its central view where it has one.

    Raises InputError in one line for what cannot be read, and for a geometry that is neither told nor assumed.
    """
    kind = format_of(path)
    if frame != 0 and kind != "zarr":
        raise InputError(f"{path}: has one frame, expected no frame {frame}")
    if kind == "hci":
        scene = read_hci(path)
        if scene.disparity_px is None:
            return scene.light_field, None
        axis: Literal["s", "t"] = "s" if scene.light_field.cols > 1 else "t"
        disparity = scene.disparity_px.astype(np.float64)
        return scene.light_field, scene.light_field.depth_mm_from_disparity(disparity, axis).astype(np.float32)
    if kind == "lftoolbox":
        return read_lftoolbox(path, assumed), None
    if kind == "nerfstudio":
        return read_nerfstudio(path), None
    if kind == "colmap":
        return read_colmap(path), None
    if kind == "stanford":
        return read_stanford(path, assumed), None
    if kind in ("eslf", "tiles"):
        return read_mosaic(path, None, assumed), None
    if kind in ("plenpy", "plenopticam"):
        return read_arrays(path, kind, assumed), None
    return read_light_field(path, frame), None
