"""Light fields as ROS 2 messages: plain values that a bag stores and a node publishes, without any ROS library.

Frames are optical (REP 103): x right, y down, z forward. Lengths are metres, stamps nanoseconds. Views are rectified:
each `camera_info` is an exact pinhole, and each view has its own frame below the camera's (`rig`).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.io.view_images import rgb
from mirrorcam.optics.light_field.io.views_file import SCHEMA, fields_of_views
from mirrorcam.optics.light_field.light_field import LightField, Views

CAMERA_FRAME = "mirrorcam_camera_optical_frame"
"""Frame `rig`, as named in the URDF of `mirrorcam camera export` and the xacro of `mirrorcam cad`."""
TF_STATIC, VIEWS_TOPIC, WEIGHTS_TOPIC, POINTS_TOPIC = "/tf_static", "views", "weights", "points"
MIN_CONFIDENCE = 0.5
"""Confidence above which a depth is published."""
M_FROM_MM = 1e-3
_NS_PER_S = 10**9
_LAST_STAMP_NS = 2**31 * _NS_PER_S - 1
"""Seconds of a stamp are int32."""
_FLOAT32 = 7
"""Type number in sensor_msgs/msg/PointField."""


@dataclass(frozen=True, eq=False)
class RosMessage:
    """A message: type, such as `sensor_msgs/msg/Image`, and fields: numbers, strings, arrays and messages."""

    type: str
    fields: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Published:
    """A message on a topic; topics without a leading slash are in the camera's namespace.

    A `latched` message is sent once, and also to later subscribers (durability "transient local").
    """

    topic: str
    message: RosMessage
    latched: bool = False


def view_topic(view: tuple[int, int]) -> str:
    """Return the namespace of a view's topics, below the camera's."""
    return f"view_{view[0]}_{view[1]}"


def view_frame(view: tuple[int, int]) -> str:
    """Return the optical frame of a decoded view: rectified, unlike the camera of the same mirror in the URDF."""
    return f"mirrorcam_rectified_{view_topic(view)}_optical_frame"


def stamp_ns(time_s: float, start_ns: int = 0) -> int:
    """Return the stamp of a frame at a time in s after a start; raises InputError if ROS 2 cannot represent it."""
    stamp = start_ns + round(time_s * _NS_PER_S)
    if not 0 <= stamp <= _LAST_STAMP_NS:
        raise InputError(f"a frame's time is {stamp / _NS_PER_S:.3f} s, but ROS 2 needs 0 to 2^31 s")
    return stamp


def latched_messages(light_field: LightField, stamp: int) -> Iterator[Published]:
    """Yield messages common to all frames: /tf_static, geometry and type of the light field, and the weights."""
    yield Published(TF_STATIC, tf_static(light_field, stamp), latched=True)
    yield Published(VIEWS_TOPIC, views_text(light_field), latched=True)
    yield Published(WEIGHTS_TOPIC, weights_array(light_field), latched=True)


def frame_messages(light_field: LightField, stamp: int, depth: DepthMap | None = None) -> Iterator[Published]:
    """Yield one frame: image and camera_info of each view and, given a depth map, depth image and point cloud."""
    for view in np.ndindex(light_field.rows, light_field.cols):
        picture = image(light_field.samples[view], stamp, view_frame(view))
        yield Published(f"{view_topic(view)}/image_rect", picture)
        yield Published(f"{view_topic(view)}/camera_info", camera_info(light_field, view, stamp))
    if depth is not None:
        yield Published("depth/image_rect", depth_image(depth, stamp))
        yield Published("depth/camera_info", camera_info(light_field, depth.view, stamp))
        yield Published(POINTS_TOPIC, point_cloud(light_field, depth, stamp))


def time_message(stamp: int) -> RosMessage:
    """Convert a stamp in ns to builtin_interfaces/msg/Time."""
    seconds, nanoseconds = divmod(stamp, _NS_PER_S)
    return RosMessage("builtin_interfaces/msg/Time", {"sec": seconds, "nanosec": nanoseconds})


def header(stamp: int, frame_id: str) -> RosMessage:
    """Build a std_msgs/msg/Header with a stamp in ns."""
    return RosMessage("std_msgs/msg/Header", {"stamp": time_message(stamp), "frame_id": frame_id})


def encoding_of(dtype: np.dtype[Any], channels: int) -> str:
    """Return the encoding's name in `sensor_msgs/image_encodings.hpp` for a pixel type."""
    return f"32FC{channels}" if dtype == np.float32 else {1: "mono8", 3: "rgb8"}[channels]


