"""COLMAP's sparse models, as text or binary: `cameras`, `images`, and `rigs` and `frames` of newer versions.

A model has no scale of its own, and pixel (0, 0) of ours is at (0.5, 0.5) of COLMAP's. Cameras are told apart by the
folders of their pictures, such as `view_0_1/0000.png`. Poses are those of a rig of several cameras where there is
one, else of the picture that most cameras have.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.disk.files import is_inside
from mirrorcam.core.values import FloatArray, InputError
from mirrorcam.optics.camera_files.camera_rig import CameraRig, Projection, RigCamera, camera_of
from mirrorcam.optics.camera_files.read.colmap_model import ColmapCamera, ColmapModel, read_model
from mirrorcam.optics.camera_files.sphere_lens import SphereLens
from mirrorcam.optics.geometry.sfm_rigs import HALF_PIXEL
from mirrorcam.optics.geometry.transforms import rigid

FORMAT = "colmap"


@dataclass(frozen=True)
class _Lens:
    """How a model's parameters are those of one of our lenses.

    `core` are the places of fx, fy, cx, cy, `distortion` those of the coefficients; None: zero.
    """

    lens_model: str
    core: tuple[int, int, int, int]
    distortion: tuple[int | None, ...]


_F, _FXY = (0, 0, 1, 2), (0, 1, 2, 3)
_NONE = (None,) * 5
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
    """The folder of a sparse model: this one, `sparse`, `sparse/0` or `0` in it; None where there is none."""
    for name in (".", "sparse", "sparse/0", "0"):
        for suffix in (".bin", ".txt"):
            if is_inside(folder, f"{name}/cameras{suffix}") and (folder / name / f"cameras{suffix}").is_file():
                return folder / name
    return None


def read_colmap(folder: Path) -> CameraRig:
    """The cameras of a sparse model; raises InputError in one line where they have no poses or a lens is not known."""
    model = read_model(folder)
    views, note = _views(model, folder)
    cameras = []
    for name, (camera_id, pose) in sorted(views.items()):
        camera = model.cameras.get(camera_id)
        if camera is None:
            raise InputError(f"{folder}: an image or a rig has camera {camera_id}, which is not in the model")
        lens = _projection(camera, f"{folder}: camera {camera_id}")
        cameras.append(RigCamera(name, lens, pose, (camera.width_px, camera.height_px)))
    return CameraRig(FORMAT, tuple(cameras), unit_mm=None, notes=(note,))


def _views(model: ColmapModel, folder: Path) -> tuple[dict[str, tuple[int, FloatArray]], str]:
    """Number of the camera and pose (4, 4) of each view, by the folder of its pictures, and what poses are of."""
    pictures: dict[str, dict[str, tuple[int, FloatArray]]] = defaultdict(dict)
    folders: dict[int, set[str]] = defaultdict(set)
    for image in model.images:
        path = PurePosixPath(image.name)
        name, picture = (path.parent.as_posix(), path.name) if len(path.parts) > 1 else (path.stem, "")
        pictures[picture][name] = image.camera_id, _matrix(image.pose)
        folders[image.camera_id].add(name)
    rig = max(model.rigs, key=len, default={})
    if len(rig) > 1:
        unnamed = next((camera_id for camera_id in rig if len(folders[camera_id]) != 1), None)
        if unnamed is not None:
            raise InputError(f"{folder}: camera {unnamed} has no folder of pictures of its own, which would name it")
        views = {min(folders[camera_id]): (camera_id, _matrix(pose)) for camera_id, pose in rig.items()}
        return views, "poses are those of the rig"
    if not pictures:
        raise InputError(f"{folder}: no images, expected a model with poses")
    picture = max(sorted(pictures), key=lambda name: len(pictures[name]))
    note = f"poses are those of the picture {picture}" if picture else "poses are those of the pictures"
    return pictures[picture], note


def _matrix(pose: tuple[float, ...]) -> FloatArray:
    """camera_from (4, 4) of a quaternion w, x, y, z and a translation."""
    return rigid(Rotation.from_quat(pose[:4], scalar_first=True).as_matrix(), np.array(pose[4:]))


def _projection(camera: ColmapCamera, where: str) -> Projection:
    if camera.model not in LENSES:
        raise InputError(f"{where}: {camera.model[:40]}, expected one of {', '.join(LENSES)}")
    known, given = LENSES[camera.model], camera.parameters
    fx, fy, cx, cy = (given[place] for place in known.core)
    core = [fx, fy, cx - HALF_PIXEL, cy - HALF_PIXEL]
    distortion = [0.0 if place is None else given[place] for place in known.distortion]
    lens = camera_of(where, core, known.lens_model, distortion, (camera.width_px, camera.height_px))
    return SphereLens("extended_unified", np.array(given[4:6]), lens) if camera.model == "EUCM" else lens
