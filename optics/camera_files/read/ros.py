"""ROS `camera_info` files of `camera_calibration` and `camera_info_manager`, one per camera.

Messages printed by `ros2 topic echo` (or `rostopic echo`) are accepted too; they have shorter keys. The files contain
no poses. Poses, in metres, come from the optical frames in a URDF or in a `/tf_static` message as YAML, in the same
folder or its parent. Without poses, cameras are scored individually.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.disk.yaml_text import YAML_SUFFIXES
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.camera_rig import CameraRig, RigCamera, number_of, numbers_of, size_of
from mirrorcam.optics.camera_files.read.file_text import entry, read_text, read_yaml, table
from mirrorcam.optics.camera_files.read.opencv import lens_of
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.transforms import inverse, rigid

FORMAT = "ros"
MODELS = {"plumb_bob": 5, "rational_polynomial": 8, "equidistant": 4, "fisheye": 4}
KEYS = {"image_width": "width", "image_height": "height", "camera_matrix": "k", "distortion_coefficients": "d"}
"""Keys of a message by the keys of a file."""
MESSAGES = tuple({"header", "width", "height", *names} for names in ("kdp", "KDP"))
"""Keys of messages in ROS 2 and ROS 1."""
ABBREVIATED = "..."
MAX_DEPTH = 1000
"""Maximum number of links from the root of a robot to a camera."""


def is_ros(value: Any) -> bool:
    """Whether the content of a YAML file is a camera_info."""
    if not isinstance(value, dict):
        return False
    return {"camera_matrix", "projection_matrix"} <= value.keys() or any(keys <= value.keys() for keys in MESSAGES)


def is_tf(value: Any) -> bool:
    """Whether the content of a YAML file is a message of transforms."""
    return isinstance(value, dict) and isinstance(value.get("transforms"), list)


def read_ros(paths: Sequence[Path]) -> CameraRig:
    """The cameras of camera_info files, with poses if an adjacent URDF or message of transforms has their frames."""
    frames = _adjacent_frames(paths[0].parent)
    cameras, unposed = [], []
    for path in paths:
        values = _camera_info(path)
        name = str(values.get("camera_name", path.stem))[:100]
        size = size_of([entry(values, key, str(path)) for key in ("image_width", "image_height")], str(path))
        stems = (name, path.stem)
        names = (str(values.get("frame_id", "")), *(f"{stem}_optical_frame" for stem in stems), *stems)
        pose = next((frames[frame] for frame in names if frame in frames), None)
        if pose is None:
            unposed.append(name)
        cameras.append(RigCamera(name, _lens(path, values, size), None if pose is None else inverse(pose), size))
    if frames and len(unposed) not in (0, len(cameras)):
        raise InputError(f"{paths[0].parent}: the URDF or the transforms have no frame of camera {unposed[0]}")
    note = "no poses, as there is no URDF or tf_static: each camera is scored individually"
    return CameraRig(FORMAT, tuple(cameras), unit_mm=1000.0, notes=(note,) if unposed else ())


def _camera_info(path: Path) -> dict[str, Any]:
    """The content of a camera_info file, or of a message with the keys of a file."""
    values = table(read_yaml(path), str(path))
    if not any(keys <= values.keys() for keys in MESSAGES):
        return values
    info = {name: values[key if key in values else key.upper()] for name, key in KEYS.items()}
    info |= {key: values[key] for key in ("distortion_model",) if key in values}
    frame = values["header"].get("frame_id") if isinstance(values["header"], dict) else None
    if frame:
        info |= {"camera_name": str(frame).removesuffix("_optical_frame"), "frame_id": frame}
    for name in ("camera_matrix", "distortion_coefficients"):
        if isinstance(info[name], list) and ABBREVIATED in info[name]:
            raise InputError(f"{path}: {name} is abbreviated, expected the output of `ros2 topic echo --full-length`")
    return info | {"camera_matrix": {"rows": 3, "cols": 3, "data": info["camera_matrix"]}}


def _lens(path: Path, values: dict[str, Any], size: tuple[int, int]) -> Camera:
    model = str(values.get("distortion_model", "plumb_bob"))
    if model not in MODELS:
        raise InputError(f"{path}: distortion_model {model[:40]!r}, expected one of {', '.join(MODELS)}")
    coefficients = values.get("distortion_coefficients")
    if isinstance(coefficients, dict):  # ignore its shape: some tools always write 1 x 5
        coefficients = coefficients.get("data")
    zeros = [0.0] * MODELS[model]
    return lens_of(str(path), entry(values, "camera_matrix", str(path)), coefficients or zeros, model, size)


def _adjacent_frames(folder: Path) -> dict[str, FloatArray]:
    """root_from_frame (4, 4), m, by frame name, from a URDF or message of transforms in this folder or its parent."""
    for directory in (folder, folder.parent):
        urdfs = sorted(directory.glob("*.urdf"))
        if len(urdfs) > 1:
            raise InputError(f"{directory}: {len(urdfs)} URDF files, expected one")
        if urdfs:
            return _urdf_frames(urdfs[0])
        for path in sorted(directory.glob("*tf*")):
            if path.suffix.lower() in YAML_SUFFIXES and is_tf(value := read_yaml(path)):
                return _tf_frames(path, value)
    return {}


def _urdf_frames(path: Path) -> dict[str, FloatArray]:
    text = read_text(path)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(f"{path}: contains a document type, expected a plain URDF")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise InputError(f"{path}: not valid XML: {error}") from None
    edges = {}
    for joint in root.iter("joint"):
        parent, child, origin = joint.find("parent"), joint.find("child"), joint.find("origin")
        if parent is None or child is None:
            continue
        where = f"{path}: joint {str(joint.get('name'))[:60]!r}"
        xyz, rpy = (
            numbers_of((("0 0 0" if origin is None else origin.get(key)) or "0 0 0").split(), where, 3)
            for key in ("xyz", "rpy")
        )
        parent_from_child = rigid(Rotation.from_euler("xyz", rpy).as_matrix(), xyz)
        edges[str(child.get("link"))] = str(parent.get("link")), parent_from_child
    return _from_root(edges, path)


def _tf_frames(path: Path, value: dict[str, Any]) -> dict[str, FloatArray]:
    edges = {}
    for item in value["transforms"]:
        stamped = table(item, f"{path}: transforms")
        child = str(entry(stamped, "child_frame_id", f"{path}: transforms"))
        where = f"{path}: {child[:60]}"
        header, pose = (table(entry(stamped, key, where), where) for key in ("header", "transform"))
        translation, rotation = (table(entry(pose, key, where), where) for key in ("translation", "rotation"))
        xyz = [number_of(entry(translation, axis, where), where) for axis in "xyz"]
        quaternion = [number_of(entry(rotation, axis, where), where) for axis in "xyzw"]
        if not any(quaternion):
            raise InputError(f"{where}: rotation is zero, expected a quaternion")
        parent_from_child = rigid(Rotation.from_quat(quaternion).as_matrix(), xyz)
        edges[child] = str(entry(header, "frame_id", where)), parent_from_child
    return _from_root(edges, path)


def _from_root(edges: dict[str, tuple[str, FloatArray]], path: Path) -> dict[str, FloatArray]:
    """root_from_frame (4, 4) by frame, from the parent and parent_from_frame of each frame."""
    poses = {}
    roots = set()
    for frame in edges:
        pose, ancestor = np.eye(4), frame
        for _ in range(MAX_DEPTH):
            if ancestor not in edges:
                break
            ancestor, parent_from_child = edges[ancestor]
            pose = parent_from_child @ pose
        else:
            raise InputError(f"{path}: frame {frame[:60]!r} is its own ancestor, expected a tree")
        roots.add(ancestor)
        poses[frame] = pose
    if len(roots) > 1:
        raise InputError(f"{path}: {len(roots)} unconnected trees of frames, expected one")
    return poses
