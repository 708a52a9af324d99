"""Drawing of a device's mirrors from behind, with the turns of each screw."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mirrorcam.core.disk.files import atomic
from mirrorcam.core.values import FloatArray

LETTERS = "abc"


def turns_figure(
    names: Sequence[str],
    turns: Sequence[FloatArray],
    outlines_mm: Sequence[FloatArray],
    screws_mm: FloatArray,
    path: Path,
) -> None:
    """Draw mirrors from behind, with the turns of their screws.

    Parameters
    ----------
    names : sequence of str
        Names of the mirrors.
    turns : sequence of (3,)
        Clockwise turns of each mirror's screws.
    outlines_mm : sequence of (n, 2)
        Outlines of the mirrors, right and up as seen from behind, mm.
    screws_mm : (m, 3, 2)
        Screws of each mirror, likewise.
    path : Path
        PNG file to write.
    """
    corners = np.vstack(outlines_mm)
    width, height = np.ptp(corners, axis=0)
    figure = Figure(figsize=(10.0, 10.0 * height / width + 1.2), layout="constrained")
    axes = figure.add_subplot()
    for name, own, outline, screws in zip(names, turns, outlines_mm, screws_mm, strict=True):
        axes.fill(*outline.T, facecolor="#eef2f6", edgecolor="#7a8896", linewidth=1.0)
        x, y = outline.mean(axis=0)
        axes.text(x, y, name, ha="center", va="center", color="#9aa6b2", fontsize=13)
        for letter, turn, at in zip(LETTERS, own, screws, strict=True):
            axes.plot(*at, marker="o", color="#c8412c" if abs(turn) >= 0.005 else "#5f6b76", markersize=5)
            text = f"{letter} {turn:+.2f}"
            axes.annotate(text, at, (0.0, 5.0), textcoords="offset points", ha="center", fontsize=9)
    axes.set_aspect("equal")
    axes.set_title("From behind the device: turns of the screws, + clockwise (in), - anticlockwise (out)", fontsize=11)
    axes.set_xlabel("mm")
    with atomic(path) as temporary:
        figure.savefig(temporary, format="png", dpi=130, metadata={"Software": None})
