"""A few frames of many, spread evenly whatever their number."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from mirrorcam.core.video.frames import Frame, Lost
from mirrorcam.core.video.spread_frames import MOST, SpreadFrames, WatchedSource


@pytest.mark.parametrize("count", [1, 5, 8, 9, 16, 17, 100, 1000])
def test_frames_are_spread_evenly(count: int) -> None:
    spread = SpreadFrames()
    for number in range(count):
        spread.add(np.full(1, number, np.int64).astype(np.uint8) if count < 256 else np.array([number]))
    kept = [int(frame[0]) for frame in spread.kept]
    assert min(count, 5) <= len(kept) <= MOST
    steps = np.diff(kept)
    assert kept[0] == 0
    assert (steps == steps[:1]).all()
    assert count - kept[-1] <= 2 * (steps[0] if len(steps) else 1)


def test_a_watched_source_gives_the_same_frames_and_keeps_a_few() -> None:
    class Source:
        stopped = False

        def frames(self, after: int = -1) -> Iterator[Frame | Lost]:
            for number in range(after + 1, 40):
                yield Frame(number, number / 30.0, np.full((2, 2, 3), number, np.uint8))
            yield Lost(40, "is damaged")

        def stop(self) -> None:
            self.stopped = True

    source = Source()
    watched = WatchedSource(source)
    assert [item.number for item in watched.frames(9)] == list(range(10, 41))
    assert [int(frame[0, 0, 0]) for frame in watched.seen.kept] == [10, 14, 18, 22, 26, 30, 34, 38]
    watched.stop()
    assert source.stopped
