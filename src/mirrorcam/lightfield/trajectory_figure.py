"""Figure of a trajectory: the path from above and from the first view, and the standard deviation of its positions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mirrorcam.core.disk.files import atomic
from mirrorcam.optics.light_field.motion import TrackedPose

SIZE_IN = (15.0, 4.6)
LENGTH = 0.06
"""Of the lines along the views, in parts of the largest extent of the path."""
LEAST_MM = 1.0
COLOUR, KEY = "tab:blue", "tab:red"


def draw_trajectory(path: Path, times_s: Sequence[float], poses: Sequence[TrackedPose]) -> None:
    """Write the figure as PNG, atomically.

    Positions are those of the reference view in its frame at the first light field, mm; key frames are red. Where it
    is lost, the path is broken.
    """
    world_from_view = np.array([pose.world_from_view for pose in poses])
    places, ahead = world_from_view[:, :3, 3], world_from_view[:, :3, 2]
    keys = np.array([pose.is_key for pose in poses])
    known = np.isfinite(places).all(axis=1)
    extent_mm = max(float(np.ptp(places[known], axis=0).max()), LEAST_MM) if known.any() else LEAST_MM
    figure = Figure(figsize=SIZE_IN, dpi=100, layout="constrained")
    axes = figure.subplots(1, 3)
    names = ("right", "down", "ahead")
    for each, (across, up), title in zip(
        axes, ((0, 2), (0, 1)), ("from above", "as the first view looks"), strict=False
    ):
        each.plot(places[:, across], places[:, up], color=COLOUR, linewidth=1.2)
        ends = places + LENGTH * extent_mm * ahead
        for start, end in zip(places[known], ends[known], strict=True):
            each.plot([start[across], end[across]], [start[up], end[up]], color="0.7", linewidth=0.8, zorder=1)
        each.scatter(places[~keys, across], places[~keys, up], s=9, color=COLOUR, zorder=2)
        each.scatter(places[keys, across], places[keys, up], s=22, color=KEY, zorder=3)
        each.set_xlabel(f"{names[across]}, mm")
        each.set_ylabel(f"{names[up]}, mm")
        each.set_title(f"the camera's path {title}")
        each.set_aspect("equal", adjustable="datalim")
        each.grid(alpha=0.3)
    axes[1].invert_yaxis()
    sigmas = np.sqrt([np.trace(pose.covariance[:3, :3]) for pose in poses])
    axes[2].plot(times_s, sigmas, color=COLOUR, marker=".")
    axes[2].set_ylim(bottom=0.0)
    axes[2].set_xlabel("time, s")
    axes[2].set_ylabel("\N{GREEK SMALL LETTER SIGMA} of the position, mm")
    axes[2].set_title("standard deviation of the position")
    axes[2].grid(alpha=0.3)
    with atomic(path) as temporary:
        figure.savefig(temporary, metadata={"Software": None})
