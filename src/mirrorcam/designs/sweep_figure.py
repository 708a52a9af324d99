"""Trade-offs between designs of a sweep: field of view for depth of field, grid error for efficiency."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mirrorcam.core.disk.files import atomic
from mirrorcam.designs.placed_axes import axes_at
from mirrorcam.optics.design.assess.layout_metrics import MAX_DEPTH_MM
from mirrorcam.optics.design.spec_grid import Outcome, pareto_front, summary_figures

FRONT, BEST = "#bbbbbb", "#333333"
WIDTH_IN, HEIGHT_IN = 15.0, 10.0
LEGEND_IN, LEGEND_COLUMN_IN = 1.0, 0.85
MARGIN_IN = {"left": 0.8, "right": 0.25, "bottom": 0.85, "top": 0.55}
LEGEND_ROWS = 30
MAX_COUNT_LABELS, MAX_HORIZONTAL_LABELS = 16, 6
FAINT = 0.35


@dataclass(frozen=True)
class Axis:
    """A figure of merit: name, unit, value of an outcome, and whether larger is better."""

    name: str
    unit: str
    value: Callable[[Outcome], float | None]
    larger_is_better: bool = True


def _figure(name: str) -> Callable[[Outcome], float | None]:
    return lambda outcome: summary_figures(outcome)[name]


def _grid_error(outcome: Outcome) -> float | None:
    figure = outcome.metrics["grid_error"]
    return figure.value if figure.known else None


FIELD_OF_VIEW = Axis("field of view", "diagonal, deg", _figure("fov_diagonal_deg"))
DEPTH_OF_FIELD = Axis("depth of field", "1/near - 1/far, 1/m", _figure("depth_of_field_per_m"))
GRID_ERROR = Axis("grid error", "of a spacing", _grid_error, larger_is_better=False)
EFFICIENCY = Axis("pixel efficiency", "mean of the depths", _figure("pixel_efficiency_mean"))


def count_colours(outcomes: Sequence[Outcome]) -> dict[tuple[int, int], str]:
    """Colour of each count (rows, cols): the more mirrors, the lighter."""
    counts = sorted({_count(outcome) for outcome in outcomes}, key=lambda count: (count[0] * count[1], count))
    shades = matplotlib.colormaps["plasma"](np.linspace(0.0, 0.88, len(counts)))
    return {count: to_hex(shade) for count, shade in zip(counts, shades, strict=True)}


def _count(outcome: Outcome) -> tuple[int, int]:
    return outcome.spec.rows, outcome.spec.cols


def _reaches_infinity(outcome: Outcome) -> bool:
    farthest = outcome.metrics.get("depth_farthest_mm")
    return farthest is not None and farthest.value >= MAX_DEPTH_MM


def pareto(outcomes: Sequence[Outcome], path: Path) -> None:
    """Write a PNG of the solved outcomes: two trade-offs above, each figure over the count of mirrors below.

    Raises ValueError if none is solved.
    """
    solved = [outcome for outcome in outcomes if outcome.status == "solved"]
    if not solved:
        raise ValueError(f"no solved design among {len(outcomes)}, expected one or more")
    colours = count_colours(solved)
    columns = -(-len(colours) // LEGEND_ROWS)
    width_in = WIDTH_IN - LEGEND_IN - LEGEND_COLUMN_IN * columns
    figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN))
    above = HEIGHT_IN * 0.42
    for column, (x, y) in enumerate(((FIELD_OF_VIEW, DEPTH_OF_FIELD), (GRID_ERROR, EFFICIENCY))):
        axes = axes_at(figure, column * width_in / 2.0, above, width_in / 2.0, HEIGHT_IN - above, MARGIN_IN)
        _trade_off(axes, solved, x, y, colours)
    for column, axis in enumerate((FIELD_OF_VIEW, DEPTH_OF_FIELD, GRID_ERROR, EFFICIENCY)):
        axes = axes_at(figure, column * width_in / 4.0, 0.0, width_in / 4.0, above, MARGIN_IN)
        _against_count(axes, solved, axis, colours)
    _legend(figure, colours, columns, endless=any(_reaches_infinity(outcome) for outcome in solved))
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=110)


def _finish(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title, fontsize=12)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.tick_params(labelsize=9)
    axes.grid(color="#eeeeee", linewidth=0.8)
    axes.set_axisbelow(True)


def _front(points: Sequence[tuple[float, float]], x: Axis, y: Axis) -> list[tuple[float, float]]:
    """The points of the Pareto front, along it."""
    signs = [1.0 if axis.larger_is_better else -1.0 for axis in (x, y)]
    return [points[number] for number in pareto_front([(signs[0] * a, signs[1] * b) for a, b in points])]


def _trade_off(axes: Axes, solved: Sequence[Outcome], x: Axis, y: Axis, colours: dict[tuple[int, int], str]) -> None:
    """Plot two figures of merit against each other, with each count's Pareto front and, wider, the overall front."""
    points = [
        (a, b, outcome)
        for outcome in solved
        if (a := x.value(outcome)) is not None and (b := y.value(outcome)) is not None
    ]
    overall = _front([(a, b) for a, b, _ in points], x, y)
    # Steps: between two designs of the front, only the worse value of each figure is certain to be achieved.
    axes.plot(*np.array(overall).reshape(-1, 2).T, color=FRONT, linewidth=5.0, drawstyle="steps-pre", zorder=1)
    for count, colour in colours.items():
        count_points = [(a, b, outcome) for a, b, outcome in points if _count(outcome) == count]
        front = _front([(a, b) for a, b, _ in count_points], x, y)
        axes.plot(*np.array(front).reshape(-1, 2).T, color=colour, linewidth=1.3, zorder=2)
        for a, b, outcome in count_points:
            on_front = (a, b) in front
            style: dict[str, Any] = {"marker": "^" if _reaches_infinity(outcome) and DEPTH_OF_FIELD in (x, y) else "o"}
            style |= {"markersize": 7.5 if on_front else 5.0, "alpha": 1.0 if on_front else FAINT}
            edge = "white" if on_front else colour
            axes.plot(a, b, color=colour, markeredgecolor=edge, zorder=4 if on_front else 3, **style)
    axes.margins(0.06)
    better = "right" if x.larger_is_better else "left"
    title = f"{x.name.capitalize()} against {y.name} (better: up, {better})"
    _finish(axes, title, f"{x.name}, {x.unit}", f"{y.name}, {y.unit}")


