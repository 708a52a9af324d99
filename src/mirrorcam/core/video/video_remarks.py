"""What a user should know of a video before its frames are measured: that it is interlaced, or turned by players."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from itertools import islice
from math import atan2, degrees
from typing import Any

_SAMPLED_FRAMES, _SAMPLED_PACKETS = 8, 32
_FIELD_ORDERS = range(2, 6)
"""FFmpeg's orders of fields, without "unknown" and "progressive" (AV_FIELD_TT to AV_FIELD_BT)."""
_MATRIX = struct.Struct("=9i")


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
            "distorts what is measured; deinterlace it (ffmpeg -noautorotate -i VIDEO -vf bwdif=0 -crf 12 OUT.mkv), or "
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
