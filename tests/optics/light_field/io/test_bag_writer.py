"""Bags in other readers: MCAP's own, with Foxglove's decoder of ROS 2 messages, and rerun's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core import extras
from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.io import ros_messages
from mirrorcam.optics.light_field.io.bag_writer import BagWriter
from mirrorcam.optics.light_field.io.ros_messages import Published
from mirrorcam.optics.light_field.light_field import LightField
from tests.core.video.videos import pictures
from tests.optics.light_field.io.bags import STEP_NS, needs_rosbags, write_bag

COUNT = 3


@pytest.fixture(scope="module")
def light_fields(decoder: Decoder) -> list[LightField]:
    return [decoder.decode(picture) for picture in pictures(COUNT, 320, 192)]


@pytest.fixture(scope="module")
def depth(light_fields: list[LightField]) -> DepthMap:
    views = light_fields[0]
    size = (views.height_px, views.width_px)
    depth_mm = np.linspace(300.0, 500.0, views.height_px * views.width_px, dtype=np.float32).reshape(size)
    ones = np.ones(size, np.float32)
    return DepthMap(views=views, view=(1, 1), depth_mm=depth_mm, sigma_mm=ones, confidence=ones)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory, light_fields: list[LightField], depth: DepthMap) -> Path:
    return write_bag(tmp_path_factory.mktemp("bag") / "a.mcap", light_fields, depth)


@needs_rosbags
def test_mcaps_own_reader_decodes_every_message_exactly(
    bag: Path, light_fields: list[LightField], depth: DepthMap
) -> None:
    reader = pytest.importorskip("mcap.reader", reason="needs mcap, of the extra dev")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="needs mcap-ros2-support, of the extra dev")
    found: dict[str, list[Any]] = {}
    with bag.open("rb") as file:
        last = 0
        messages = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()], validate_crcs=True)
        for schema, channel, record, message in messages.iter_decoded_messages():
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            assert last <= record.log_time == record.publish_time
            last = record.log_time
            found.setdefault(channel.topic, []).append((record.log_time, message))
            latched = channel.topic in ("/tf_static", "/mirrorcam/views", "/mirrorcam/weights")
            durability = "durability: 1" if latched else "durability: 2"
            assert durability in channel.metadata["offered_qos_profiles"]
            assert "reliability: 1" in channel.metadata["offered_qos_profiles"]
    assert len(found) == 3 + 18 + 3
    for view in np.ndindex(3, 3):
        images = found[f"/mirrorcam/view_{view[0]}_{view[1]}/image_rect"]
        for number, (time_ns, image) in enumerate(images):
            assert time_ns == 10**9 + number * STEP_NS
            assert image.header.stamp.sec * 10**9 + image.header.stamp.nanosec == time_ns
            assert image.data == light_fields[number].samples[view].tobytes()
            assert image.encoding == "rgb8"
        infos = found[f"/mirrorcam/view_{view[0]}_{view[1]}/camera_info"]
        assert len(images) == len(infos) == COUNT
        for _, info in infos:
            assert np.array_equal(np.reshape(info.k, (3, 3)), light_fields[0].matrices[view])
            assert info.header.frame_id == images[0][1].header.frame_id
            assert info.distortion_model == "plumb_bob"
    ((_, tree),) = found["/tf_static"]
    assert [each.child_frame_id for each in tree.transforms][4] == found["/mirrorcam/points"][0][1].header.frame_id
    _, map_m = found["/mirrorcam/depth/image_rect"][-1]
    assert map_m.data == ros_messages.depth_m(depth).tobytes()
    assert len(found["/mirrorcam/points"][-1][1].data) == 20 * depth.depth_mm.size


@needs_rosbags
def test_rerun_shows_images_cameras_depth_points_and_frames(bag: Path, light_fields: list[LightField]) -> None:
    chunks = pytest.importorskip("rerun.chunk", reason="needs rerun-sdk, of the extra view")
    columns: dict[str, set[str]] = {}
    rows: dict[str, int] = {}
    buffers = []
    for chunk in chunks.McapReader(bag).stream():
        batch = chunk.to_record_batch()
        names = {name for name in batch.schema.names if ":" in name and not name.startswith("Mcap")}
        columns.setdefault(chunk.entity_path, set()).update(names)
        rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + (chunk.num_rows if names else 0)
        if chunk.entity_path == "/mirrorcam/view_0_2/image_rect" and "Image:buffer" in names:
            buffers += [np.array(row[0], np.uint8) for row in batch.column("Image:buffer").to_pylist()]
    assert {"Transform3D:translation", "Transform3D:quaternion"} <= columns["/tf_static"]
    assert rows["/tf_static"] == 9
    assert "Pinhole:image_from_camera" in columns["/mirrorcam/view_2_2/camera_info"]
    assert "DepthImage:buffer" in columns["/mirrorcam/depth/image_rect"]
    assert "Points3D:positions" in columns["/mirrorcam/points"]
    assert len(buffers) == COUNT
    for buffer, light_field in zip(buffers, light_fields, strict=True):
        assert np.array_equal(buffer, light_field.samples[0, 2].ravel())


@needs_rosbags
def test_nothing_remains_of_an_interrupted_bag(light_fields: list[LightField], tmp_path: Path) -> None:
    for error in (KeyboardInterrupt, InputError):
        with pytest.raises(error), BagWriter(tmp_path / "a.mcap") as bag:
            bag.write(list(ros_messages.frame_messages(light_fields[0], 0)), 0)
            assert not (tmp_path / "a.mcap").exists()
            raise error
        assert list(tmp_path.iterdir()) == []


@needs_rosbags
def test_an_unwritable_path_is_reported_in_one_line(light_fields: list[LightField], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder", encoding="utf-8")
    with pytest.raises(InputError, match=r"a\.mcap: cannot be written: "), BagWriter(tmp_path / "file" / "a.mcap"):
        pass


@needs_rosbags
def test_topics_with_a_slash_are_nowhere_else(tmp_path: Path) -> None:
    from rosbags.rosbag2 import Reader

    text = ros_messages.RosMessage("std_msgs/msg/String", {"data": "x"})
    with BagWriter(tmp_path / "a.mcap") as bag:
        bag.write([Published("/there", text), Published("here", text)], 5)
    with Reader(tmp_path / "a.mcap") as reader:
        assert [each.topic for each in reader.connections] == ["/there", "/mirrorcam/here"]


def test_without_rosbags_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r'^rosbags not installed, .*: pip install "mirrorcam\[robot\]"$'):
        BagWriter(tmp_path / "a.mcap")
