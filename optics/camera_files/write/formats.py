"""Cameras of a layout in the file formats of OpenCV, ROS, URDF, Kalibr, COLMAP and nerfstudio.

Optical frames in ROS have x right, y down and z forward (REP 103); the base camera's optical frame is the rig frame.

Kalibr's reader refuses a principal point outside the first quadrant, so its cameras show the entire flipped frame. Its
radtan model is OpenCV's without k3, its equidistant model is OpenCV's fisheye.

COLMAP drops cameras whose principal point lies outside their image, so its images are entire flipped frames with masks
of the pixels of a view.
"""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.names import number, numbers
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.write.virtual_cameras import VirtualCamera
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lenses.families import LensName
from mirrorcam.optics.geometry.nearest_lens import nearest_lens
from mirrorcam.optics.geometry.sfm_rigs import HALF_PIXEL, WORLD_FROM_VIEW, SfmCamera, frame
from mirrorcam.optics.geometry.transforms import inverse, rigid

ROS_MODELS = {"brown_conrady": "plumb_bob", "rational": "rational_polynomial", "fisheye": "equidistant"}
"""Names of lens models in `sensor_msgs/distortion_models.hpp`."""
URDF_ROOT = "mirrorcam_camera_link"
URDF_CAMERA = "mirrorcam_camera_optical_frame"
LINK_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""The frame of a camera's body has x forward, y left and z up (REP 103)."""


@dataclass(frozen=True)
class FormatLens:
    """A view's camera in the lens models of a format, and its largest error in the sub-image, px."""

    camera: Camera
    error_px: float


@dataclass(frozen=True)
class LensFormat:
    """The lens models of a format.

    Attributes
    ----------
    families
        Lens models that the format represents exactly.
    nearest
        Lens model that is fitted to all others.
    lacks
        Coefficients of `nearest` that the format lacks.
    """

    families: frozenset[LensName]
    nearest: LensName
    lacks: Collection[str] = ()

    def of(self, view: VirtualCamera) -> FormatLens:
        """The lens of a view in this format: exact if possible, else fitted over the view's sub-image."""
        camera = view.camera
        exact = camera.lens_model in self.families
        if exact and camera.lens_model == self.nearest:
            exact = not any(
                value for name, value in zip(camera.lens.names, camera.distortion, strict=True) if name in self.lacks
            )
        if exact:
            return FormatLens(camera, 0.0)
        crop = view.sub_image
        first = np.array([crop.x, crop.y], dtype=np.float64)
        last = first + np.array([crop.width - 1, crop.height - 1])
        return FormatLens(*nearest_lens(camera, self.nearest, (first, last), self.lacks))


OPENCV = LensFormat(frozenset({"brown_conrady", "rational", "thin_prism", "fisheye"}), "thin_prism")
"""`cv2.projectPoints` takes 5, 8 or 12 coefficients, `cv2.fisheye.projectPoints` takes 4."""

ROS = LensFormat(frozenset({"brown_conrady", "rational", "fisheye"}), "rational")
"""`sensor_msgs/distortion_models.hpp`: plumb_bob, rational_polynomial, equidistant."""

COLMAP = LensFormat(frozenset({"brown_conrady", "rational", "fisheye"}), "rational")
"""FULL_OPENCV has k1 k2 p1 p2 k3 k4 k5 k6, OPENCV_FISHEYE k1 k2 k3 k4; its thin-prism models are other fisheyes."""

NERFSTUDIO = LensFormat(frozenset({"brown_conrady", "fisheye"}), "brown_conrady")
"""OPENCV has k1 k2 k3 p1 p2, OPENCV_FISHEYE k1 k2 k3 k4."""

KALIBR = LensFormat(frozenset({"brown_conrady", "fisheye"}), "brown_conrady", ("k3",))
"""pinhole-radtan is the Brown-Conrady lens without k3, pinhole-equi the fisheye lens."""

FORMATS = {"OpenCV": OPENCV, "ROS": ROS, "COLMAP": COLMAP, "nerfstudio": NERFSTUDIO, "Kalibr": KALIBR}


