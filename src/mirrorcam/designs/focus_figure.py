"""Circles of confusion over depth, through the nearest, the central and the farthest mirror of a layout."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mirrorcam.core.disk.files import atomic
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.focus import CIRCLE_LIMIT_PX, best_focus_mm, circles_px, nearness_per_mm
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import fields_of_view

COLOURS = ("#cc3311", "#000000", "#0077bb")
LIMIT, DEPTH = "#777777", "#bbbbbb"
STEPS = 60
BEYOND = 1.6
"""Ratio by which the depths drawn reach beyond the working depths, as far as the mirrors allow."""

WIDE = 10.0
"""Ratio of the farthest to the nearest working depth from which on depths are on a logarithmic axis."""


def focus_figure(layout: Layout, depths_mm: Sequence[float], path: Path) -> None:
    """Write a PNG of the largest circle of confusion over depth, with the focus of the camera and with the best focus.

    Nearest and farthest are the mirrors with the shortest and the longest path of light to the working depths.

    Parameters
    ----------
    layout
        Its camera has an aperture, and its views share a part of each depth.
    depths_mm
        The working depths, at which curves have a mark.
    path
        The file, which is written atomically.
    """
    camera, views = layout.camera, fields_of_view(layout)
    working = np.array([nearness_per_mm(views, depth_mm) for depth_mm in depths_mm])
    best_mm = best_focus_mm(working)
    mirrors = _chosen(layout, working)
    first_mm = max(min(depths_mm) / BEYOND, views.reach_mm * 1.02)
    drawn_mm = np.geomspace(first_mm, max(depths_mm) * BEYOND, STEPS)
    nearness = np.array([nearness_per_mm(views, depth_mm) for depth_mm in drawn_mm])
    figure = Figure(figsize=(7.5, 4.6), layout="constrained")
    axes = figure.subplots()
    for focus_mm, line in ((camera.focus_mm, "solid"), (best_mm, "dashed")):
        circles, marks = (circles_px(camera, values, focus_mm) for values in (nearness, working))
        for colour, k in zip(COLOURS, mirrors, strict=False):
            axes.plot(drawn_mm, circles[:, k], color=colour, linestyle=line, linewidth=1.6)
            axes.plot(depths_mm, marks[:, k], "o", color=colour, markersize=4, zorder=3)
    axes.set_title(f"{camera.name}: aperture {camera.aperture_mm:g} mm", fontsize=11)
    _finish(axes, depths_mm)
    handles = [
        Line2D([], [], color=colour, label=f"{name} mirror, {layout.mirror_names[k]}")
        for colour, (k, name) in zip(COLOURS, mirrors.items(), strict=False)
    ]
    handles += [
        Line2D([], [], color=LIMIT, label=f"in focus at {camera.focus_mm:.0f} mm"),
        Line2D([], [], color=LIMIT, linestyle="dashed", label=f"best focus, {best_mm:.0f} mm"),
        Line2D([], [], color=LIMIT, linestyle="dotted", label=f"limit, {CIRCLE_LIMIT_PX:g} px"),
    ]
    axes.legend(handles=handles, fontsize=9, ncols=2, frameon=False)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=110)


def _chosen(layout: Layout, working: FloatArray) -> dict[int, str]:
    """What the mirrors drawn are among all, by index, for 1/z (depths, mirrors, 2) at the working depths."""
    chosen = {
        "nearest": int(working[..., 1].max(axis=0).argmax()),
        "central": layout.central_index,
        "farthest": int(working[..., 0].min(axis=0).argmin()),
    }
    return {k: " and ".join(name for name, index in chosen.items() if index == k) for k in chosen.values()}


def _finish(axes: Axes, depths_mm: Sequence[float]) -> None:
    for depth_mm in depths_mm:
        axes.axvline(depth_mm, color=DEPTH, linewidth=0.8, zorder=0)
    axes.axhline(CIRCLE_LIMIT_PX, color=LIMIT, linestyle="dotted", linewidth=1.4)
    if max(depths_mm) > WIDE * min(depths_mm):
        axes.set_xscale("log")
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("depth, mm")
    axes.set_ylabel("largest circle of confusion, px")
    axes.grid(alpha=0.2, linewidth=0.5)
