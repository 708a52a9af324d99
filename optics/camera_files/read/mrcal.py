"""mrcal's `.cameramodel` files, one per camera: a Python literal, parsed as data. Poses are rt_cam_ref, in metres."""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from warnings import catch_warnings

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.disk.files import read_bytes
from mirrorcam.core.errors import InputError
from mirrorcam.core.messages import shortened
from mirrorcam.optics.camera_files.camera_rig import (
    CameraRig,
    Projection,
    RigCamera,
    SphereLens,
    camera_of,
    numbers_of,
    size_of,
)
from mirrorcam.optics.camera_files.read.file_text import entry, table
from mirrorcam.optics.geometry.transforms import rigid

FORMAT, SUFFIX = "mrcal", ".cameramodel"
PREFIX = "LENSMODEL_"
OPENCV = {"OPENCV4": 4, "OPENCV5": 5, "OPENCV8": 8, "OPENCV12": 12}
MAX_BYTES = 50_000_000
"""Files include the inputs of their optimisation, which are ignored."""
MAX_OUTLINE_BYTES = 300_000
"""Limit on a file without its strings, which hold those inputs: Python parses this much in half a second."""
_TEXTS = re.compile(rb"\"(?:[^\"\\\n]|\\.?)*+\"?|'(?:[^'\\\n]|\\.?)*+'?|#[^\n]*+", re.DOTALL)
POSE_KEYS = ("extrinsics", "rt_cam_ref")


def read_mrcal(paths: Sequence[Path]) -> CameraRig:
    """The cameras of files with one camera each, named by file."""
    return CameraRig(FORMAT, tuple(_camera(path) for path in paths), unit_mm=1000.0)


def _camera(path: Path) -> RigCamera:
    where = str(path)
    values = table(_literal(path), where)
    pose_key = next((key for key in POSE_KEYS if key in values), POSE_KEYS[0])
    rt = np.array(numbers_of(entry(values, pose_key, where), f"{where}: {pose_key}", 6))
    size = size_of(entry(values, "imagersize", where), f"{where}: imagersize")
    pose = rigid(Rotation.from_rotvec(rt[:3]).as_matrix(), rt[3:])
    return RigCamera(path.name.removesuffix(SUFFIX), _lens(values, where, size), pose, size)


def _literal(path: Path) -> Any:
    raw = read_bytes(path, MAX_BYTES)
    if len(_TEXTS.sub(b"", raw)) > MAX_OUTLINE_BYTES:
        raise InputError(f"{path}: not an mrcal camera model: too large")
    try:
        with catch_warnings(action="ignore"):  # about invalid escapes and comparisons
            tree = ast.parse(raw.decode("utf-8-sig").strip(" \t\r\n"), mode="eval")
        if not all(map(_is_plain, ast.walk(tree))):
            raise ValueError("a set, or a key that is not a string")
        return ast.literal_eval(tree)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError) as error:
        reason = " ".join(str(error).partition(": <ast")[0].split())  # drop the node's address
        raise InputError(shortened(f"{path}: not an mrcal camera model: {reason}", 200)) from None


def _is_plain(node: ast.AST) -> bool:
    """Whether a node of a literal hashes only strings: crafted numbers could all collide."""
    if isinstance(node, ast.Dict):
        return all(isinstance(key, ast.Constant) and isinstance(key.value, str) for key in node.keys)
    return not isinstance(node, ast.Set)


def _lens(values: dict[str, Any], where: str, size: tuple[int, int]) -> Projection:
    model = str(values.get("lens_model", values.get("lensmodel", "")))
    name = model.removeprefix(PREFIX)
    intrinsics = numbers_of(entry(values, "intrinsics", where), f"{where}: intrinsics")
    expected = 4 + OPENCV.get(name, 0)
    if name not in (*OPENCV, "PINHOLE", "STEREOGRAPHIC"):
        names = ", ".join(PREFIX + lens for lens in ("PINHOLE", "STEREOGRAPHIC", *OPENCV))
        raise InputError(f"{where}: lens_model {model[:60]!r}, expected one of {names}")
    if len(intrinsics) != expected:
        raise InputError(f"{where}: intrinsics: {len(intrinsics)} numbers, expected {expected} for {model}")
    core, distortion = intrinsics[:4], intrinsics[4:]
    if name == "STEREOGRAPHIC":  # 2 tan(a / 2) = 2 r / (z + d)
        core = [2.0 * core[0], 2.0 * core[1], *core[2:]]
        return SphereLens("unified", np.array([1.0]), camera_of(where, core, "brown_conrady", [0.0] * 5, size))
    lens = {8: "rational", 12: "thin_prism"}.get(len(distortion), "brown_conrady")
    if lens == "brown_conrady":
        distortion = [*distortion, *[0.0] * (5 - len(distortion))]
    return camera_of(where, core, lens, distortion, size)
