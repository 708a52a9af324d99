"""Figures of a design: next to the faceted parabola (tech report, figure "OptimizingMirrorCam"), and its focus."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patches import Polygon as PolygonPatch
from matplotlib.patheffects import withStroke
from shapely import Polygon, union_all

from mirrorcam.core.disk.files import atomic
from mirrorcam.core.values import FloatArray
from mirrorcam.designs.placed_axes import axes_at
from mirrorcam.optics.design.assess.focus import CIRCLE_LIMIT_PX, best_focus_mm, circles_px, inverse_depths_per_mm
from mirrorcam.optics.design.assess.layout_metrics import fitted_grid, grid_error
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import common_region, fields_of_view, pixel_efficiency, region_outline_px

MIRROR, VIEW, RAY, GRID, COMMON, CAMERA = "#4477aa", "#cc3311", "#ddaa33", "#777777", "#228833", "#333333"
LINE_STYLES: tuple[Literal["solid", "dashed", "dotted", "dashdot"], ...] = ("solid", "dashed", "dotted", "dashdot")
DEPTHS_PER_ROW = 2
LEGEND_COLUMNS = 3
SAME_COLUMN = 0.1
"""Distance along x, in steps, up to which views are drawn in one column in the side view."""
SIDE_IN, HEAD_IN, SENSOR_IN, ROW_IN = 8.0, 1.0, 5.35, 3.9
MARGIN_IN = {"left": 0.75, "right": 0.2, "bottom": 0.95, "top": 0.35}
CIRCLE_COLOURS = ("#cc3311", "#000000", "#0077bb")
DEPTH_LINE = "#bbbbbb"
CIRCLE_STEPS = 60
BEYOND_DEPTHS = 1.6
"""Factor by which circles are drawn beyond the working depths, as far as the mirrors allow."""
WIDE_DEPTHS = 10.0
"""Ratio of the farthest to the nearest working depth above which the depth axis is logarithmic."""


def before_after(parabola: Layout | None, optimised: Layout, path: Path) -> None:
    """Write a PNG of two layouts side by side: sensor, mirrors from the side and from behind, overlap at each depth.

    Panels of one kind share their scale.

    Parameters
    ----------
    parabola
        The start of the optimisation, in the left column; without it, the optimised layout fills the figure.
    optimised
        The result, in the right column, at whose working depths both are drawn.
    path
        The file, which is written atomically.
    """
    sides = {"Faceted parabola": parabola} if parabola else {}
    sides["Optimised" if parabola else "Optimised (no parabola fits)"] = optimised
    depths_mm = sorted(optimised.designed_spec.depths_mm)
    overlap_rows = [depths_mm[k : k + DEPTHS_PER_ROW] for k in range(0, len(depths_mm), DEPTHS_PER_ROW)]
    height_in = HEAD_IN + SENSOR_IN + ROW_IN * (1 + len(overlap_rows))
    figure = Figure(figsize=(len(sides) * SIDE_IN, height_in))
    axes_by_layout: list[list[Axes]] = []
    for number, (name, layout) in enumerate(sides.items()):
        left_in = number * SIDE_IN
        centre, top_in = (left_in + SIDE_IN / 2.0) / figure.get_figwidth(), height_in - HEAD_IN
        figure.text(centre, 1.0 - 0.35 / height_in, name, ha="center", va="center", fontsize=17, fontweight="bold")
        summary = _figures(layout, depths_mm)
        figure.text(centre, 1.0 - 0.75 / height_in, summary, ha="center", va="center", fontsize=13)
        _sensor(_row(figure, left_in, top_in, SENSOR_IN, (1.0,))[0], layout, depths_mm)
        from_side, from_behind = _row(figure, left_in, top_in - SENSOR_IN, ROW_IN, (1.15, 1.0))
        _side(from_side, layout)
        _behind(from_behind, layout)
        axes_by_layout.append([from_side, from_behind])
        for number_below, row in enumerate(overlap_rows, start=1):
            panels = _row(figure, left_in, top_in - SENSOR_IN - ROW_IN * number_below, ROW_IN, (1.0,) * len(row))
            for axes, depth_mm in zip(panels, row, strict=True):
                _overlap(axes, layout, depth_mm)
            axes_by_layout[-1].extend(panels)
    for column in zip(*axes_by_layout, strict=True):
        _share_limits(column)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=110)


def _row(figure: Figure, left_in: float, top_in: float, height_in: float, widths: Sequence[float]) -> list[Axes]:
    """Add a row of axes to a column of the figure."""
    panels = []
    for width in widths:
        cell_in = SIDE_IN * width / sum(widths)
        panels.append(axes_at(figure, left_in, top_in - height_in, cell_in, height_in, MARGIN_IN))
        left_in += cell_in
    return panels


def _figures(layout: Layout, depths_mm: Sequence[float]) -> str:
    efficiencies = [pixel_efficiency(layout, depth_mm, layout.camera.pupil) for depth_mm in depths_mm]
    if len(efficiencies) > DEPTHS_PER_ROW:
        efficiency = f"{min(efficiencies):.0%} to {max(efficiencies):.0%} at {depths_mm[0]:g} to {depths_mm[-1]:g} mm"
    else:
        efficiency = ", ".join(
            f"{value:.0%} at {depth:g} mm" for value, depth in zip(efficiencies, depths_mm, strict=True)
        )
    return f"grid error {grid_error(layout):.3f} of a spacing, usable pixels {efficiency}"


def _share_limits(column: Sequence[Axes]) -> None:
    """Set the limits of all panels of one kind to their union; y points down, as in views."""
    for get, put in ((Axes.get_xlim, Axes.set_xlim), (Axes.get_ylim, Axes.set_ylim)):
        limits = np.array([get(axes) for axes in column])
        for axes in column:
            put(axes, limits[:, 0].min(), limits[:, 1].max())
    for axes in column:
        axes.invert_yaxis()


def _outline(axes: Axes, points: FloatArray, **style: Any) -> None:
    axes.add_patch(PolygonPatch(points, closed=True, **style))


def _vertices(region: Polygon) -> FloatArray:
    return np.array(region.exterior.coords)[:-1]


def _fill(colour: str, opacity: float) -> tuple[float, float, float, float]:
    red, green, blue = (int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    return red, green, blue, opacity


def _finish(axes: Axes, title: str, x: str, y: str, handles: Sequence[Artist]) -> None:
    axes.set_aspect("equal", adjustable="box")
    axes.set_title(title, fontsize=11)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.tick_params(labelsize=9)
    axes.locator_params(axis="x", nbins=6)
    # The legend's distance is counted in font sizes, so that it clears the axis label under panels of any height.
    position: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "borderaxespad": 4.0}
    axes.legend(handles=handles, ncols=min(len(handles), LEGEND_COLUMNS), frameon=False, fontsize=9, **position)


def _sensor(axes: Axes, layout: Layout, depths_mm: Sequence[float]) -> None:
    """Draw the sub-images on the sensor and, in them, the region that all views see at each depth."""
    camera = layout.camera
    for k in range(len(layout.mirrors)):
        _outline(axes, layout.outline_px(k), facecolor=_fill(MIRROR, 0.18), edgecolor=MIRROR, linewidth=1.3)
    for depth_mm, line in zip(depths_mm, cycle(LINE_STYLES)):
        region, _ = common_region(layout, depth_mm)
        for k in range(len(layout.mirrors) if not region.is_empty else 0):
            outline = region_outline_px(layout, region, depth_mm, k)
            _outline(axes, outline, facecolor=_fill(COMMON, 0.25), edgecolor=COMMON, linewidth=1.3, linestyle=line)
    for k in range(len(layout.mirrors)):
        centre = layout.outline_px(k).mean(axis=0)
        name = axes.annotate(layout.mirror_names[k], centre, ha="center", va="center", fontsize=11, color=CAMERA)
        name.set_path_effects([withStroke(linewidth=3.0, foreground="white")])
    axes.set(xlim=(-0.5, camera.width_px - 0.5), ylim=(camera.height_px - 0.5, -0.5))
    handles = [Patch(facecolor=_fill(MIRROR, 0.18), edgecolor=MIRROR, label="sub-image")]
    for depth_mm, line in zip(depths_mm, cycle(LINE_STYLES)):
        label = f"seen by all at {depth_mm:g} mm"
        handles.append(Patch(facecolor=_fill(COMMON, 0.25), edgecolor=COMMON, linestyle=line, label=label))
    _finish(axes, "Sub-images on the sensor", "x px", "y px", handles)


def _virtual_cameras(axes: Axes, layout: Layout, first: int, second: int) -> None:
    """Draw virtual centres, the fitted ideal grid or pattern and the deviations from it, along two axes of the view."""
    arrangement = layout.arrangement
    marker_scale = min(1.0, 4.0 / (arrangement.extent.max() + 1.0))
    grid = fitted_grid(layout)[0][..., [first, second]]
    for i, j in arrangement.neighbours:
        axes.plot(*grid.reshape(-1, 2)[[i, j]].T, color=GRID, linewidth=0.9, zorder=2)
    centres = layout.virtual_centres_in_view_mm.reshape(-1, 3)[:, [first, second]]
    for centre, node in zip(centres, grid.reshape(-1, 2), strict=True):
        axes.plot(*np.array([centre, node]).T, color=VIEW, linewidth=1.6, zorder=3)
    axes.plot(*grid.reshape(-1, 2).T, "s", color="white", markeredgecolor=GRID, markersize=6 * marker_scale, zorder=4)
    axes.plot(*centres.T, "o", color=VIEW, markersize=5 * marker_scale, zorder=5)


def _side(axes: Axes, layout: Layout) -> None:
    """Draw mirrors, camera, chief rays and virtual cameras from the side; the scene is to the right."""
    rig_from_view, steps_x = layout.view_from_rig.T, layout.arrangement.steps[:, 0]
    depths = np.concatenate([mirror.outline_in_rig_mm @ rig_from_view for mirror in layout.mirrors])[:, 2]
    end_mm = depths.max() + 0.5 * np.ptp(depths)
    for k, mirror in enumerate(layout.mirrors):
        outline = mirror.outline_in_rig_mm @ rig_from_view
        if abs(steps_x[k] - steps_x[layout.central_index]) < SAME_COLUMN:
            apparent = mirror.apparent
            point = layout.view_from_rig @ apparent.intersect(apparent.outline_normalized.mean(axis=0))
            direction = point - layout.view_from_rig @ apparent.virtual_centre_in_rig_mm
            end = point + direction * ((end_mm - point[2]) / direction[2])
            axes.plot(*np.array([np.zeros(3), point, end])[:, [2, 1]].T, color=RAY, linewidth=1.2, zorder=1)
        _outline(axes, outline[:, [2, 1]], facecolor=_fill(MIRROR, 0.25), edgecolor=MIRROR, linewidth=1.2)
    _virtual_cameras(axes, layout, 2, 1)
    axes.plot(0.0, 0.0, "^", color=CAMERA, markersize=10)
    axes.annotate(
        "camera", (0.0, 0.0), (-9, 0), textcoords="offset points", ha="right", va="center", fontsize=9, color=CAMERA
    )
    axes.margins(0.06)
    handles = [Line2D([], [], color=MIRROR, label="mirror"), Line2D([], [], color=RAY, label="chief ray")]
    _finish(axes, "From the side", "z mm (towards the scene)", "y mm (down)", handles)


def _behind(axes: Axes, layout: Layout) -> None:
    """Draw mirrors and virtual cameras from behind, along the view axis; x points right."""
    for mirror in layout.mirrors:
        outline = (mirror.outline_in_rig_mm @ layout.view_from_rig.T)[:, :2]
        _outline(axes, outline, facecolor=_fill(MIRROR, 0.12), edgecolor=MIRROR, linewidth=0.8)
    _virtual_cameras(axes, layout, 0, 1)
    axes.margins(0.06)
    ideal = "ideal grid" if layout.pattern is None else f"ideal {layout.pattern.name}"
    handles = [
        Line2D([], [], color=VIEW, marker="o", linestyle="none", label="virtual camera"),
        Line2D([], [], color=GRID, marker="s", markerfacecolor="white", label=ideal),
    ]
    _finish(axes, "Virtual cameras along the view", "x mm", "y mm (down)", handles)


def _overlap(axes: Axes, layout: Layout, depth_mm: float) -> None:
    """Draw the fields of all views on the plane at a depth, and the field that they share."""
    region, footprints = common_region(layout, depth_mm)
    opacity, linewidth = min(0.07, 0.7 / len(footprints)), max(0.9 - len(footprints) / 80.0, 0.3)
    for footprint in footprints:
        if not footprint.is_empty:
            _outline(
                axes, _vertices(footprint), facecolor=_fill(MIRROR, opacity), edgecolor=MIRROR, linewidth=linewidth
            )
    if not region.is_empty:
        _outline(axes, _vertices(region), facecolor=_fill(COMMON, 0.45), edgecolor=COMMON, linewidth=1.6)
    axes.margins(0.04)
    axes.autoscale_view()
    efficiency, union = pixel_efficiency(layout, depth_mm, layout.camera.pupil), union_all(footprints).area
    overlap = region.area / union if union else 0.0
    title = f"{depth_mm:g} mm: {efficiency:.0%} of the pixels usable, IoU {overlap:.2f}"
    handles = [
        Line2D([], [], color=MIRROR, label="one view"),
        Patch(facecolor=_fill(COMMON, 0.45), edgecolor=COMMON, label="all views"),
    ]
    _finish(axes, title, "x mm", "y mm (down)", handles)


def focus_figure(layout: Layout, depths_mm: Sequence[float], path: Path) -> None:
    """Write a PNG of the largest circle of confusion over depth, with the focus of the camera and with the best focus.

    Nearest and farthest are the mirrors with the shortest and the longest path of light to the working depths.

    Parameters
    ----------
    layout
        A layout whose camera has an aperture and whose views have a common region at each depth.
    depths_mm
        The working depths, at which curves have a mark.
    path
        The file, which is written atomically.
    """
    camera, views = layout.camera, fields_of_view(layout)
    working = np.array([inverse_depths_per_mm(views, depth_mm) for depth_mm in depths_mm])
    best_mm = best_focus_mm(working)
    mirrors = _mirrors_to_draw(layout, working)
    first_mm = max(min(depths_mm) / BEYOND_DEPTHS, views.mirror_depth_mm * 1.02)
    plotted_mm = np.geomspace(first_mm, max(depths_mm) * BEYOND_DEPTHS, CIRCLE_STEPS)
    inverse_depths = np.array([inverse_depths_per_mm(views, depth_mm) for depth_mm in plotted_mm])
    figure = Figure(figsize=(7.5, 4.6), layout="constrained")
    axes = figure.subplots()
    for focus_mm, line in ((camera.focus_mm, "solid"), (best_mm, "dashed")):
        circles, marks = (circles_px(camera, values, focus_mm) for values in (inverse_depths, working))
        for colour, k in zip(CIRCLE_COLOURS, mirrors, strict=False):
            axes.plot(plotted_mm, circles[:, k], color=colour, linestyle=line, linewidth=1.6)
            axes.plot(depths_mm, marks[:, k], "o", color=colour, markersize=4, zorder=3)
    axes.set_title(f"{camera.name}: aperture {camera.aperture_mm:g} mm", fontsize=11)
    _finish_depths(axes, depths_mm)
    handles = [
        Line2D([], [], color=colour, label=f"{name} mirror, {layout.mirror_names[k]}")
        for colour, (k, name) in zip(CIRCLE_COLOURS, mirrors.items(), strict=False)
    ]
    handles += [
        Line2D([], [], color=GRID, label=f"in focus at {camera.focus_mm:.0f} mm"),
        Line2D([], [], color=GRID, linestyle="dashed", label=f"best focus, {best_mm:.0f} mm"),
        Line2D([], [], color=GRID, linestyle="dotted", label=f"limit, {CIRCLE_LIMIT_PX:g} px"),
    ]
    axes.legend(handles=handles, fontsize=9, ncols=2, frameon=False)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=110)


def _mirrors_to_draw(layout: Layout, working: FloatArray) -> dict[int, str]:
    """Names of the mirrors to draw, by index: the nearest, the central and the farthest, by 1/z (depths, m, 2)."""
    indices = {
        "nearest": int(working[..., 1].max(axis=0).argmax()),
        "central": layout.central_index,
        "farthest": int(working[..., 0].min(axis=0).argmin()),
    }
    return {k: " and ".join(name for name, index in indices.items() if index == k) for k in indices.values()}


def _finish_depths(axes: Axes, depths_mm: Sequence[float]) -> None:
    for depth_mm in depths_mm:
        axes.axvline(depth_mm, color=DEPTH_LINE, linewidth=0.8, zorder=0)
    axes.axhline(CIRCLE_LIMIT_PX, color=GRID, linestyle="dotted", linewidth=1.4)
    if max(depths_mm) > WIDE_DEPTHS * min(depths_mm):
        axes.set_xscale("log")
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("depth, mm")
    axes.set_ylabel("largest circle of confusion, px")
    axes.grid(alpha=0.2, linewidth=0.5)