def _against_count(axes: Axes, solved: Sequence[Outcome], axis: Axis, colours: dict[tuple[int, int], str]) -> None:
    """Plot one figure of merit of every design over its count, and a line through the best of each count."""
    best: list[tuple[float, float]] = []
    for column, (count, colour) in enumerate(colours.items()):
        all_values = [axis.value(outcome) for outcome in solved if _count(outcome) == count]
        values = [value for value in all_values if value is not None]
        if not values:
            continue
        spread = np.linspace(-0.28, 0.28, len(values)) if len(values) > 1 else np.zeros(1)
        axes.plot(column + spread, values, "o", color=colour, markersize=4.0, alpha=0.7, zorder=2)
        best_index = int(np.argmax(values) if axis.larger_is_better else np.argmin(values))
        best.append((column + float(spread[best_index]), values[best_index]))
    axes.plot(*np.array(best).reshape(-1, 2).T, color=BEST, linewidth=1.1, zorder=1)
    labelled = list(enumerate(colours))[:: -(-len(colours) // MAX_COUNT_LABELS)]
    names = [f"{rows}x{cols}" for _, (rows, cols) in labelled]
    axes.set_xticks(
        [column for column, _ in labelled], names, rotation=90 if len(labelled) > MAX_HORIZONTAL_LABELS else 0
    )
    axes.set_xlim(-0.6, len(colours) - 0.4)
    _finish(axes, f"{axis.name.capitalize()} by count", "rows x columns of mirrors", f"{axis.name}, {axis.unit}")


def _legend(figure: Figure, colours: dict[tuple[int, int], str], columns: int, *, endless: bool) -> None:
    """Draw the legend in a strip to the right of all panels, so that it covers no data."""
    plain: dict[str, Any] = {"linestyle": "none", "color": BEST}
    marks = [
        Line2D([], [], color=FRONT, linewidth=5.0, label="front of all"),
        Line2D([], [], color=BEST, linewidth=1.3, marker="o", markeredgecolor="white", label="front of a count"),
        Line2D([], [], marker="o", markersize=5.0, alpha=FAINT, label="dominated", **plain),
        Line2D([], [], color=BEST, linewidth=1.1, label="best of a count"),
    ]
    if endless:
        marks.append(Line2D([], [], marker="^", markersize=7.5, label="reaches 100 m\nor more", **plain))
    left = 1.0 - (LEGEND_IN + LEGEND_COLUMN_IN * columns) / WIDTH_IN
    style: dict[str, Any] = {"frameon": False, "fontsize": 9, "borderaxespad": 0.0}
    figure.legend(handles=marks, loc="upper left", bbox_to_anchor=(left, 1.0 - MARGIN_IN["top"] / HEIGHT_IN), **style)
    count_handles = [
        Line2D([], [], color=colour, marker="o", label=f"{rows}x{cols}") for (rows, cols), colour in colours.items()
    ]
    figure.legend(handles=count_handles, loc="upper left", ncols=columns, bbox_to_anchor=(left, 0.80), **style)
