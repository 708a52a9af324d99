"""COLMAP's sparse models, text or binary: `cameras` and `images`, and `rigs` in newer versions.

A model has no scale, and our pixel (0, 0) is COLMAP's (0.5, 0.5). Cameras are identified by the folders of their
pictures, such as `view_0_1/0000.png`. Poses come from a rig of several cameras if there is one, else from the picture
taken by the most cameras.

The files are not trusted: counts are checked against the size of the file before reading.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.disk.files import is_inside, read_bytes
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.camera_rig import UNSIZED_PX, CameraRig, Projection, RigCamera, SphereLens, camera_of
from mirrorcam.optics.geometry.sfm_rigs import HALF_PIXEL
from mirrorcam.optics.geometry.transforms import rigid

FORMAT = "colmap"
_F, _FXY = (0, 0, 1, 2), (0, 1, 2, 3)
"""Indices of fx, fy, cx, cy among parameters f, cx, cy or fx, fy, cx, cy."""
_NONE = (None,) * 5
Item = TypeVar("Item")
MODELS = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8),
    6: ("FULL_OPENCV", 12),
    7: ("FOV", 5),
    8: ("SIMPLE_RADIAL_FISHEYE", 4),
    9: ("RADIAL_FISHEYE", 5),
    10: ("THIN_PRISM_FISHEYE", 12),
    11: ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    12: ("SIMPLE_DIVISION", 4),
    13: ("DIVISION", 5),
    14: ("SIMPLE_FISHEYE", 3),
    15: ("FISHEYE", 4),
    16: ("EUCM", 6),
}
"""Name and number of parameters by model id."""
PARAMETER_COUNTS = dict(MODELS.values())
CAMERA_SENSOR = 0
MAX_IMAGES_BYTES = 300_000_000
"""Limit on `images`, which lists the points of every picture."""
MAX_CAMERAS_BYTES = 5_000_000
"""Limit on `cameras` and `rigs`; a hundred cameras take 0.02 MB."""
MAX_IMAGES = 100_000
"""Limit on the pictures of a model; `images.txt` has two lines per picture."""
MAX_NAME_BYTES = 1000
IDENTITY = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class _Lens:
    """Mapping of a model's parameters to one of our lenses.

    `core` are the indices of fx, fy, cx, cy, `distortion` the indices of the coefficients, None for zero.
    """

    lens_model: str
    core: tuple[int, int, int, int]
    distortion: tuple[int | None, ...]


LENSES = {
    "SIMPLE_PINHOLE": _Lens("brown_conrady", _F, _NONE),
    "PINHOLE": _Lens("brown_conrady", _FXY, _NONE),
    "SIMPLE_RADIAL": _Lens("brown_conrady", _F, (3, None, None, None, None)),
    "RADIAL": _Lens("brown_conrady", _F, (3, 4, None, None, None)),
    "OPENCV": _Lens("brown_conrady", _FXY, (4, 5, 6, 7, None)),
    "FULL_OPENCV": _Lens("rational", _FXY, (4, 5, 6, 7, 8, 9, 10, 11)),
    "OPENCV_FISHEYE": _Lens("fisheye", _FXY, (4, 5, 6, 7)),
    "SIMPLE_FISHEYE": _Lens("fisheye", _F, (None,) * 4),
    "FISHEYE": _Lens("fisheye", _FXY, (None,) * 4),
    "SIMPLE_RADIAL_FISHEYE": _Lens("fisheye", _F, (3, None, None, None)),
    "RADIAL_FISHEYE": _Lens("fisheye", _F, (3, 4, None, None)),
    "EUCM": _Lens("brown_conrady", _FXY, _NONE),
}


def model_folder(folder: Path) -> Path | None:
    """The folder of a sparse model: the folder itself, or `sparse`, `sparse/0` or `0` in it; None if there is none."""
    for name in (".", "sparse", "sparse/0", "0"):
        for suffix in (".bin", ".txt"):
            if is_inside(folder, f"{name}/cameras{suffix}") and (folder / name / f"cameras{suffix}").is_file():
                return folder / name
    return None


def read_colmap(folder: Path) -> CameraRig:
    """The cameras of a sparse model; raises InputError if poses are missing or a lens model is unknown."""
    model = read_model(folder)
    views, note = _views(model, folder)
    cameras = []
    for name, (camera_id, pose) in sorted(views.items()):
        camera = model.cameras.get(camera_id)
        if camera is None:
            raise InputError(
                f"{folder}: an image or a rig refers to camera {camera_id}, which is missing from the model"
            )
        lens = projection_of(camera, f"{folder}: camera {camera_id}")
        cameras.append(RigCamera(name, lens, pose, (camera.width_px, camera.height_px)))
    return CameraRig(FORMAT, tuple(cameras), unit_mm=None, notes=(note,))


def _views(model: ColmapModel, folder: Path) -> tuple[dict[str, tuple[int, FloatArray]], str]:
    """Camera id and pose (4, 4) of each view, by the folder of its pictures, and a note on the origin of the poses."""
    pictures: dict[str, dict[str, tuple[int, FloatArray]]] = defaultdict(dict)
    folders: dict[int, set[str]] = defaultdict(set)
    for image in model.images:
        path = PurePosixPath(image.name)
        name, picture = (path.parent.as_posix(), path.name) if len(path.parts) > 1 else (path.stem, "")
        pictures[picture][name] = image.camera_id, matrix_of(image.pose)
        folders[image.camera_id].add(name)
    rig = max(model.rigs, key=len, default={})
    if len(rig) > 1:
        unnamed = next((camera_id for camera_id in rig if len(folders[camera_id]) != 1), None)
        if unnamed is not None:
            raise InputError(f"{folder}: camera {unnamed} has no name, expected its pictures in their own folder")
        views = {min(folders[camera_id]): (camera_id, matrix_of(pose)) for camera_id, pose in rig.items()}
        return views, "poses are taken from the rig"
    if not pictures:
        raise InputError(f"{folder}: no images, expected a model with poses")
    picture = max(sorted(pictures), key=lambda name: len(pictures[name]))
    return pictures[picture], f"poses are taken from {f'the picture {picture}' if picture else 'the pictures'}"


def matrix_of(pose: tuple[float, ...]) -> FloatArray:
    """Rigid transform (4, 4) from a quaternion w, x, y, z and a translation."""
    return rigid(Rotation.from_quat(pose[:4], scalar_first=True).as_matrix(), np.array(pose[4:]))


def projection_of(camera: ColmapCamera, where: str) -> Projection:
    if camera.model not in LENSES:
        raise InputError(f"{where}: {camera.model[:40]}, expected one of {', '.join(LENSES)}")
    mapping, values = LENSES[camera.model], camera.parameters
    fx, fy, cx, cy = (values[index] for index in mapping.core)
    core = [fx, fy, cx - HALF_PIXEL, cy - HALF_PIXEL]
    distortion = [0.0 if index is None else values[index] for index in mapping.distortion]
    lens = camera_of(where, core, mapping.lens_model, distortion, (camera.width_px, camera.height_px))
    return SphereLens("extended_unified", np.array(values[4:6]), lens) if camera.model == "EUCM" else lens


@dataclass(frozen=True)
class ColmapCamera:
    """A camera: name of its model, size in px, and parameters."""

    model: str
    width_px: int
    height_px: int
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class ColmapImage:
    """A picture: its name, its camera, and camera_from_world as a quaternion w, x, y, z and a translation."""

    name: str
    camera_id: int
    pose: tuple[float, ...]


@dataclass(frozen=True)
class ColmapModel:
    """Cameras by id, pictures, and for each rig the poses camera_from_rig of its cameras by id."""

    cameras: dict[int, ColmapCamera]
    images: tuple[ColmapImage, ...]
    rigs: tuple[dict[int, tuple[float, ...]], ...]


def read_model(folder: Path) -> ColmapModel:
    """Read a folder's model, preferring binary files; raises InputError for an invalid model."""
    binary = (folder / "cameras.bin").is_file()
    cameras, images, rigs = (folder / f"{name}.{'bin' if binary else 'txt'}" for name in ("cameras", "images", "rigs"))
    model = ColmapModel(
        dict(_parsed(cameras, _binary_cameras if binary else _text_cameras)),
        tuple(_parsed(images, _binary_images if binary else _text_images, MAX_IMAGES_BYTES)),
        tuple(_parsed(rigs, _binary_rigs if binary else _text_rigs) if rigs.is_file() else ()),
    )
    _check(model, folder)
    return model


