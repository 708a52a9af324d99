"""Pictures decoded from the packets of a video, in presentation order: each complete, or lost with a reason."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import starmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.images.jpeg import EXTRANEOUS, JPEG_BEGIN, JPEG_END, DamagedPicture, Jpeg, decode_jpeg
from mirrorcam.core.images.sample_bits import to_8_bits
from mirrorcam.core.video.video_packets import Packet

DAMAGED, DEPENDS = "is damaged", "depends on a damaged one"
SAMPLED = 8
"""Number of packets at the start of a video that show how its camera writes JPEG."""

_INTRA = 1
"""FFmpeg's type of a picture that depends on no other (AV_PICTURE_TYPE_I)."""
_MAX_AHEAD = 64
"""Packets after which a missing frame is given up: more than a decoder reorders or decodes at once."""
# Comment of a JPEG with samples in limited (television) range, which libjpeg ignores.
_LIMITED_RANGE = b"CS=ITU601"


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture at a timestamp: a function that returns its pixels (h, w, 3), or the reason why it is lost.

    `pixels` raises `DamagedPicture` for damaged data. `broken` states that packets next to it may be missing, `skipped`
    the number known to be missing before it.
    """

    timestamp: int
    pixels: Callable[[], NDArray[Any]] | None
    reason: str = ""
    broken: bool = False
    skipped: int = 0


def are_plain_jpegs(packets: Sequence[Packet], height_px: int) -> bool:
    """Return whether JPEG packets are like picture files: complete frames, not fields, in full range.

    Damaged packets count as plain, unless libjpeg warns of bytes before a marker in all of them, as some cameras write.
    """
    extraneous = 0
    for packet in packets:
        raw = bytes(packet.data)
        try:
            jpeg = _jpeg_of(raw)
            if jpeg.size(raw)[1] * 2 == height_px or _LIMITED_RANGE in raw[: jpeg.scan(raw)]:
                return False
            decode_jpeg(_ended(raw, jpeg), jpeg, "frame")
            return True
        except DamagedPicture as error:
            extraneous += EXTRANEOUS in str(error)
    return extraneous < len(packets)


def have_ends(packets: Sequence[Packet]) -> bool:
    """Return whether any of these JPEG packets has an end marker."""
    return any(Jpeg.of(bytes(packet.data)).end is not None for packet in packets)


def jpeg_pictures(packets: Iterable[Packet], size: tuple[int, int], with_ends: bool = True) -> Iterator[Picture]:
    """Yield the pictures of JPEG packets, decoded like picture files; some cameras write no end markers."""
    for packet in packets:
        yield _jpeg_picture(packet, size, with_ends)


def _jpeg_picture(packet: Packet, size: tuple[int, int], with_ends: bool) -> Picture:
    raw = bytes(packet.data)
    try:
        jpeg = _jpeg_of(raw)
        if with_ends and jpeg.end is None:
            raise DamagedPicture("frame: image is truncated")
    except DamagedPicture:
        return Picture(packet.timestamp, None, DAMAGED, packet.gap, packet.skipped)
    if jpeg.size(raw) != size:
        return Picture(packet.timestamp, None, wrong_size_message(jpeg.size(raw), size), packet.gap, packet.skipped)

    def pixels() -> NDArray[np.uint8]:
        return decode_jpeg(_ended(raw, jpeg), jpeg, "frame")

    return Picture(packet.timestamp, pixels, "", packet.gap, packet.skipped)


def _jpeg_of(raw: bytes) -> Jpeg:
    jpeg = Jpeg.of(raw)
    if not raw.startswith(JPEG_BEGIN) or not all(jpeg.size(raw)):
        raise DamagedPicture("frame: not a JPEG")
    return jpeg


def _ended(raw: bytes, jpeg: Jpeg) -> bytes:
    """Return JPEG data with an end marker."""
    return raw if jpeg.end is not None else raw + JPEG_END


def wrong_size_message(size: tuple[int, int], expected: tuple[int, int]) -> str:
    """Return the reason why a picture whose size differs from the video's is lost."""
    return f"is {size[0]}x{size[1]} px, others {expected[0]}x{expected[1]}"


@dataclass(frozen=True, eq=False)
class _Ordered:
    """A packet in presentation order: its frame or None, timestamp, and number of the key frame that it depends on."""

    packet: Packet
    frame: Any
    timestamp: int
    key: int


def _is_key(frame: Any) -> bool:
    return frame is not None and bool(frame.key_frame) and frame.pict_type == _INTRA


