"""Light fields in ROS 2 bags: written by `BagWriter`, or recorded again from its topics; read frame by frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.array_files import check_bytes
from mirrorcam.core.disk.bags import Bag, is_bag, stamp_of, topics_text
from mirrorcam.core.disk.files import json_of, model_from
from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.io.bag_writer import BagWriter
from mirrorcam.optics.light_field.io.light_field_format import Contents, Format, StoredFrames, depthless_writer
from mirrorcam.optics.light_field.io.ros_messages import (
    VIEWS_TOPIC,
    WEIGHTS_TOPIC,
    encoding_of,
    frame_messages,
    latched_messages,
    view_topic,
)
from mirrorcam.optics.light_field.io.views_file import SCHEMA, ViewsFile, light_field_of_fields, views_of_fields
from mirrorcam.optics.light_field.light_field import LightField

TEXT, ARRAY, IMAGE = "std_msgs/msg/String", "std_msgs/msg/Float32MultiArray", "sensor_msgs/msg/Image"
View = tuple[int, int]


class StoredBag(StoredFrames):
    """The light fields of a bag (an MCAP file or a rosbag2 folder), each read on access.

    A frame consists of the images of all views with one stamp. Frames that lack a view are left out; the first and last
    ones of a bag recorded over a network may be incomplete.

    Parameters
    ----------
    path
        The bag.

    Attributes
    ----------
    stamps_ns
        Stamps of the frames, ns, ascending.
    incomplete
        Number of incomplete frames, which are left out.

    Raises
    ------
    InputError
        In one line, if the bag cannot be read, or contains no light field or those of several cameras.
    """

    def __init__(self, path: Path) -> None:
        self.path, self._bag = path, Bag(path)
        with self._bag.reading():
            description, namespace = self._geometry()
            views = views_of_fields(description.views, str(path))
            shape = (views.rows, views.cols, views.height_px, views.width_px)
            self._dtype, self._channels = np.dtype(description.dtype or "uint8"), description.channels
            frame_bytes = self._dtype.itemsize * self._channels + np.dtype(np.float32).itemsize
            check_bytes(path, frame_bytes * int(np.prod([float(length) for length in shape])), self._bag.file_bytes)
            self._topics = {f"{namespace}{view_topic(view)}/image_rect": view for view in np.ndindex(shape[:2])}
            weights = self._weights(f"{namespace}{WEIGHTS_TOPIC}", shape)
            empty = np.zeros((*shape, self._channels), self._dtype)
            self._empty = light_field_of_fields({**description.views, "samples": empty, "weights": weights}, str(path))
            self._frame_times = self._frames()
        self.stamps_ns = tuple(self._frame_times)

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def _frame(self, index: int) -> LightField:
        stamp = self.stamps_ns[index]
        samples = np.empty_like(self._empty.samples)
        with self._bag.reading():
            first, last = self._frame_times[stamp]
            for _, view, raw in self._images(first, last + 1):
                if stamp_of(raw) == stamp:
                    samples[view] = self._pixels(raw, samples.shape[2:])
        return LightField.of(self._empty, samples, self._empty.weights)

    def _geometry(self) -> tuple[ViewsFile, str]:
        """Return the bag's description of its light field, and the namespace of its topics."""
        descriptions: dict[str, ViewsFile] = {}
        connections = [
            connection
            for connection in self._bag.connections
            if connection.topic.endswith(f"/{VIEWS_TOPIC}") and connection.msgtype == TEXT
        ]
        for connection, _, raw in self._bag.messages(connections):
            message: Any = self._bag.message(raw, TEXT)
            if SCHEMA in message.data:
                where = f"{self.path}: {connection.topic}"
                description = model_from(ViewsFile, where, json_of(where, message.data.encode()))
                descriptions[connection.topic.removesuffix(VIEWS_TOPIC)] = description
        if not descriptions:
            topics = topics_text({connection.topic for connection in self._bag.connections})
            raise InputError(f"{self.path}: contains no light field: topics are {topics}, expected .../{VIEWS_TOPIC}")
        if len(descriptions) > 1:
            cameras = topics_text(descriptions)
            raise InputError(
                f"{self.path}: contains the light fields of {len(descriptions)} cameras ({cameras}), expected one"
            )
        ((namespace, description),) = descriptions.items()
        return description, namespace

    def _weights(self, topic: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """Read the weights (t, s, v, u), which are the same for all frames."""
        wanted = [conn for conn in self._bag.connections if conn.topic == topic and conn.msgtype == ARRAY]
        for _, _, raw in self._bag.messages(wanted):
            message: Any = self._bag.message(raw, ARRAY)
            return np.asarray(message.data, np.float32).reshape(shape)
        raise InputError(f"{self.path}: has no message on {topic}, expected the weights of the views")

    def _images(self, start: int | None = None, stop: int | None = None) -> Iterator[tuple[int, View, bytes]]:
        """Yield bag time in ns, view and data of the views' images, between two times."""
        wanted = [conn for conn in self._bag.connections if conn.topic in self._topics and conn.msgtype == IMAGE]
        for connection, time_ns, raw in self._bag.messages(wanted, start, stop):
            yield time_ns, self._topics[connection.topic], raw

    def _frames(self) -> Mapping[int, tuple[int, int]]:
        """Return the stamps of all frames, ascending, with the first and last bag time of their images."""
        descriptions: dict[int, dict[View, int]] = {}
        for time_ns, view, raw in self._images():
            descriptions.setdefault(stamp_of(raw), {})[view] = time_ns
        complete = {
            stamp: views.values() for stamp, views in sorted(descriptions.items()) if len(views) == len(self._topics)
        }
        self.incomplete = len(descriptions) - len(complete)
        if not complete:
            available = {view for views in descriptions.values() for view in views}
            missing = next((topic for topic, view in self._topics.items() if view not in available), None)
            reason = "no stamp that all views have" if missing is None else f"no image on {missing}"
            raise InputError(f"{self.path}: has {reason}, expected an image of each view at every stamp")
        return {stamp: (min(times), max(times)) for stamp, times in complete.items()}

    def _pixels(self, raw: bytes, shape: tuple[int, ...]) -> NDArray[Any]:
        """Decode the pixels (v, u, c) of an image message; raises ValueError for a different size or encoding."""
        message: Any = self._bag.message(raw, IMAGE)
        height, width, channels = shape
        encoding = encoding_of(self._dtype, channels)
        actual = (message.width, message.height, message.encoding, bool(message.is_bigendian))
        if actual != (width, height, encoding, False):
            raise ValueError(
                f"an image is {actual[0]}x{actual[1]} {actual[2][:20]!r}, expected {width}x{height} {encoding!r}"
            )
        row_bytes = width * channels * self._dtype.itemsize
        if message.step < row_bytes or len(message.data) != message.step * height:
            raise ValueError(
                f"an image has {len(message.data)} bytes in rows of {message.step}, expected {height} rows"
            )
        rows = np.ascontiguousarray(message.data.reshape(height, message.step)[:, :row_bytes])
        return rows.view(self._dtype.newbyteorder("<")).reshape(shape)


def write_bag(path: Path, light_field: LightField) -> None:
    """Write one light field as a bag with one frame at time 0."""
    with BagWriter(path) as bag:
        bag.write([*latched_messages(light_field, 0), *frame_messages(light_field, 0)], 0)


def _contents(bag: StoredBag) -> Contents:
    return Contents(bag, is_recording=True, times_s=[stamp / 1e9 for stamp in bag.stamps_ns])


FORMAT = Format(
    name="mcap",
    ending=".mcap",
    detect=is_bag,
    read=lambda path, assumed: _contents(StoredBag(path)),
    write=depthless_writer(write_bag),
)