def _parsed(path: Path, parse: Callable[[bytes], list[Item]], max_bytes: int = MAX_CAMERAS_BYTES) -> list[Item]:
    raw = read_bytes(path, max_bytes)
    try:
        return parse(raw)
    except (struct.error, ValueError, IndexError) as error:
        raise InputError(f"{path}: invalid COLMAP file: {' '.join(str(error).split())[:120]}") from None


def _check(model: ColmapModel, folder: Path) -> None:
    """Raise InputError for impossible sizes, quaternions and numbers."""
    for camera_id, camera in model.cameras.items():
        if not (1 <= camera.width_px <= UNSIZED_PX and 1 <= camera.height_px <= UNSIZED_PX):
            raise InputError(f"{folder}: camera {camera_id} is {camera.width_px} x {camera.height_px} px")
        if camera.model in PARAMETER_COUNTS and len(camera.parameters) != PARAMETER_COUNTS[camera.model]:
            count = len(camera.parameters)
            raise InputError(
                f"{folder}: camera {camera_id}: {count} parameters, expected {PARAMETER_COUNTS[camera.model]}"
            )
        if not np.isfinite(camera.parameters).all():
            raise InputError(f"{folder}: camera {camera_id} has parameters that are not finite")
    poses = [image.pose for image in model.images] + [pose for rig in model.rigs for pose in rig.values()]
    if any(len(pose) != len(IDENTITY) for pose in poses):
        raise InputError(f"{folder}: a pose does not have {len(IDENTITY)} numbers: a quaternion and a translation")
    # Components of a unit quaternion are at most 1; squares of large ones may overflow.
    if not np.isfinite(poses).all() or any(
        max(map(abs, pose[:4])) > 2.0 or abs(np.linalg.norm(pose[:4]) - 1.0) > 1e-3 for pose in poses
    ):
        raise InputError(f"{folder}: a pose is not finite, or its quaternion is not a unit quaternion")


