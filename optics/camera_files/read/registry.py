"""Detection of a calibration's format, and the reader of each format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from mirrorcam.core.disk.files import is_inside
from mirrorcam.core.disk.yaml_text import YAML_SUFFIXES
from mirrorcam.core.errors import InputError
from mirrorcam.optics.camera_files.camera_rig import CameraRig, MirrorProjection, RigCamera
from mirrorcam.optics.camera_files.read import anipose, colmap, kalibr, mrcal, opencv, ros
from mirrorcam.optics.camera_files.read.file_text import MAX_BYTES, read_yaml
from mirrorcam.optics.camera_files.write.virtual_cameras import view_name
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid

FormatName = Literal["kalibr", "opencv", "ros", "colmap", "mrcal", "anipose", "mirrorcam"]
FORMATS: tuple[FormatName, ...] = get_args(FormatName)
UNITS_MM: dict[str, float | None] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "none": None}
"""Values of `--unit`; `none` for poses without scale."""
SUBFOLDERS = {name: name for name in ("ros", "colmap", "anipose")}
"""Subfolders in which `mirrorcam camera export` puts files."""
MAX_POSE = 1e12
"""Maximum absolute number in a pose, whatever its unit."""
MAX_FILES = 1000
"""Maximum number of files to examine in a folder."""
UNREAD = {
    ".pickle": "pickles, such as DeepLabCut's, are never opened",
    ".urdf": "a URDF contains only poses; they are read with the camera_info files next to it (ros/)",
    ".ini": "camera_calibration's .ini files are not read, but its .yaml files are",
    "ost.txt": "camera_calibration's ost.txt is not read, but its ost.yaml is",
    "transforms.json": "nerfstudio's cameras do not state the position of their pictures in the frame",
    "rig_config.json": "COLMAP's rig_config.json contains no lenses, but its model does (colmap/sparse)",
    **dict.fromkeys(
        (f"{name}.{ending}" for name in ("images", "rigs", "frames", "points3D") for ending in ("txt", "bin")),
        "this file is part of a COLMAP model, expected its folder",
    ),
}
"""Reasons why known files contain no cameras to score, by file name or suffix."""
FORMAT = "mirrorcam"


@dataclass(frozen=True)
class Detected:
    """A calibration: its format, and its files or its folder."""

    format: FormatName
    paths: tuple[Path, ...]


READERS: dict[FormatName, Callable[[tuple[Path, ...]], CameraRig]] = {
    "kalibr": lambda paths: kalibr.read_kalibr(paths[0]),
    "opencv": opencv.read_opencv,
    "ros": ros.read_ros,
    "colmap": lambda paths: colmap.read_colmap(paths[0]),
    "mrcal": mrcal.read_mrcal,
    "anipose": lambda paths: anipose.read_anipose(paths[0]),
    "mirrorcam": lambda paths: rig_of(Layout.load(paths[0])),
}


def read_rig(path: Path, format: FormatName | None = None, unit: str | None = None) -> CameraRig:
    """Read a calibration.

    Parameters
    ----------
    path
        File, or folder with a single calibration in a known format.
    format
        Format; by default detected from the content.
    unit
        Unit of poses, one of `UNITS_MM`; by default the unit of the format or the file.

    Raises
    ------
    InputError
        If there is no calibration in a known format, or more than one.
    """
    detected = _detect(path)
    if format is not None:
        detected = [candidate for candidate in detected if candidate.format == format] or _in_subfolder(path, format)
    if not detected:
        expected = " or ".join(FORMATS) if format is None else format
        reason = reason_unread(path)
        unknown = f"no calibration in a known format, expected {expected}"
        raise InputError(f"{path}: {f'{reason}, expected layout.json or opencv.yaml' if reason else unknown}")
    if len(detected) > 1:
        names = ", ".join(candidate.format for candidate in detected)
        raise InputError(f"{path}: calibrations as {names}, select one of them with --format")
    rig = READERS[detected[0].format](detected[0].paths)
    for camera in rig.cameras:
        if camera.camera_from_rig is not None and not (np.abs(camera.camera_from_rig) <= MAX_POSE).all():
            raise InputError(
                f"{path}: the pose of camera {camera.name[:40]!r} is out of range, expected numbers up to {MAX_POSE:g}"
            )
    return rig if unit is None else replace(rig, unit_mm=UNITS_MM[unit])


def formats_in(path: Path) -> tuple[FormatName, ...]:
    """The formats of the calibrations in a file or folder; raises InputError for a file that cannot be read."""
    return tuple(candidate.format for candidate in _detect(path))


def _detect(path: Path) -> list[Detected]:
    return _in_folder(path) if path.is_dir() else _of_file(path)


def reason_unread(path: Path) -> str:
    """Why a file, or a file in a folder, is known to contain no cameras to score; "" if it is not known."""
    names = [path.name] if not path.is_dir() else [file.name for file in path.iterdir()][:MAX_FILES]
    return next((reason for name in names for ending, reason in UNREAD.items() if name.endswith(ending)), "")


def _in_subfolder(path: Path, format: FormatName) -> list[Detected]:
    name = SUBFOLDERS.get(format)
    inner = None if name is None or not is_inside(path, name) else path / name
    if inner is None or not inner.is_dir():
        return []
    return [candidate for candidate in _in_folder(inner) if candidate.format == format]


def _kind(path: Path) -> FormatName | None:
    """The format of one file; None if unknown."""
    suffix = path.suffix.lower()
    if suffix == mrcal.SUFFIX:
        return "mrcal"
    if suffix == anipose.SUFFIX:
        return "anipose" if anipose.is_anipose(anipose.read_value(path)) else None
    if suffix == ".json":
        return _kind_of(opencv.read_value(path))
    return _kind_of(read_yaml(path)) if suffix in YAML_SUFFIXES else None


def _kind_of(value: Any) -> FormatName | None:
    if is_layout(value):
        return "mirrorcam"
    if kalibr.is_kalibr(value):
        return "kalibr"
    if ros.is_ros(value):
        return "ros"
    return "opencv" if opencv.is_opencv(value) else None


def _of_file(path: Path) -> list[Detected]:
    if path.suffix.lower() == ".xml":
        opencv.read_value(path)  # raises InputError
    if path.name.startswith("cameras.") and colmap.model_folder(path.parent) == path.parent / ".":
        return [Detected("colmap", (path.parent,))]
    kind = _kind(path)
    return [] if kind is None else [Detected(kind, (path,))]


def _in_folder(folder: Path) -> list[Detected]:
    """The calibrations in a folder, at most one per format; files with one camera each form one calibration."""
    files: dict[FormatName, list[Path]] = {}
    names = sorted(path for path in folder.iterdir() if path.is_file())
    if sum(path.stat().st_size for path in names[:MAX_FILES] if path.suffix.lower() in YAML_SUFFIXES) > MAX_BYTES:
        megabytes = MAX_BYTES // 1_000_000
        raise InputError(f"{folder}: contains more than {megabytes} MB of YAML, expected the files of one calibration")
    for path in names[:MAX_FILES]:
        kind = _kind(path)
        if kind is not None:
            files.setdefault(kind, []).append(path)
    if "opencv" in files:  # the extrinsics of `stereo_calib` contain no camera to detect
        stereo = [path for path in names if path.stem == "extrinsics" and path.suffix in YAML_SUFFIXES][:1]
        files["opencv"] += [path for path in stereo if path not in files["opencv"]]
    one_file: tuple[FormatName, ...] = ("kalibr", "anipose", "mirrorcam")
    for kind in one_file:
        if len(files.get(kind, ())) > 1:
            listed = ", ".join(path.name for path in files[kind][:5])
            raise InputError(f"{folder}: several calibrations as {kind} ({listed}), expected one")
    detected = [Detected(kind, tuple(paths)) for kind, paths in files.items()]
    model = colmap.model_folder(folder)
    return detected if model is None else [*detected, Detected("colmap", (model,))]


def is_layout(value: Any) -> bool:
    """Whether the content of a JSON file is a layout."""
    return isinstance(value, dict) and str(value.get("schema", "")).startswith("mirrorcam.layout/")


def rig_of(layout: Layout) -> CameraRig:
    """The mirrors of a layout as cameras with reflections as poses, and the covariance of the layout's parameters."""
    size = layout.camera.width_px, layout.camera.height_px
    cameras = []
    for number, mirror in enumerate(layout.mirrors):
        apparent = mirror.apparent
        pose = rigid(apparent.reflection, apparent.virtual_centre_in_rig_mm)
        name = view_name(*divmod(number, layout.cols))
        cameras.append(RigCamera(name, MirrorProjection(layout.camera, mirror), pose, size))
    return CameraRig(
        FORMAT, tuple(cameras), unit_mm=1.0, pictures="as-is", uncertainty=layout.uncertainty, layout=layout
    )
