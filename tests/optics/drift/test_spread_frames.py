"""A few frames of many, spread evenly whatever their number."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.drift.spread_frames import MOST, SpreadFrames


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
