"""COLMAP: the views as one rig, in metres, and a sparse model of one frame without points.

COLMAP puts the centre of the top-left pixel at (0.5, 0.5). It drops cameras whose principal point lies outside their
image, so the images are whole flipped frames, and masks say what belongs to a view.
"""

from __future__ import annotations

import json

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.exports.numbers import numbers
from mirrorcam.optics.exports.virtual_cameras import VirtualCamera

HALF_PIXEL = 0.5
MODEL = "FULL_OPENCV"


def parameters(view: VirtualCamera) -> list[float]:
    """FULL_OPENCV: fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6, the last three zero."""
    fx, fy, cx, cy, *distortion = (float(value) for value in view.camera.intrinsics)
    return [fx, fy, cx + HALF_PIXEL, cy + HALF_PIXEL, *distortion, 0.0, 0.0, 0.0]


def pose(camera_from: FloatArray) -> list[float]:
    """A rigid transform (4, 4) in mm as COLMAP writes it: quaternion w, x, y, z and translation in metres."""
    quaternion = Rotation.from_matrix(camera_from[:3, :3]).as_quat(canonical=True, scalar_first=True)
    return [*quaternion.tolist(), *(camera_from[:3, 3] / 1000.0).tolist()]


def rig_config(views: tuple[VirtualCamera, ...], reference: int) -> str:
    """`rig_config.json` for `colmap rig_configurator`: images by the folder of their view; `reference` comes first."""
    reference_from_rig = views[reference].camera_from_rig
    cameras: list[dict[str, object]] = []
    for view in (views[reference], *views[:reference], *views[reference + 1 :]):
        values = pose(view.camera_from_rig @ np.linalg.inv(reference_from_rig))
        place: dict[str, object] = {"cam_from_rig_rotation": values[:4], "cam_from_rig_translation": values[4:]}
        if view is views[reference]:
            place = {"ref_sensor": True}
        camera = {"camera_model_name": MODEL, "camera_params": parameters(view)}
        cameras.append({"image_prefix": f"{view.name}/", **place, **camera})
    return json.dumps([{"cameras": cameras}], indent=1, allow_nan=False) + "\n"


def sparse_model(views: tuple[VirtualCamera, ...], reference: int, picture: str) -> dict[str, str]:
    """`cameras.txt`, `rigs.txt`, `frames.txt`, `images.txt` and an empty `points3D.txt`; world is the rig frame.

    `picture` is the file's name in the folder of each view. Cameras and images are numbered as COLMAP's database has
    them, from 1 by name; it gives each camera a rig and each image a frame, so that the rig and the frame of all views,
    which `rig_configurator` puts in their place, come next. `point_triangulator` asks for these very numbers.
    """
    joint = len(views) + 1
    from_reference = np.linalg.inv(views[reference].camera_from_rig)
    cameras, images, sensors = [], [], [f"{joint} {len(views)} CAMERA {reference + 1}"]
    for camera_id, view in enumerate(views, start=1):
        size = f"{view.camera.width_px} {view.camera.height_px}"
        cameras.append(f"{camera_id} {MODEL} {size} {numbers(parameters(view), ' ')}")
        images.append(f"{camera_id} {numbers(pose(view.camera_from_rig), ' ')} {camera_id} {view.name}/{picture}\n")
        if camera_id - 1 != reference:
            sensors.append(f"CAMERA {camera_id} 1 {numbers(pose(view.camera_from_rig @ from_reference), ' ')}")
    data = " ".join(f"CAMERA {camera_id} {camera_id}" for camera_id in range(1, len(views) + 1))
    frame = f"{joint} {joint} {numbers(pose(views[reference].camera_from_rig), ' ')} {len(views)} {data}"
    return {
        "cameras.txt": _lines("CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]", cameras),
        "rigs.txt": _lines(
            "RIG_ID NUM_SENSORS REF_TYPE REF_ID (TYPE ID HAS_POSE QW QX QY QZ TX TY TZ)[]", [" ".join(sensors)]
        ),
        "frames.txt": _lines("FRAME_ID RIG_ID QW QX QY QZ TX TY TZ NUM_DATA (TYPE SENSOR_ID DATA_ID)[]", [frame]),
        "images.txt": _lines("IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of points", images),
        "points3D.txt": _lines("POINT3D_ID X Y Z R G B ERROR TRACK[]", []),
    }


def _lines(header: str, lines: list[str]) -> str:
    return "".join(f"{line}\n" for line in [f"# {header}", *lines])
