"""OpenCV's FileStorage (YAML or JSON) with the keys of OpenCV's programs and of this project.

- our `opencv.yaml`: a list `views` of cameras with `name`, `camera_matrix`, `distortion_coefficients`, `R`, `T`;
- the sample `calibration`: one camera per file, `camera_matrix` and `distortion_coefficients`, named by the file;
- the sample `stereo_calib`: `M1`, `D1`, `M2`, `D2` with `R`, `T`, in one file or in `intrinsics` and `extrinsics`;
- named cameras: one mapping each, with the same keys.

A pose is `R` or `rvec`, and `T` or `tvec` (or `rotation`, `translation`): x_camera = R x_rig + T. Its unit is the
unit of the board in `calibrateCamera`; the key `unit` states it, the default is mm.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, read_json
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.camera_rig import (
    CameraRig,
    PictureFlip,
    RigCamera,
    camera_of,
    number_of,
    numbers_of,
    orthogonal,
    size_of,
)
from mirrorcam.optics.camera_files.read.file_text import entry, read_yaml, table
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.transforms import rigid

FORMAT = "opencv"
LENSES = {4: "brown_conrady", 5: "brown_conrady", 8: "rational", 12: "thin_prism", 14: "thin_prism"}
FISHEYE = ("fisheye", "equidistant", "kannala_brandt")
UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
FLIPS: dict[int, PictureFlip] = {0: "top-bottom", 1: "left-right"}
"""Flips by code of `cv2.flip`."""
CORE = np.array([[True, False, True], [False, True, True], [False, False, False]])
"""Mask of fx, fy, cx and cy in a camera matrix."""
KEYS = ("camera_matrix", "K", "cameraMatrix")
DISTORTION_KEYS = ("distortion_coefficients", "D", "distCoeffs", "distortion")
ROTATION_KEYS, TRANSLATION_KEYS = ("R", "rvec", "rotation"), ("T", "tvec", "translation", "t")


def is_opencv(value: Any) -> bool:
    """Whether the content of a YAML or JSON file has cameras in OpenCV's format."""
    return bool(isinstance(value, dict) and (_cameras_in(value) or {"M1", "M2"} & value.keys()))


def _cameras_in(values: dict[str, Any]) -> bool:
    return bool(
        isinstance(values.get("views"), list)
        or _first(values, KEYS) is not None
        or any(isinstance(part, dict) and _first(part, KEYS) is not None for part in values.values())
    )


def read_value(path: Path) -> Any:
    """Content of a FileStorage in YAML or JSON, with matrices as mappings; raises InputError for other files."""
    if path.suffix.lower() == ".xml":
        raise InputError(f"{path}: FileStorage in XML, expected YAML or JSON")
    if path.suffix.lower() == ".json":
        return read_json(path, LARGEST_LAYOUT_BYTES)  # may be a layout
    return read_yaml(path)


def read_opencv(paths: tuple[Path, ...]) -> CameraRig:
    """The cameras of one file, of the two files of `stereo_calib`, or of files with one camera each."""
    files = [(path, table(read_value(path), str(path))) for path in paths]
    if any("M1" in values for _, values in files):
        return _stereo(files)
    cameras: list[RigCamera] = []
    for path, values in files:
        cameras += _cameras_of(path, values, named_by_file=len(files) > 1)
    if not cameras:
        raise InputError(f"{paths[0]}: contains no camera, expected camera_matrix and distortion_coefficients")
    posed = [camera.camera_from_rig is not None for camera in cameras]
    if any(posed) and not all(posed):
        name = cameras[posed.index(False)].name
        raise InputError(f"{paths[0]}: camera {name[:40]!r} has no pose, expected R and T for all cameras or none")
    flips = {
        int(number_of(values["flip_code"], f"{path}: flip_code")) for path, values in files if "flip_code" in values
    }
    if not flips <= FLIPS.keys() or len(flips) > 1:
        raise InputError(f"{paths[0]}: flip_code {sorted(flips)}, expected 0 or 1 for all pictures")
    return CameraRig(
        FORMAT,
        tuple(cameras),
        unit_mm=_unit_mm(files),
        pictures=FLIPS[flips.pop()] if flips else None,
        notes=_unit_note(files) if any(posed) else (),
    )


def _unit_note(files: list[tuple[Path, dict[str, Any]]]) -> tuple[str, ...]:
    is_stated = any("unit" in values for _, values in files)
    return () if is_stated else ("the file does not state the unit of poses: mm is assumed",)


def _unit_mm(files: list[tuple[Path, dict[str, Any]]]) -> float:
    for path, values in files:
        if "unit" in values:
            if values["unit"] not in UNITS_MM:
                raise InputError(f"{path}: unit {str(values['unit'])[:40]!r}, expected one of {', '.join(UNITS_MM)}")
            return UNITS_MM[values["unit"]]
    return UNITS_MM["mm"]