class _Order:
    """Decides which frames are complete: none between a damaged one and the next key frame, in packet order.

    A frame is decided once all packets from its key frame up to its own are decoded or lost.
    """

    def __init__(self, intra_only: bool) -> None:
        self._intra_only = intra_only
        self._pending: dict[int, Packet] = {}
        self._timestamps: list[int] = []
        self._presented: deque[_Ordered] = deque()
        self._key = 0
        self._damaged: set[float] = set()

    def add_packet(self, packet: Packet) -> None:
        self._pending[packet.number] = packet
        if not packet.has_pts:
            heapq.heappush(self._timestamps, packet.timestamp)
        if packet.gap:
            # A missing packet before this one, which depends on it unless it is a key frame.
            self._damaged.add(packet.number - 0.5)
        if packet.suspect:
            self._damaged.add(packet.number)

    def add_frame(self, number: int, frame: Any, reorders: bool) -> None:
        """Add a decoded frame, and count frames that it has overtaken as lost."""
        packet = self._pending.pop(number, None)
        if packet is None:
            return  # its timestamp is wrong: it was counted as lost before
        if frame.is_corrupt:
            self._damaged.add(number)
        key = _is_key(frame)
        for pending in sorted(self._pending.values(), key=lambda pending: pending.timestamp):
            is_earlier = pending.number < number and (key or not reorders)
            overtaken = pending.timestamp < packet.timestamp if packet.has_pts else is_earlier
            if overtaken or pending.number < number - _MAX_AHEAD:
                self._miss(pending)
        if key and number not in self._damaged:
            self._key = number
        self._show(packet, frame)

    def end(self) -> None:
        """Count all frames still expected as lost."""
        for pending in sorted(self._pending.values(), key=lambda pending: pending.timestamp):
            self._miss(pending)

    def _miss(self, packet: Packet) -> None:
        del self._pending[packet.number]
        self._damaged.add(packet.number)
        self._show(packet, None)

    def _show(self, packet: Packet, frame: Any) -> None:
        timestamp = packet.timestamp if packet.has_pts else heapq.heappop(self._timestamps)
        self._presented.append(_Ordered(packet, frame, timestamp, self._key))

    def decided(self) -> Iterator[tuple[_Ordered, str]]:
        """Yield the frames that can be decided, in presentation order, each with the reason for its loss, if any."""
        while self._presented:
            ordered = self._presented[0]
            number = ordered.packet.number
            if not self._intra_only and any(ordered.key <= sent < number for sent in self._pending):
                return
            self._presented.popleft()
            intra_only = self._intra_only or _is_key(ordered.frame)
            depends = not intra_only and any(ordered.key <= damaged < number for damaged in self._damaged)
            yield ordered, DEPENDS if depends else DAMAGED if number in self._damaged else ""
        self._damaged = {damaged for damaged in self._damaged if damaged >= self._key}


def has_16_bits(source: Any) -> bool:
    """Return whether a frame, or a decoder's output, is 16-bit grey or RGB, of which a camera may use only some bits.

    Formats of 10, 12 or 14 bits state their depth.
    """
    return source.format is not None and source.format.name.startswith(
        ("gray16", "ya16", "rgb48", "rgba64", "bgr48", "bgra64", "gbrp16", "gbrap16")
    )


def samples_of_16_bits(frame: Any) -> NDArray[Any]:
    """Return the 16-bit samples of a frame: (h, w), or (h, w, 3) in RGB."""
    target = "gray16le" if frame.format.name.startswith(("gray", "ya")) else "rgb48le"
    return np.asarray(frame.reformat(format=target, threads=1).to_ndarray())


def rgb_of(frame: Any) -> NDArray[np.uint8]:
    """Convert a frame to 8-bit RGB (h, w, 3)."""
    return np.asarray(frame.reformat(format="rgb24", threads=1).to_ndarray(), dtype=np.uint8)


def rgb_of_samples(samples: NDArray[Any], bits: int) -> NDArray[np.uint8]:
    """Convert 16-bit samples, of which the lowest `bits` are used, to 8-bit RGB (h, w, 3)."""
    image = to_8_bits(samples, bits)
    return np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image


def decoded_pictures(
    decoder: Any,
    packets: Iterable[Packet],
    size: tuple[int, int],
    convert: Callable[[Any], NDArray[Any]] = rgb_of,
) -> Iterator[Picture]:
    """Yield the pictures of packets by FFmpeg's decoder, in presentation order; `convert` returns their pixels."""
    from av.codec.context import Flags

    decoder.thread_type = "AUTO"
    decoder.flags |= Flags.copy_opaque
    # Otherwise, FFmpeg conceals errors in the data, and the frame seems complete.
    decoder.options = {"err_detect": "crccheck+explode"}
    order = _Order(bool(decoder.codec.intra_only))

    def picture(ordered: _Ordered, reason: str, at_end: bool = False) -> Picture:
        def pixels() -> NDArray[Any]:
            return convert(ordered.frame)

        # At the end of the file, frames that are decoded after the last one in presentation order may be cut off.
        packet = ordered.packet
        broken, skipped = packet.gap or (at_end and bool(decoder.has_b_frames)), packet.skipped
        if not reason and (ordered.frame.width, ordered.frame.height) != size:
            reason = wrong_size_message((ordered.frame.width, ordered.frame.height), size)
        return Picture(ordered.timestamp, None if reason else pixels, reason, broken, skipped)

    failed = False
    for packet in packets:
        if failed and packet.data.is_keyframe:
            # After damaged data, decoding threads may fail on undamaged packets, too, until all restart.
            _decode(decoder, None, order)
            order.end()
            decoder.flush_buffers()
            failed = False
        order.add_packet(packet)
        packet.data.opaque = packet.number
        failed |= not _decode(decoder, packet.data, order)
        yield from starmap(picture, order.decided())
    _decode(decoder, None, order)
    order.end()
    for ordered, reason in order.decided():
        yield picture(ordered, reason, at_end=True)


def _decode(decoder: Any, data: Any, order: _Order) -> bool:
    """Decode a packet, or flush the decoder (None); return whether that succeeded."""
    import av

    try:
        frames = decoder.decode(data)
    except av.FFmpegError:
        # `_Order` notices that its frame is missing.
        return False
    for frame in frames:
        order.add_frame(frame.opaque, frame, bool(decoder.has_b_frames))
    return True
