"""Axes at stated places of a figure: matplotlib's layout engines vary from run to run."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure


def axes_at(
    figure: Figure, left_in: float, bottom_in: float, width_in: float, height_in: float, margin_in: Mapping[str, float]
) -> Axes:
    """Add axes to a cell of a figure, within margins at its `left`, `right`, `bottom` and `top`; in inches."""
    figure_width_in, figure_height_in = figure.get_size_inches()
    size = width_in - margin_in["left"] - margin_in["right"], height_in - margin_in["top"] - margin_in["bottom"]
    left, bottom = (left_in + margin_in["left"]) / figure_width_in, (bottom_in + margin_in["bottom"]) / figure_height_in
    return figure.add_axes((left, bottom, size[0] / figure_width_in, size[1] / figure_height_in))
