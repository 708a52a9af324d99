"""Compare two calibrations from files, and write the result as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from mirrorcam.core.disk.files import atomic, write_metrics
from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import SIGMA
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.calibration.diagnostics.calibration_difference import (
    CalibrationDifference,
    ViewDifference,
    calibration_difference,
    view_label,
)
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import outline_px
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.camera_files.read.registry import formats_in, reason_unread
from mirrorcam.optics.geometry.layout import Layout, working_distance_mm

FILES = ("difference.png", "metrics.json")
KINDS = ("difference", "sigma")
HEIGHT_RATIO = 0.3, 1.5
"""Minimum and maximum height of a panel, relative to its width."""
MARGIN = 0.02
"""Space around the views of a panel, relative to their extent."""
LABEL_FRACTION = 0.4
"""Width of a label, relative to the width of its view."""
LONGEST_ARROW = 0.9
"""Length, in cells, of the arrow of the largest difference."""


def compare_files(a: Path, b: Path, distance_mm: float | None) -> CalibrationDifference:
    """Compare two `layout.json` files for points at a distance from each view, by default the distance of A's board.

    Raises InputError if a file cannot be read, if the devices differ, or if A states no distance.
    """
    layout, other = read_compared(a), read_compared(b)
    if distance_mm is None:
        distance_mm = working_distance_mm(layout)
    if distance_mm is None:
        raise InputError(f"{a}: no working distance in it, expected --distance-mm MM")
    try:
        return calibration_difference(layout, other, range_mm=distance_mm)
    except InputError as error:
        raise InputError(f"{a} and {b}: {error}") from None


def read_compared(path: Path) -> Layout:
    """Read a layout; the InputError for a different file names its format if it is another tool's calibration."""
    try:
        return Layout.load(path)
    except InputError:
        if not path.is_file():
            raise
        other_formats = [name for name in formats_in(path) if name != "mirrorcam"]
        description = f"a calibration as {other_formats[0]}" if other_formats else reason_unread(path)
        if not description:
            raise
        raise InputError(f"{path}: {description}, expected a layout.json, as `mirrorcam calibrate` writes it") from None


def comparison_metrics(difference: CalibrationDifference, layout: Layout) -> dict[str, Metric]:
    """The figures of a comparison: for all views together, for the motion of the rig, and for each view."""
    metrics = {"distance_mm": Metric(value=difference.range_mm, unit="mm")}
    metrics |= {f"all_{name}": figure for name, figure in difference.metrics(difference.views).items()}
    metrics |= difference.motion
    for view in difference.views:
        row, column = divmod(view.view, layout.cols)
        name = "direct" if view.view == DIRECT else f"view_{row}_{column}"
        metrics |= {f"{name}_{key}": figure for key, figure in difference.metrics([view]).items()}
    return metrics


def write_comparison(difference: CalibrationDifference, layout: Layout, folder: Path) -> None:
    """Write difference.png and metrics.json into a folder, each atomically; `layout` is A's."""
    write_metrics(folder / "metrics.json", comparison_metrics(difference, layout))
    difference_figure(difference, layout, folder / "difference.png")


PANEL_IN, ROW_IN, BAR_IN, HEAD_IN = 7.0, 0.7, 1.2, 0.3


def difference_figure(difference: CalibrationDifference, layout: Layout, path: Path) -> None:
    """Write a PNG: the difference in every view where the sensor has it, and its predicted sigma, in px and in mm.

    Panels with the same unit have a common scale. The direct view, which overlaps the sub-images, has its own rows.
    """
    mirrors = [view for view in difference.views if view.view != DIRECT]
    direct = [view for view in difference.views if view.view == DIRECT]
    rows = [(unit, views) for unit in ("px", "mm") for views in (mirrors, direct) if views]
    columns = 2 if any(difference.predicted) else 1
    sizes = [np.diff(panel_extent(layout, views), axis=0)[0] for _, views in rows]
    heights_in = [PANEL_IN * float(np.clip(high / wide, *HEIGHT_RATIO)) + ROW_IN for wide, high in sizes]
    figure = Figure(figsize=(columns * PANEL_IN + BAR_IN, sum(heights_in) + HEAD_IN), layout="constrained")
    panels = figure.subplots(len(rows), columns, squeeze=False, height_ratios=heights_in)
    for (unit, views), axes in zip(rows, panels, strict=True):
        max_value = max(float(np.max(_values(view, unit, kind))) for view in difference.views for kind in KINDS)
        cells_drawn = draw_map(axes[0], layout, views, [_values(view, unit, "difference") for view in views], max_value)
        longest_px = draw_arrows(axes[0], views)
        axes[0].set_title(f"difference, {unit} (RMS of each view; longest arrow: {longest_px:.2g} px)")
        if columns == 2:
            draw_map(axes[1], layout, views, [_values(view, unit, "sigma") for view in views], max_value)
            axes[1].set_title(f"predicted {SIGMA}{_which_sigma(difference)}, {unit} (RMS of each view)")
        figure.colorbar(cells_drawn, ax=axes, label=unit, fraction=0.03, pad=0.01)
    rotation, shift = (difference.motion[f"motion_{name}"].value for name in ("turn_deg", "shift_mm"))
    removed = f"a motion of the rig by {rotation:.2g}° and {shift:.2g} mm is removed"
    figure.suptitle(f"B minus A of points {difference.range_mm:.0f} mm from each view; {removed}")
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=110, metadata={"Software": None})


