"""Requests that a designer may ask for next, so that they are solved by then."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mirrorcam.core.values import InvalidValue
from mirrorcam.optics.geometry.design_spec import DesignSpec

MOST_MIRRORS = 25
"""Designs of more mirrors take too long to be solved on suspicion."""

Change = Callable[[DesignSpec], dict[str, Any]]


def _count(name: str, by: int) -> Change:
    return lambda spec: {name: getattr(spec, name) + by}


def _times(name: str, factor: float) -> Change:
    return lambda spec: {name: round(getattr(spec, name) * factor)}


def _plus(name: str, by: float) -> Change:
    return lambda spec: {name: round(getattr(spec, name) + by, 3)}


CHANGES: tuple[Change, ...] = (
    *(_count(name, by) for by in (1, -1) for name in ("rows", "cols")),
    *(_times("scale_mm", factor) for factor in (1.3, 1 / 1.3)),
    *(_plus("tradeoff", by) for by in (0.2, -0.2)),
)


def nearby_requests(spec: DesignSpec) -> list[DesignSpec]:
    """Requests one step from this one, the likeliest first; none of more mirrors than are solved in a few seconds."""
    found = []
    for change in CHANGES:
        fields = change(spec)
        if spec.pattern is not None and fields.keys() & {"rows", "cols"}:
            continue
        try:
            other = spec.replaced(**fields)
        except InvalidValue:
            continue  # beyond what a request can hold, such as no rows
        if len(other.arrangement.steps) <= MOST_MIRRORS:
            found.append(other)
    return found
