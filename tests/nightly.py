"""Parametrised tests of which the default run takes the first cases, and the nightly run the others."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def a_few(count: int, cases: Iterable[Any]) -> list[Any]:
    """Return the cases of a parametrised test, those past the first `count` marked as slow."""
    return [case if number < count else _slow(case) for number, case in enumerate(cases)]


def _slow(case: Any) -> Any:
    if hasattr(case, "marks"):
        return pytest.param(*case.values, marks=[*case.marks, pytest.mark.slow], id=case.id)
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow)
