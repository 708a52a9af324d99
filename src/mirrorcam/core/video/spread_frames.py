"""A few frames spread evenly over a stream whose length is not known beforehand."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.video.frames import Frame, Lost, Source

MOST = 8


class SpreadFrames:
    """Keeps every first, second, fourth, ... frame of those that are added: at most 8, and 5 or more of 9 or more."""

    def __init__(self) -> None:
        self.kept: list[NDArray[np.uint8]] = []
        self._added, self._stride = 0, 1

    def add(self, frame: NDArray[np.uint8]) -> None:
        """Take the next frame, which is not copied."""
        if self._added % self._stride == 0:
            self.kept.append(frame)
            if len(self.kept) > MOST:
                self.kept, self._stride = self.kept[::2], 2 * self._stride
        self._added += 1


@dataclass(frozen=True)
class WatchedSource:
    """A source of frames of which a few, spread evenly, are kept as they pass."""

    source: Source
    seen: SpreadFrames = field(default_factory=SpreadFrames)

    def frames(self, after: int = -1) -> Iterator[Frame | Lost]:
        """The frames of the source."""
        for item in self.source.frames(after):
            if isinstance(item, Frame):
                self.seen.add(item.pixels)
            yield item

    def stop(self) -> None:
        """End the frames, also where they wait for one."""
        self.source.stop()
