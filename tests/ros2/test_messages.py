"""Messages for ROS are, byte for byte, those of a bag; the mapping does without ROS."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.io.ros_messages import frame_messages, latched_messages
from tests.optics.light_field.io.bags import write_bag
from tests.optics.light_field.io.formats.test_registry import noise
from tests.ros2.stand_in import message_class, typestore


def test_every_message_is_that_of_a_bag(tmp_path: Path) -> None:
    from mirrorcam_ros.messages import ros_message
    from rosbags.rosbag2 import Reader

    light_field = noise(3, 3)
    t, s = np.argwhere((light_field.positions_mm == 0).all(axis=2))[0]
    ones = np.ones((light_field.height_px, light_field.width_px), np.float32)
    depth = DepthMap(views=light_field, view=(int(t), int(s)), depth_mm=500 * ones, sigma_mm=ones, confidence=ones)
    expected: dict[str, bytes] = {}
    with Reader(write_bag(tmp_path / "a.mcap", [light_field], depth)) as reader:
        expected = {each.topic: bytes(raw) for each, _, raw in reader.messages()}
    found: dict[str, bytes] = {}
    for each in (*latched_messages(light_field, 10**9), *frame_messages(light_field, 10**9, depth)):
        message: Any = ros_message(each.message, message_class)
        topic = each.topic if each.topic.startswith("/") else f"/mirrorcam/{each.topic}"
        found[topic] = bytes(typestore().serialize_cdr(message.plain(), each.message.type))
    assert found == expected


def test_the_mapping_does_without_ros(workspace: Path) -> None:
    code = f"import sys; sys.path.insert(0, {str(workspace)!r}); import mirrorcam_ros.messages"
    code += "; import mirrorcam_ros.light_field_stream; print('rclpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
