"""The tolerance study of a layout as files: expected figures of devices as built, and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from mirrorcam.core.disk.files import atomic, write_metrics
from mirrorcam.core.figures.figure_texts import label_text
from mirrorcam.core.values import Metric
from mirrorcam.designs.placed_axes import axes_at
from mirrorcam.optics.design.assess import monte_carlo
from mirrorcam.optics.design.assess.monte_carlo import CAUSES, Spread, Study
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import WORKMANSHIP, Tolerances

SHARE_UNIT = "of the mean square departure"
COLOURS = ("#4477aa", "#cc3311", "#228833", "#ddaa33", "#aa3377", "#777777")
PANELS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("Pixel efficiency, of a pinhole", "of the sensor", ("pixel_efficiency",)),
    ("Usable efficiency, unvignetted", "of the sensor", ("usable_efficiency",)),
    ("Overlap of the views", "of their union", ("overlap_iou",)),
    ("Grid error", "of a spacing", ("grid_error",)),
    ("Field of view", "deg", ("fov_x", "fov_y")),
    ("Decoded with the design", "error, px", ("uncalibrated_error",)),
    ("The same, between views", "error, px", ("misregistration",)),
    ("After calibration", "part", ("usable_window", "off_sensor")),
)
"""Title, unit and figures; figures of one unit share a scale."""
PANELS_PER_ROW = 4
WIDTH_IN, HEAD_IN, PANEL_IN, BAR_IN = 17.0, 0.9, 3.9, 0.3
MARGIN_IN = {"left": 0.85, "right": 0.25, "bottom": 0.65, "top": 0.45}
BARS_IN = {"left": 2.6, "right": 0.25, "bottom": 1.1, "top": 0.45}


def tolerance_metrics(study: Study) -> dict[str, Metric]:
    """The study as a flat table: tolerances, figures at each accuracy (a factor on them), and shares of causes."""
    metrics = {f"tolerance.{name}": _of_tolerance(study.tolerances, name) for name in WORKMANSHIP}
    metrics["devices"] = Metric(value=study.devices, unit="drawn")
    for accuracy, spreads in study.spreads.items():
        prefix = "" if accuracy == 1.0 else f"at_{accuracy:g}x."
        for name, spread in spreads.items():
            metrics |= {f"{prefix}{name}.{column}": metric for column, metric in spread_columns(spread).items()}
        metrics[f"{prefix}hidden_mirrors"] = hidden_mirrors(study, accuracy)
    for cause, shares in study.cause_fractions.items():
        for name, share in shares.items():
            metrics[f"share.{cause.replace(' ', '_')}.{name}"] = Metric(value=share, unit=SHARE_UNIT)
    return metrics


def write_tolerance(layout: Layout, tolerances: Tolerances, out: Path) -> Study:
    """Study a layout at the depths of its spec; write tolerance.json and tolerance.png into `out`."""
    study = monte_carlo.study(layout, tolerances, sorted(layout.designed_spec.depths_mm))
    write_metrics(out / "tolerance.json", tolerance_metrics(study))
    tolerance_figure(study, out / "tolerance.png")
    return study


def hidden_mirrors(study: Study, accuracy: float) -> Metric:
    """Fraction of devices in which a mirror occludes another, at a factor on the tolerances."""
    return Metric(value=study.hidden[accuracy], unit="of the devices")


def spread_columns(spread: Spread) -> dict[str, Metric]:
    """Design value, quantiles and median of a figure over the devices, by the title of their column."""
    values = {"design": spread.nominal, "p5": spread.low, "median": spread.median, "p95": spread.high}
    return {column: Metric(value=value, unit=spread.unit) for column, value in values.items()}


def _of_tolerance(tolerances: Tolerances, name: str) -> Metric:
    return Metric(value=getattr(tolerances, name), unit="deg" if name.endswith("_deg") else "mm")


def tolerance_figure(study: Study, path: Path) -> None:
    """Write a PNG: panels of figures over accuracy (median and 5 to 95 %), above the share of each tolerance."""
    figures = [*study.spreads[1.0]]
    panels = [
        (title, unit, names)
        for title, unit, stems in PANELS
        if (names := [name for stem in stems for name in figures if name.startswith(stem)])
    ]
    rows = -(-len(panels) // PANELS_PER_ROW)
    bars_in = BARS_IN["top"] + BAR_IN * len(figures) + BARS_IN["bottom"]
    height_in = HEAD_IN + PANEL_IN * rows + bars_in
    figure = Figure(figsize=(WIDTH_IN, height_in))
    figure.text(0.5, 1.0 - 0.3 / height_in, "What a maker can expect", ha="center", va="center", fontsize=16)
    subtitle = f"{study.devices} devices; 1x is one standard deviation of {study.tolerances.workmanship}"
    figure.text(0.5, 1.0 - 0.66 / height_in, subtitle, ha="center", va="center", fontsize=11)
    axes_by_unit: dict[str, list[Axes]] = {}
    for number, (title, unit, names) in enumerate(panels):
        row, column = divmod(number, PANELS_PER_ROW)
        width_in = WIDTH_IN / PANELS_PER_ROW
        left_in, bottom_in = column * width_in, height_in - HEAD_IN - (row + 1) * PANEL_IN
        axes = axes_at(figure, left_in, bottom_in, width_in, PANEL_IN, MARGIN_IN)
        _over_accuracy(axes, study, title, unit, names)
        axes_by_unit.setdefault(unit, []).append(axes)
    for same_unit in axes_by_unit.values():
        highest = max(axes.get_ylim()[1] for axes in same_unit)
        for axes in same_unit:
            axes.set_ylim(top=highest)
    _shares(axes_at(figure, 0.0, 0.0, WIDTH_IN, bars_in, BARS_IN), study, figures)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=110)


def _over_accuracy(axes: Axes, study: Study, title: str, unit: str, names: Sequence[str]) -> None:
    """Draw median and range of figures over accuracy; accuracy 0 is the design itself."""
    accuracies = [0.0, *study.spreads]
    for name, colour in zip(names, cycle(COLOURS)):
        spreads = [by_name[name] for by_name in study.spreads.values()]
        design = spreads[0].nominal
        low, median, high = (
            [design, *(getattr(spread, end) for spread in spreads)] for end in ("low", "median", "high")
        )
        axes.fill_between(accuracies, low, high, color=colour, alpha=0.15, linewidth=0)
        axes.plot(accuracies, median, "o-", color=colour, markersize=4, label=label_text(name))
    axes.set(title=title, xlabel="tolerances, times those below the title", ylabel=unit)
    axes.set_xlim(0.0, accuracies[-1])
    axes.set_xticks(accuracies)
    axes.tick_params(labelsize=9)
    if unit != "deg":
        axes.set_ylim(bottom=0.0)
    axes.grid(color="0.9", linewidth=0.8)
    axes.set_axisbelow(True)
    if len(names) > 1:
        axes.legend(frameon=False, fontsize=9)


def _shares(axes: Axes, study: Study, figures: Sequence[str]) -> None:
    """Draw the share of each tolerance in the spread of figures, as bars of equal length."""
    rows = np.arange(len(figures))
    start = np.zeros(len(figures))
    for cause, colour in zip(CAUSES, COLOURS, strict=True):
        if cause in study.cause_fractions:
            parts = np.array([study.cause_fractions[cause][name] for name in figures])
            axes.barh(rows, parts, left=start, color=colour, height=0.75, label=cause)
            start += parts
    axes.set(xlim=(0.0, 1.0), ylim=(len(figures) - 0.4, -0.6))
    axes.set_yticks(rows, [label_text(name) for name in figures], fontsize=9)
    axes.xaxis.set_major_formatter(PercentFormatter(1.0))
    axes.set_title("Share of each tolerance in the mean square deviation from the design, one at a time")
    if study.cause_fractions:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.09), ncols=len(COLOURS), frameon=False, fontsize=10)
