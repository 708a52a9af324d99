"""Limits of a score's figures, in a file: a figure's name and the most that it may be, or the least of a share."""

from __future__ import annotations

import re
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from mirrorcam.core.disk.files import LARGEST_TEXT_BYTES, read_bytes, toml_of
from mirrorcam.core.values import InputError, Metric, Value

OF_VIEWS = (
    *("rms_px", "median_px", "p95_px", "max_px", "rms_mm", "bias_x_px", "bias_y_px"),
    *("shown_share", "focal_error_percent"),
)
"""Figures of all views together, and of each as `view_ROW_COLUMN_NAME`."""
FIGURES = (
    *OF_VIEWS,
    *("worst_view_rms_px", "focal_error_rms_percent"),
    *("baseline_error_rms_mm", "baseline_error_max_mm", "baseline_error_percent"),
    *("angle_error_rms_deg", "angle_error_max_deg"),
    *("triangulation_rms_mm", "triangulation_median_mm", "triangulation_max_mm", "scale_error_percent"),
    *("nees", "nees_low", "nees_high", "nees_freedom"),
)
"""All figures of a score, in their order."""
AT_LEAST = frozenset({"shown_share"})
"""Figures whose limit is the least that they may be; of all others it is the most that their size may be."""
OVER_SETS = "over_sets"
_OF_VIEW = re.compile(r"view_\d+_\d+_(.+)")


class Limits(Value):
    """Limits by the names of figures: of each set, and of means over sets."""

    each: dict[str, float]
    over_sets: dict[str, float]

    @classmethod
    def load(cls, path: Path) -> Limits:
        """Read a TOML file; raises InputError in one line for a name of no figure, or a value that is no limit."""
        tables = toml_of(path, read_bytes(path, LARGEST_TEXT_BYTES))
        over = tables.pop(OVER_SETS, {})
        if not isinstance(over, dict):
            raise InputError(f"{path}: {OVER_SETS}: expected a table of limits")
        return cls(each=_checked(path, tables), over_sets=_checked(path, over))


class Check(Value):
    """Whether a figure keeps its limit; a figure that is not given does not, and `reason` says why."""

    figure: str
    value: float | None
    unit: str
    limit: float
    at_least: bool
    passed: bool
    reason: str = ""


def _checked(path: Path, tables: Mapping[str, object]) -> dict[str, float]:
    limits = {}
    for name, value in tables.items():
        if figure_of(name) not in FIGURES:
            meant = get_close_matches(name, FIGURES, n=1)
            hint = f"did you mean {meant[0]}?" if meant else "expected a figure of `mirrorcam score`, such as rms_px"
            raise InputError(f"{path}: no figure {name[:40]!r}, {hint}")
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= float(value) < np.inf:
            raise InputError(f"{path}: {name}: {str(value)[:40]!r}, expected a limit of 0 or more")
        limits[name] = float(value)
    return limits


def figure_of(name: str) -> str:
    """The figure that a name means, without the view; one that views do not have is left with it."""
    found = _OF_VIEW.fullmatch(name)
    return found[1] if found and found[1] in OF_VIEWS else name


def checks(
    limits: Mapping[str, float], figures: Mapping[str, Metric], not_given: Mapping[str, str]
) -> tuple[Check, ...]:
    """Whether each limit is kept."""
    found = []
    for name, limit in limits.items():
        metric, at_least = figures.get(name), figure_of(name) in AT_LEAST
        if metric is None or not metric.known:
            reason = not_given.get(name, "not given") if metric is None else metric.reason
            found.append(
                Check(figure=name, value=None, unit="", limit=limit, at_least=at_least, passed=False, reason=reason)
            )
            continue
        passed = metric.value >= limit if at_least else abs(metric.value) <= limit
        found.append(
            Check(figure=name, value=metric.value, unit=metric.unit, limit=limit, at_least=at_least, passed=passed)
        )
    return tuple(found)
