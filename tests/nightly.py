"""Cases of which a few stand for all by day; the others are for the nightly run."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def a_few(count: int, cases: Iterable[Any]) -> list[Any]:
    """Return the cases of a parametrised test, those past the first `count` marked as slow."""
    listed = list(cases)
    rest = [case if isinstance(case, tuple) else (case,) for case in listed[count:]]
    return [*listed[:count], *(pytest.param(*case, marks=pytest.mark.slow) for case in rest)]
