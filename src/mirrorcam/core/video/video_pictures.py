"""Pictures of the packets of a video, in order of time: each complete, or lost with a reason."""

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
"""Number of packets at the start of a video that tell how its camera writes JPEG."""

_INTRA = 1
"""FFmpeg's type of a picture that depends on no other (AV_PICTURE_TYPE_I)."""
_MOST_AHEAD = 64
"""Packets after which one that gave no frame will give none: more than a decoder reorders or decodes at once."""
# States that samples are in the limited range of television, which libjpeg does not know of.
_LIMITED_RANGE = b"CS=ITU601"


@dataclass(frozen=True, eq=False)
class Picture:
    """What is shown at a moment: a function that makes the pixels (h, w, 3), or the reason why there is no picture.

    `pixels` raises `DamagedPicture` for damaged data. A picture is `broken` where packets of the file may
    be missing, and `skipped` as many are known to be missing before it.
    """

    moment: int
    pixels: Callable[[], NDArray[Any]] | None
    reason: str = ""
    broken: bool = False
    skipped: int = 0


def are_plain_jpegs(packets: Sequence[Packet], height_px: int) -> bool:
    """Return whether JPEG packets are like picture files: complete frames, in full range.

    Damaged ones are, too. Where libjpeg warns of bytes between data and marker in all of them, the camera writes so.
    """
    strange = 0
    for packet in packets:
        raw = bytes(packet.data)
        try:
            jpeg = _jpeg_of(raw)
            if jpeg.size(raw)[1] * 2 == height_px or _LIMITED_RANGE in raw[: jpeg.scan(raw)]:
                return False
            decode_jpeg(_ended(raw, jpeg), jpeg, "frame")
            return True
        except DamagedPicture as error:
            strange += EXTRANEOUS in str(error)
    return strange < len(packets)


def have_ends(packets: Sequence[Packet]) -> bool:
    """Return whether any of some JPEG packets has an end marker."""
    return any(Jpeg.of(bytes(packet.data)).end is not None for packet in packets)


def jpeg_pictures(packets: Iterable[Packet], size: tuple[int, int], with_ends: bool = True) -> Iterator[Picture]:
    """The pictures of JPEG packets, each decoded as a picture's file is; some cameras write no end markers."""
    for packet in packets:
        yield _jpeg_picture(packet, size, with_ends)


def _jpeg_picture(packet: Packet, size: tuple[int, int], with_ends: bool) -> Picture:
    raw = bytes(packet.data)
    try:
        jpeg = _jpeg_of(raw)
        if with_ends and jpeg.end is None:
            raise DamagedPicture("frame: image is truncated")
    except DamagedPicture:
        return Picture(packet.moment, None, DAMAGED, packet.gap, packet.skipped)
    if jpeg.size(raw) != size:
        return Picture(packet.moment, None, other_size(jpeg.size(raw), size), packet.gap, packet.skipped)

    def pixels() -> NDArray[np.uint8]:
        return decode_jpeg(_ended(raw, jpeg), jpeg, "frame")

    return Picture(packet.moment, pixels, "", packet.gap, packet.skipped)


def _jpeg_of(raw: bytes) -> Jpeg:
    jpeg = Jpeg.of(raw)
    if not raw.startswith(JPEG_BEGIN) or not all(jpeg.size(raw)):
        raise DamagedPicture("frame: no JPEG")
    return jpeg


def _ended(raw: bytes, jpeg: Jpeg) -> bytes:
    """JPEG data with their end marker."""
    return raw if jpeg.end is not None else raw + JPEG_END


def other_size(size: tuple[int, int], expected: tuple[int, int]) -> str:
    """Why a picture of another size than the video's is lost."""
    return f"is {size[0]}x{size[1]} px, others {expected[0]}x{expected[1]}"


@dataclass(frozen=True, eq=False)
class _Shown:
    """A packet at its turn: the frame that it gave or None, when it is shown, and the key frame that it depends on."""

    packet: Packet
    frame: Any
    moment: int
    key: int


def _is_key(frame: Any) -> bool:
    return frame is not None and bool(frame.key_frame) and frame.pict_type == _INTRA


