"""Cameras for tools that track animals: aniposelib's `calibration.toml` and DeepLabCut 3-D's `stereo_params.pickle`.

Each mirror is a camera whose picture is the frame flipped and cut to what the mirror shows; the camera itself is one
more, `direct`, where it looks at the scene. Anipose, lightning-pose and its ensemble Kalman smoother read the first
file, DeepLabCut's `triangulate` the second.
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
"""By which a picture is wider on each side than the part of a mirror that is known to show something."""
FFMPEG = "ffmpeg -noautorotate -i FRAMES"
"""How ffmpeg reads frames as they lie on the sensor: it would turn a video that a phone marks as turned."""
MOST_PAIRED = 12
"""Cameras of which every pair is written for DeepLabCut; of more, those with the first one alone."""


@dataclass(frozen=True)
class PoseCamera:
    """A camera with the lens of Brown and Conrady (k1 k2 p1 p2 k3), and how its pictures are made.

    `camera` has the size and intrinsics of the cut picture, `camera_from_rig` (4, 4) is rigid, in mm; `crop` is the
    part of the frame, which is flipped before as `flip` says ("" for the direct view, which is not). `error_px` is the
    largest error of the lens within the picture.
    """

    name: str
    camera: Camera
    camera_from_rig: FloatArray
    flip: str
    crop: Rectangle
    error_px: float

    @property
    def filters(self) -> str:
        """What ffmpeg's `-vf` takes to make the pictures from frames."""
        cut = self.crop
        crop = f"crop={cut.width}:{cut.height}:{cut.x}:{cut.y}"
        return f"{self.flip},{crop}" if self.flip else crop


def pose_cameras(layout: Layout, views: Sequence[VirtualCamera]) -> tuple[PoseCamera, ...]:
    """The direct view, where views look along the camera's axis, and all mirrors."""
    cameras = []
    if np.allclose(layout.view_from_rig, np.eye(3)):
        base = layout.camera
        whole = Rectangle(0, 0, base.width_px, base.height_px)
        cameras.append(_pose_camera(DIRECT, base, np.eye(4), "", whole))
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
    cut = camera.replaced(
        width_px=crop.width, height_px=crop.height, cx_px=camera.cx_px - crop.x, cy_px=camera.cy_px - crop.y
    )
    return PoseCamera(name, cut, camera_from_rig, flip, crop, error_px)


def _crop(view: VirtualCamera) -> Rectangle:
    """The bounding rectangle of a view with a margin, as far as the frame goes; in even numbers, for video codecs."""
    size = np.array([view.camera.width_px, view.camera.height_px])
    low, high = view.outline_px.min(axis=0), view.outline_px.max(axis=0)
    margin = MARGIN * (high - low)
    first = np.maximum(np.floor(low - margin), 0).astype(int) // 2 * 2
    last = np.minimum(np.ceil(high + margin), size - 1).astype(int)
    width, height = (int(side) // 2 * 2 for side in last - first + 1)
    return Rectangle(int(first[0]), int(first[1]), width, height)


def calibration_toml(cameras: Sequence[PoseCamera]) -> str:
    """The cameras as `aniposelib.cameras.CameraGroup.load` reads them; translations are in mm."""
    parts = []
    for number, each in enumerate(cameras):
        camera, pose = each.camera, each.camera_from_rig
        parts.append(
            f"[cam_{number}]\n"
            f"# pictures of this camera: {FFMPEG} -vf {each.filters} {each.name}.mp4\n"
            f'name = "{each.name}"\n'
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
    """The pairs of cameras as `camera_matrix/stereo_params.pickle` of a 3-D project of DeepLabCut, by "NAME-NAME".

    DeepLabCut undistorts with R1, P1 and R2, P2, and triangulates with P1 and P2. Cameras at mirrors look too
    differently to be rectified: with R1 = 1, P1 = K1 [1 | 0], R2 = R^T and P2 = K2 [R | T], undistorted pixels are
    those of pinholes, and points come out in the frame of the first camera, in mm.
    """
    pairs = list(permutations(cameras, 2)) if len(cameras) <= MOST_PAIRED else [(cameras[0], b) for b in cameras[1:]]
    return pickle.dumps({f"{a.name}-{b.name}": _stereo(a, b) for a, b in pairs}, protocol=4)


def _stereo(a: PoseCamera, b: PoseCamera) -> dict[str, object]:
    b_from_a = b.camera_from_rig @ np.linalg.inv(a.camera_from_rig)
    turn, shift = b_from_a[:3, :3], b_from_a[:3, 3:]
    x, y, z = shift.ravel()
    essential = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ turn
    first, second = a.camera.matrix, b.camera.matrix
    sizes = [(each.camera.width_px, each.camera.height_px) for each in (a, b)]
    return {
        "cameraMatrix1": first,
        "cameraMatrix2": second,
        "distCoeffs1": np.array(a.camera.distortion)[None],
        "distCoeffs2": np.array(b.camera.distortion)[None],
        "R": turn,
        "T": shift,
        "E": essential,
        "F": np.linalg.inv(second).T @ essential @ np.linalg.inv(first),
        "R1": np.eye(3),
        "R2": turn.T.copy(),
        "P1": first @ np.eye(3, 4),
        "P2": second @ b_from_a[:3],
        "roi1": (0, 0, *sizes[0]),
        "roi2": (0, 0, *sizes[1]),
        "Q": np.eye(4),
        "image_shape": sizes,
    }


def pictures_table(cameras: Sequence[PoseCamera]) -> str:
    """How the pictures of each camera are made, as rows of a table."""
    return "".join(
        f"| `{each.name}` | `-vf {each.filters}` | {f'{each.error_px:.2g}' if each.error_px > 1e-6 else '0'} |\n"
        for each in cameras
    )
