"""Camera rigs in the formats of structure-from-motion tools, in metres: COLMAP's text files and nerfstudio's frames.

In both, the centre of the top-left pixel is (0.5, 0.5). nerfstudio's cameras look along -z with y up, and z points up
in its world.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.names import numbers
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import inverse

HALF_PIXEL = 0.5
"""Offset of principal points in these formats from ours."""
OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
"""From OpenGL's camera axes to OpenCV's; its own inverse."""
WORLD_FROM_VIEW = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Rows: the world's x (right), y (to the scene) and z (up) in view axes."""


@dataclass(frozen=True, eq=False)
class SfmCamera:
    """A camera of a rig in COLMAP's terms.

    Attributes
    ----------
    name : str
        Name of the folder with its pictures; the cameras are sorted by name.
    model : str
        COLMAP's name of the lens model.
    width_px, height_px : int
        Size of its pictures.
    parameters : sequence of float
        Parameters of the model; the principal point counts the centre of the top-left pixel as 0.5.
    camera_from_world : ndarray
        Rigid transform (4, 4), mm.
    """

    name: str
    model: str
    width_px: int
    height_px: int
    parameters: Sequence[float]
    camera_from_world: FloatArray


def _pose(transform: FloatArray) -> list[float]:
    """Format a rigid transform (4, 4) in mm for COLMAP: quaternion w, x, y, z and translation in metres."""
    quaternion = Rotation.from_matrix(transform[:3, :3]).as_quat(canonical=True, scalar_first=True)
    return [*quaternion.tolist(), *(transform[:3, 3] / 1000.0).tolist()]


def rig_config(cameras: Sequence[SfmCamera], reference: int) -> str:
    """`rig_config.json` for `colmap rig_configurator`; identifies pictures by folder, with `reference` first."""
    world_from_reference = inverse(cameras[reference].camera_from_world)
    entries: list[dict[str, object]] = []
    for camera in (cameras[reference], *cameras[:reference], *cameras[reference + 1 :]):
        values = _pose(camera.camera_from_world @ world_from_reference)
        pose: dict[str, object] = {"cam_from_rig_rotation": values[:4], "cam_from_rig_translation": values[4:]}
        if camera is cameras[reference]:
            pose = {"ref_sensor": True}
        model = {"camera_model_name": camera.model, "camera_params": list(camera.parameters)}
        entries.append({"image_prefix": f"{camera.name}/", **pose, **model})
    return json.dumps([{"cameras": entries}], indent=1, allow_nan=False) + "\n"


def sparse_model(cameras: Sequence[SfmCamera], reference: int, picture: str) -> dict[str, str]:
    """`cameras.txt`, `rigs.txt`, `frames.txt`, `images.txt` and an empty `points3D.txt`.

    `picture` is the file name in the folder of each camera. Numbers must equal those of COLMAP's database, which
    `point_triangulator` reads. There, cameras and images count from 1 by name. The database first has a rig for each
    camera and a frame for each image; `rig_configurator` replaces them by one rig and one frame with the next number.
    """
    joint = len(cameras) + 1
    world_from_reference = inverse(cameras[reference].camera_from_world)
    lenses, images, sensors = [], [], [f"{joint} {len(cameras)} CAMERA {reference + 1}"]
    for camera_id, camera in enumerate(cameras, start=1):
        pose = numbers(_pose(camera.camera_from_world), " ")
        lenses.append(
            f"{camera_id} {camera.model} {camera.width_px} {camera.height_px} {numbers(camera.parameters, ' ')}"
        )
        images.append(f"{camera_id} {pose} {camera_id} {camera.name}/{picture}\n")
        if camera_id - 1 != reference:
            from_reference = numbers(_pose(camera.camera_from_world @ world_from_reference), " ")
            sensors.append(f"CAMERA {camera_id} 1 {from_reference}")
    data = " ".join(f"CAMERA {camera_id} {camera_id}" for camera_id in range(1, joint))
    frame = f"{joint} {joint} {numbers(_pose(cameras[reference].camera_from_world), ' ')} {len(cameras)} {data}"
    return {
        "cameras.txt": _lines("CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]", lenses),
        "rigs.txt": _lines(
            "RIG_ID NUM_SENSORS REF_TYPE REF_ID (TYPE ID HAS_POSE QW QX QY QZ TX TY TZ)[]", [" ".join(sensors)]
        ),
        "frames.txt": _lines("FRAME_ID RIG_ID QW QX QY QZ TX TY TZ NUM_DATA (TYPE SENSOR_ID DATA_ID)[]", [frame]),
        "images.txt": _lines("IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of points", images),
        "points3D.txt": _lines("POINT3D_ID X Y Z R G B ERROR TRACK[]", []),
    }


def _lines(header: str, lines: list[str]) -> str:
    return "".join(f"{line}\n" for line in [f"# {header}", *lines])


def frame(
    name: str,
    size: tuple[int, int],
    focal_px: tuple[float, float],
    centre_px: tuple[float, float],
    world_from_camera: FloatArray,
    distortion: dict[str, float],
) -> dict[str, Any]:
    """One view as nerfstudio's frame: its camera, `images/NAME.png` and `masks/NAME.png`.

    Parameters
    ----------
    name
        Name of the view.
    size
        Width and height of its picture, px.
    focal_px, centre_px
        Focal lengths and principal point, (0, 0) being the centre of the top-left pixel.
    world_from_camera
        Rigid transform (4, 4), mm, from the camera in OpenCV's axes to the world.
    distortion
        OpenCV's distortion coefficients by name.
    """
    transform = world_from_camera @ OPENCV_FROM_OPENGL
    transform[:3, 3] /= 1000.0
    return {
        "file_path": f"images/{name}.png",
        "mask_path": f"masks/{name}.png",
        "w": size[0],
        "h": size[1],
        "fl_x": focal_px[0],
        "fl_y": focal_px[1],
        "cx": centre_px[0] + HALF_PIXEL,
        "cy": centre_px[1] + HALF_PIXEL,
        **distortion,
        "transform_matrix": transform.tolist(),
    }
