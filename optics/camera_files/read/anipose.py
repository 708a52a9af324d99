"""aniposelib's `calibration.toml`, shared by Anipose and lightning-pose: cameras `cam_0`, `cam_1`, …

A file from `mirrorcam camera export` is in mm. A comment states how each camera's pictures are cropped from the frame;
aniposelib drops comments when it writes a file.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from scipy.spatial.transform import Rotation

from mirrorcam.core.disk.files import tables_of
from mirrorcam.core.errors import InputError
from mirrorcam.optics.camera_files.camera_rig import CameraRig, PictureFlip, RigCamera, numbers_of, size_of
from mirrorcam.optics.camera_files.read.file_text import entry, read_text, table
from mirrorcam.optics.camera_files.read.opencv import lens_of
from mirrorcam.optics.camera_files.write.pose_cameras import DIRECT, FFMPEG
from mirrorcam.optics.geometry.transforms import rigid

FORMAT, SUFFIX = "anipose", ".toml"
FLIPS: dict[str, PictureFlip] = {"hflip": "left-right", "vflip": "top-bottom"}
_CROP_COMMENT = re.compile(
    rf"^# pictures of this camera: (?:{re.escape(FFMPEG)}|ffmpeg -i FRAMES) "  # version 0.2.0 wrote the latter
    r"-vf (?:(hflip|vflip),)?crop=\d+:\d+:(\d{1,5}):(\d{1,5}) "
)
_CAMERA = re.compile(r"^\[(cam_\d+)\]\s*$")


def is_anipose(value: Any) -> bool:
    """Whether the content of a TOML file has aniposelib's cameras."""
    return isinstance(value, dict) and isinstance(value.get("cam_0"), dict) and "matrix" in value["cam_0"]


def read_value(path: Path) -> Any:
    """Content of a TOML file; raises InputError for invalid TOML."""
    return tables_of(path, read_text(path).encode())


def read_anipose(path: Path) -> CameraRig:
    """The cameras of a file except the direct view; raises InputError for an invalid file."""
    values = table(read_value(path), str(path))
    crops = _crops(read_text(path))
    cameras, flips = [], set()
    for key in (key for key in values if re.fullmatch(r"cam_\d+", key)):
        where = f"{path}: {key}"
        part = table(values[key], where)
        name = str(part.get("name", key))[:100]
        if name == DIRECT:
            continue
        flip, first = crops.get(key, (None, None))
        flips.add(flip)
        cameras.append(_camera(part, name, where, first))
    if not cameras:
        raise InputError(f"{path}: contains no mirror, expected cameras such as view_0_0")
    notes = (
        [f"the camera {DIRECT} is not scored"] if len(cameras) < sum(key.startswith("cam_") for key in values) else []
    )
    if not crops:
        notes.append("the file does not state the unit of poses: mm is assumed")
    flip = flips.pop() if len(flips) == 1 else None
    return CameraRig(
        FORMAT, tuple(cameras), unit_mm=1.0, pictures=None if flip is None else FLIPS[flip], notes=tuple(notes)
    )


def _camera(part: dict[str, Any], name: str, where: str, first: tuple[int, int] | None) -> RigCamera:
    """The camera of a cropped picture or, if the first pixel is known, of the entire flipped frame."""
    size = size_of(entry(part, "size", where), f"{where}: size")
    model = "fisheye" if part.get("fisheye") is True else "pinhole"
    lens = lens_of(where, entry(part, "matrix", where), entry(part, "distortions", where), model, size)
    rotvec, translation = (
        numbers_of(entry(part, key, where), f"{where}: {key}", 3) for key in ("rotation", "translation")
    )
    pose = rigid(Rotation.from_rotvec(rotvec).as_matrix(), translation)
    if first is None:
        return RigCamera(name, lens, pose, size)
    return RigCamera(name, lens.replaced(cx_px=lens.cx_px + first[0], cy_px=lens.cy_px + first[1]), pose, None)


def _crops(text: str) -> dict[str, tuple[str | None, tuple[int, int]]]:
    """Flip and first pixel in the flipped frame of each camera's pictures, from its comment."""
    crops: dict[str, tuple[str | None, tuple[int, int]]] = {}
    camera = ""
    for line in text.splitlines():
        if named := _CAMERA.match(line):
            camera = named[1]
        elif camera and (crop := _CROP_COMMENT.match(line)):
            crops[camera] = crop[1], (int(crop[2]), int(crop[3]))
    return crops
