"""A picture that contradicts the others is named first, and the fit without it is better."""

from __future__ import annotations

import pytest

from mirrorcam.optics.calibration.diagnostics.causes import ranked_causes
from mirrorcam.optics.calibration.diagnostics.left_out import left_out
from tests.nightly import a_few
from tests.optics.calibration.diagnostics.faults import fitted_with


@pytest.mark.parametrize("seed", a_few(1, range(5)))
def test_without_the_picture_residuals_and_bounds_are_smaller(seed: int) -> None:
    fitted, observations, index = fitted_with("picture", seed)
    found = left_out(fitted, ranked_causes(fitted, observations), observations)
    assert found is not None
    assert found.frames[0] == index
    assert found.rms_px[1] < found.rms_px[0]
    assert 0.0 < found.sigma_ratio < 1.0


def test_no_picture_is_left_out_for_another_cause() -> None:
    fitted, observations, _ = fitted_with("warp", 0)
    assert left_out(fitted, ranked_causes(fitted, observations), observations) is None
