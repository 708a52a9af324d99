"""Frames one after another, from a video file or a camera; a damaged frame is reported, never made up."""

from __future__ import annotations

import heapq
import queue
import threading
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.values import InputError

T = TypeVar("T")

AHEAD = 4
"""Frames that wait between reading and decoding: enough to even out slow ones, 25 MB of 1920 x 1080."""

PATIENCE = 30
"""Pictures in a row that a camera may fail to give before it counts as disconnected."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture (h, w, 3) in RGB, its number in the source from 0, and its time in s from the source's start."""

    number: int
    time_s: float
    pixels: NDArray[np.uint8]


@dataclass(frozen=True)
class Lost:
    """A frame that was there, but cannot be used: its number in the source, and why."""

    number: int
    reason: str


class Video:
    """A video file.

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

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._opened() as container:
            stream = self._stream(container)
            self.width_px, self.height_px = int(stream.codec_context.width), int(stream.codec_context.height)
            self.rate_hz = float(stream.average_rate or 0.0)
            self.count: int | None = int(stream.frames) or None

    def _opened(self) -> Any:
        import av

        try:
            # Names and remarks in the file are of no use here, and need not be text.
            return av.open(str(self.path), metadata_errors="replace")
        except FileNotFoundError:
            raise InputError(f"{self.path}: no such file") from None
        except IsADirectoryError:
            raise InputError(f"{self.path}: is a folder, expected a video") from None
        except av.FFmpegError as error:
            raise InputError(
                f"{self.path}: not a video that can be opened, or cut off before its index: {error.strerror}"
            ) from None

    def _stream(self, container: Any) -> Any:
        if not container.streams.video:
            raise InputError(f"{self.path}: has no pictures, expected a video")
        stream = container.streams.video[0]
        if stream.codec_context is None or not stream.codec_context.width:
            raise InputError(
                f"{self.path}: its pictures cannot be read, expected a common codec such as H.264 or MJPEG"
            )
        return stream

    def frames(self, after: int = -1) -> Iterator[Frame | Lost]:
        """Frames that follow number `after`, in order of time.

        Where frames are predicted from earlier ones, all frames between a damaged one and the next key frame are lost:
        they decode, but to wrong pictures.
        """
        import av
        from av.video.reformatter import VideoReformatter

        with self._opened() as container:
            stream = self._stream(container)
            decoder, convert = stream.codec_context, VideoReformatter().reformat
            decoder.thread_type = "AUTO"
            # Else damage is painted over with what stands around it, and the frame passes for a whole one.
            decoder.options = {"err_detect": "explode"}
            alone = bool(decoder.codec.intra_only)
            start = stream.start_time or 0
            sent: list[int] = []
            number, broken = 0, False
            for packet in _packets(container, stream):
                if packet.size:
                    packet.pts = _moment(packet, number + len(sent))
                    heapq.heappush(sent, packet.pts)
                try:
                    decoded = decoder.decode(packet if packet.size else None)
                except av.FFmpegError:
                    # Its frame will be missing among those that come.
                    decoded = []
                for frame in decoded:
                    moment = frame.pts if frame.pts is not None else min(sent, default=0)
                    # Frames come in order of time: what was sent with an earlier time and has not come will not.
                    while sent and sent[0] < moment:
                        heapq.heappop(sent)
                        if number > after:
                            yield Lost(number, "is damaged")
                        number, broken = number + 1, True
                    if sent and sent[0] == moment:
                        heapq.heappop(sent)
                    broken = bool(frame.is_corrupt) or (broken and not frame.key_frame and not alone)
                    size = frame.width, frame.height
                    if number <= after:
                        pass
                    elif frame.is_corrupt:
                        yield Lost(number, "is damaged")
                    elif broken:
                        yield Lost(number, "leans on a damaged one")
                    elif size != (self.width_px, self.height_px):
                        yield Lost(number, f"is {size[0]}x{size[1]} px, others {self.width_px}x{self.height_px}")
                    else:
                        pixels: NDArray[Any] = convert(frame, format="rgb24", threads=1).to_ndarray()
                        yield Frame(number, float((moment - start) * stream.time_base), pixels)
                    number += 1
            for _ in sent:
                if number > after:
                    yield Lost(number, "is damaged")
                number += 1


def _packets(container: Any, stream: Any) -> Iterator[Any]:
    """The stream's packets, and an empty one at the end, also where the file breaks off in the middle of one."""
    import av

    try:
        for packet in container.demux(stream):
            if packet.size:
                yield packet
    except av.FFmpegError:
        # What follows cannot be read; the frames before are whole.
        pass
    yield av.Packet()


