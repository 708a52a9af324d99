"""Kalibr's camchain: `cam0`, `cam1`, …, each with the pose T_cn_cnm1 relative to the previous camera, in metres.

If the chain has gaps, the pose T_cam_imu of `camchain-imucam` files replaces it.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.camera_rig import (
    CameraRig,
    Projection,
    RigCamera,
    SphereLens,
    SphereName,
    camera_of,
    numbers_of,
    orthogonal,
    size_of,
)
from mirrorcam.optics.camera_files.read.file_text import entry, read_yaml, table
from mirrorcam.optics.geometry.transforms import rigid

FORMAT = "kalibr"
SPHERES: dict[str, SphereName] = {"omni": "unified", "eucm": "extended_unified", "ds": "double_sphere"}
COUNTS = {"pinhole": 4, "omni": 5, "eucm": 6, "ds": 6}
"""Number of `intrinsics`: the parameters of the sphere, then fu, fv, pu, pv."""


def is_kalibr(value: Any) -> bool:
    """Whether the content of a YAML file is a camchain."""
    return isinstance(value, dict) and isinstance(value.get("cam0"), dict) and "camera_model" in value["cam0"]


def read_kalibr(path: Path) -> CameraRig:
    """The cameras of a camchain; raises InputError for anything else."""
    chain = table(read_yaml(path), str(path))
    names = [f"cam{number}" for number in range(len(chain))]
    if not chain or set(names) != set(chain):
        raise InputError(f"{path}: expected the cameras of a camchain: cam0, cam1 and so on")
    parts = [table(chain[name], f"{path}: {name}") for name in names]
    chained = all("T_cn_cnm1" in part for part in parts[1:])
    imu = all("T_cam_imu" in part for part in parts)
    if not chained and not imu:
        missing = next(name for name, part in zip(names[1:], parts[1:], strict=True) if "T_cn_cnm1" not in part)
        raise InputError(f"{path}: {missing}: T_cn_cnm1 is missing")
    cameras = []
    pose = np.eye(4)
    for name, part in zip(names, parts, strict=True):
        where = f"{path}: {name}"
        if chained:
            pose = pose if name == "cam0" else _transform(part["T_cn_cnm1"], f"{where}: T_cn_cnm1") @ pose
        else:
            pose = _transform(part["T_cam_imu"], f"{where}: T_cam_imu")
        size = size_of(entry(part, "resolution", where), f"{where}: resolution")
        cameras.append(RigCamera(_name(name, part), _lens(part, where, size), pose, size))
    return CameraRig(FORMAT, tuple(cameras), unit_mm=1000.0)


def _name(name: str, part: dict[str, Any]) -> str:
    """The name of the view in the topic, else the camera's name in the chain."""
    match = re.search(r"view_\d+_\d+", str(part.get("rostopic", "")))
    return match[0] if match else name


def _transform(value: Any, where: str) -> FloatArray:
    if not isinstance(value, list) or len(value) != 4:
        raise InputError(f"{where}: expected 4 rows of 4 numbers")
    rows = np.array([numbers_of(row, where, 4) for row in value])
    return rigid(orthogonal(rows[:3, :3], where), rows[:3, 3])


def _lens(part: dict[str, Any], where: str, size: tuple[int, int]) -> Projection:
    model, distortion = str(entry(part, "camera_model", where)), str(part.get("distortion_model", "none"))
    if model not in COUNTS:
        raise InputError(f"{where}: camera_model {model[:40]!r}, expected one of {', '.join(COUNTS)}")
    values = numbers_of(entry(part, "intrinsics", where), f"{where}: intrinsics", COUNTS[model])
    coefficients = part.get("distortion_coeffs") or []
    if distortion == "radtan":
        lens = "brown_conrady", [*numbers_of(coefficients, f"{where}: distortion_coeffs", 4), 0.0]
    elif distortion in ("equidistant", "equi"):
        lens = "fisheye", numbers_of(coefficients, f"{where}: distortion_coeffs", 4)
    elif distortion == "none":
        lens = "brown_conrady", [0.0] * 5
    else:
        raise InputError(f"{where}: distortion_model {distortion[:40]!r}, expected radtan, equidistant or none")
    camera = camera_of(where, values[-4:], *lens, size)
    return SphereLens(SPHERES[model], np.array(values[:-4]), camera) if model in SPHERES else camera
