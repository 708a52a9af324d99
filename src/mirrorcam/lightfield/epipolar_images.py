"""Epipolar-plane images as files: arrays, and a figure with the slopes of depths."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mirrorcam.core.disk.files import atomic, write_npz
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.depth.parallax import reference_index
from mirrorcam.optics.light_field.light_field import Axis, LightField
from mirrorcam.optics.light_field.render.epipolar_images import Epi, epi
from mirrorcam.optics.light_field.render.refocusing import RenderedPicture, to_bytes

WIDTH_IN, EPI_IN, TITLE_IN = 10.0, 2.2, 0.9
LINES = 7
# Nearest and farthest depth with a drawn slope, as multiples of the reference depth.
NEAR, FAR = 0.75, 2.0


def write_epi(
    folder: Path,
    name: str,
    light_field: LightField,
    *,
    axis: Axis = "s",
    line: int | None = None,
    depth_mm: float | None = None,
) -> None:
    """Extract an epipolar-plane image from a light field and write NAME_epi.npz and NAME_epi.png into a folder.

    Parameters
    ----------
    axis
        Views along one row (s) or one column (t).
    line
        Pixel row of the central view for s, pixel column for t; None for the middle.
    depth_mm
        Depth from the pupil, mm, at which points form vertical lines; None for the reference depth.

    Raises
    ------
    InputError
        For a line outside the views, or a depth that is not in front of them.
    """
    lines = light_field.height_px if axis == "s" else light_field.width_px
    epi_image = epi(light_field, axis, lines // 2 if line is None else line, depth_mm=depth_mm)
    write_npz(
        folder / f"{name}_epi.npz",
        {
            "samples": epi_image.samples,
            "weights": epi_image.weights,
            "positions_mm": epi_image.positions_mm,
            "axis": np.array(epi_image.axis),
            "line": np.array(epi_image.line),
            "plane_depth_mm": np.array(epi_image.plane_depth_mm),
            "layout_identity": np.array(light_field.layout_identity),
        },
    )
    reference = light_field.reference_depth_mm
    draw_epi(folder / f"{name}_epi.png", light_field, epi_image, (NEAR * reference, FAR * reference))


def draw_epi(path: Path, light_field: LightField, epi_image: Epi, depths_mm: tuple[float, float]) -> None:
    """Write a PNG: the reference view with the line, the EPI below it, and the slopes of some depths.

    `depths_mm` are the nearest and the farthest depth with a slope.
    """
    view = light_field.samples[reference_index(light_field)]
    epi_bytes = to_bytes(RenderedPicture(epi_image.samples, epi_image.weights))
    if epi_image.axis == "t":
        view = view.swapaxes(0, 1)
    height_in = WIDTH_IN * view.shape[0] / view.shape[1]
    figure = Figure(figsize=(WIDTH_IN, height_in + EPI_IN + TITLE_IN), dpi=100, layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[height_in, EPI_IN])
    above.imshow(np.broadcast_to(view, (*view.shape[:2], 3)), aspect="auto", interpolation="nearest")
    above.axhline(epi_image.line, color="white", linewidth=1.0)
    line_name = "row" if epi_image.axis == "s" else "column"
    above.set_title(
        f"{line_name} {epi_image.line} of the reference view" + ("" if epi_image.axis == "s" else " (rotated)")
    )
    above.set_axis_off()
    _bands(below, epi_bytes, epi_image.positions_mm)
    _fan(below, light_field, epi_image, depths_mm)
    below.set_xlabel("u, px" if epi_image.axis == "s" else "v, px")
    below.set_ylabel("view position, mm")
    below.set_title(
        f"vertical at {epi_image.plane_depth_mm:.0f} mm; lines: slopes of points at the stated depths in mm"
    )
    with atomic(path) as temporary:
        figure.savefig(temporary, metadata={"Software": None})


def _bands(axes: Axes, epi_bytes: np.ndarray, positions_mm: FloatArray) -> None:
    """Draw the line of each view as a band around its position, up to halfway to the next view."""
    boundaries = (positions_mm[1:] + positions_mm[:-1]) / 2.0
    first, last = 2.0 * positions_mm[0] - boundaries[0], 2.0 * positions_mm[-1] - boundaries[-1]
    edges = np.concatenate([[first], boundaries, [last]])
    for line, low, high in zip(epi_bytes, edges[:-1], edges[1:], strict=True):
        axes.imshow(line[None], extent=(-0.5, len(line) - 0.5, high, low), aspect="auto", interpolation="nearest")
    axes.set_ylim(edges[-1], edges[0])
    axes.set_xlim(-0.5, epi_bytes.shape[1] - 0.5)
    axes.set_yticks(positions_mm, [f"{position:.1f}" for position in positions_mm])


def _fan(axes: Axes, light_field: LightField, epi_image: Epi, depths_mm: tuple[float, float]) -> None:
    near, far = depths_mm
    ends_mm = epi_image.positions_mm[[0, -1]]
    for part, inverse_depth in enumerate(np.linspace(1.0 / near, 1.0 / far, LINES)):
        depth = float(np.inf if inverse_depth == 0 else 1.0 / inverse_depth)
        start = epi_image.samples.shape[1] * (part + 0.5) / LINES
        u = start + epi_image.slope_px_per_mm(light_field, depth) * ends_mm
        axes.plot(u, ends_mm, color="white", linewidth=1.2)
        text = "∞" if np.isinf(depth) else f"{depth:.0f}"
        box = {"facecolor": "black", "alpha": 0.6, "pad": 1.0, "edgecolor": "none"}
        axes.text(start + 4.0, 0.0, text, color="white", fontsize=9, va="center", bbox=box, clip_on=True)
