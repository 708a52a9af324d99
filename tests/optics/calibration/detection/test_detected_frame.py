"""What was detected in a picture holds finite places only, and does not change."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.detected_frame import DetectedFrame
from mirrorcam.optics.calibration.solver.observations import Observations


@pytest.mark.parametrize("middles", [np.zeros(2), np.zeros((1, 3)), np.array([[0.0, np.nan]])])
def test_what_is_no_place_in_a_picture_is_refused(middles: FloatArray) -> None:
    with pytest.raises(ValueError, match=r"expected \(k, 2\) of finite numbers"):
        DetectedFrame(Observations.none(), middles)


def test_places_are_kept_read_only() -> None:
    middles = np.zeros((1, 2))
    frame = DetectedFrame(Observations.none(), middles)
    middles[0] = 1.0
    assert frame.unassigned_px.tolist() == [[0.0, 0.0]]
    with pytest.raises(ValueError, match="read-only"):
        frame.unassigned_px[0, 0] = 1.0
    assert DetectedFrame(Observations.none()).unassigned_px.shape == (0, 2)
