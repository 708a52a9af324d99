"""Cameras for animal-tracking tools: aniposelib's `calibration.toml` and DeepLabCut 3-D's `stereo_params.pickle`.

Each mirror is a camera whose picture is the frame, flipped and cropped to the mirror's sub-image. If the base camera
itself looks at the scene, it is the additional camera `direct`. Anipose, lightning-pose and its ensemble Kalman
smoother read the first file, DeepLabCut's `triangulate` reads the second.
"""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.write.virtual_cameras import Rectangle, VirtualCamera
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.nearest_lens import nearest_lens

DIRECT = "direct"
MARGIN = 0.15
"""Margin of a cropped picture around the sub-image, on each side, relative to the sub-image."""
FFMPEG = "ffmpeg -noautorotate -i FRAMES"
"""Reads frames in the sensor's orientation, ignoring the rotation flag of a phone's video."""
MAX_PAIRED = 12
"""Maximum number of cameras for which all pairs are written for DeepLabCut; else only pairs with the first camera."""


@dataclass(frozen=True)
class PoseCamera:
    """A camera with a Brown-Conrady lens (k1 k2 p1 p2 k3), and the flip and crop that give its pictures.

    Attributes
    ----------
    name : name of the camera.
    camera : size and intrinsics of the cropped picture.
    camera_from_rig : rigid transform (4, 4), mm.
    flip : ffmpeg's filter that flips the frame; "" for the direct view.
    crop : part of the flipped frame.
    error_px : largest error of the lens within the picture.
    """

    name: str
    camera: Camera
    camera_from_rig: FloatArray
    flip: str
    crop: Rectangle
    error_px: float

    @property
    def filters(self) -> str:
        """Argument of ffmpeg's `-vf` that makes the pictures from frames."""
        crop = f"crop={self.crop.width}:{self.crop.height}:{self.crop.x}:{self.crop.y}"
        return f"{self.flip},{crop}" if self.flip else crop


def pose_cameras(layout: Layout, views: Sequence[VirtualCamera]) -> tuple[PoseCamera, ...]:
    """All mirrors, preceded by the direct view if the views look along the camera's axis."""
    cameras = []
    if np.allclose(layout.view_from_rig, np.eye(3)):
        base = layout.camera
        frame = Rectangle(0, 0, base.width_px, base.height_px)
        cameras.append(_pose_camera(DIRECT, base, np.eye(4), "", frame))
    for view in views:
        flip = "hflip" if view.flip == "left-right" else "vflip"
        cameras.append(_pose_camera(view.name, view.camera, view.camera_from_rig, flip, _crop(view)))
    return tuple(cameras)


def _pose_camera(name: str, camera: Camera, camera_from_rig: FloatArray, flip: str, crop: Rectangle) -> PoseCamera:
    error_px = 0.0
    if camera.lens_model != "brown_conrady":
        first = np.array([crop.x, crop.y], dtype=np.float64)
        last = first + np.array([crop.width - 1, crop.height - 1])
        camera, error_px = nearest_lens(camera, "brown_conrady", (first, last))
    cropped = camera.replaced(
        width_px=crop.width, height_px=crop.height, cx_px=camera.cx_px - crop.x, cy_px=camera.cy_px - crop.y
    )
    return PoseCamera(name, cropped, camera_from_rig, flip, crop, error_px)


def _crop(view: VirtualCamera) -> Rectangle:
    """Bounding rectangle of a view with a margin, clipped to the frame; even numbers, as video codecs require."""
    size = np.array([view.camera.width_px, view.camera.height_px])
    low, high = view.outline_px.min(axis=0), view.outline_px.max(axis=0)
    margin = MARGIN * (high - low)
    first = np.maximum(np.floor(low - margin), 0).astype(int) // 2 * 2
    last = np.minimum(np.ceil(high + margin), size - 1).astype(int)
    width, height = (int(side) // 2 * 2 for side in last - first + 1)
    return Rectangle(int(first[0]), int(first[1]), width, height)


def calibration_toml(cameras: Sequence[PoseCamera]) -> str:
    """The cameras in the format of `aniposelib.cameras.CameraGroup.load`; translations in mm."""
    parts = []
    for number, pose_camera in enumerate(cameras):
        camera, pose = pose_camera.camera, pose_camera.camera_from_rig
        parts.append(
            f"[cam_{number}]\n"
            f"# pictures of this camera: {FFMPEG} -vf {pose_camera.filters} {pose_camera.name}.mp4\n"
            f'name = "{pose_camera.name}"\n'
            f"size = [{camera.width_px}, {camera.height_px}]\n"
            f"matrix = [{', '.join(_numbers(row) for row in camera.matrix)}]\n"
            f"distortions = {_numbers(camera.distortion)}\n"
            f"rotation = {_numbers(Rotation.from_matrix(pose[:3, :3]).as_rotvec())}\n"
            f"translation = {_numbers(pose[:3, 3])}\n"
        )
    parts.append("[metadata]\nadjusted = false\n")
    return "\n".join(parts)


def _numbers(values: FloatArray) -> str:
    return f"[{', '.join(repr(float(value)) for value in values)}]"


def stereo_params(cameras: Sequence[PoseCamera]) -> bytes:
    """Pairs of cameras as `camera_matrix/stereo_params.pickle` of a DeepLabCut 3-D project, with keys "NAME-NAME".

    DeepLabCut undistorts with R1, P1 and R2, P2, and triangulates with P1 and P2. Cameras at mirrors differ too much in
    direction to be rectified. With R1 = 1, P1 = K1 [1 | 0], R2 = R^T and P2 = K2 [R | T], undistorted pixels are
    pinhole pixels, and points are in the frame of the first camera, in mm.
    """
    pairs = list(permutations(cameras, 2)) if len(cameras) <= MAX_PAIRED else [(cameras[0], b) for b in cameras[1:]]
    return pickle.dumps({f"{a.name}-{b.name}": _stereo(a, b) for a, b in pairs}, protocol=4)


def _stereo(a: PoseCamera, b: PoseCamera) -> dict[str, object]:
    b_from_a = b.camera_from_rig @ np.linalg.inv(a.camera_from_rig)
    rotation, translation = b_from_a[:3, :3], b_from_a[:3, 3:]
    x, y, z = translation.ravel()
    essential = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ rotation
    first, second = a.camera.matrix, b.camera.matrix
    sizes = [(view.camera.width_px, view.camera.height_px) for view in (a, b)]
    return {
        "cameraMatrix1": first,
        "cameraMatrix2": second,
        "distCoeffs1": np.array(a.camera.distortion)[None],
        "distCoeffs2": np.array(b.camera.distortion)[None],
        "R": rotation,
        "T": translation,
        "E": essential,
        "F": np.linalg.inv(second).T @ essential @ np.linalg.inv(first),
        "R1": np.eye(3),
        "R2": rotation.T.copy(),
        "P1": first @ np.eye(3, 4),
        "P2": second @ b_from_a[:3],
        "roi1": (0, 0, *sizes[0]),
        "roi2": (0, 0, *sizes[1]),
        "Q": np.eye(4),
        "image_shape": sizes,
    }


def pictures_table(cameras: Sequence[PoseCamera]) -> str:
    """Table rows with the ffmpeg filters of each camera's pictures."""
    return "".join(
        f"| `{view.name}` | `-vf {view.filters}` | {f'{view.error_px:.2g}' if view.error_px > 1e-6 else '0'} |\n"
        for view in cameras
    )
