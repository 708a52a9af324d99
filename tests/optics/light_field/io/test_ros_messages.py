"""Light fields as ROS 2 messages: frames and cameras match the layout's rays, depth and points are in metres."""

from __future__ import annotations

import json
from typing import Any

import cv2
import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.io import ros_messages
from mirrorcam.optics.light_field.io.ros_messages import RosMessage
from mirrorcam.optics.light_field.light_field import LightField
from tests.core.video.videos import pictures

MIDDLE = (1, 1)


@pytest.fixture(scope="module")
def light_field(decoder: Decoder) -> LightField:
    return decoder.decode(pictures(1, 320, 192)[0])


@pytest.fixture(scope="module")
def depth(light_field: LightField) -> DepthMap:
    """A tilted plane with an uncertain and an unknown corner."""
    v, u = np.mgrid[0 : light_field.height_px, 0 : light_field.width_px]
    depth_mm = (380.0 + 0.5 * u - 0.2 * v).astype(np.float32)
    confidence = np.where((u < 4) & (v < 3), 0.4, 0.9).astype(np.float32)
    depth_mm[-2:, -5:] = np.nan
    sigma = np.where(np.isfinite(depth_mm), 2.5, np.nan).astype(np.float32)
    return DepthMap(views=light_field, view=MIDDLE, depth_mm=depth_mm, sigma_mm=sigma, confidence=confidence)


def rig_from_frame(transforms: RosMessage, frame: str) -> FloatArray:
    """Return the pose (4, 4) in metres of a frame in /tf_static, by the formula of unit quaternions."""
    (found,) = (each.fields for each in transforms.fields["transforms"] if each.fields["child_frame_id"] == frame)
    assert found["header"].fields["frame_id"] == "mirrorcam_camera_optical_frame"
    place, turn = (found["transform"].fields[name].fields for name in ("translation", "rotation"))
    x, y, z, w = (turn[name] for name in "xyzw")
    assert x * x + y * y + z * z + w * w == pytest.approx(1.0, abs=1e-12)
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = [place[name] for name in "xyz"]
    return pose


def test_tf_and_camera_info_project_points_as_the_mirrors_do(
    layout: Layout, decoder: Decoder, light_field: LightField
) -> None:
    transforms = ros_messages.tf_static(light_field, 0)
    random = np.random.default_rng(5)
    for index, view in enumerate(np.ndindex(3, 3)):
        info = ros_messages.camera_info(light_field, view, 7).fields
        frame_from_rig = np.linalg.inv(rig_from_frame(transforms, info["header"].fields["frame_id"]))
        seen = random.uniform((0, 0), (light_field.width_px, light_field.height_px), (200, 2))
        depths = random.uniform(0.7, 1.5, 20) * light_field.reference_depth_mm
        points_mm = np.concatenate(
            [light_field.plane_points_in_rig(depths[n], seen[10 * n : 10 * n + 10]) for n in range(20)]
        )
        in_frame = np.column_stack([points_mm / 1000.0, np.ones(200)]) @ frame_from_rig.T
        projected = in_frame @ info["p"].reshape(3, 4).T
        pixels = projected[:, :2] / projected[:, 2:]
        inside = ((pixels > 1) & (pixels < (light_field.width_px - 2, light_field.height_px - 2))).all(axis=1)
        assert inside.sum() > 20
        # The decoder's sensor pixels for these pixels, against those of the points by the layout's mirror.
        rows = slice(index * light_field.height_px, (index + 1) * light_field.height_px)
        whole, parts = decoder.tables[0]
        lookup = cv2.convertMaps(whole[rows], parts[rows], cv2.CV_32FC1)
        u, v = np.moveaxis(pixels[inside].astype(np.float32)[:, None], -1, 0)
        looked_up = np.concatenate([cv2.remap(table, u, v, cv2.INTER_LINEAR) for table in lookup], axis=1)
        shown = layout.project(points_mm[inside], index)
        served = cv2.remap(light_field.weights[view], u, v, cv2.INTER_LINEAR)[:, 0] == 1.0
        assert served.sum() > 10
        np.testing.assert_allclose(looked_up[served], shown[served], atol=0.06)


def test_every_view_has_its_own_frame_that_no_urdf_has(light_field: LightField) -> None:
    names = [each.fields["child_frame_id"] for each in ros_messages.tf_static(light_field, 0).fields["transforms"]]
    assert len(set(names)) == 9
    assert names[5] == "mirrorcam_rectified_view_1_2_optical_frame"