def _cameras_of(path: Path, values: dict[str, Any], *, named_by_file: bool) -> list[RigCamera]:
    """The cameras of a file; `named_by_file` names a single camera by its file."""
    if isinstance(values.get("views"), list):
        parts = [table(view, f"{path}: views") for view in values["views"]]
        named = [(str(entry(part, "name", f"{path}: views")), part) for part in parts]
    elif _first(values, KEYS) is not None:
        named = [(str(values.get("camera_name", path.stem)) if not named_by_file else path.stem, values)]
    else:
        named = [(name, part) for name, part in values.items() if isinstance(part, dict) and _first(part, KEYS)]
    return [_camera(path, name, {**_shared(values), **part}) for name, part in named]


def _shared(values: dict[str, Any]) -> dict[str, Any]:
    """Values that all cameras of a file share."""
    return {key: values[key] for key in ("image_width", "image_height", "distortion_model") if key in values}


def _camera(path: Path, name: str, part: dict[str, Any]) -> RigCamera:
    where = f"{path}: {name[:60]}"
    sizes = [part[key] for key in ("image_width", "image_height") if key in part]
    size = size_of(sizes, f"{where}: image_width, image_height") if sizes else None
    distortion = _first(part, DISTORTION_KEYS)
    distortion = [0.0] * 5 if distortion is None else distortion
    lens = lens_of(where, _first(part, KEYS), distortion, str(part.get("distortion_model")), size)
    return RigCamera(name, lens, _pose(part, where), size)


def lens_of(where: str, camera_matrix: Any, distortion: Any, model: str, size: tuple[int, int] | None) -> Camera:
    """A camera from OpenCV's camera matrix and distortion coefficients; `model` selects the fisheye module."""
    k = matrix_of(camera_matrix, f"{where}: camera_matrix")
    if k.shape != (3, 3) or not np.array_equal(k * ~CORE, np.diag([0.0, 0.0, 1.0])):
        raise InputError(f"{where}: camera_matrix: expected [fx 0 cx; 0 fy cy; 0 0 1]")
    values = matrix_of(distortion, f"{where}: distortion").ravel().tolist()
    core = [k[0, 0], k[1, 1], k[0, 2], k[1, 2]]
    if model.lower() in FISHEYE:
        if len(values) != 4:
            raise InputError(f"{where}: distortion: {len(values)} numbers, expected 4 for a fisheye")
        return camera_of(where, core, "fisheye", values, size)
    values = values or [0.0] * 5
    if len(values) not in LENSES:
        raise InputError(f"{where}: distortion: {len(values)} numbers, expected 4, 5, 8, 12 or 14")
    if any(values[12:]):
        raise InputError(
            f"{where}: distortion: a tilted sensor (tau_x, tau_y) is not supported, expected at most 12 numbers"
        )
    values = values[:12] + [0.0] * (len(values) == 4)
    return camera_of(where, core, LENSES[max(len(values), 5)], values, size)


def matrix_of(value: Any, where: str) -> FloatArray:
    """Array from a matrix in FileStorage or from nested lists."""
    if isinstance(value, dict):
        data = numbers_of(entry(value, "data", where), where)
        if "sizes" in value:  # a one-dimensional array of OpenCV 5
            return np.array(data)
        rows, cols = (int(number_of(entry(value, key, where), where)) for key in ("rows", "cols"))
        if rows < 0 or cols < 0 or rows * cols != len(data):
            raise InputError(f"{where}: {len(data)} numbers, expected {rows} x {cols}")
        return np.array(data).reshape(rows, cols)
    if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        matrix = [numbers_of(row, where) for row in value]
        if len({len(row) for row in matrix}) != 1:
            raise InputError(f"{where}: rows of different lengths, expected a matrix")
        return np.array(matrix)
    return np.array(numbers_of(value, where))


def _pose(part: dict[str, Any], where: str) -> FloatArray | None:
    r, t = _first(part, ROTATION_KEYS), _first(part, TRANSLATION_KEYS)
    if r is None and t is None:
        return None
    if r is None or t is None:
        raise InputError(f"{where}: expected both R and T")
    rotation, translation = matrix_of(r, f"{where}: R"), matrix_of(t, f"{where}: T").ravel()
    if rotation.size == 3:
        rotation = Rotation.from_rotvec(rotation.ravel()).as_matrix()
    if translation.shape != (3,):
        raise InputError(f"{where}: T: {translation.size} numbers, expected 3")
    return rigid(orthogonal(rotation, f"{where}: R"), translation)


def _stereo(files: list[tuple[Path, dict[str, Any]]]) -> CameraRig:
    """The cameras `first` and `second` of the sample `stereo_calib`."""
    path, merged = files[0][0], {key: value for _, values in files for key, value in values.items()}
    model = str(merged.get("distortion_model"))
    cameras = []
    for number, name in ((1, "first"), (2, "second")):
        where = f"{path}: {name} camera"
        matrix, distortion = (entry(merged, f"{letter}{number}", where) for letter in "MD")
        pose = np.eye(4) if number == 1 else _pose(merged, where)
        if pose is None:
            raise InputError(f"{path}: M1 and M2 without R and T, expected the extrinsics as well")
        cameras.append(RigCamera(name, lens_of(where, matrix, distortion, model, None), pose, None))
    return CameraRig(FORMAT, tuple(cameras), unit_mm=_unit_mm(files), notes=_unit_note(files))


def _first(values: dict[str, Any], keys: tuple[str, ...]) -> Any:
    return next((values[key] for key in keys if values.get(key) is not None), None)
