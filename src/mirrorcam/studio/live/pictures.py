"""The newest picture of each kind of a live session, for whoever waits for the next one."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from mirrorcam.studio.live.values import PictureKind, Shown


@dataclass(frozen=True, eq=False)
class LivePicture:
    """A JPEG picture of a frame, counted from 1 in its kind.

    `depth_mm` (v, u) is beside a picture of depth, 0 where it is not known.
    """

    serial: int
    frame: int
    time_s: float
    jpeg: bytes
    depth_mm: NDArray[np.uint16] | None = None


class LivePictures:
    """The newest picture of each kind; any thread may put one, ask and wait.

    Parameters
    ----------
    idle_s
        Time after which pictures of a kind that nobody waits for are no longer wanted; None: they always are.
    """

    def __init__(self, idle_s: float | None) -> None:
        self._idle_s, self._asked = idle_s, dict.fromkeys(get_args(PictureKind), -np.inf)
        self._latest: dict[PictureKind, LivePicture] = {}
        self._changed, self._over = threading.Condition(), False

    def put(self, kind: PictureKind, shown: Shown, jpeg: bytes, depth_mm: NDArray[np.uint16] | None = None) -> None:
        """Replace the picture of a kind by one of a frame."""
        with self._changed:
            before = self._latest.get(kind)
            serial = 1 if before is None else before.serial + 1
            self._latest[kind] = LivePicture(serial, shown.number, shown.time_s, jpeg, depth_mm)
            self._changed.notify_all()

    def latest(self, kind: PictureKind) -> LivePicture | None:
        """The newest picture of a kind; None before the first."""
        with self._changed:
            return self._latest.get(kind)

    def wait_for(self, kind: PictureKind, after: int, timeout_s: float) -> LivePicture | None:
        """The newest picture of a kind whose serial number is beyond `after`; None where there is none in time."""

        def newer() -> bool:
            picture = self._latest.get(kind)
            return (picture is not None and picture.serial > after) or self._over

        with self._changed:
            self._asked[kind] = time.monotonic() + timeout_s
            self._changed.wait_for(newer, timeout_s)
            self._asked[kind] = time.monotonic()
            picture = self._latest.get(kind)
            return picture if picture is not None and picture.serial > after else None

    def wanted(self, kind: PictureKind) -> bool:
        """Whether someone was waiting for pictures of a kind lately."""
        return self._idle_s is None or time.monotonic() - self._asked[kind] < self._idle_s

    def end(self) -> None:
        """Let nobody wait any more."""
        with self._changed:
            self._over = True
            self._changed.notify_all()