def opencv_yaml(views: tuple[VirtualCamera, ...]) -> str:
    """The views for `cv2.FileStorage`; x_camera = R x_rig + T, as in `cv2.projectPoints`."""
    flip = views[0].flip
    file = cv2.FileStorage(".yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML)
    file.write("image_width", views[0].camera.width_px)
    file.write("image_height", views[0].camera.height_px)
    if flip != "none":
        file.write("flip_code", 1 if flip == "left-right" else 0)
        file.writeComment(f"cv2.flip(frame, flip_code) is the image of every view: {flip}")
    file.write("unit", "mm")
    if views[0].camera.lens_model == "fisheye":
        file.writeComment("distortion_coefficients are those of cv2.fisheye.projectPoints")
        file.write("distortion_model", "fisheye")
    file.startWriteStruct("views", cv2.FILE_NODE_SEQ)
    for view in views:
        crop = view.sub_image
        file.startWriteStruct("", cv2.FILE_NODE_MAP)
        file.write("name", view.name)
        camera = OPENCV.of(view).camera
        file.write("camera_matrix", camera.matrix)
        file.write("distortion_coefficients", camera.distortion[None])
        file.write("R", view.camera_from_rig[:3, :3])
        file.write("T", view.camera_from_rig[:3, 3:])
        file.write("roi", np.array([[crop.x, crop.y, crop.width, crop.height]], dtype=np.int32))
        file.endWriteStruct()
    file.endWriteStruct()
    return str(file.releaseAndGetString())


def frame_id(view: VirtualCamera) -> str:
    """Name of a view's optical frame, also in the URDF."""
    return f"mirrorcam_{view.name}_optical_frame"


def camera_info_yaml(view: VirtualCamera) -> str:
    """The view's camera_info; the rectified camera (R = 1, P = [K 0]) has the same pose and no distortion.

    K describes the entire flipped frame, as CameraInfo requires even if an image covers only its `roi`. ROS's parser
    ignores `frame_id` and `roi`; a driver copies them into header.frame_id and roi.
    """
    camera, roi = ROS.of(view).camera, view.sub_image
    fx, fy, cx, cy = (number(value) for value in camera.intrinsics[:4])
    return (
        f"image_width: {camera.width_px}\n"
        f"image_height: {camera.height_px}\n"
        f"camera_name: mirrorcam_{view.name}\n"
        f"{_ros_matrix('camera_matrix', camera.matrix)}"
        f"distortion_model: {ROS_MODELS[camera.lens_model]}\n"
        f"{_ros_matrix('distortion_coefficients', camera.distortion[None])}"
        "rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]\n"
        f"projection_matrix:\n  rows: 3\n  cols: 4\n"
        f"  data: [{fx}, 0.0, {cx}, 0.0, 0.0, {fy}, {cy}, 0.0, 0.0, 0.0, 1.0, 0.0]\n"
        f"frame_id: {frame_id(view)}\n"
        "roi:\n"
        f"  x_offset: {roi.x}\n  y_offset: {roi.y}\n  height: {roi.height}\n  width: {roi.width}\n  do_rectify: false\n"
    )


def _ros_matrix(name: str, matrix: FloatArray) -> str:
    rows, columns = matrix.shape
    return f"{name}:\n  rows: {rows}\n  cols: {columns}\n  data: [{numbers(matrix.ravel())}]\n"


def urdf(views: tuple[VirtualCamera, ...]) -> str:
    """The optical frames as a robot whose links have no geometry."""
    robot = Element("robot", name="mirrorcam_calibrated")
    SubElement(robot, "link", name=URDF_ROOT)
    _urdf_frame(robot, URDF_CAMERA, URDF_ROOT, LINK_FROM_OPTICAL)
    for view in views:
        _urdf_frame(robot, frame_id(view), URDF_CAMERA, inverse(view.camera_from_rig))
    indent(robot)
    return f'<?xml version="1.0"?>\n{tostring(robot, encoding="unicode")}\n'


def _urdf_frame(robot: Element, name: str, parent: str, parent_from_frame: FloatArray) -> None:
    """Add a link and its fixed joint; rpy are rotations about the fixed x, y and z."""
    SubElement(robot, "link", name=name)
    joint = SubElement(robot, "joint", name=f"{name}_joint", type="fixed")
    rpy = Rotation.from_matrix(parent_from_frame[:3, :3]).as_euler("xyz")
    SubElement(joint, "origin", xyz=numbers(parent_from_frame[:3, 3] / 1000.0, " "), rpy=numbers(rpy, " "))
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=name)


