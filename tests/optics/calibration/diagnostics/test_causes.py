"""The cause of a misfit is named first, and none is named without one."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from mirrorcam.optics.calibration.diagnostics.causes import ranked_causes
from mirrorcam.optics.calibration.diagnostics.nested_models import fit_with
from mirrorcam.optics.calibration.diagnostics.score_test import CauseKind
from tests.nightly import a_few
from tests.optics.calibration.diagnostics.faults import FAULTS, KINDS, NOISE_PX, causes_of, fitted_with


@pytest.mark.parametrize("seed", a_few(1, range(5)))
@pytest.mark.parametrize("fault", list(FAULTS))
def test_the_right_cause_comes_first(fault: str, seed: int) -> None:
    causes, index = causes_of(fault, seed)
    assert causes[0].kind == KINDS.get(fault, fault)
    assert index == (causes[0].frame if causes[0].mirror is None else causes[0].mirror)


@pytest.mark.parametrize("seed", a_few(4, range(40)))
def test_without_a_fault_none_is_named(seed: int) -> None:
    assert causes_of(None, seed)[0] == []


def test_every_kind_is_simulated() -> None:
    with_a_direct_view = {"turn", "board"}  # tests of direct views
    assert {KINDS.get(fault, fault) for fault in FAULTS} == set(get_args(CauseKind)) - with_a_direct_view


@pytest.mark.parametrize("seed", a_few(1, range(5)))
def test_a_model_of_motion_removes_the_effect_of_a_rolling_shutter(seed: int) -> None:
    fitted, observations, _ = fitted_with("shutter", seed)
    assert ranked_causes(fitted, observations)[0].addition == "motion"
    moving = fit_with("motion", fitted, observations)
    assert all(cause.kind != "shutter" for cause in ranked_causes(moving, observations))
    assert np.max(moving.solution.rms_px) < 1.05 * NOISE_PX < np.max(fitted.solution.rms_px)
    assert moving.solution.scale == pytest.approx(1.0, abs=0.05)