def image(pixels: NDArray[Any], stamp: int, frame_id: str) -> RosMessage:
    """Build a sensor_msgs/msg/Image of pixels (h, w) or (h, w, c), uint8 or float32: rgb8, mono8, 32FC3 or 32FC1."""
    channels = 1 if pixels.ndim == 2 else pixels.shape[2]
    height, width = pixels.shape[:2]
    little_endian = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<"))
    fields = {
        "header": header(stamp, frame_id),
        "height": height,
        "width": width,
        "encoding": encoding_of(pixels.dtype, channels),
        "is_bigendian": 0,
        "step": width * channels * pixels.dtype.itemsize,
        "data": little_endian.reshape(-1).view(np.uint8),
    }
    return RosMessage("sensor_msgs/msg/Image", fields)


def camera_info(views: Views, view: tuple[int, int], stamp: int) -> RosMessage:
    """Build a view's sensor_msgs/msg/CameraInfo: K is exact, without distortion, R = 1 and P = [K 0].

    Each view has its own frame, so P has no baseline, unlike for a stereo pair in one frame.
    """
    matrix = views.matrices[view]
    region = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
    fields = {
        "header": header(stamp, view_frame(view)),
        "height": views.height_px,
        "width": views.width_px,
        "distortion_model": "plumb_bob",
        "d": np.zeros(5),
        "k": matrix.ravel(),
        "r": np.eye(3).ravel(),
        "p": np.column_stack([matrix, np.zeros(3)]).ravel(),
        "binning_x": 0,
        "binning_y": 0,
        "roi": RosMessage("sensor_msgs/msg/RegionOfInterest", region),
    }
    return RosMessage("sensor_msgs/msg/CameraInfo", fields)


def depth_m(depth: DepthMap) -> NDArray[np.float32]:
    """Return the depth (v, u) in metres along z from the reference view itself (REP 118); NaN where uncertain.

    `DepthMap.depth_mm` is measured from the camera's pupil, which is not the frame of a view.
    """
    from_view = depth.depth_mm.astype(np.float64) - depth.views.reference_view_depth_mm
    confident = depth.valid & (depth.confidence > MIN_CONFIDENCE)
    return np.where(confident, from_view * M_FROM_MM, np.nan).astype(np.float32)


def points_m(depth: DepthMap) -> NDArray[np.float32]:
    """Return the points (v, u, 3) in metres in the frame of the reference view; NaN where depth is uncertain."""
    z = depth_m(depth)[..., None]
    directions = (depth.views.pixel_grid() - depth.views.centre_px) / depth.views.focal_px
    return np.concatenate([directions.astype(np.float32) * z, z], axis=-1)


def depth_image(depth: DepthMap, stamp: int) -> RosMessage:
    """Build a sensor_msgs/msg/Image of `depth_m`, 32FC1, in the frame of the reference view."""
    return image(depth_m(depth), stamp, view_frame(depth.view))


