"""Sweeps over designs: a grid of specs, the outcome for each, and the rows of their table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import InvalidValue, Metric, Value
from mirrorcam.optics.geometry.design_spec import GAVE_UP, DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.rectangle_sizes import FREE

if TYPE_CHECKING:
    from mirrorcam.optics.geometry.layout import Layout

Status = Literal["solved", "infeasible", "failed"]
Cell = str | int | float | list[float] | None


class Outcome(Value):
    """The outcome for one spec: its figures, the constraint that cannot be met, or the error."""

    spec: DesignSpec
    status: Status
    constraint: str = ""
    finding: str = ""
    metrics: dict[str, Metric] = Field(default_factory=dict)


def grid(
    common: DesignSpec,
    *,
    counts: Sequence[tuple[int, int]],
    depth_sets_mm: Sequence[tuple[float, ...]],
    scales_mm: Sequence[float],
    tradeoffs: Sequence[float],
) -> tuple[DesignSpec, ...]:
    """All combinations of counts (rows, cols), depths, scales and trade-offs, in this order, the last varying fastest.

    All other fields are taken from `common`. Raises InputError for an invalid or duplicate value.
    """
    axes: dict[str, list[dict[str, Any]]] = {
        "counts": [{"rows": rows, "cols": cols} for rows, cols in counts],
        "depth_sets_mm": [{"depths_mm": depths} for depths in depth_sets_mm],
        "scales_mm": [{"scale_mm": scale} for scale in scales_mm],
        "tradeoffs": [{"tradeoff": tradeoff} for tradeoff in tradeoffs],
    }
    fields = {name: getattr(common, name) for name in DesignSpec.model_fields}
    for axis, choices in axes.items():
        if not choices:
            raise InputError(f"{axis}: no value, expected one or more")
        for choice in choices:
            text = "x".join(str(value) for value in choice.values())
            if choices.count(choice) > 1:
                raise InputError(f"{axis}: {text} is given twice")
            try:
                DesignSpec(**(fields | choice))
            except InvalidValue as error:
                raise InputError(f"{axis}: {text}: {error}") from None
    combined = (
        {key: value for choice in choices for key, value in choice.items()} for choices in product(*axes.values())
    )
    return tuple(DesignSpec(**(fields | choice)) for choice in combined)


def structure(spec: DesignSpec) -> tuple[int, int, int, int, str, bool]:
    """Key that identifies the structure of a spec's nonlinear program."""
    return spec.rows, spec.cols, len(spec.depths_mm), spec.sides, spec.surface, spec.shape == FREE


def solve(spec: DesignSpec) -> tuple[Outcome, Layout | None]:
    """Design one spec; returns the layout if there is one. Any error becomes the outcome and does not stop a sweep."""
    from mirrorcam.optics.design.optimise import design

    try:
        layout = design(spec)
    except InfeasibleDesign as refusal:
        status: Status = "failed" if refusal.constraint == GAVE_UP else "infeasible"
        return Outcome(spec=spec, status=status, constraint=refusal.constraint, finding=refusal.finding), None
    except Exception as error:
        finding = " ".join(f"{type(error).__name__}: {error}".split())
        return Outcome(spec=spec, status="failed", finding=finding), None
    return Outcome(spec=spec, status="solved", metrics=layout.metrics), layout


def summary_figures(outcome: Outcome) -> dict[str, float | None]:
    """Figures that compare designs with any counts and depths; None for an unknown figure.

    `pixel_efficiency_mean` is the mean over the depths of the spec, `fov_diagonal_deg` the diagonal field of view.
    `depth_of_field_per_m` is the depth range in which views overlap as 1/nearest - 1/farthest: it is proportional to
    disparity and finite for an infinite range.
    """
    values = {name: metric.value for name, metric in outcome.metrics.items() if metric.known}
    efficiencies = [values.get(f"pixel_efficiency_{depth_mm:g}mm") for depth_mm in outcome.spec.depths_mm]
    defined = [efficiency for efficiency in efficiencies if efficiency is not None]
    fov_x, fov_y = values.get("fov_x_deg"), values.get("fov_y_deg")
    nearest_mm, farthest_mm = values.get("depth_nearest_mm"), values.get("depth_farthest_mm")
    diagonal = depth_of_field = None
    if fov_x is not None and fov_y is not None:
        halves = [math.tan(math.radians(angle) / 2.0) for angle in (fov_x, fov_y)]
        diagonal = 2.0 * math.degrees(math.atan(math.hypot(*halves)))
    if nearest_mm is not None and farthest_mm is not None:
        depth_of_field = 1e3 / nearest_mm - 1e3 / farthest_mm
    return {
        "pixel_efficiency_mean": sum(defined) / len(defined) if defined else None,
        "fov_diagonal_deg": diagonal,
        "depth_of_field_per_m": depth_of_field,
    }


def pareto_front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the Pareto-optimal points (larger coordinates are better), by increasing first coordinate.

    Only the first of equal points is included.
    """
    front: list[int] = []
    for number in sorted(range(len(points)), key=lambda k: (-points[k][0], -points[k][1], k)):
        if not front or points[number][1] > points[front[-1]][1]:
            front.append(number)
    return front[::-1]


def rows_of(outcomes: Sequence[Outcome]) -> list[dict[str, Cell]]:
    """A row for each outcome with the same columns: spec, outcome and figures; None for an unknown figure.

    Names of figures contain their units. `camera` is the camera's name. `none` lists the reasons for figures that a
    solved design does not have.
    """
    names = list(dict.fromkeys(name for outcome in outcomes for name in outcome.metrics))
    rows: list[dict[str, Cell]] = []
    for outcome in outcomes:
        spec = outcome.spec.model_dump(mode="json", exclude={"camera"})
        row: dict[str, Cell] = {"camera": outcome.spec.camera.name} | spec
        row |= {"status": outcome.status, "constraint": outcome.constraint, "finding": outcome.finding}
        row |= summary_figures(outcome)
        row |= {"none": "; ".join(f"{name}: {m.reason}" for name, m in outcome.metrics.items() if not m.known)}
        row |= {name: m.value if (m := outcome.metrics.get(name)) and m.known else None for name in names}
        rows.append(row)
    return rows
