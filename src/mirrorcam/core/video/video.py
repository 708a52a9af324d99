"""Frames of a video file in order; a damaged frame is reported, never concealed."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from itertools import chain, islice, pairwise
from math import atan2, degrees
from pathlib import Path
from typing import Any

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
_NEAR = 16
"""Number of pictures after damage among which others may be missing: as many as a codec reorders."""
_REMEMBERED = 4096
"""Number of past timestamps that are recognised when they repeat."""
_SAMPLED_FRAMES, _SAMPLED_PACKETS = 8, 32
_FIELD_ORDERS = range(2, 6)
"""FFmpeg's orders of fields, without "unknown" and "progressive" (AV_FIELD_TT to AV_FIELD_BT)."""
_MATRIX = struct.Struct("=9i")


class Video:
    """A video file.

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

    def __init__(self, path: Path, on_note: Callable[[str], None] | None = None) -> None:
        self.path = path
        with opened(path) as container:
            stream = self._stream(container)
            self.width_px, self.height_px = int(stream.codec_context.width), int(stream.codec_context.height)
            self.rate_hz = float(stream.average_rate or 0.0)
            self.count = _count(container, stream)
            if self.width_px * self.height_px > LARGEST_PICTURE_PX:
                most = f"{LARGEST_PICTURE_PX // 1_000_000} megapixels"
                raise InputError(f"{path}: {self.width_px}x{self.height_px} px, expected a video of at most {most}")
            if on_note is not None:
                for line in remarks(path.name, container, stream):
                    on_note(line)

    def _stream(self, container: Any) -> Any:
        from av.stream import Disposition

        # Cover pictures of music files are no video.
        streams = [each for each in container.streams.video if not each.disposition & Disposition.attached_pic]
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
            pictures = with_missing(self._pictures(container, stream), period, self._most(container))
            start = stream.start_time or 0
            for number, picture in enumerate(pictures):
                if number > after:
                    yield _frame(number, picture, start, stream.time_base)

    def stop(self) -> None:
        """Do nothing: reading a file never waits."""

    def _most(self, container: Any) -> int:
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
        """Used bits of all 16-bit frames, which are decoded for it; empty for a video of other samples."""
        found = SampleBits()
        with opened(self.path) as container:
            stream = self._stream(container)
            if has_16_bits(stream.codec_context):
                size = (self.width_px, self.height_px)
                packets = packets_of(container, stream)
                for picture in decoded_pictures(stream.codec_context, packets, size, samples_of_16_bits):
                    if picture.pixels is not None:
                        found = SampleBits.together((found, SampleBits.of(picture.pixels())))
                    if found.used == ALL:
                        break
        return found


def _count(container: Any, stream: Any) -> int | None:
    """Return the stated number of frames, without the empty frames that AVI counts, too."""
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


def with_missing(pictures: Iterable[Picture], period: float, most: int) -> Iterator[Picture]:
    """Yield the pictures, and lost ones for gaps in the timestamps of a damaged file.

    Only a constant frame rate, with timestamps `period` apart (0 if unknown), shows gaps; a gap above `most` frames
    does not count. A picture with a timestamp not between its neighbours' is lost, but one with a repeated timestamp
    is a copy, and is left out.
    """
    last: int | None = None
    even, steady, near = period > 0, 0, 0
    seen: deque[int] = deque(maxlen=_REMEMBERED)
    for picture, following in pairwise(chain(pictures, (None,))):
        assert picture is not None
        near = _NEAR if any(_may_miss(each, steady) for each in (picture, following)) else near - 1
        timestamp, missing = picture.timestamp, picture.skipped
        if last is not None and timestamp <= last and timestamp in seen:
            continue
        steps = round((timestamp - last) / period) if even and last is not None else 0
        on_grid = last is not None and abs(timestamp - last - steps * period) <= 1 + period / 20
        too_late = following is not None and last is not None and last < following.timestamp <= timestamp
        if last is not None and (timestamp <= last or (too_late and not (steps == 1 and on_grid))):
            yield Picture(timestamp, None, WRONG_TIME)
            last = round(last + period) if even else last
            continue
        if even and last is not None:
            even = on_grid and (steps == 1 or near > 0)
            missing = max(missing, steps - 1) if even and steps <= most else missing
            steady += even
        yield from (Picture(timestamp, None, MISSING) for _ in range(missing))
        last = timestamp
        seen.append(timestamp)
        yield picture


def _may_miss(picture: Picture | None, steady: int) -> bool:
    """Return whether pictures next to this one may be missing, after `steady` pictures at even times."""
    return picture is not None and (picture.broken or (picture.reason == DAMAGED and steady > _NEAR))


def remarks(name: str, container: Any, stream: Any) -> list[str]:
    """Return remarks on a video from its header and its first frames, which are read."""
    frames = list(islice(_frames(container, stream), _SAMPLED_FRAMES))
    return frame_remarks(name, frames, interlaced=stream.codec_context.field_order in _FIELD_ORDERS)


def frame_remarks(name: str, frames: Sequence[Any], *, interlaced: bool = False) -> list[str]:
    """Return remarks on a video or camera from some frames; `interlaced` is the flag of its header."""
    found = []
    if interlaced or any(frame.interlaced_frame for frame in frames):
        found.append(
            f"{name} is interlaced: the odd and even rows of a frame were exposed at different times, so that motion "
            "distorts measurements; deinterlace it (ffmpeg -noautorotate -i VIDEO -vf bwdif=0 -crf 12 OUT.mkv), or "
            "hold the board and the scene still"
        )
    turned = next(filter(None, map(_turned, frames)), None)
    if turned is not None:
        found.append(
            f"{name} is to be shown {turned}: its frames are used as they lie on the sensor; so that ffmpeg does the "
            "same, put -noautorotate -display_rotation 0 before its -i"
        )
    return found


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


def _turned(frame: Any) -> str | None:
    """Describe how players turn a frame by its display matrix; None if they do not."""
    data = next((bytes(each) for each in frame.side_data if each.type.name == "DISPLAYMATRIX"), b"")
    if len(data) != _MATRIX.size:
        return None
    a, b, _, c, d, *_ = _MATRIX.unpack(data)
    if a * d - b * c < 0:
        return "mirrored"
    angle = round(degrees(atan2(b, a))) % 360
    return f"turned by {angle}°" if angle else None
