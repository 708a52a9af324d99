"""Frames of a video file, one after another; a damaged frame is reported, never made up."""

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
"""Pictures after a damage at which others may be missing: as many as a codec reorders."""
_REMEMBERED = 4096
"""Times in the past that are known again."""
_SAMPLED_FRAMES, _SAMPLED_PACKETS = 8, 32
_FIELD_ORDERS = range(2, 6)
"""FFmpeg's orders of fields, without "unknown" and "progressive" (AV_FIELD_TT to AV_FIELD_BT)."""
_MATRIX = struct.Struct("=9i")


class Video:
    """A video file.

    Parameters
    ----------
    path
        The file: a path, also where its name looks like an address.
    on_note
        Called with a line on what the user should know of it: that it is interlaced, or turned by players.

    Attributes
    ----------
    width_px, height_px, rate_hz
        Size and frame rate that the file states.
    count
        Number of frames that the file states; None where it states none.

    Raises
    ------
    InputError
        For a file that is not a video, or one that is cut off before the index that it cannot be read without.
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

        # The picture on the cover of a piece of music is no video.
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
        """Frames that follow number `after`, in order of time.

        Of a codec whose frames depend on others, all frames between a damaged one and the next key frame are lost: they
        decode, but to something that nobody has seen.
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
        """Do nothing: no frame of a file is waited for."""

    def _most(self, container: Any) -> int:
        """Number of frames that fit into the length that the file states."""
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
        """What all frames of 16 bits, which are decoded for it, have in common; nothing in a video of other samples."""
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
    """Number of frames that a file states; AVI also counts the times at which no frame was taken."""
    stated, index = int(stream.frames), stream.index_entries
    if container.format.name == "avi" and len(index) and index[-1].timestamp + 1 == stated:
        return sum(entry.size > 0 for entry in index)
    return stated or None


def _frame(number: int, picture: Picture, start: int, time_base: Any) -> Frame | Lost:
    if picture.pixels is None:
        return Lost(number, picture.reason)
    try:
        return Frame(number, float((picture.moment - start) * time_base), picture.pixels())
    except DamagedPicture:
        return Lost(number, DAMAGED)


def with_missing(pictures: Iterable[Picture], period: float, most: int) -> Iterator[Picture]:
    """The pictures, and those that a damaged file has lost without a trace, as its times tell.

    The times of a video of a constant rate are `period` apart; where they are irregular from the start, None.
    A gap of more than `most` is no gap. A picture whose time is not between those before and after it is lost, but one
    of a time that was there before is a copy of data, and none.
    """
    last: int | None = None
    even, steady, near = period > 0, 0, 0
    seen: deque[int] = deque(maxlen=_REMEMBERED)
    for picture, following in pairwise(chain(pictures, (None,))):
        assert picture is not None
        near = _NEAR if any(_may_miss(each, steady) for each in (picture, following)) else near - 1
        moment, missing = picture.moment, picture.skipped
        if last is not None and moment <= last and moment in seen:
            continue
        steps = round((moment - last) / period) if even and last is not None else 0
        on_grid = last is not None and abs(moment - last - steps * period) <= 1 + period / 20
        too_late = following is not None and last is not None and last < following.moment <= moment
        if last is not None and (moment <= last or (too_late and not (steps == 1 and on_grid))):
            yield Picture(moment, None, WRONG_TIME)
            last = round(last + period) if even else last
            continue
        if even and last is not None:
            even = on_grid and (steps == 1 or near > 0)
            missing = max(missing, steps - 1) if even and steps <= most else missing
            steady += even
        yield from (Picture(moment, None, MISSING) for _ in range(missing))
        last = moment
        seen.append(moment)
        yield picture


def _may_miss(picture: Picture | None, steady: int) -> bool:
    """Return whether pictures next to a picture may be missing, after some pictures at even times."""
    return picture is not None and (picture.broken or (picture.reason == DAMAGED and steady > _NEAR))


def remarks(name: str, container: Any, stream: Any) -> list[str]:
    """Lines about the video of this name, from its header and its first frames, which are read."""
    frames = list(islice(_frames(container, stream), _SAMPLED_FRAMES))
    return frame_remarks(name, frames, interlaced=stream.codec_context.field_order in _FIELD_ORDERS)


def frame_remarks(name: str, frames: Sequence[Any], *, interlaced: bool = False) -> list[str]:
    """Lines about the video or camera of this name, from some of its frames, and whether its header says interlaced."""
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
    """The first frames, without those that are damaged: they are reported when their turn comes."""
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
    """How a player turns a frame, by its display matrix; None where it does not."""
    data = next((bytes(each) for each in frame.side_data if each.type.name == "DISPLAYMATRIX"), b"")
    if len(data) != _MATRIX.size:
        return None
    a, b, _, c, d, *_ = _MATRIX.unpack(data)
    if a * d - b * c < 0:
        return "mirrored"
    angle = round(degrees(atan2(b, a))) % 360
    return f"turned by {angle}°" if angle else None