def test_images_are_named_by_their_type(light_field: LightField) -> None:
    for pixels, encoding, step in (
        (np.zeros((2, 5, 3), np.uint8), "rgb8", 15),
        (np.zeros((2, 5, 1), np.uint8), "mono8", 5),
        (np.zeros((2, 5), np.float32), "32FC1", 20),
        (np.zeros((2, 5, 3), np.float32), "32FC3", 60),
    ):
        fields = ros_messages.image(pixels, 3_000_000_005, "here").fields
        assert (fields["encoding"], fields["step"], fields["height"], fields["width"]) == (encoding, step, 2, 5)
        assert len(fields["data"]) == 2 * step
        header = fields["header"].fields
        assert header["frame_id"] == "here"
        assert header["stamp"].fields == {"sec": 3, "nanosec": 5}
    picture = ros_messages.image(light_field.samples[2, 0], 0, "").fields["data"]
    assert np.array_equal(picture, light_field.samples[2, 0].ravel())


def test_stamps_are_whole_nanoseconds_that_ros_can_hold() -> None:
    assert ros_messages.stamp_ns(1 / 30) == 33_333_333
    assert ros_messages.stamp_ns(0.04, 1_700_000_000_000_000_000) == 1_700_000_000_040_000_000
    for time_s in (-0.001, 2.0**31):
        with pytest.raises(InputError, match=r"but ROS 2 needs 0 to 2\^31 s"):
            ros_messages.stamp_ns(time_s)


def test_certain_depth_is_given_from_the_view_in_metres(light_field: LightField, depth: DepthMap) -> None:
    fields = ros_messages.depth_image(depth, 0).fields
    assert fields["encoding"] == "32FC1"
    found = fields["data"].view(np.float32).reshape(depth.depth_mm.shape)
    unsure = np.zeros(found.shape, bool)
    unsure[:3, :4] = unsure[-2:, -5:] = True
    assert np.array_equal(np.isnan(found), unsure)
    behind = float(light_field.view_from_rig[2] @ light_field.reference_view_in_rig_mm)
    np.testing.assert_allclose(found[~unsure], (depth.depth_mm[~unsure] - behind) / 1000.0, rtol=1e-6)


def test_points_lie_on_the_rays_of_the_views_pixels(light_field: LightField, depth: DepthMap) -> None:
    fields = ros_messages.point_cloud(light_field, depth, 0).fields
    offsets: dict[str, Any] = {each.fields["name"]: each.fields for each in fields["fields"]}
    assert {name: each["offset"] for name, each in offsets.items()} == {"x": 0, "y": 4, "z": 8, "rgb": 12, "sigma": 16}
    assert {each["datatype"] for each in offsets.values()} == {7}
    assert (fields["height"], fields["width"]) == depth.depth_mm.shape
    assert fields["row_step"] == 20 * fields["width"]
    assert not fields["is_dense"]
    values = fields["data"].view(np.float32).reshape(*depth.depth_mm.shape, 5)
    sure = np.isfinite(values[..., 2])
    pose = rig_from_frame(ros_messages.tf_static(light_field, 0), fields["header"].fields["frame_id"])
    in_rig = values[sure][:, :3].astype(np.float64) @ pose[:3, :3].T + pose[:3, 3]
    np.testing.assert_allclose(in_rig, depth.points_in_rig()[sure] / 1000.0, atol=1e-6)
    np.testing.assert_allclose(values[sure][:, 4], 0.0025)
    packed = values[..., 3].copy().view(np.uint32)
    colours = np.stack([packed >> 16, packed >> 8 & 255, packed & 255], axis=-1)
    assert np.array_equal(colours, light_field.samples[MIDDLE])


def test_a_frame_has_an_image_and_a_camera_per_view_with_one_stamp(light_field: LightField, depth: DepthMap) -> None:
    messages = list(ros_messages.frame_messages(light_field, 40_000_000, depth))
    topics = [each.topic for each in messages]
    assert len(topics) == len(set(topics)) == 21
    assert {"view_2_0/image_rect", "view_2_0/camera_info", "depth/image_rect", "depth/camera_info", "points"} <= {
        *topics
    }
    stamps = {each.message.fields["header"].fields["stamp"].fields["nanosec"] for each in messages}
    assert stamps == {40_000_000}
    assert not any(each.latched for each in messages)
    assert len(list(ros_messages.frame_messages(light_field, 0))) == 18


def test_constant_messages_are_latched(light_field: LightField) -> None:
    messages = {each.topic: each for each in ros_messages.latched_messages(light_field, 0)}
    assert set(messages) == {"/tf_static", "views", "weights"}
    assert all(each.latched for each in messages.values())
    assert json.loads(messages["views"].message.fields["data"])["views"]["layout_identity"]
    layout = messages["weights"].message.fields["layout"].fields
    sizes = [(each.fields["label"], each.fields["size"], each.fields["stride"]) for each in layout["dim"]]
    count = light_field.weights.size
    assert sizes[0] == ("t", 3, count)
    assert sizes[3] == ("u", light_field.width_px, light_field.width_px)