def point_cloud(light_field: LightField, depth: DepthMap, stamp: int) -> RosMessage:
    """Build a sensor_msgs/msg/PointCloud2 in the frame of the reference view, organised like its picture.

    Fields are x, y, z and sigma (standard deviation along z) in metres, and rgb as PCL packs it; all but rgb are NaN
    where depth is uncertain.
    """
    points = points_m(depth)
    valid = np.isfinite(points[..., 2])
    cloud = np.zeros(valid.shape, [(name, "<f4") for name in ("x", "y", "z")] + [("rgb", "<u4"), ("sigma", "<f4")])
    cloud["x"], cloud["y"], cloud["z"] = np.moveaxis(points, -1, 0)
    red, green, blue = np.moveaxis(rgb(light_field.samples[depth.view]).astype(np.uint32), -1, 0)
    cloud["rgb"] = red << 16 | green << 8 | blue
    cloud["sigma"] = np.where(valid, depth.sigma_mm * np.float32(M_FROM_MM), np.nan)
    assert cloud.dtype.fields is not None
    fields = [
        RosMessage("sensor_msgs/msg/PointField", {"name": name, "offset": offset, "datatype": _FLOAT32, "count": 1})
        for name, (_, offset, *_) in cloud.dtype.fields.items()
    ]
    height, width = valid.shape
    return RosMessage(
        "sensor_msgs/msg/PointCloud2",
        {
            "header": header(stamp, view_frame(depth.view)),
            "height": height,
            "width": width,
            "fields": fields,
            "is_bigendian": False,
            "point_step": cloud.dtype.itemsize,
            "row_step": width * cloud.dtype.itemsize,
            "data": cloud.reshape(-1).view(np.uint8),
            "is_dense": bool(valid.all()),
        },
    )


def tf_static(views: Views, stamp: int) -> RosMessage:
    """Build a tf2_msgs/msg/TFMessage with the frame of every view below the camera's, in metres."""
    quaternion = dict(zip("xyzw", Rotation.from_matrix(views.view_from_rig.T).as_quat().tolist(), strict=True))
    transforms = []
    for view in np.ndindex(views.rows, views.cols):
        position_mm = views.reference_view_in_rig_mm + views.positions_mm[view] @ views.view_from_rig
        position_m = dict(zip("xyz", (position_mm * M_FROM_MM).tolist(), strict=True))
        transform = {
            "translation": RosMessage("geometry_msgs/msg/Vector3", position_m),
            "rotation": RosMessage("geometry_msgs/msg/Quaternion", quaternion),
        }
        fields = {
            "header": header(stamp, CAMERA_FRAME),
            "child_frame_id": view_frame(view),
            "transform": RosMessage("geometry_msgs/msg/Transform", transform),
        }
        transforms.append(RosMessage("geometry_msgs/msg/TransformStamped", fields))
    return RosMessage("tf2_msgs/msg/TFMessage", {"transforms": transforms})


def views_text(light_field: LightField) -> RosMessage:
    """Build a std_msgs/msg/String with the geometry as in `views.json`, which restores the light field from a bag."""
    content = {
        "schema": SCHEMA,
        "channels": light_field.samples.shape[-1],
        "dtype": str(light_field.samples.dtype),
        "views": fields_of_views(light_field),
    }
    return RosMessage("std_msgs/msg/String", {"data": json.dumps(content, allow_nan=False)})


def weights_array(light_field: LightField) -> RosMessage:
    """Build a std_msgs/msg/Float32MultiArray of the weights (t, s, v, u): viewers show such images as depth."""
    shape = light_field.weights.shape
    strides = [int(np.prod(shape[axis:])) for axis in range(len(shape))]
    dimensions = [
        RosMessage("std_msgs/msg/MultiArrayDimension", {"label": label, "size": size, "stride": stride})
        for label, size, stride in zip("tsvu", shape, strides, strict=True)
    ]
    layout = RosMessage("std_msgs/msg/MultiArrayLayout", {"dim": dimensions, "data_offset": 0})
    flat = np.ascontiguousarray(light_field.weights).reshape(-1)
    return RosMessage("std_msgs/msg/Float32MultiArray", {"layout": layout, "data": flat})
