"""The values of a live session that pass between processes, and the newest picture of each kind."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.alignment.meters import Exposure

PictureKind = Literal["frame", "views", "refocus", "depth"]
DECODED: tuple[PictureKind, ...] = ("frame", "views", "refocus")
"""Pictures of every frame; depth has its own rate."""

FRAME_WIDTH_PX, VIEW_WIDTH_PX, DEPTH_WIDTH_PX = 960, 320, 200
"""Widths of the frame as shown, of each view and the refocused picture, and of the views that depth is measured in."""


@dataclass(frozen=True)
class LiveRequest:
    """A live session.

    Parameters
    ----------
    layout
        `layout.json`: nominal, to align the mirrors by, or calibrated.
    source
        Number or address of a camera, a video file, or a folder of pictures.
    frame_width_px, view_width_px, depth_width_px
        Widths of pictures.
    every_frame
        Show every frame of a file, as fast as possible, instead of the newest in real time.
    """

    layout: Path
    source: str
    frame_width_px: int = FRAME_WIDTH_PX
    view_width_px: int = VIEW_WIDTH_PX
    depth_width_px: int = DEPTH_WIDTH_PX
    every_frame: bool = False


@dataclass(frozen=True)
class SessionAbout:
    """Properties of a session: source, sizes of pictures (width, height) in px, and depths in mm.

    `layout_kind` is "nominal", "as-built" or "calibrated".
    """

    source: str
    kind: str
    layout_kind: str
    camera_px: tuple[int, int]
    sizes_px: dict[PictureKind, tuple[int, int]]
    grid: tuple[int, int]
    reference_mm: float
    near_mm: float
    far_mm: float
    least_focus_mm: float


@dataclass(frozen=True)
class Orders:
    """The requested results of the next frame.

    Parameters
    ----------
    focus_mm
        Depth of the refocused picture; None for the reference plane.
    kinds
        Pictures that are watched.
    depth
        Whether to return the light field for depth.
    frames
        Whether to return some of the last frames, in grey, for alignment.
    record
        Video to record frames to from now on; None for none.
    take
        File for the next frame, lossless.
    reset_focus
        Whether to reset the best sharpness so far.
    plays
        Requested number of starts of a finite source: 0 waits; one more than before restarts a source that has ended.
        A camera always plays.
    timeout_s
        Time to wait for a frame.
    """

    focus_mm: float | None = None
    kinds: tuple[PictureKind, ...] = DECODED
    depth: bool = False
    frames: bool = False
    record: Path | None = None
    take: Path | None = None
    reset_focus: bool = False
    plays: int = 1
    timeout_s: float = 1.0


@dataclass(frozen=True, eq=False)
class FrameResults:
    """The results of one frame.

    Attributes
    ----------
    number, time_s
        Number and time of the frame in its source.
    arrived_s, done_s
        Times of its arrival and of its encoded pictures, by `time.monotonic`.
    jpegs
        The pictures.
    sharpness
        Sharpness of each mirror, relative to its best so far; None if not measured in this frame.
    exposure
        Exposure; None if not measured in this frame.
    samples
        Samples (t, s, v, u, 3) for depth.
    frames
        Some of the last frames (h, w), grey.
    taken
        The file that the frame was written to.
    repeated
        Whether this repeats the last frame of an ended source, for newly requested pictures.
    """

    number: int
    time_s: float
    arrived_s: float
    done_s: float
    jpegs: dict[PictureKind, bytes]
    sharpness: tuple[float, ...] | None = None
    exposure: Exposure | None = None
    samples: NDArray[np.uint8] | None = None
    frames: tuple[NDArray[np.uint8], ...] = ()
    taken: Path | None = None
    repeated: bool = False


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer of a session: a frame's results, if one arrived in time, and the counts so far.

    `recorded` and `not_recorded` count frames of the current recording: those in the file, and lost ones.
    """

    results: FrameResults | None
    ended: bool
    dropped: int
    lost: int
    outages: int
    recorded: int
    not_recorded: int
    memory_mb: float
    lines: tuple[str, ...] = field(default=())


@dataclass(frozen=True, eq=False)
class LivePicture:
    """A JPEG picture of a frame, counted from 1 in its kind.

    `depth_mm` (v, u) accompanies a picture of depth, 0 where unknown.
    """

    serial: int
    frame: int
    time_s: float
    jpeg: bytes
    depth_mm: NDArray[np.uint16] | None = None


class LivePictures:
    """The newest picture of each kind; any thread may publish, read and wait.

    Parameters
    ----------
    idle_s
        Time after which pictures of an unwatched kind are no longer made; None to make them always.
    """

    def __init__(self, idle_s: float | None) -> None:
        self._idle_s, self._requested = idle_s, dict.fromkeys(get_args(PictureKind), -np.inf)
        self._latest: dict[PictureKind, LivePicture] = {}
        self._changed, self._ended = threading.Condition(), False

    def put(
        self, kind: PictureKind, results: FrameResults, jpeg: bytes, depth_mm: NDArray[np.uint16] | None = None
    ) -> None:
        """Replace the picture of a kind by one of a frame."""
        with self._changed:
            previous = self._latest.get(kind)
            serial = 1 if previous is None else previous.serial + 1
            self._latest[kind] = LivePicture(serial, results.number, results.time_s, jpeg, depth_mm)
            self._changed.notify_all()

    def latest(self, kind: PictureKind) -> LivePicture | None:
        """The newest picture of a kind; None before the first."""
        with self._changed:
            return self._latest.get(kind)

    def wait_for(self, kind: PictureKind, after: int, timeout_s: float) -> LivePicture | None:
        """Wait for a picture of a kind with a serial number above `after`; None if none arrives in time."""

        def newer() -> bool:
            picture = self._latest.get(kind)
            return (picture is not None and picture.serial > after) or self._ended

        with self._changed:
            self._requested[kind] = time.monotonic() + timeout_s
            self._changed.wait_for(newer, timeout_s)
            self._requested[kind] = time.monotonic()
            picture = self._latest.get(kind)
            return picture if picture is not None and picture.serial > after else None

    def wanted(self, kind: PictureKind) -> bool:
        """Whether pictures of a kind were requested recently."""
        return self._idle_s is None or time.monotonic() - self._requested[kind] < self._idle_s

    def end(self) -> None:
        """Release all waiting threads."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()
