"""ROS: a camera_info file of every view, as `camera_calibration_parsers` and `camera_info_url` take it."""

from __future__ import annotations

from mirrorcam.core.number_text import number, numbers
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.write.held_lens import ROS
from mirrorcam.optics.camera_files.write.virtual_cameras import VirtualCamera

MODELS = {"brown_conrady": "plumb_bob", "rational": "rational_polynomial", "fisheye": "equidistant"}
"""Names of lens models in `sensor_msgs/distortion_models.hpp`."""


def frame_id(view: VirtualCamera) -> str:
    """The optical frame of a view, as the URDF names it too."""
    return f"mirrorcam_{view.name}_optical_frame"


def camera_info_yaml(view: VirtualCamera) -> str:
    """The view's camera_info; the rectified camera (R = 1, P = [K 0]) is that of the same pose without distortion.

    K is that of the whole flipped frame, as CameraInfo asks for where an image is only its `roi`. The parser reads
    neither `frame_id` nor `roi`; a driver copies them into header.frame_id and roi.
    """
    camera, cut = ROS.of(view).camera, view.sub_image
    fx, fy, cx, cy = (number(value) for value in camera.intrinsics[:4])
    return (
        f"image_width: {camera.width_px}\n"
        f"image_height: {camera.height_px}\n"
        f"camera_name: mirrorcam_{view.name}\n"
        f"{_matrix('camera_matrix', camera.matrix)}"
        f"distortion_model: {MODELS[camera.lens_model]}\n"
        f"{_matrix('distortion_coefficients', camera.distortion[None])}"
        "rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]\n"
        f"projection_matrix:\n  rows: 3\n  cols: 4\n"
        f"  data: [{fx}, 0.0, {cx}, 0.0, 0.0, {fy}, {cy}, 0.0, 0.0, 0.0, 1.0, 0.0]\n"
        f"frame_id: {frame_id(view)}\n"
        "roi:\n"
        f"  x_offset: {cut.x}\n  y_offset: {cut.y}\n  height: {cut.height}\n  width: {cut.width}\n  do_rectify: false\n"
    )


def _matrix(name: str, matrix: FloatArray) -> str:
    rows, columns = matrix.shape
    return f"{name}:\n  rows: {rows}\n  cols: {columns}\n  data: [{numbers(matrix.ravel())}]\n"
