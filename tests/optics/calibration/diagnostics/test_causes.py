"""The cause of a misfit is named first, and none is named without one."""

from __future__ import annotations

from typing import get_args

import pytest

from mirrorcam.optics.calibration.diagnostics.causes import CauseKind
from tests.nightly import a_few
from tests.optics.calibration.diagnostics.faults import FAULTS, causes_of


@pytest.mark.parametrize("seed", a_few(1, range(5)))
@pytest.mark.parametrize("kind", list(FAULTS))
def test_the_right_cause_comes_first(kind: CauseKind, seed: int) -> None:
    causes, index = causes_of(kind, seed)
    assert (causes[0].kind, causes[0].index) == (kind, index)


@pytest.mark.parametrize("seed", a_few(4, range(40)))
def test_without_a_fault_none_is_named(seed: int) -> None:
    assert causes_of(None, seed)[0] == []


def test_every_kind_is_simulated() -> None:
    with_a_direct_view = {"turn", "board"}  # tests of direct views
    assert set(FAULTS) == set(get_args(CauseKind)) - with_a_direct_view
