"""Pictures of a camera in a ROS 2 bag: `sensor_msgs/Image` and `sensor_msgs/CompressedImage`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property, partial
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.arguments import AnyPath, path_of
from mirrorcam.core.bounds import LARGEST_PICTURE_PX
from mirrorcam.core.disk.bags import Bag, is_bag, stamp_of, topics_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.jpeg import DamagedPicture
from mirrorcam.core.images.picture_data import PictureData
from mirrorcam.core.images.sample_bits import ALL, SampleBits
from mirrorcam.core.video.frames import Frame, Lost
from mirrorcam.core.video.video import WRONG_TIME
from mirrorcam.core.video.video_pictures import DAMAGED, rgb_of_samples, wrong_size_message

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_NS_PER_S = 10**9
_MAX_DAMAGED = 30
"""Number of pictures at the start of a bag of which one must be undamaged."""


class _Encoding(NamedTuple):
    """An encoding of `sensor_msgs/image_encodings.hpp`: its samples, and OpenCV's conversion to RGB, if one is needed.

    Grey pictures of 16 bits stay grey.
    """

    dtype: str
    channels: int
    to_rgb: int | None = None


_ENCODINGS = {
    "rgb8": _Encoding("u1", 3),
    "rgba8": _Encoding("u1", 4, cv2.COLOR_RGBA2RGB),
    "bgr8": _Encoding("u1", 3, cv2.COLOR_BGR2RGB),
    "bgra8": _Encoding("u1", 4, cv2.COLOR_BGRA2RGB),
    "mono8": _Encoding("u1", 1, cv2.COLOR_GRAY2RGB),
    "rgb16": _Encoding("u2", 3),
    "rgba16": _Encoding("u2", 4, cv2.COLOR_RGBA2RGB),
    "bgr16": _Encoding("u2", 3, cv2.COLOR_BGR2RGB),
    "bgra16": _Encoding("u2", 4, cv2.COLOR_BGRA2RGB),
    "mono16": _Encoding("u2", 1),
    "uyvy": _Encoding("u1", 2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422": _Encoding("u1", 2, cv2.COLOR_YUV2RGB_UYVY),
    "yuyv": _Encoding("u1", 2, cv2.COLOR_YUV2RGB_YUYV),
    "yuv422_yuy2": _Encoding("u1", 2, cv2.COLOR_YUV2RGB_YUYV),
    **{
        f"bayer_{order}{8 * size}": _Encoding(f"u{size}", 1, conversion)
        for size in (1, 2)
        for order, conversion in (
            ("rggb", cv2.COLOR_BayerRGGB2RGB_EA),
            ("bggr", cv2.COLOR_BayerBGGR2RGB_EA),
            ("gbrg", cv2.COLOR_BayerGBRG2RGB_EA),
            ("grbg", cv2.COLOR_BayerGRBG2RGB_EA),
        )
    },
}


def bag_and_topic(path: Path) -> tuple[Path, str | None] | None:
    """Split BAG or BAG:/TOPIC; None if the path names no bag."""
    if is_bag(path):
        return path, None
    name, colon, topic = str(path).rpartition(":/")
    return (Path(name), f"/{topic}") if colon and is_bag(Path(name)) and not path.exists() else None


class CameraBag:
    """The pictures of one camera in a bag, in the order of the bag; times are those of the messages' headers.

    Parameters
    ----------
    path
        The bag, or BAG:/TOPIC if pictures of several topics are in it.

    Attributes
    ----------
    path
        The bag.
    width_px, height_px
        Size of the first picture that can be decoded.
    rate_hz
        Mean rate of the pictures.
    count
        Number of pictures.
    started_ns
        Time of the first picture, ns since 1970.

    Raises
    ------
    InputError
        If the bag cannot be read, has no topic with pictures or several, or none of them can be decoded.
    """

    def __init__(self, path: AnyPath) -> None:
        path = path_of("path", path)
        split = bag_and_topic(path)
        if split is None:
            raise InputError(f"{path}: not a ROS 2 bag, expected an MCAP file or a folder with metadata.yaml")
        self.path, topic = split
        self._bag = Bag(self.path)
        self._connections = self._of_topic(topic)
        self._name = f"{self.path}:{self._connections[0].topic}"
        self.count: int = sum(connection.msgcount for connection in self._connections)
        self.width_px, self.height_px, self.started_ns = self._first()
        duration_s = self._bag.duration_ns / _NS_PER_S
        self.rate_hz = (self.count - 1) / duration_s if duration_s else 0.0

    def frames(self, after: int = -1) -> Iterator[Frame | Lost]:
        """Yield the frames after number `after`; a damaged picture, or one of another size or encoding, is lost."""
        last_ns = -1
        for number, time_ns, picture in self._pictures():
            is_later, last_ns = time_ns > last_ns, max(time_ns, last_ns)
            if number <= after:
                continue
            if not is_later:
                yield Lost(number, WRONG_TIME)
                continue
            try:
                pixels = self._rgb(picture())
            except DamagedPicture:
                yield Lost(number, DAMAGED)
                continue
            size = pixels.shape[1], pixels.shape[0]
            if size != (self.width_px, self.height_px):
                yield Lost(number, wrong_size_message(size, (self.width_px, self.height_px)))
                continue
            yield Frame(number, (time_ns - self.started_ns) / _NS_PER_S, pixels)

    def stop(self) -> None:
        """Do nothing: reading a bag never waits."""

    @cached_property
    def sample_bits(self) -> SampleBits:
        """Used bits of all 16-bit pictures, which are decoded for this; empty for a bag of other samples."""
        bits = SampleBits()
        for _, _, picture in self._pictures():
            try:
                samples = picture()
            except DamagedPicture:
                continue
            if samples.dtype == np.uint8:
                break
            bits = SampleBits.combined((bits, SampleBits.of(samples)))
            if bits.used == ALL:
                break
        return bits

    def _of_topic(self, topic: str | None) -> list[Any]:
        """Return the connections of the requested or only topic with pictures."""
        connections = [each for each in self._bag.connections if each.msgtype in (IMAGE, COMPRESSED) and each.msgcount]
        topics = {each.topic for each in connections if not each.topic.endswith("/compressedDepth")}
        if topic is None and len(topics) == 1:
            (topic,) = topics
        if topic not in topics:
            known = topics_text(topics or {each.topic for each in self._bag.connections})
            if not topics:
                raise InputError(f"{self.path}: topics are {known}, expected one with pictures ({IMAGE})")
            problem = "pictures of several topics" if topic is None else f"no pictures of {topic[:60]}"
            raise InputError(
                f"{self.path}: holds {problem}, expected one of {known}, such as {self.path.name}:{min(topics)}"
            )
        return [each for each in connections if each.topic == topic]

    def _first(self) -> tuple[int, int, int]:
        """Return width and height of the first picture that can be decoded, and the time of the first picture."""
        started_ns, damage = None, ""
        for _, time_ns, picture in islice(self._pictures(), _MAX_DAMAGED):
            started_ns = time_ns if started_ns is None else started_ns
            try:
                height, width = picture().shape[:2]
            except DamagedPicture as error:
                damage = str(error)
                continue
            return width, height, started_ns
        raise InputError(f"{damage}; none of the first {min(self.count, _MAX_DAMAGED)} pictures can be decoded")

    def _pictures(self) -> Iterator[tuple[int, int, Callable[[], NDArray[Any]]]]:
        """Yield number, time in ns, and a function that decodes the samples, of each message.

        The time is that of the bag if the header states none. The function raises DamagedPicture.
        """
        with self._bag.reading():
            for number, (connection, time_ns, raw) in enumerate(self._bag.messages(self._connections)):
                yield number, stamp_of(raw) or time_ns, partial(self._samples, connection.msgtype, raw)

    def _samples(self, kind: str, raw: bytes) -> NDArray[Any]:
        """Decode the samples of a message: (h, w, 3) RGB of 8 or 16 bits, or (h, w) grey."""
        try:
            with self._bag.reading():
                message = self._bag.message(raw, kind)
                if kind == COMPRESSED:
                    return self._decompressed(message)
                return self._uncompressed(message)
        except DamagedPicture:
            raise
        except InputError as error:
            raise DamagedPicture(str(error)) from None

    def _uncompressed(self, message: Any) -> NDArray[Any]:
        encoding = _ENCODINGS.get(message.encoding)
        if encoding is None:
            known = ", ".join(_ENCODINGS)
            raise InputError(f"{self._name}: encoding is {message.encoding[:20]!r}, expected one of {known}")
        row_bytes = message.width * encoding.channels * np.dtype(encoding.dtype).itemsize
        if not 0 < message.width * message.height <= LARGEST_PICTURE_PX or message.step < row_bytes:
            size = f"{message.width}x{message.height} px in rows of {message.step} bytes"
            raise InputError(f"{self._name}: a picture has {size}, expected at least {row_bytes} bytes")
        if len(message.data) != message.step * message.height:
            expected = f"expected {message.height} rows of {message.step}"
            raise InputError(f"{self._name}: a picture has {len(message.data)} bytes, {expected}")
        rows = np.ascontiguousarray(message.data.reshape(message.height, message.step)[:, :row_bytes])
        dtype = np.dtype(encoding.dtype).newbyteorder(">" if message.is_bigendian else "<")
        samples = rows.view(dtype).astype(encoding.dtype, copy=False)
        shape = (message.height, message.width, encoding.channels)
        samples = samples.reshape(shape[:2] if encoding.channels == 1 else shape)
        return samples if encoding.to_rgb is None else np.asarray(cv2.cvtColor(samples, encoding.to_rgb))

    def _decompressed(self, message: Any) -> NDArray[Any]:
        """Decode a compressed picture; a grey one of a colour filter array, which its format states, becomes RGB."""
        picture = PictureData.of(Path(self._name), message.data.tobytes())
        encoding, _, compressed = message.format.partition(";")
        mosaic = _ENCODINGS.get(encoding) if encoding.startswith("bayer_") else None
        if mosaic is None or mosaic.to_rgb is None or "rgb" in compressed or "bgr" in compressed:
            return picture.decoded()
        return np.asarray(cv2.cvtColor(picture.decoded(grey=True), mosaic.to_rgb))

    def _rgb(self, samples: NDArray[Any]) -> NDArray[np.uint8]:
        if samples.dtype != np.uint8:
            return rgb_of_samples(samples, self.sample_bits.used)
        return np.repeat(samples[..., None], 3, axis=2) if samples.ndim == 2 else samples
