"""Frames of a video file in order; a damaged frame is reported, never concealed."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from itertools import chain, islice, pairwise
from math import atan2, degrees
from typing import Any

from mirrorcam.core.arguments import AnyPath, path_of
from mirrorcam.core.bounds import LARGEST_PICTURE_PX
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.jpeg import DamagedPicture
from mirrorcam.core.images.sample_bits import ALL, SampleBits
from mirrorcam.core.video.frames import Frame, Lost
from mirrorcam.core.video.media_files import opened
from mirrorcam.core.video.video_packets import packets_of
from mirrorcam.core.video.video_pictures import (
    DAMAGED,
    SAMPLED,
    Picture,
    are_plain_jpegs,
    decoded_pictures,
    has_16_bits,
    have_ends,
    jpeg_pictures,
    rgb_of_samples,
    samples_of_16_bits,
)

MISSING, WRONG_TIME = "is missing", "has a wrong time"
_REORDERED = 16
"""Number of pictures after damage among which others may be missing: as many as a codec reorders."""
_MAX_TIMESTAMPS = 4096
"""Number of past timestamps that are recognised when they repeat."""
_SAMPLED_FRAMES, _SAMPLED_PACKETS = 8, 32
_FIELD_ORDERS = range(2, 6)
"""FFmpeg's orders of fields, without "unknown" and "progressive" (AV_FIELD_TT to AV_FIELD_BT)."""
_MATRIX = struct.Struct("=9i")


class Video:
    """A video file, whose frames are RGB.

    Parameters
    ----------
    path
        The file; a name that looks like an address is a path, too.
    on_note
        Called with remarks for the user: the video is interlaced, or players rotate it.

    Attributes
    ----------
    width_px, height_px, rate_hz
        Size and frame rate that the file states.
    count
        Number of frames that the file states; None if it states none.

    Raises
    ------
    InputError
        For a file that is not a video, or is cut off before an index that it needs.
    """

    def __init__(self, path: AnyPath, on_note: Callable[[str], None] | None = None) -> None:
        self.path = path = path_of("path", path)
        with opened(path) as container:
            stream = self._stream(container)
            self.width_px, self.height_px = int(stream.codec_context.width), int(stream.codec_context.height)
            self.rate_hz = float(stream.average_rate or 0.0)
            self.count = _count(container, stream)
            if self.width_px * self.height_px > LARGEST_PICTURE_PX:
                limit = f"{LARGEST_PICTURE_PX // 1_000_000} megapixels"
                raise InputError(f"{path}: {self.width_px}x{self.height_px} px, expected a video of at most {limit}")
            if on_note is not None:
                for line in remarks(path.name, container, stream):
                    on_note(line)

    def _stream(self, container: Any) -> Any:
        from av.stream import Disposition

        # Cover pictures of music files are not videos.
        streams = [item for item in container.streams.video if not item.disposition & Disposition.attached_pic]
        if not streams:
            raise InputError(f"{self.path}: has no pictures, expected a video")
        stream = streams[0]
        if stream.codec_context is None or not stream.codec_context.width:
            raise InputError(
                f"{self.path}: its pictures cannot be read, expected a common codec such as H.264 or MJPEG"
            )
        return stream

    def frames(self, after: int = -1) -> Iterator[Frame | Lost]:
        """Yield the frames after number `after`, in presentation order.

        If frames depend on each other, all frames between a damaged one and the next key frame are lost: they would
        decode to wrong pictures.
        """
        with opened(self.path) as container:
            stream = self._stream(container)
            period = 1 / (self.rate_hz * float(stream.time_base)) if self.rate_hz else 0.0
            pictures = with_missing(self._pictures(container, stream), period, self._stated_frames(container))
            start = stream.start_time or 0
            for number, picture in enumerate(pictures):
                if number > after:
                    yield _frame(number, picture, start, stream.time_base)

    def stop(self) -> None:
        """Do nothing: reading a file never waits."""

    def _stated_frames(self, container: Any) -> int:
        """Return the number of frames that fit into the stated duration."""
        return round(self.rate_hz * (container.duration or 0) / 1e6)

    def _pictures(self, container: Any, stream: Any) -> Iterator[Picture]:
        packets, size = packets_of(container, stream), (self.width_px, self.height_px)
        if stream.codec_context.name == "mjpeg":
            first = list(islice(packets, SAMPLED))
            packets = chain(first, packets)
            if are_plain_jpegs(first, self.height_px):
                return jpeg_pictures(packets, size, have_ends(first))
        if has_16_bits(stream.codec_context):
            used = self.sample_bits.used
            return decoded_pictures(
                stream.codec_context, packets, size, lambda frame: rgb_of_samples(samples_of_16_bits(frame), used)
            )
        return decoded_pictures(stream.codec_context, packets, size)

    @cached_property
    def sample_bits(self) -> SampleBits:
        """Used bits of all 16-bit frames, which are decoded for this; empty for a video of other samples."""
        bits = SampleBits()
        with opened(self.path) as container:
            stream = self._stream(container)
            if has_16_bits(stream.codec_context):
                size = (self.width_px, self.height_px)
                packets = packets_of(container, stream)
                for picture in decoded_pictures(stream.codec_context, packets, size, samples_of_16_bits):
                    if picture.pixels is not None:
                        bits = SampleBits.combined((bits, SampleBits.of(picture.pixels())))
                    if bits.used == ALL:
                        break
        return bits