class _Order:
    """Decides which frames are complete: none between a damaged one and the next key frame, in packet order.

    A frame is judged once all packets from its key frame up to its own are decoded or lost.
    """

    def __init__(self, alone: bool) -> None:
        self._alone = alone
        self._sent: dict[int, Packet] = {}
        self._moments: list[int] = []
        self._shown: deque[_Shown] = deque()
        self._key = 0
        self._damaged: set[float] = set()

    def send(self, packet: Packet) -> None:
        self._sent[packet.number] = packet
        if not packet.stated:
            heapq.heappush(self._moments, packet.moment)
        if packet.gap:
            # Between the last packet and this one, which depends on it unless it is a key frame.
            self._damaged.add(packet.number - 0.5)
        if packet.suspect:
            self._damaged.add(packet.number)

    def give(self, number: int, frame: Any, reorders: bool) -> None:
        """Take a frame in, and note those that it has overtaken: they will not come."""
        packet = self._sent.pop(number, None)
        if packet is None:
            return  # counted as missing before, by a wrong time
        if frame.is_corrupt:
            self._damaged.add(number)
        key = _is_key(frame)
        for each in sorted(self._sent.values(), key=lambda each: each.moment):
            by_number = each.number < number and (key or not reorders)
            overtaken = each.moment < packet.moment if packet.stated else by_number
            if overtaken or each.number < number - _MOST_AHEAD:
                self._miss(each)
        if key and number not in self._damaged:
            self._key = number
        self._show(packet, frame)

    def end(self) -> None:
        """Note that no more frames of the packets so far will come."""
        for each in sorted(self._sent.values(), key=lambda each: each.moment):
            self._miss(each)

    def _miss(self, packet: Packet) -> None:
        del self._sent[packet.number]
        self._damaged.add(packet.number)
        self._show(packet, None)

    def _show(self, packet: Packet, frame: Any) -> None:
        moment = packet.moment if packet.stated else heapq.heappop(self._moments)
        self._shown.append(_Shown(packet, frame, moment, self._key))

    def judged(self) -> Iterator[tuple[_Shown, str]]:
        """The frames that can be judged, in the order of time, each with the reason why it is lost, or none."""
        while self._shown:
            shown = self._shown[0]
            number = shown.packet.number
            if not self._alone and any(shown.key <= each < number for each in self._sent):
                return
            self._shown.popleft()
            alone = self._alone or _is_key(shown.frame)
            depends = not alone and any(shown.key <= each < number for each in self._damaged)
            yield shown, DEPENDS if depends else DAMAGED if number in self._damaged else ""
        self._damaged = {each for each in self._damaged if each >= self._key}


def has_16_bits(shown: Any) -> bool:
    """Return whether a frame, or a decoder's output, is grey or RGB of 16 bits, of which cameras may use the lowest.

    Samples of 10, 12 or 14 bits are stored as such, and need no guess.
    """
    return shown.format is not None and shown.format.name.startswith(
        ("gray16", "ya16", "rgb48", "rgba64", "bgr48", "bgra64", "gbrp16", "gbrap16")
    )


def samples_of_16_bits(frame: Any) -> NDArray[Any]:
    """Samples of a frame as stored: (h, w), or (h, w, 3) in RGB."""
    wanted = "gray16le" if frame.format.name.startswith(("gray", "ya")) else "rgb48le"
    return np.asarray(frame.reformat(format=wanted, threads=1).to_ndarray())


def rgb_of(frame: Any) -> NDArray[np.uint8]:
    """A frame (h, w, 3) in RGB with 8 bits."""
    return np.asarray(frame.reformat(format="rgb24", threads=1).to_ndarray(), dtype=np.uint8)


def rgb_of_samples(samples: NDArray[Any], bits: int) -> NDArray[np.uint8]:
    """The result of `rgb_of` for samples of 16 bits of which the lowest `bits` are used."""
    image = to_8_bits(samples, bits)
    return np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image


def decoded_pictures(
    decoder: Any,
    packets: Iterable[Packet],
    size: tuple[int, int],
    convert: Callable[[Any], NDArray[Any]] = rgb_of,
) -> Iterator[Picture]:
    """The pictures that FFmpeg's decoder makes of packets, in order of time; `convert` makes their pixels."""
    from av.codec.context import Flags

    decoder.thread_type = "AUTO"
    decoder.flags |= Flags.copy_opaque
    # Else an error in the data is concealed from its surroundings, and the frame passes for a complete one.
    decoder.options = {"err_detect": "crccheck+explode"}
    order = _Order(bool(decoder.codec.intra_only))

    def picture(shown: _Shown, reason: str, at_end: bool = False) -> Picture:
        def pixels() -> NDArray[Any]:
            return convert(shown.frame)

        # Frames that are shown before the last, but are decoded after it, may be cut off.
        broken, skipped = shown.packet.gap or (at_end and bool(decoder.has_b_frames)), shown.packet.skipped
        if not reason and (shown.frame.width, shown.frame.height) != size:
            reason = other_size((shown.frame.width, shown.frame.height), size)
        return Picture(shown.moment, None if reason else pixels, reason, broken, skipped)

    failed = False
    for packet in packets:
        if failed and packet.data.is_keyframe:
            # Threads that met damaged data may fail at undamaged ones too, until all restart.
            _decode(decoder, None, order)
            order.end()
            decoder.flush_buffers()
            failed = False
        order.send(packet)
        packet.data.opaque = packet.number
        failed |= not _decode(decoder, packet.data, order)
        yield from starmap(picture, order.judged())
    _decode(decoder, None, order)
    order.end()
    for shown, reason in order.judged():
        yield picture(shown, reason, at_end=True)


def _decode(decoder: Any, data: Any, order: _Order) -> bool:
    """Decode a packet, or what the decoder still holds; return whether it raised no error."""
    import av

    try:
        frames = decoder.decode(data)
    except av.FFmpegError:
        # Its frame will be missing among those that come.
        return False
    for frame in frames:
        order.give(frame.opaque, frame, bool(decoder.has_b_frames))
    return True
