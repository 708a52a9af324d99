"""ROS 2 bags of a camera's pictures, written by rosbags."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Message = tuple[str, str, dict[str, Any]]
"""Topic, type, and fields except the header."""
START_NS, STEP_NS = 1_700_000_000 * 10**9, 40_000_000


def write_bag(folder: Path, messages: Sequence[Message], storage: str = "MCAP", stamps: Sequence[int] = ()) -> Path:
    """Write a rosbag2 folder of messages 40 ms apart, or with other stamps in their headers."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store: Any = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    with Writer(folder, version=8, storage_plugin=StoragePlugin[storage]) as writer:
        topics: dict[str, Any] = {}
        for number, (topic, kind, fields) in enumerate(messages):
            time_ns = START_NS + number * STEP_NS
            stamp = stamps[number] if stamps else time_ns
            header = types["std_msgs/msg/Header"](
                stamp=types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id="cam"
            )
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=store)
            message = types[kind](header=header, **fields)
            writer.write(topics[topic], time_ns, store.serialize_cdr(message, kind))
    return folder


def image(pixels: NDArray[Any], encoding: str, padding: int = 0, *, big: bool = False) -> dict[str, Any]:
    """Fields of an Image of samples (h, w) or (h, w, c), with padded rows."""
    height, width = pixels.shape[:2]
    rows = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder(">" if big else "<")).reshape(height, -1)
    data = np.pad(rows.view(np.uint8), ((0, 0), (0, padding)))
    fields = {"height": height, "width": width, "encoding": encoding, "is_bigendian": int(big)}
    return {**fields, "step": data.shape[1], "data": data.ravel()}


def raw(pixels: NDArray[Any], encoding: str, topic: str = "/camera/image_raw") -> Message:
    return topic, "sensor_msgs/msg/Image", image(pixels, encoding)


def compressed(data: bytes, form: str, topic: str = "/camera/image_raw/compressed") -> Message:
    return topic, "sensor_msgs/msg/CompressedImage", {"format": form, "data": np.frombuffer(data, np.uint8)}