def _count(container: Any, stream: Any) -> int | None:
    """Return the stated number of frames, without the empty frames, which AVI also counts."""
    stated, index = int(stream.frames), stream.index_entries
    if container.format.name == "avi" and len(index) and index[-1].timestamp + 1 == stated:
        return sum(entry.size > 0 for entry in index)
    return stated or None


def _frame(number: int, picture: Picture, start: int, time_base: Any) -> Frame | Lost:
    if picture.pixels is None:
        return Lost(number, picture.reason)
    try:
        return Frame(number, float((picture.timestamp - start) * time_base), picture.pixels())
    except DamagedPicture:
        return Lost(number, DAMAGED)


def with_missing(pictures: Iterable[Picture], period: float, max_gap: int) -> Iterator[Picture]:
    """Yield the pictures, and lost ones for gaps in the timestamps of a damaged file.

    Only a constant frame rate, with timestamps `period` apart (0 if unknown), shows gaps; a gap above `max_gap`
    frames does not count. A picture with a timestamp not between its neighbours' is lost, but one with a repeated
    timestamp is a copy, and is left out.
    """
    last: int | None = None
    is_regular, regular_steps, near_damage = period > 0, 0, 0
    recent: deque[int] = deque(maxlen=_MAX_TIMESTAMPS)
    for picture, next_picture in pairwise(chain(pictures, (None,))):
        assert picture is not None
        is_damaged = any(_may_miss(item, regular_steps) for item in (picture, next_picture))
        near_damage = _REORDERED if is_damaged else near_damage - 1
        timestamp, missing = picture.timestamp, picture.skipped
        if last is not None and timestamp <= last and timestamp in recent:
            continue
        steps = round((timestamp - last) / period) if is_regular and last is not None else 0
        on_grid = last is not None and abs(timestamp - last - steps * period) <= 1 + period / 20
        too_late = next_picture is not None and last is not None and last < next_picture.timestamp <= timestamp
        if last is not None and (timestamp <= last or (too_late and not (steps == 1 and on_grid))):
            yield Picture(timestamp, None, WRONG_TIME)
            last = round(last + period) if is_regular else last
            continue
        if is_regular and last is not None:
            is_regular = on_grid and (steps == 1 or near_damage > 0)
            missing = max(missing, steps - 1) if is_regular and steps <= max_gap else missing
            regular_steps += is_regular
        yield from (Picture(timestamp, None, MISSING) for _ in range(missing))
        last = timestamp
        recent.append(timestamp)
        yield picture


def _may_miss(picture: Picture | None, regular_steps: int) -> bool:
    """Return whether pictures next to this one may be missing, after `regular_steps` regular intervals."""
    return picture is not None and (picture.broken or (picture.reason == DAMAGED and regular_steps > _REORDERED))


def remarks(name: str, container: Any, stream: Any) -> list[str]:
    """Return remarks on a video from its header and its first frames, which are read."""
    frames = list(islice(_frames(container, stream), _SAMPLED_FRAMES))
    return frame_remarks(name, frames, interlaced=stream.codec_context.field_order in _FIELD_ORDERS)


def frame_remarks(name: str, frames: Sequence[Any], *, interlaced: bool = False) -> list[str]:
    """Return remarks on a video or camera from some frames; `interlaced` is the flag of its header."""
    lines = []
    if interlaced or any(frame.interlaced_frame for frame in frames):
        lines.append(
            f"{name} is interlaced: the odd and even rows of a frame were exposed at different times, so motion "
            "distorts measurements; deinterlace it (ffmpeg -noautorotate -i VIDEO -vf bwdif=0 -crf 12 OUT.mkv), or "
            "hold the board and the scene still"
        )
    rotation = next(filter(None, map(_rotation, frames)), None)
    if rotation is not None:
        lines.append(
            f"{name} is displayed {rotation} by players: its frames are used as they lie on the sensor; to make "
            "ffmpeg do the same, put -noautorotate -display_rotation 0 before its -i"
        )
    return lines


def _frames(container: Any, stream: Any) -> Iterator[Any]:
    """Yield the first frames, without damaged ones, which `frames` reports."""
    import av

    packets = container.demux(stream)
    for _ in range(_SAMPLED_PACKETS):
        try:
            packet = next(packets, None)
            decoded = [] if packet is None else packet.decode()
        except (av.FFmpegError, OSError):
            continue
        if packet is None:
            return
        yield from decoded


def _rotation(frame: Any) -> str | None:
    """Describe how players rotate or mirror a frame by its display matrix; None if they do not."""
    data = next((bytes(item) for item in frame.side_data if item.type.name == "DISPLAYMATRIX"), b"")
    if len(data) != _MATRIX.size:
        return None
    a, b, _, c, d, *_ = _MATRIX.unpack(data)
    if a * d - b * c < 0:
        return "mirrored"
    angle = round(degrees(atan2(b, a))) % 360
    return f"rotated by {angle}°" if angle else None
