"""Recording of a stream of frames as light fields: reading, decoding and writing run concurrently."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.video.frames import READ_AHEAD, Frame, Lost, Source, read_ahead
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.io.recording import Recording
from mirrorcam.optics.light_field.light_field import LightField

Decoded = tuple[Frame, LightField] | Lost


class RecordingCheck(Protocol):
    """A check of a complete recording, for example whether mirrors have moved."""

    @property
    def file(self) -> str:
        """Suffix of the file that it writes."""

    def report(self, frames: Sequence[NDArray[np.uint8]], name: str, sources: str) -> None:
        """Check some frames of a recording named `name`; `sources` are the arguments of a command that reads them."""


def light_fields(decoder: Decoder, source: Source, after: int = -1, *, ahead: int = READ_AHEAD) -> Iterator[Decoded]:
    """Yield the light fields of a source's frames after a number, and its lost frames, in order.

    Frames are read in a separate thread, `ahead` of them in advance; with 0, each on demand.
    """
    frames = source.frames(after)
    for item in read_ahead(frames, ahead, source.stop) if ahead else frames:
        yield item if isinstance(item, Lost) else (item, decoder.decode(item.pixels))


def decoded_ahead(decoder: Decoder, source: Source, after: int = -1) -> Iterator[Decoded]:
    """Like `light_fields`, but decode a few frames ahead in a separate thread, which ends with the returned iterator.

    OpenCV, the video decoder and file writes release Python's lock.
    """
    return read_ahead(light_fields(decoder, source, after), count=2, stop=source.stop)


def record(
    decoder: Decoder,
    source: Source,
    recording: Recording,
    *,
    on_frame: Callable[[int, Decoded], None] | None = None,
    limit: int | None = None,
) -> None:
    """Append a source's remaining frames to a recording, up to `limit` frames, written and lost, in total.

    `on_frame` gets the number of frames done and the last of them. The recording is neither finished nor closed.
    """
    done = len(recording.entries.numbers) + len(recording.entries.lost)
    remaining = None if limit is None else max(0, limit - done)
    for item in islice(decoded_ahead(decoder, source, recording.entries.last), remaining):
        if isinstance(item, Lost):
            recording.add_lost(item)
        else:
            recording.add(*item)
        done += 1
        if on_frame is not None:
            on_frame(done, item)