def camchain_yaml(views: tuple[VirtualCamera, ...]) -> str:
    """`camchain.yaml`: cam0 is the first view; T_cn_cnm1 transforms points from the previous camera to this one."""
    text = ""
    for index, view in enumerate(views):
        lens = KALIBR.of(view)
        camera = lens.camera
        model = "equidistant" if camera.lens_model == "fisheye" else "radtan"
        others = ", ".join(str(other) for other in range(len(views)) if other != index)
        text += f"cam{index}:\n"
        if index > 0:
            from_previous = view.camera_from_rig @ inverse(views[index - 1].camera_from_rig)
            from_previous[:3, 3] /= 1000.0
            text += "  T_cn_cnm1:\n" + "".join(f"  - [{numbers(row)}]\n" for row in from_previous)
        text += (
            f"  cam_overlaps: [{others}]\n"
            "  camera_model: pinhole\n"
            f"  distortion_coeffs: [{numbers(camera.distortion[:4])}]"
            f"  # within {lens.error_px:.2g} px of the lens here\n"
            f"  distortion_model: {model}\n"
            f"  intrinsics: [{numbers(camera.intrinsics[:4])}]\n"
            f"  resolution: [{camera.width_px}, {camera.height_px}]\n"
            f"  rostopic: /mirrorcam/{view.name}/image_raw\n"
        )
    return text


def rig_cameras(views: tuple[VirtualCamera, ...]) -> tuple[SfmCamera, ...]:
    """The views as cameras of a rig; the world is the rig frame.

    FULL_OPENCV has fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6, with k4 to k6 zero for a Brown-Conrady lens;
    OPENCV_FISHEYE has fx, fy, cx, cy, k1, k2, k3, k4.
    """
    cameras = []
    for view in views:
        camera = COLMAP.of(view).camera
        fx, fy, cx, cy, *distortion = (float(value) for value in camera.intrinsics)
        model = "OPENCV_FISHEYE" if camera.lens_model == "fisheye" else "FULL_OPENCV"
        unused = (0.0,) * (3 if camera.lens_model == "brown_conrady" else 0)
        parameters = (fx, fy, cx + HALF_PIXEL, cy + HALF_PIXEL, *distortion, *unused)
        cameras.append(SfmCamera(view.name, model, camera.width_px, camera.height_px, parameters, view.camera_from_rig))
    return tuple(cameras)


def transforms_json(views: tuple[VirtualCamera, ...], view_from_rig: FloatArray) -> str:
    """The views as nerfstudio's dataset; its world has the pupil as origin, x right, y to the scene and z up."""
    world_from_rig = rigid(WORLD_FROM_VIEW @ view_from_rig, np.zeros(3))
    frames = []
    for view in views:
        camera = view.crop_to_sub_image(NERFSTUDIO.of(view).camera)
        frames.append(
            frame(
                view.name,
                (camera.width_px, camera.height_px),
                (camera.fx_px, camera.fy_px),
                (camera.cx_px, camera.cy_px),
                world_from_rig @ inverse(view.camera_from_rig),
                dict(zip(camera.lens.names, camera.distortion.tolist(), strict=True)),
            )
        )
    model = "OPENCV_FISHEYE" if views[0].camera.lens_model == "fisheye" else "OPENCV"
    return json.dumps({"camera_model": model, "frames": frames}, indent=1, allow_nan=False) + "\n"