def _values(view: ViewDifference, unit: str, kind: str) -> FloatArray:
    """Values (n,) of a view in a panel."""
    if unit == "mm":
        return view.difference_mm if kind == "difference" else view.sigma_mm
    return view.length_px if kind == "difference" else view.sigma_px


def panel_extent(layout: Layout, views: list[ViewDifference]) -> FloatArray:
    """Minimum and maximum pixel (2, 2) of a panel that shows some views, with a margin."""
    outlines = np.concatenate([outline_px(layout, view.view) for view in views])
    low, high = outlines.min(axis=0), outlines.max(axis=0)
    return np.array([low, high]) + MARGIN * (high - low).max() * np.array([[-1.0], [1.0]])


def _which_sigma(difference: CalibrationDifference) -> str:
    if all(difference.predicted):
        return ""
    return " of A alone" if difference.predicted[0] else " of B alone"


def _cell_px(view: ViewDifference) -> tuple[float, float]:
    """Width and height of the cells of a view's map."""
    steps = [float(np.diff(np.unique(view.pixels[:, k].round(3))).min(initial=np.inf)) for k in range(2)]
    width, height = (step if np.isfinite(step) else min(steps) for step in steps)
    return width, height


def draw_map(
    axes: Axes, layout: Layout, views: list[ViewDifference], values: list[FloatArray], max_value: float
) -> PatchCollection:
    """Draw the cells of views, clipped to outlines, with name and RMS; return one view's cells, for the colour bar."""
    (left, top), (right, bottom) = panel_extent(layout, views)
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    axes.set(xlabel="x px", ylabel="y px", facecolor="0.93")
    for view, value in zip(views, values, strict=True):
        width, height = _cell_px(view)
        cells = [Rectangle((u - width / 2, v - height / 2), width, height) for u, v in view.pixels.tolist()]
        cells_drawn = PatchCollection(cells, cmap="viridis", edgecolor="face", linewidth=0.3)
        cells_drawn.set_array(value)
        cells_drawn.set_clim(0.0, max(max_value, 1e-12))
        axes.add_collection(cells_drawn)
        outline = outline_px(layout, view.view)
        cells_drawn.set_clip_path(axes.add_patch(Polygon(outline, facecolor="none", edgecolor="0.3", linewidth=0.8)))
        rms = float(np.sqrt(np.mean(value**2)))
        x, y = _label_position(outline)
        axes.annotate(
            f"{view_label(layout, view.view).removeprefix('mirror ')}: {rms:.2g}",
            (x, y),
            (0, -3),
            textcoords="offset points",
            ha="center",
            va="top",
            fontsize=8,
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.75},
        )
    return cells_drawn


def _label_position(outline: FloatArray) -> tuple[float, float]:
    """Top centre (x, y) of a label within an outline (n, 2), which may be slanted."""
    polygon = shapely.Polygon(outline)
    left, top, right, bottom = polygon.bounds
    centre, half = polygon.centroid.x, LABEL_FRACTION * (right - left) / 2.0
    columns = [shapely.LineString([(x, top), (x, bottom)]) for x in (centre - half, centre, centre + half)]
    return centre, max(polygon.intersection(column).bounds[1] for column in columns)


def draw_arrows(axes: Axes, views: list[ViewDifference]) -> float:
    """Draw the difference in every cell as an arrow, with one scale for all views; returns the longest in px."""
    pixels, arrows = (np.concatenate([getattr(view, name) for view in views]) for name in ("pixels", "difference_px"))
    longest = float(np.linalg.norm(arrows, axis=1).max())
    gain = LONGEST_ARROW * min(min(_cell_px(view)) for view in views) / max(longest, 1e-12)
    axes.quiver(
        *pixels.T, *(gain * arrows.T), angles="xy", scale_units="xy", scale=1, width=0.0018, color="white", pivot="mid"
    )
    return longest