def _lines(raw: bytes) -> list[str]:
    return [line for line in raw.decode("utf-8").splitlines() if not line.startswith("#")]


def _text_cameras(raw: bytes) -> list[tuple[int, ColmapCamera]]:
    words = [line.split() for line in _lines(raw) if line.strip()]
    return [(int(row[0]), ColmapCamera(row[1], int(row[2]), int(row[3]), tuple(map(float, row[4:])))) for row in words]


def _text_images(raw: bytes) -> list[ColmapImage]:
    """Each picture has a line, followed by a line of points, which may be empty."""
    text = raw.decode("utf-8").lstrip()
    if text.count("\n") > 2 * MAX_IMAGES:
        raise ValueError(f"more than {MAX_IMAGES} pictures")
    lines = [line for line in text.split("\n") if not line.startswith("#")]
    first = next((number for number, line in enumerate(lines) if line.strip()), 0)
    words = [line.split(maxsplit=9) for line in lines[first::2] if line.strip()]
    return [ColmapImage(row[9].strip(), int(row[8]), tuple(map(float, row[1:8]))) for row in words]


def _text_rigs(raw: bytes) -> list[dict[int, tuple[float, ...]]]:
    rigs = []
    for line in _lines(raw):
        words = line.split()
        if not words:
            continue
        rig: dict[int, tuple[float, ...]] = {}
        if int(words[1]) > 0 and words[2] == "CAMERA":
            rig[int(words[3])] = IDENTITY
        index = 4
        while index < len(words):
            kind, number, has_pose = words[index], int(words[index + 1]), words[index + 2] == "1"
            if has_pose and kind == "CAMERA":
                rig[number] = tuple(map(float, words[index + 3 : index + 10]))
            index += 10 if has_pose else 3
        rigs.append(rig)
    return rigs


class _Reader:
    """Reads consecutive little-endian numbers."""

    def __init__(self, raw: bytes) -> None:
        self.raw, self.position = raw, 0

    def take(self, layout: str) -> tuple[float, ...]:
        """Read the numbers of a `struct` format."""
        values = struct.unpack_from(f"<{layout}", self.raw, self.position)
        self.position += struct.calcsize(f"<{layout}")
        return values

    def count(self, min_bytes: int) -> int:
        """Read a number of items; raises ValueError if the file is too short for items of at least `min_bytes`."""
        (number,) = self.take("Q")
        if number * min_bytes > len(self.raw) - self.position:
            raise ValueError(f"{number} items in {len(self.raw)} bytes")
        return int(number)

    def name(self) -> str:
        """Read a null-terminated string."""
        end = self.raw.index(b"\x00", self.position, self.position + MAX_NAME_BYTES)
        text = self.raw[self.position : end].decode("utf-8")
        self.position = end + 1
        return text


def _binary_cameras(raw: bytes) -> list[tuple[int, ColmapCamera]]:
    reader, cameras = _Reader(raw), []
    for _ in range(reader.count(24)):
        number, model, width, height = (int(value) for value in reader.take("IiQQ"))
        if model not in MODELS:
            raise ValueError(f"camera model {model}, expected one of 0 to {max(MODELS)}")
        name, count = MODELS[model]
        cameras.append((number, ColmapCamera(name, width, height, reader.take(f"{count}d"))))
    return cameras


def _binary_images(raw: bytes) -> list[ColmapImage]:
    reader, images = _Reader(raw), []
    count = reader.count(73)
    if count > MAX_IMAGES:
        raise ValueError(f"more than {MAX_IMAGES} pictures")
    for _ in range(count):
        reader.take("I")
        pose = reader.take("7d")
        (camera_id,) = reader.take("I")
        name = reader.name()
        points = reader.count(24)
        reader.position += 24 * points
        images.append(ColmapImage(name, int(camera_id), pose))
    return images


def _binary_rigs(raw: bytes) -> list[dict[int, tuple[float, ...]]]:
    reader, rigs = _Reader(raw), []
    for _ in range(reader.count(8)):
        _, sensors = (int(value) for value in reader.take("II"))
        rig: dict[int, tuple[float, ...]] = {}
        if sensors > 0:
            kind, number = (int(value) for value in reader.take("iI"))
            if kind == CAMERA_SENSOR:
                rig[number] = IDENTITY
        for _ in range(sensors - 1):
            kind, number = (int(value) for value in reader.take("iI"))
            (has_pose,) = reader.take("B")
            pose = reader.take("7d") if has_pose else None
            if pose is not None and kind == CAMERA_SENSOR:
                rig[number] = pose
        rigs.append(rig)
    return rigs
