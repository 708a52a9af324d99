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
    assert causes[0].kind == kind
    assert index is None or index == (causes[0].frame if kind == "picture" else causes[0].mirror)


@pytest.mark.parametrize("seed", a_few(4, range(40)))
def test_without_a_fault_none_is_named(seed: int) -> None:
    assert causes_of(None, seed)[0] == []


def test_every_kind_is_simulated() -> None:
    """But an irregular print, which is tried without mirrors alone (`test_plain_camera`)."""
    assert {*FAULTS, "print"} == set(get_args(CauseKind))
