"""Where a verdict says that corners lack, and with which noise it judges."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.verdict import empty_region
from mirrorcam.optics.calibration.diagnostics.view_statistics import view_figures
from tests.optics.calibration.sound_calibration import (
    rows_of,
    sound_calibration,
)


@pytest.fixture
def calibration() -> Calibration:
    return sound_calibration()


@pytest.mark.parametrize(("corner", "words"), [((0, 0), "at the top left"), ((1, 1), "at the bottom right")])
def test_the_empty_region_is_where_no_corner_was_seen(
    calibration: Calibration, corner: tuple[int, int], words: str
) -> None:
    seen, outline_px = calibration.observations, calibration.layout.outline_px(0)
    low, high = outline_px.min(axis=0), outline_px.max(axis=0)
    place = (seen.pixels - low) / (high - low)
    near = (np.abs(place - corner) < 0.45).all(axis=1)
    views = view_figures(rows_of(calibration, (seen.view != 0) | ~near))
    assert empty_region(views[0]) == words
    assert views[0].coverage < 0.9 * view_figures(calibration)[0].coverage