def _moment(packet: Any, number: int) -> int:
    """Time at which a packet's frame is shown, in the stream's own time; counted where the file does not state it."""
    return int(next(moment for moment in (packet.pts, packet.dts, number) if moment is not None))


class CaptureDevice:
    """A camera on this machine, asked for pictures of a size.

    Raises InputError for a camera that cannot be opened or gives pictures of another size.
    """

    def __init__(
        self,
        number: int,
        width_px: int,
        height_px: int,
        capture: Callable[[int], Any] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.number, self.width_px, self.height_px = number, width_px, height_px
        # OpenCV would print its attempts on standard error; the failure is reported here.
        level = cv2.utils.logging.getLogLevel()
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        try:
            self._capture, self._clock = (capture or cv2.VideoCapture)(number), clock
        finally:
            cv2.utils.logging.setLogLevel(level)
        if not self._capture.isOpened():
            raise InputError(f"camera {number} cannot be opened, expected one on this machine (/dev/video{number})")
        # Uncompressed pictures of this size do not fit through USB 2 at a camera's rate.
        self._capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, width_px)
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, height_px)

    def frames(self, after: int = -1) -> Generator[Frame | Lost]:
        """Pictures from now on, numbered from `after` on; without an end, unless the camera goes."""
        started, number, missed = self._clock(), after + 1, 0
        try:
            while missed < PATIENCE:
                given, bgr = self._capture.read()
                moment = self._clock() - started
                if not given:
                    missed += 1
                    yield Lost(number, "was not given by the camera")
                elif bgr.shape[:2] != (self.height_px, self.width_px):
                    raise InputError(
                        f"camera {self.number} gives {bgr.shape[1]}x{bgr.shape[0]} px, expected "
                        f"{self.width_px}x{self.height_px} of the layout's camera"
                    )
                else:
                    missed = 0
                    yield Frame(number, moment, np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8))
                number += 1
            raise InputError(f"camera {self.number} gave no picture {PATIENCE} times in a row, is it connected?")
        finally:
            self._capture.release()


@dataclass(frozen=True)
class _Failed:
    error: BaseException


def read_ahead(items: Iterator[T], count: int = AHEAD) -> Generator[T]:
    """The same items, of which a thread gets at most `count` before they are asked for; errors arrive in their place.

    The thread ends with the items, or when the iterator that this returns is closed.
    """
    waiting: queue.Queue[Any] = queue.Queue(maxsize=count)
    over, end = threading.Event(), object()

    def put(item: object) -> None:
        while not over.is_set():
            try:
                waiting.put(item, timeout=0.1)
                return
            except queue.Full:
                continue

    def read() -> None:
        try:
            for item in items:
                put(item)
                if over.is_set():
                    return
            put(end)
        except BaseException as error:  # raised again where the items are asked for
            put(_Failed(error))
        finally:
            close = getattr(items, "close", None)
            if close is not None:
                close()

    thread = threading.Thread(target=read, name="read ahead", daemon=True)
    thread.start()
    try:
        while (item := waiting.get()) is not end:
            if isinstance(item, _Failed):
                raise item.error
            yield item
    finally:
        over.set()
        thread.join()
